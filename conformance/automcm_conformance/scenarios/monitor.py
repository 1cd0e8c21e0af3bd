"""A station behind an adapter, followed on the oracle while it runs, with its log beside it.

The adapter protocol tells what a station sends and says, and its next deadline; it does not tell
which timers run.  The specification does: so it is asked, step by step, and what it arms and stops
is what the log says and what the deadline is compared with.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, cast

from automcm_conformance.adapter.connect import Connection
from automcm_conformance.adapter.protocol import Answer, HelloAnswer, read_answer
from automcm_conformance.exchange import transcript
from automcm_conformance.exchange.armed_timers import Clock, Running
from automcm_conformance.exchange.records import COMPLETE, bare
from automcm_conformance.exchange.results import Line
from automcm_conformance.exchange.wire import encode
from automcm_spec.vocabulary.json_forms import canonical
from automcm_spec.vocabulary.parameters import derived, forgotten_at, in_header
from automcm_spec.vocabulary.rules import RULES
from automcm_traces.checker.engine import Engine
from automcm_traces.checker.finding import Diverges
from automcm_traces.checker.track import CannotTell, Step, Track
from automcm_traces.format.log import (
    RECORD,
    Event,
    ForgetTimer,
    MessageTimer,
    Timer,
    TimerEnd,
    not_plain,
)
from automcm_traces.format.reader import read
from automcm_traces.format.writer import LogWriter

Json = Any
SILENT_MS = 1_000
"""The longest legal interval of CAMs (protocol.md, section 3, t_cam_loss)."""


class Monitor:
    """One station from ``reset`` on.  Its log is written to ``path``; ``lines`` gets what is said.

    ``parameters`` are those of ``reset``, ``now`` is the virtual time in ms.  What the
    specification does not allow raises Diverges, here and in ``give``.
    """

    def __init__(
        self,
        station: int,
        process: Connection,
        path: Path,
        lines: list[Line],
        hello: HelloAnswer,
        parameters: Mapping[str, int],
        *,
        run: str,
        seed: int,
        now: int,
    ) -> None:
        self.id = station
        self.deadline: int | None = None
        """Of its next timer, as it told."""
        self.excused: set[tuple[int, int]] = set()
        """Sessions in which it aborted, lost CAMs or restarted (S-5)."""
        self.last: Step | None = None
        """The step of the specification that is looked at."""
        self.sent: list[tuple[str, dict[str, Json]]] = []
        """What the last answer held, CAMs too, each with the id of its transmission."""
        self.indications: list[dict[str, Json]] = []
        """The indications of the last answer."""
        self.backoffs = 0
        """How often a back-off was armed."""
        self.backoff = 0
        """How long each lasts, in ms; 0 if that is left to the station."""
        self._sends_cams = "cam" in hello.features
        self._process = process
        self._lines = lines
        self._backoff = parameters["backoff_min"], parameters["backoff_max"]
        self._known = {**parameters, **derived(parameters)}
        self._log = LogWriter(
            path,
            run=run,
            station=station,
            implementation=hello.name,
            version=hello.version,
            parameters=in_header(self._known),
            complete=COMPLETE,
        )
        self._engine = Engine(read(path).header, late_ms=0)
        self._clock: Clock[Timer] = Clock()
        self._joined_at: dict[int, int] = {}
        self._transmissions = 0
        self._at = 1
        self._cam_ms = now
        self._answer = Answer(messages=[], indications=[], deadline=None)
        reset = {"station": station, "seed": seed, "parameters": dict(parameters)}
        try:
            self.give(now, {"cmd": "reset", **reset})
        except Exception as error:
            self.end("clean" if isinstance(error, Diverges) else "crash")
            raise

    @property
    def track(self) -> Track:
        """Where the specification says that it is."""
        return self._engine.track

    def give(
        self, now: int, command: dict[str, Json], tx: str | None = None, raw: str | None = None
    ) -> None:
        """Say a line, ``now`` not in it, and follow the answer: it is in ``sent`` and ``told``.
        ``tx`` is the transmission of a message received; ``raw`` is what the log is to hold, in
        base64, if that is no message (END-5).

        Raises Diverges, CannotTell if the oracle knows no such situation, AdapterError and
        ProtocolError.
        """
        command = {**command, "now": now}
        line = encode(command)
        self._lines.append(Line(now, "kit", f"{self.id}: {transcript.said(command)}"))
        said = self._process.exchange([line])[0]
        self._lines.append(Line(now, "station", f"{self.id}: {transcript.answered(said)}"))
        answer = self._answer = read_answer(said)
        answer.indications = [bare(indication) for indication in answer.indications]
        self.sent, self.indications = [], list(answer.indications)
        self.deadline = answer.deadline
        session = self.track.session
        self._follow(now, command, tx, raw)
        if self.track.state.role == "receiver" and self.track.session not in (None, session):
            self._joined_at[self.track.peer] = now
        if (
            _is_no_op(command)
            and not self.indications
            and all(m["type"] == "CAM" for _, m in self.sent)
        ):
            del self._lines[-2:]

    def set_backoff(self, ms: int) -> None:
        """Every back-off from now on lasts so long; needs the feature ``durations``.

        Raises AdapterError and ProtocolError.
        """
        line = encode({"cmd": "durations", "durations": {"backoff": ms}})
        read_answer(self._process.exchange([line])[0])
        self._backoff, self.backoff = (ms, ms), ms

    def end(self, reason: str) -> None:
        """The log ends: ``clean``, or ``crash`` if the adapter broke."""
        self._log.end(reason)

    def _follow(self, now: int, command: dict[str, Json], tx: str | None, raw: str | None) -> None:
        """Timers that are due, then the command.  CAMs were due before that, or with the timers."""
        before = [cam for cam in self._answer.cams if self._marks(cam)]
        for cam in before:
            self._cam(now, cam)
        kind = command["cmd"]
        while kind != "restart" and (timer := self._clock.due(now)) is not None:
            self._clock.stop(timer)
            self._input(now, "timer", op="expire", timer=timer)
        if kind == "receive" and raw is not None:
            self._malformed(now, tx, raw)
        elif kind == "receive":
            planned, message = command.get("planned"), command["message"]
            self._input(now, kind, tx=tx, message=message, planned=planned)
        elif kind == "command":
            self._input(now, kind, command=command["command"])
        elif kind == "restart":
            self._input(now, kind)
        self._rest(now)
        self._engine.finish()
        for cam in self._answer.cams:
            if cam not in before:
                self._cam(now, cam)
        self._compare(now)

    # -- one step

    def _input(self, now: int, ev: str, **fields: Json) -> None:
        """An input, and what the specification wants to follow it."""
        self._engine.finish()
        session = self.track.session
        self._event(now, ev, **fields)
        step = self.last = self._engine.step
        assert step is not None
        excuse = ("expire", ("cam",)), ("restart",)
        if session and (step.input in excuse or step.input[:2] == ("command", "abort")):
            self.excused.add(session)
        while (m := next(filter(self._engine.takes, self._answer.messages), None)) is not None:
            self._answer.messages.remove(m)
            self._send(now, m)
        if step.messages:  # one is missing, or is not as it should be
            self._rest(now)
            self._engine.finish()
        stop, arm = self._engine.timers_to_change()
        for timer in list(self._clock.running) if ev == "restart" else stop:
            self._clock.stop(timer)
            self._event(now, "timer", op="stop", timer=timer)
        for armed, duration in arm:
            self._arm(now, armed, duration)
        for indication in [i for i in self._answer.indications if i["name"] in step.told]:
            self._answer.indications.remove(indication)
            self._event(now, "indication", indication=indication)

    def _malformed(self, now: int, tx: str | None, raw: str) -> None:
        """What is no message has no effect (END-5): all that is answered is too much."""
        self._engine.finish()
        self.last = None
        self._event(now, "receive", tx=tx, raw=raw)
        if self._answer.messages:
            m = self._answer.messages[0]
            try:
                self._send(now, m)
            except Diverges as d:
                raise self._diverges(d.finding.observed, ["nothing is sent"], "END-5") from None

    def _rest(self, now: int) -> None:
        """What was answered and nothing called for."""
        for m in self._answer.messages:
            self._send(now, m)
        for indication in self._answer.indications:
            self._event(now, "indication", indication=indication)

    def _arm(self, now: int, timer: Timer, duration: int | None) -> None:
        deadline = now + duration if duration is not None else self._unsettled(now, timer)
        self.backoffs += timer.name == "backoff"
        message = timer.message if isinstance(timer, MessageTimer) else None
        self._clock.arm(timer, deadline, message, message.type if message else "")
        self._event(now, "timer", op="arm", timer=timer, deadline=deadline)

    def _unsettled(self, now: int, timer: Timer) -> int:
        """When a timer expires whose duration is in no parameter: forget (ADV-8), back-off."""
        if isinstance(timer, ForgetTimer) and timer.station is not None:
            return forgotten_at(self._known, self._joined_at[timer.station], now)
        low, high = (now + ms for ms in self._backoff)
        others = min((each.deadline for each in self._clock.running.values()), default=high + 1)
        if low == high:
            return low
        if others <= high and others == self._answer.deadline:
            raise CannotTell("another deadline hides that of the back-off")
        if self._answer.deadline is None or not low <= self._answer.deadline <= high:
            raise self._diverges(
                f"deadline: the back-off ends at {self._answer.deadline}",
                [f"next deadline from {low} to {high} (backoff)"],
                "END-7",
            )
        return self._answer.deadline

    def _cam(self, now: int, cam: dict[str, Json]) -> None:
        if cam.get("src") != self.id:
            wrong = f"send CAM: src {cam.get('src')}"
            raise self._diverges(wrong, [f"src {self.id}"], "ACT-2")
        self._cam_ms = cam["generation_ms"]
        self._send(now, cam)

    def _marks(self, cam: dict[str, Json]) -> bool:
        """Whether a CAM has the marks of the present state (ACT-5)."""
        marks = cam.get("marks")
        own = sorted(map(canonical, self.track.marks))
        return isinstance(marks, list) and sorted(map(canonical, marks)) == own

    def _send(self, now: int, m: dict[str, Json]) -> None:
        self._transmissions += 1
        tx = f"{self.id}:{self._transmissions}"
        if invalid := not_plain(m):  # the log cannot hold it
            text = f"send {m['type']}: {': '.join(invalid)}"
            raise self._diverges(text, ["a message as section 2 has it"])
        self._event(now, "send", tx=tx, message=m)
        self.sent.append((tx, m))

    def _event(self, now: int, ev: str, **fields: Json) -> None:
        """Into the log, and to the engine."""
        observed = {name: value for name, value in fields.items() if value is not None}
        if "timer" in observed:
            observed["timer"] = observed["timer"].model_dump(exclude_none=True)
        seq = self._log.event(ev, now, **observed)
        self._at = seq + 1
        record = {"rec": "event", "seq": seq, "t_ms": now, "ev": ev, **observed}
        event = cast(Event, RECORD.validate_python(record))
        self._engine.feed(self._at, event)

    # -- what is left to compare

    def _compare(self, now: int) -> None:
        """The phase if it is told, the next deadline, and whether CAMs come at all."""
        answer, phase = self._answer, self.track.state.phase
        if answer.phase not in (None, phase):
            raise self._diverges(f"phase: {phase} is expected, not {answer.phase}", [phase])
        first = self._clock.first
        wanted = None if first is None else first.deadline
        if answer.deadline != wanted:
            name = "no timer" if first is None else first.timer.name
            if first is not None and (answer.deadline or first.deadline) >= first.deadline:
                self.last = self._expiry(first)
            text = f"deadline: {_number(wanted)} is expected, not {_number(answer.deadline)}"
            raise self._diverges(text, [f"next deadline {_number(wanted)} ({name})"])
        if self._sends_cams and now > self._cam_ms + SILENT_MS:
            text = f"no CAM since {self._cam_ms} ms"
            raise self._diverges(text, ["a CAM every t_cam"], "ACT-2")

    def _expiry(self, running: Running[Timer]) -> Step | None:
        """The step that this timer would bring about: it is missing, or lasts too long."""
        engine = self._engine.copy()
        timer, t_ms = running.timer, running.deadline
        event = TimerEnd.model_construct(
            rec="event", seq=self._at, t_ms=t_ms, ev="timer", op="expire", timer=timer
        )
        engine.feed(self._at, event)
        return engine.step

    def _diverges(self, what: str, wanted: list[str], rule: str = "") -> Diverges:
        """``rule`` is that of the last step if none is given."""
        step = self.last
        guard = RULES[rule] if rule else "" if step is None else step.guard
        return Diverges(self._at, what, rule or (step.rule if step else ""), wanted, guard)


def _is_no_op(command: dict[str, Json]) -> bool:
    """Time passes, or a CAM arrives."""
    kind: str = command.get("message", {}).get("type", command["cmd"])
    return kind in ("CAM", "advance")


def _number(value: int | None) -> str:
    return "null" if value is None else str(value)
