"""Follows a station's log on the compiled specification, event by event.

Of an input (a message, a command, an expiry) the specification says what must follow; what the log
says followed is held against that.  Kinds of event that the log does not promise are not missed
where they are missing.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import NamedTuple, Self

from automcm_spec.vocabulary.messages import Cam, Fields, Prescription
from automcm_spec.vocabulary.parameters import DEFAULTS, LIMITS, TIMERS, durations, lease_lasts
from automcm_spec.vocabulary.rules import RULES
from automcm_spec.vocabulary.station import Input, Outcome, State, Station
from automcm_traces.checker.finding import Diverges, Late, Seen, Supposition
from automcm_traces.checker.track import (
    NOTHING_TOLD,
    RESTARTED,
    Asked,
    CannotTell,
    Limits,
    Step,
    Track,
    armed_name,
    commanded,
    difference,
    expected,
    expired,
    lift,
    marked_and_newer,
    match,
    named,
    off,
    received,
    short,
    timer_name,
)
from automcm_traces.format.log import (
    ApplicationCommand,
    ApplicationIndication,
    Event,
    Header,
    Receive,
    Restart,
    Send,
    Timer,
    TimerArm,
    TimerEnd,
    typed,
)

NOTHING = "nothing more"
"""What a step wants that has all that it calls for."""
REMEMBERED = 20_000
"""Answers of the specification that are kept in memory."""
QUIET = 1000
"""Senders of CAMs whose question is remembered."""


class Specification:
    """The compiled station, and its answers: kept until there are too many, then it starts anew."""

    def __init__(self, *limits: int) -> None:
        self._station = Station(*limits)
        self._answers: dict[tuple[int, State, Input], tuple[Outcome, bool]] = {}

    def answer(self, me: int, st: State, i: Input) -> tuple[Outcome, bool]:
        """What ``Step`` says, and whether the state stays as it is."""
        found = self._answers.get((me, st, i))
        if found is None:
            if len(self._answers) >= REMEMBERED:
                self._answers.clear()
            outcome = self._station.step(me, st, i)
            found = self._answers[me, st, i] = outcome, outcome.st == st
        return found


specification = cache(Specification)
"""With these rounds, participants, outbox and memory, for every log that has them."""


class Malformed(NamedTuple):
    """A message that is no input of the specification: only ``discarded`` follows (END-5)."""

    line: int
    must: bool
    """Whether it must be reported."""
    why: str
    reported: bool = False


class Deadline(NamedTuple):
    """When an armed timer expires, in ms of the station's clock: not before ``first``, and at
    ``last`` at the latest; None if that is not known."""

    first: int
    last: int | None


class Engine:
    """Follows one station's log.

    A timer may expire up to ``late_ms`` after its deadline, by default half of t_resend: what
    section 3 allows a copy to be under way.
    """

    def __init__(self, header: Header, late_ms: int | None = None) -> None:
        p = header.known
        self._durations = durations(p)
        self._clock_drift = p.get("clock_drift", 0)
        self.promised = frozenset(header.complete)
        self._late_ms = header.longest_delay if late_ms is None else late_ms
        rounds, *limits = (p.get(name, DEFAULTS[name]) for name in LIMITS)
        self.track = Track(header.station, rounds, Limits(*limits))
        self._specification = specification(self.track.max_rounds, *limits)
        self.timers: dict[Timer, Deadline] = {}
        self.since_ms = 0
        """The time of the last event but CAMs: what was not observed happened later."""
        self.observer: Callable[[Step, Track], None] | None = None
        """Called after each step is complete, with the station as it is then."""
        self.step: Step | None = None
        """The last input and what is still expected to follow it; None after ``finish``."""
        self.odd: Malformed | None = None
        """The last input, if it is a message that is malformed."""
        self._quiet: dict[tuple[int, bool, bool], Step] = {}
        """CAMs that change nothing as the station is: by sender, marked, newer."""

    def copy(self) -> Self:
        """The same, to go on from here on its own."""
        other = self.__class__.__new__(self.__class__)
        other.__dict__.update(self.__dict__)
        other.track = self.track.copy()
        other.timers = dict(self.timers)
        other._quiet = {}
        other.step = None if self.step is None else self.step.copy()
        return other

    # -- what may follow, for who drives a station and writes its log meanwhile

    @property
    def states(self) -> int:
        """How many states of the specification are possible: one, if nothing is unseen."""
        return 1

    @property
    def only_if(self) -> tuple[Supposition, ...]:
        """What must have happened unseen for the log to be allowed."""
        return ()

    def takes(self, fields: Fields) -> bool:
        """Whether the current step calls for this message to be sent."""
        step, m = self.step, typed(fields)
        if step is None or isinstance(m, list | Cam):
            return False
        new = step.content, step.fresh
        return any(difference(e, m, self.track, *new) is None for e in step.messages)

    def timers_to_change(self) -> tuple[list[Timer], list[tuple[Timer, int | None]]]:
        """The timers that the current step still stops, and those that it arms, each with its
        duration in ms: None for backoff, forget, and what the header does not tell.

        They are named as in a log, so the messages of the step must have been fed before.
        """
        step = self.step
        if step is None:
            return [], []
        armed = [named(self.track, step.sent, timer) for timer in step.arm]
        armed.sort(key=lambda timer: getattr(getattr(timer, "message", None), "seq", 0))  # as sent
        return (
            [named(self.track, step.sent, timer) for timer in step.stop],
            [(timer, self._duration(step, timer)) for timer in armed],
        )

    def outstanding(self) -> list[str]:
        """What the last input calls for, the log promises to hold, and has not come yet."""
        step = self.step
        if step is None:
            return []
        missing = [f"send {m}" for m in step.messages] if "send" in self.promised else []
        if "timer" in self.promised:
            missing += [f"arm {short(t)}" for t in step.arm]
            missing += [f"stop {short(t)}" for t in step.stop]
        missing += [f"indication {t}" for t in step.told if "indication" in self.promised]
        return missing

    # -- events

    def feed(self, at: int, event: Event) -> None:
        """The next event.  Raises Diverges, CannotTell."""
        match event:
            case Send(message=message) if message["type"] == "CAM":
                self.finish()
                self._missed(at, event.t_ms)
                self._cam_sent(at, message)
                self._phase_is(at, event)
                return
            case Send(message=message):
                self._sent(at, event.t_ms, message)
            case TimerArm() | TimerEnd(op="stop"):
                self._timer_changed(at, event)
            case ApplicationIndication():
                self._told(at, event)
            case Restart():  # what was due before is lost (END-8)
                self.finish()
                self._input(at, event)
            case _:
                self.finish()
                self._missed(at, event.t_ms)
                self._input(at, event)
        if not (isinstance(event, Receive) and event.message and event.message["type"] == "CAM"):
            self.since_ms = event.t_ms
        if event.phase is not None or event.role is not None:
            self._phase_is(at, event)

    def finish(self) -> None:
        """No more effects of the last input: what is still expected is missing."""
        step, odd = self.step, self.odd
        self.odd = None
        if odd is not None and odd.must and "indication" in self.promised:
            text = "receive a malformed message: not everything followed"
            raise Diverges(odd.line, text, "END-5", ["indication discarded"], _by("END-5"))
        if step is None:
            return
        missing = self.outstanding() if step.messages or step.arm or step.stop or step.told else []
        if missing:
            text = f"{step.what}: not everything followed"
            raise Diverges(step.at, text, step.rule, missing, step.guard, step)
        if step.messages:  # the log may lack it; but then its seq is not known
            raise CannotTell(f"line {step.at}: the log does not hold: send {step.messages[0]}")
        if "timer" not in self.promised:
            self._timers_as_told(step)
        self.step = None
        self._lift(step)
        if self.observer is not None:
            self.observer(step, self.track)

    def _lift(self, step: Step) -> None:
        t, m = self.track, step.given
        if step.input[0] == "restart":
            self.timers = {k: d for k, d in self.timers.items() if k.name == "quarantine"}
        if step.changes or step.sent:
            self._quiet.clear()
        after = step.after
        if after is not t.state or step.sent:
            was = t.state.phase
            lift(t, after, step.sent)
            prescribed = step.input.kind == "receive" and step.input.message.type == "Prescription"
            if prescribed and t.state.phase == "NEGOTIATING" != was:
                t.lease_ms = m.lease_ms if isinstance(m, Prescription) else 0
        if step.input.kind == "cam" and step.changes:
            t.heard_ms = m.generation_ms if isinstance(m, Cam) else t.heard_ms or 0

    def _phase_is(self, at: int, event: Event) -> None:
        """Phase and role after the step, where the log has them, are those of the specification."""
        step = self.step
        wanted = (self.track.state if step is None else step.after)[:2]
        found = event.phase, event.role
        for name, is_, should in zip(("phase", "role"), found, wanted, strict=True):
            if is_ is not None and is_ != should:
                rule, guard = self._last_rule()
                wants = [f"{name} {should}"]
                text = f"{name} {is_}{'' if step else self._but_odd()}"
                raise Diverges(at, text, rule, wants, guard, step, (name, is_))

    # -- inputs

    def _input(self, at: int, event: Event) -> None:
        match event:
            case Receive(message=None):
                self.odd = Malformed(at, False, "raw bytes")
            case Receive(message=dict(fields)):
                m = typed(fields)
                if isinstance(m, list):  # END-5: nothing may follow but "discarded"
                    mine = fields.get("dst", self.track.me) == self.track.me
                    self.odd = Malformed(at, mine, ": ".join(m[0]))
                elif isinstance(m, Cam):
                    self._cam_received(at, event, m)
                else:
                    self._ask(at, event.t_ms, event, received(self.track, event, m))
            case TimerEnd(timer=timer):
                self._expired(at, event, timer)
            case ApplicationCommand(command=command):
                self._ask(at, event.t_ms, event, commanded(command))
            case _:
                self._ask(at, event.t_ms, event, RESTARTED)

    def _cam_received(self, at: int, event: Receive, m: Cam) -> None:
        """A CAM.  Most change nothing, and then the same one again is no new question."""
        key = m.src, *marked_and_newer(self.track, m)
        k, t_ms = self._quiet.get(key), event.t_ms
        if k is None:
            step = self._ask(at, t_ms, event, received(self.track, event, m))
            if not step.changes and len(self._quiet) < QUIET:
                self._quiet[key] = step
            return
        parts = k.input, k.what, k.rule, k.after, False, k.says, k.messages, k.arm, k.stop, k.told
        self.step = Step(at, t_ms, event, *parts, m, k.content, t_ms)

    def _expired(self, at: int, event: Event, timer: Timer) -> None:
        what, rule = f"expire {timer_name(timer)}", TIMERS[timer.name].rule
        deadline = self.timers.pop(timer, None)
        seen = ("expire", timer)
        if deadline is None:
            armed = ", ".join(sorted(map(armed_name, self.timers)))
            wanted = [f"one of the armed: {armed or 'none'}"]
            raise Diverges(at, f"{what}: not armed", rule, wanted, "", None, seen)
        if event.t_ms < deadline.first:
            early = f"{what}: {deadline.first - event.t_ms} ms too early"
            wanted = [f"{what} at {deadline.first} ms"]
            raise Diverges(at, early, rule, wanted, _by(rule), None, seen)
        question = expired(self.track, timer)
        if question is None:
            gone = f"{what}: no such message in the outbox"
            raise Diverges(at, gone, "END-6", [], "", None, seen)
        self._ask(at, event.t_ms, event, question)

    def _ask(self, at: int, t_ms: int, event: Event | None, question: Asked) -> Step:
        """An input, and what must follow it."""
        t, value, given = self.track, question.value, question.given
        found, stays = self._specification.answer(t.me, t.state, value)
        step = self.step = Step(
            at,
            t_ms,
            event,
            value,
            question.what,
            found.rule,
            t.state if stays else found.st,
            bool(not stays or found.arm or found.stop),
            found.told,
            [expected(t, m, value, given) for m in sorted(found.out)],
            sorted(found.arm),
            # After a restart everything stops, whether the log says so or not.
            sorted(found.stop) if value.kind != "restart" else [],
            [] if found.told == NOTHING_TOLD else [found.told[0]],
            given,
            question.content,
            t_ms,
        )
        return step

    # -- effects

    def _current(self, at: int, t_ms: int, event: str, seen: Seen) -> Step:
        """The step that an effect belongs to.  The first effect tells when an unseen input was:
        less than late_ms before."""
        step = self.step
        if step is None:
            text = f"{event}: nothing called for it{self._but_odd()}"
            rule, guard = self._last_rule()
            raise Diverges(at, text, rule, [], guard, None, seen)
        if step.unseen:
            first = max(step.since_ms, t_ms - max(self._late_ms - 1, 0))
            if first > step.t_ms:
                self._missed(at, first)
                wanted = [f"{step.what}, by {step.t_ms} ms"]
                raise Late(at, event, step.rule, wanted, step.guard, step, seen)
            step.unseen, step.since_ms = False, first
        return step

    def _but_odd(self) -> str:
        """That nothing follows from the last message, if it is malformed."""
        if self.odd is None:
            return ""
        return f"; the message of line {self.odd.line} is malformed ({self.odd.why})"

    def _last_rule(self) -> tuple[str, str]:
        """The rule that decided the last input, and what it says; empty if nothing was decided."""
        if self.step is not None:
            return self.step.rule, self.step.guard
        return ("END-5", _by("END-5")) if self.odd is not None else ("", "")

    def _sent(self, at: int, t_ms: int, fields: Fields) -> None:
        event, seen = f"send {fields['type']} to {fields.get('dst', 'all')}", ("send", fields)
        step, m = self._current(at, t_ms, event, seen), typed(fields)
        assert not isinstance(m, Cam), "feed gives those to _cam_sent"
        problems: list[tuple[int, str]] = []
        for e in step.messages:
            problem: str | None
            if isinstance(m, list):
                problem = ": ".join(m[0])
            elif (problem := difference(e, m, self.track, step.content, step.fresh)) is None:
                step.messages.remove(e)
                step.sent.append((e, m))
                step.fresh += bool(e.k and e.copy_of is None)
                return
            if e.type == fields["type"]:
                problems.append((off(e, fields), problem))
        least, problem = min(problems, key=lambda p: p[0], default=(0, None))
        why = f" ({problem})" if problem else ""
        wanted = self.outstanding() or [NOTHING]
        raise Diverges(at, f"{event}{why}", step.rule, wanted, step.guard, step, seen, least)

    def _cam_sent(self, at: int, fields: Fields) -> None:
        """ACT-5: the marks are the bound session and those whose Fin is still being sent."""
        m, wanted, rule, wants = typed(fields), self.track.marks, "ACT-5", list[str]()
        if isinstance(m, list):
            text, rule = f"send CAM ({': '.join(m[0])})", "END-5"
        elif m.src != self.track.me:
            text, wants = f"send CAM: src {m.src}", [f"src {self.track.me}"]
        elif isinstance(m, Cam) and sorted({*m.marks}) != wanted:
            text = f"send CAM: marks {fields['marks']}"
            wants = [f"marks {[list(mark) for mark in wanted]}"]
        else:
            return
        raise Diverges(at, text, rule, wants, _by(rule), None, ("send", fields))

    def _told(self, at: int, event: ApplicationIndication) -> None:
        name = event.indication.name
        may_be_odd = (self.odd and not self.odd.reported) or "receive" not in self.promised
        if self.step is None and name == "discarded" and may_be_odd:
            self.odd = self.odd and self.odd._replace(must=False, reported=True)
            return
        seen = ("indication", name)
        step = self._current(at, event.t_ms, f"indication {name}", seen)
        if name not in step.told:
            wanted = self.outstanding() or step.told or [NOTHING]
            text = f"indication {name}"
            raise Diverges(at, text, step.rule, wanted, step.guard, step, seen)
        step.told.remove(name)
        fields = event.indication.model_extra or {}
        if name == "fallback" and "reason" in fields:
            reason = step.says[1]
            if reason == "as_sent":
                given = step.content.get("reason", fields["reason"])
                reason = getattr(step.given, "reason", None) or str(given)
            if fields["reason"] != reason:
                text, wants = f"indication fallback ({fields['reason']})", [f"fallback ({reason})"]
                raise Diverges(at, text, step.rule, wants, step.guard, step, seen)

    def _timer_changed(self, at: int, event: TimerArm | TimerEnd) -> None:
        timer = event.timer
        what, seen = f"{event.op} {timer_name(timer)}", (event.op, timer)
        step = self._current(at, event.t_ms, what, seen)
        armed = isinstance(event, TimerArm)
        pool = step.arm if armed else step.stop
        value = match(self.track, step, timer, pool)
        if step.input[0] == "restart" and not armed and timer in self.timers:
            del self.timers[timer]
            return
        if value is None:
            wanted = self.outstanding() or [NOTHING]
            raise Diverges(at, what, step.rule, wanted, step.guard, step, seen)
        pool.remove(value)
        if not isinstance(event, TimerArm):
            self.timers.pop(timer, None)
            return
        duration = self._duration(step, timer)
        if duration is not None and event.deadline != event.t_ms + duration:
            wanted = [f"{what} until {event.t_ms + duration} ms"]
            text = f"{what} until {event.deadline} ms"
            raise Diverges(at, text, step.rule, wanted, step.guard, step, seen)
        self._arm(timer, event.deadline, event.deadline)

    def _arm(self, timer: Timer, first: int, last: int | None) -> None:
        """Note a deadline; CAMs that were not observed may put off theirs without end (ACT-5)."""
        if timer.name == "cam" and not {"receive", "timer"} & self.promised:
            last = None
        self.timers[timer] = Deadline(first, last)

    def _timers_as_told(self, step: Step) -> None:
        """What the step stops and arms, where the log does not promise to say it."""
        stop, arm = self.timers_to_change()
        if step.input[0] == "restart":
            self.timers.clear()
        for timer in stop:
            self.timers.pop(timer, None)
        for timer, duration in arm:
            if duration is None:
                self._arm(timer, step.since_ms, None)
            else:
                self._arm(timer, step.since_ms + duration, step.t_ms + duration)
        step.stop, step.arm = [], []

    def _duration(self, step: Step, timer: Timer) -> int | None:
        if timer.name != "lease":
            return self._durations.get(timer.name)
        for _, m in step.sent:
            if isinstance(m, Prescription):
                return lease_lasts(self._clock_drift, "prescriber", m.lease_ms)
        return self.track.lease_ms or None

    def _missed(self, at: int, t_ms: int) -> None:
        """A timer that should have fired long before: the first of them."""
        late = [
            (d.last, armed_name(timer), TIMERS[timer.name].rule)
            for timer, d in self.timers.items()
            if d.last is not None and t_ms > d.last + self._late_ms
        ]
        if late:
            due_ms, name, rule = min(late)
            wanted = [f"expire {name} at {due_ms} ms"]
            raise Late(at, f"{name} was due at {due_ms} ms", rule, wanted, _by(rule))


def _by(rule: str) -> str:
    return f"{rule}: {RULES[rule]}"
