"""One exchange with a station: the kit sets the time, keeps the clock of the armed timers, and
compares every answer with the oracle.

Lines are written in bulk and judged when their answers are read (``flush``); the first wrong answer
raises ``Mismatch``.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, Protocol

from automcm_conformance.adapter.process import AdapterError
from automcm_conformance.adapter.protocol import Answer, ProtocolError, read_answer
from automcm_conformance.exchange.answers import Problem, differences
from automcm_conformance.exchange.armed_timers import UNKNOWN, ArmedTimers
from automcm_conformance.exchange.results import UNCONFIRMED, Deciding, Verdict
from automcm_conformance.exchange.wire import LONG_MS, ME, PLAIN, Required, Values, Wire, encode
from automcm_spec.graph.oracle import Oracle, OracleAnswer
from automcm_spec.vocabulary.parameters import derived, durations, forgotten_at, lease_lasts
from automcm_spec.vocabulary.renumbering import Rename
from automcm_spec.vocabulary.station import Entry, Expire, Message, Receive, Restart, Timer
from automcm_traces.checker.track import NO_INDICATION

Json = Any


class LineLink(Protocol):
    """What an exchange needs of a process."""

    def exchange(self, lines: Sequence[bytes]) -> list[bytes]:
        """As ``Adapter.exchange``."""


@dataclass(slots=True)
class GraphEffects:
    """The effects of one step of the specification, for a log: the expired timer, the numbers of
    messages and indications, the timers stopped and armed."""

    expired: Json
    messages: int
    indications: int
    stopped: list[Json]
    armed: list[tuple[Json, int]]


@dataclass(slots=True)
class Step:
    """One line to the station, the steps of the oracle it stands for, and the expected answer.

    ``pairs``: (state, input) of each step of the specification.
    """

    now: int
    line: bytes
    expected: Required
    place: int = 0
    """The index of the tour's input that the line belongs to."""
    pairs: list[tuple[int, int]] = field(default_factory=list)
    times: list[int] = field(default_factory=list)
    """The time in ms of each of ``pairs``: an expiry happens at its deadline."""
    before: int = 0
    after: int = 0
    next_timer: Timer | None = None
    """The timer whose deadline is expected in the answer."""
    answer: bytes = b""
    fault: str = ""
    """What is wrong with a malformed message, in words."""
    effects: list[GraphEffects] = field(default_factory=list)
    """The effects of each of ``pairs``, if the exchange is logged."""

    @property
    def command(self) -> Json:
        """The content of the line."""
        return json.loads(self.line)


class Wrong(Exception):
    """The station's answer to the last of ``steps`` is wrong, or missing. The kit's word about it:

    ``deciding`` decides it, ``more`` follows the text, and ``unconfirmed``, one of UNCONFIRMED,
    says why a fresh process does not fail; it is empty if it does.
    """

    def __init__(self, steps: list[Step], text: str, kind: str) -> None:
        super().__init__(text)
        self.steps, self.kind = steps, kind
        self.deciding, self.more, self.unconfirmed = Deciding(), "", ""

    @property
    def what(self) -> str:
        """What is wrong, in one line."""
        why = f"{self.unconfirmed}: {UNCONFIRMED[self.unconfirmed]}: " if self.unconfirmed else ""
        return f"{why}{self}{self.more}"

    @property
    def difference(self) -> str:
        """What differs, without values."""
        return self.unconfirmed or self.kind

    @property
    def verdict(self) -> Verdict:
        """ERROR if the adapter broke, or did not answer twice in the same way."""
        return "FAIL" if isinstance(self, Mismatch) and not self.unconfirmed else "ERROR"


class Mismatch(Wrong):
    """An answer that the specification does not allow."""

    def __init__(self, steps: list[Step], problems: list[Problem]) -> None:
        super().__init__(steps, "; ".join(each.text for each in problems), problems[0].kind)
        self.problems = problems
        self.synchronized = True
        """The reset that ended the exchange got its own answer."""
        self.session: Rename | None = None
        """The real session of each session of the graph."""

    @property
    def parts(self) -> set[str]:
        """The parts of the answer that are wrong."""
        return {problem.part for problem in self.problems}

    @cached_property
    def answer(self) -> Answer:
        """The wrong answer."""
        return read_answer(self.steps[-1].answer)


class Broken(Wrong):
    """The station did not answer, or its answer is invalid. ``kind`` is that of the AdapterError,
    and empty for an invalid line; ``sent``: the steps and those whose lines were written with
    them."""

    def __init__(self, steps: list[Step], error: Exception, sent: Sequence[Step] = ()) -> None:
        super().__init__(steps, str(error), getattr(error, "kind", ""))
        self.error = error
        self.sent = list(sent) or steps
        self.stderr: list[str] = getattr(error, "stderr", [])
        """The last lines of standard error, if the process has ended."""


class Unpredicted(Exception):
    """The number that the station chose for its session is not the next one."""


class Infeasible(Exception):
    """This timer cannot expire here: another one is due before it."""


class Exchange:
    """An exchange with one station, from ``reset`` on; ``parameters`` are those of ``reset``."""

    def __init__(
        self,
        oracle: Oracle,
        link: LineLink,
        parameters: Mapping[str, int],
        *,
        scenario: str = "lane_change",
        seed: int = 1,
        rich: bool = False,
        values: Values = PLAIN,
        predict: bool = False,
        logged: bool = True,
        judges_marks: bool = True,
    ) -> None:
        self.oracle = oracle
        self.parameters = parameters
        self.state = 0
        self.now = values.start_ms
        self.wire = Wire(scenario=scenario, rich=rich, values=values)
        self.done: list[Step] = []
        """Steps that were answered as expected."""
        self.place = 0
        self.predict = predict
        """Whether the number of a new session is assumed to be the next one. If it is not,
        Unpredicted is raised and nothing is judged."""
        self.judges_marks = judges_marks
        """Whether the marks of CAMs are judged."""
        self.logged = logged
        """Whether steps keep their effects, for a log."""
        self.begun = False
        """Whether lines have been written."""
        self.overrides: dict[str, int] = {}
        self._link = link
        self.clock: ArmedTimers[Timer] = ArmedTimers()
        self._joined_at: dict[int, int] = {}
        self.unwritten_steps: list[Step] = []
        """The steps whose lines have not been written yet."""
        self._refusals: dict[object, Required] = {}
        self._right: dict[int, bytes] = {}
        """The last correct answer, by the id of its ``Required``, which ``done`` keeps alive."""
        self._lease_ms = LONG_MS
        self._known = {**parameters, **derived(parameters)}
        self._lasts = durations(self._known)
        self._reset: dict[str, Json] = {"cmd": "reset", "station": values.ids[ME], "seed": seed}
        self._reset["parameters"] = dict(parameters)
        self._queue(self._reset)

    # -- what the kit does

    def durations(self, durations: Mapping[str, int]) -> None:
        """Set the durations of these timers from now on (feature ``durations``)."""
        self.overrides.update(durations)
        self._queue({"cmd": "durations", "durations": dict(durations)})

    def give(
        self,
        i: int,
        *,
        at: int | None = None,
        lease_ms: int | None = None,
        fields: Mapping[str, Json] | None = None,
    ) -> None:
        """Give an input that is not an expiry. Timers due by then fire first, except before a
        restart.

        ``fields`` replace fields of the message or command.
        """
        if at is not None:
            self.now = at
        said = self.wire.command(self.oracle.inputs[i], self.now, lease_ms)
        if fields and self.wire.given is not None:
            self.wire.given = {**self.wire.given, **fields}
            said["message" if said["cmd"] == "receive" else "command"] = self.wire.given
        self._take(said, i)

    def advance(self, to: int) -> list[int]:
        """Advance the time; due timers fire. Returns the inputs of their expiries."""
        self.now = to
        return self._take({"cmd": "advance"}, None)

    def wait(self, until: int) -> None:
        """Advance the time to ``until``, deadline by deadline."""
        while (due := self.next_due) is not None and due <= until:
            self.advance(due)
        if self.now < until:
            self.advance(until)

    def end_with_reset(self) -> None:
        """End the exchange with one more line, which shows what the station does after its last
        answer."""
        self.state, self.clock = 0, ArmedTimers()
        self._queue(self._reset)

    def malformed(self, message: Json, fault: str) -> None:
        """Send a malformed message: the station discards it in every phase (END-5). ``fault``: in
        words."""
        expected = Required("END-5", indications=[{"name": "discarded"}])
        self._queue({"cmd": "receive", "message": message}, expected, fault)

    def expire(self, i: int, *, after_others: bool = False) -> None:
        """Advance to the deadline of this timer. Resends may fire on the way. Raises Infeasible if
        another timer would, unless ``after_others``, or if a deadline is not known."""
        wanted = self.expires(i)
        fired: list[int] = []
        while i not in fired:
            due = self.next_due
            if due is None or wanted not in self.clock.running:
                raise Infeasible
            fired = self.advance(due)
            others = (self.expires(j)[0] for j in fired if j != i)
            if not after_others and any(name != "resend" for name in others):
                raise Infeasible

    @property
    def next_due(self) -> int | None:
        """The next deadline in ms; None if no timer is armed, or not all deadlines are known."""
        first = self.clock.first
        return first.deadline if first is not None and self.clock.sure else None

    def offers(self, i: int, at: int) -> bool:
        """Whether this input can be given at this time, with at most one expiry before it."""
        due = [each for each in self.clock.running.values() if each.deadline <= at]
        match self.oracle.inputs[i]:
            case Restart():
                return True
            case Receive(message=Message(type="Ack")) if due:
                return False  # what is sent at that moment has no seq yet that it could name
        if len(due) > 1:
            return False
        state = self.state
        for running in due:
            expiry = self.oracle.answer(state, self._expiry(running.timer))
            assert expiry is not None, f"not offered: {running.timer}"
            state = expiry.next
        return self.oracle.answer(state, i) is not None

    @property
    def unwritten_lines(self) -> list[bytes]:
        """The lines that have not been written yet."""
        return [step.line for step in self.unwritten_steps]

    def flush(self) -> None:
        """Write these lines, read the answers and judge them. Raises Mismatch or Broken."""
        self.begun = True
        try:
            answers = self._link.exchange(self.unwritten_lines) if self.unwritten_steps else []
        except AdapterError as error:
            self.answered(error.answers, error)
        self.answered(answers)

    def answered(self, answers: Sequence[bytes], error: AdapterError | None = None) -> None:
        """Judge the answers to the unwritten lines; with ``error`` the last answer is missing.

        Raises Mismatch or Broken.
        """
        steps, self.unwritten_steps = self.unwritten_steps, []
        for step, line in zip(steps, answers, strict=False):
            try:
                self._judge(step, line)
            except ProtocolError as unread:
                raise Broken([*self.done, step], unread) from None
            except Mismatch as wrong:
                wrong.session = self.wire.real
                if len(answers) == len(steps) and steps[-1].command["cmd"] == "reset":
                    wrong.synchronized = False
                    with suppress(ProtocolError):
                        wrong.synchronized = not differences(steps[-1].expected, answers[-1])
                raise
        if error is not None:
            missing = steps[len(answers) :]
            raise Broken([*self.done, *missing[:1]], error, [*self.done, *missing]) from None

    # -- the clock

    def _expiry(self, timer: Timer) -> int:
        return self.oracle.input_index[Expire("expire", timer)]

    def expires(self, i: int) -> Timer:
        """The timer that expires by this input."""
        value = self.oracle.inputs[i]
        assert isinstance(value, Expire), value
        return value.timer

    def _duration(self, timer: Timer) -> int:
        name = timer[0]
        if name == "lease":
            role = self.oracle.states[self.state].role
            return lease_lasts(self.parameters.get("clock_drift", 0), role, self._lease_ms)
        if name in self.overrides:
            return self.overrides[name]
        match timer:
            case (_, int(p)):  # forget
                joined = self._joined_at.get(p, self.now)
                return forgotten_at(self._known, joined, self.now) - self.now
        lasts = self._lasts[name]
        return UNKNOWN if lasts is None else lasts

    def _settle(self, answer: OracleAnswer) -> None:
        """Arm and stop timers as the specification says."""
        value = self.oracle.inputs[answer.input]
        if isinstance(value, Expire):
            self.clock.stop(value.timer)
        for timer in answer.effect.stop:
            self.clock.stop(timer)
        after = self.oracle.states[answer.next]
        if after.role == "receiver" and self.oracle.states[answer.state].role != "receiver":
            self._joined_at[after.session[0]] = self.now
        self.clock.inputs += 1
        for timer in answer.effect.arm:
            self._arm(timer)
        self.state = answer.next

    def _arm(self, timer: Timer) -> None:
        lasts = self._duration(timer)
        ends = UNKNOWN if lasts == UNKNOWN else self.now + lasts
        match timer:
            case (_, Entry() as entry):
                self.clock.arm(timer, ends, entry[:4], entry.type)
            case _:
                self.clock.arm(timer, ends)

    # -- lines and answers

    def _take(self, command: dict[str, Json], then: int | None) -> list[int]:
        """Queue a line: due timers fire, except if power fails (END-8); then input ``then`` is
        given."""
        command["now"] = self.now
        due = self.clock.due(self.now)
        answer = None if then is None else self.oracle.answer(self.state, then)
        if due is None and answer and not answer.changes and not answer.effect.messages:
            self._refuse(command, answer)
            return []
        step = Step(self.now, encode(command), Required(), before=self.state)
        fired, given = [], self.wire.given
        self.wire.given = None
        if due and then is not None and isinstance(self.oracle.inputs[then], Restart):
            due = None  # is lost as well
        turn = None
        while due is not None:
            first = self.clock.running[due]
            if turn != (turn := (first.deadline, first.rank, first.age)):
                step.expected.begins.append(len(step.expected.messages))
            expiry = self.oracle.answer(self.state, self._expiry(due))
            if expiry is None:
                raise Infeasible  # what is to be given up before lasts too long (ADV-8)
            fired.append(expiry.input)
            step.times.append(self.clock.deadline(due) or self.now)
            self._follow(step, expiry)
            due = self.clock.due(self.now)
        self.wire.given = given
        if then is not None:
            step.expected.begins.append(len(step.expected.messages))
            step.times.append(self.now)
            unchanged = answer if not fired else None
            self._follow(step, unchanged or self.oracle.given(self.state, then))
        self._expect(step)
        numbers = [] if self.predict else [m["session"][1] for m in step.expected.messages]
        if len(step.expected.fresh) > 1 or None in numbers:
            self.flush()  # what comes next depends on what the station chose
        return fired

    def _refuse(self, command: dict[str, Json], answer: OracleAnswer) -> None:
        """Queue a line that changes nothing and sends nothing while no timer is due. Such lines
        share one ``Required``, so that an equal answer is not parsed again (``_judge``)."""
        rule, indication, first = answer.effect.rule, answer.effect.indication, self.clock.first
        due = None if first is None else (first.deadline, first.timer[0])
        key = rule, indication, self.state, due
        expected = self._refusals.get(key)
        if expected is None:
            indications = [] if indication == NO_INDICATION else [{"name": indication[0]}]
            expected = self._refusals[key] = Required(rule, indications=indications)
        step = Step(self.now, encode(command), expected, before=self.state)
        step.pairs.append((answer.state, answer.input))
        step.times.append(self.now)
        if self.logged:
            step.effects.append(GraphEffects(None, 0, len(expected.indications), [], []))
        self._expect(step)

    def _follow(self, step: Step, answer: OracleAnswer) -> None:
        """Add the expected effects of one step of the specification to ``step``."""
        value = self.oracle.inputs[answer.input]
        if answer.changes and self.wire.given is not None:
            self._lease_ms = self.wire.given.get("lease_ms", self._lease_ms)
        effects = GraphEffects(None, 0, 0, [], []) if self.logged else None
        if effects is not None:
            effects.expired = self.wire.timer(value.timer) if isinstance(value, Expire) else None
            effects.stopped = [self.wire.timer(t) for t in answer.effect.stop]
        lease = self.clock.deadline(("lease",)) if answer.changes else None
        messages, indications = self.wire.expect(
            self.oracle.states[answer.state],
            value,
            answer,
            self.oracle.states[answer.next],
            (lease or self.now) - self.now,
            self.now,
        )
        step.pairs.append((answer.state, answer.input))
        step.expected.rule = step.expected.rule or answer.effect.rule
        step.expected.messages += messages
        step.expected.indications += indications
        if answer.changes:
            step.expected.fresh, self.wire.fresh = self.wire.fresh, []
            self._settle(answer)
        if effects is not None:
            effects.messages, effects.indications = len(messages), len(indications)
            arm = answer.effect.arm
            effects.armed = [(self.wire.timer(t), self.clock.deadline(t) or 0) for t in arm]
            step.effects.append(effects)

    def _queue(
        self, command: dict[str, Json], expected: Required | None = None, fault: str = ""
    ) -> None:
        """Queue a line that does not change the station."""
        timed = {} if command["cmd"] == "durations" else {"now": self.now}
        line, expected = encode(command | timed), expected or Required()
        self._expect(Step(self.now, line, expected, before=self.state, fault=fault))

    def _expect(self, step: Step) -> None:
        """Set the expected state after the step, and queue the step."""
        first = self.clock.first
        step.place = self.place
        step.after, step.next_timer = self.state, None if first is None else first.timer
        step.expected.phase = self.oracle.states[self.state].phase
        step.expected.deadline = None if first is None else first.deadline
        step.expected.timer = "" if first is None else first.timer[0]
        if not self.clock.sure:
            step.expected.deadline = UNKNOWN
        self.unwritten_steps.append(step)

    def _judge(self, step: Step, line: bytes) -> None:
        step.answer = line
        if self._right.get(id(step.expected)) == line:
            self.done.append(step)
            return
        if self.judges_marks and (b"generation_ms" in line or b"\\u" in line):
            states = [*(state for state, _ in step.pairs), step.after]
            marks = (self.oracle.marks[state] for state in states)
            step.expected.marks = [sorted(map(self.wire.session, each)) for each in marks]
            step.expected.marks_since = [0, *step.times]
        # Of the numbers judged: what is queued only predicts them.
        step.expected.above = self.wire.last_number
        problems = differences(step.expected, line)
        if problems:
            raise Mismatch([*self.done, step], problems)
        for m in step.expected.messages:
            if m["type"] == "Advertisement" and m["session"][1] not in self.wire.own.values():
                if self.predict and m["session"][1] != self.wire.last_number + 1:
                    raise Unpredicted
                self.wire.opened(self.oracle.states[step.after].number, m["session"][1])
        self._right[id(step.expected)] = line
        self.done.append(step)
