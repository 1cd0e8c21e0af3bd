"""Follows a station behind an adapter on the specification while it runs, and writes its log.

The adapter protocol reports messages, indications and the next deadline, but not which timers
run.  The monitor takes the timers from the specification, step by step: they are written to the
log, and the deadline is compared with them.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any, cast

from automcm_conformance.adapter.process import Process
from automcm_conformance.adapter.protocol import Answer, HelloAnswer, read_answer
from automcm_conformance.exchange import transcript
from automcm_conformance.exchange.answers import are_marks
from automcm_conformance.exchange.armed_timers import ArmedTimers, Running
from automcm_conformance.exchange.records import bare, given
from automcm_conformance.exchange.results import Line
from automcm_conformance.exchange.wire import encode
from automcm_spec.log_format.log import (
    EVENT_KINDS,
    Event,
    ForgetTimer,
    MessageTimer,
    Timer,
    TimerEnd,
    record,
)
from automcm_spec.log_format.problems import not_plain
from automcm_spec.log_format.reader import read
from automcm_spec.log_format.writer import LogWriter
from automcm_spec.support import files
from automcm_spec.vocabulary.json_forms import canonical
from automcm_spec.vocabulary.parameters import derived, forgotten_at, in_header
from automcm_spec.vocabulary.rules import RULES
from automcm_traces.checker.engine import Engine
from automcm_traces.checker.finding import Diverges
from automcm_traces.checker.track import CannotTell, InputStep, Track

Json = Any
MAX_CAM_INTERVAL_MS = 1_000
"""The longest allowed interval of CAMs in ms (protocol.md, section 3, t_cam_loss)."""


class Monitor:
    """Follows one station from ``reset`` on.

    The log is written to ``path``, and ``lines`` gets the transcript.  ``parameters`` are those of
    ``reset``; ``now`` is the virtual time in ms.  Raises Diverges, as ``give`` does, if the
    specification does not allow an answer.
    """

    def __init__(
        self,
        station: int,
        process: Process,
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
        """The deadline in ms that the station reported last."""
        self.last: InputStep | None = None
        """The last step of the specification."""
        self.sent: list[tuple[str, dict[str, Json]]] = []
        """The messages and CAMs of the last answer, each with the id of its transmission."""
        self.indications: list[dict[str, Json]] = []
        """The indications of the last answer."""
        self.backoffs = 0
        """How many back-offs were armed."""
        self.backoff = 0
        """The duration of every back-off in ms; 0 if the station chooses it."""
        self._sends_cams = "cam" in hello.features
        self._process = process
        self._lines = lines
        self._backoff = parameters["backoff_min"], parameters["backoff_max"]
        self._known = {**parameters, **derived(parameters)}
        files.refuse_links(path)
        self._log = LogWriter(
            path,
            run=run,
            station=station,
            implementation=hello.name,
            version=hello.version,
            parameters=in_header(self._known),
            complete=EVENT_KINDS,
        )
        self._engine = Engine(read(path).header, late_ms=0)
        self._clock: ArmedTimers[Timer] = ArmedTimers()
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
        """The state of the station according to the specification."""
        return self._engine.track

    def give(
        self, now: int, command: dict[str, Json], tx: str | None = None, raw: str | None = None
    ) -> None:
        """Send a command at ``now`` (ms), and follow its answer.

        The answer is then in ``sent``, ``indications`` and ``deadline``.  ``tx`` is the
        transmission of a received message; ``raw`` is its base64 text for the log if it is
        malformed (END-5).  Raises Diverges, CannotTell if the specification does not cover the
        situation, AdapterError and ProtocolError.
        """
        command = {**command, "now": now}
        line = encode(command)
        self._lines.append(Line(now, "kit", f"{self.id}: {transcript.said(command)}"))
        answered = self._process.exchange([line])[0]
        self._lines.append(Line(now, "station", f"{self.id}: {transcript.answered(answered)}"))
        answer = self._answer = read_answer(answered)
        answer.indications = [bare(indication) for indication in answer.indications]
        self.sent, self.indications = [], list(answer.indications)
        self.deadline = answer.deadline
        session = self.track.session
        self._follow(now, command, tx, raw)
        if self.track.state.role == "receiver" and self.track.session not in (None, session):
            self._joined_at[self.track.peer] = now
        kind = command.get("message", {}).get("type", command["cmd"])
        only_cams = not self.indications and all(m["type"] == "CAM" for _, m in self.sent)
        if kind in ("CAM", "advance") and only_cams:
            del self._lines[-2:]

    def set_backoff(self, ms: int) -> None:
        """Set the duration of every later back-off in ms.  Needs the feature ``durations``.

        Raises AdapterError and ProtocolError.
        """
        line = encode({"cmd": "durations", "durations": {"backoff": ms}})
        read_answer(self._process.exchange([line])[0])
        self._backoff, self.backoff = (ms, ms), ms

    def end(self, reason: str) -> None:
        """End the log with the reason ``clean``, or ``crash`` if the adapter failed."""
        self._log.end(reason)

    def _follow(self, now: int, command: dict[str, Json], tx: str | None, raw: str | None) -> None:
        """Follow the timers that are due, then the command.

        CAMs with the marks of the old state come before both, the others after them.
        """
        before = [cam for cam in self._answer.cams if self._marks(cam)]
        for cam in before:
            self._cam(now, cam)
        kind = command["cmd"]
        while kind != "restart" and (timer := self._clock.due(now)) is not None:
            self._clock.stop(timer)
            self._input(now, "timer", op="expire", timer=timer)
        if raw is not None:
            self._malformed(now, tx, raw)
        elif kind in ("receive", "command", "restart"):
            self._input(now, kind, tx=tx, **given(command))
        self._log_unexpected(now)
        self._engine.finish()
        for cam in self._answer.cams:
            if cam not in before:
                self._cam(now, cam)
        self._compare(now)

    # -- one step

    def _input(self, now: int, ev: str, **fields: Json) -> None:
        """Follow an input and the effects that the specification requires."""
        self._engine.finish()
        self._event(now, ev, **fields)
        step = self.last = self._engine.step
        assert step is not None
        while (m := next(filter(self._engine.takes, self._answer.messages), None)) is not None:
            self._answer.messages.remove(m)
            self._send(now, m)
        if step.messages:  # a required message is missing or different
            self._log_unexpected(now)
            self._engine.finish()
        stop, arm = self._engine.timers_to_change()
        for timer in list(self._clock.running) if ev == "restart" else stop:
            self._clock.stop(timer)
            self._event(now, "timer", op="stop", timer=timer)
        for armed, duration in arm:
            self._arm(now, armed, duration)
        for indication in [i for i in self._answer.indications if i["name"] in step.indications]:
            self._answer.indications.remove(indication)
            self._event(now, "indication", indication=indication)

    def _malformed(self, now: int, tx: str | None, raw: str) -> None:
        """A malformed message has no effect (END-5), so no answer to it is allowed."""
        self._engine.finish()
        self.last = None
        self._event(now, "receive", tx=tx, raw=raw)
        if self._answer.messages:
            m = self._answer.messages[0]
            try:
                self._send(now, m)
            except Diverges as d:
                raise self._diverges(d.finding.observed, ["no message"], "END-5") from None

    def _log_unexpected(self, now: int) -> None:
        """Log the messages and indications of the answer that no step required."""
        for m in self._answer.messages:
            self._send(now, m)
        for indication in self._answer.indications:
            self._event(now, "indication", indication=indication)

    def _arm(self, now: int, timer: Timer, duration: int | None) -> None:
        deadline = now + duration if duration is not None else self._variable_deadline(now, timer)
        self.backoffs += timer.name == "backoff"
        message = timer.message if isinstance(timer, MessageTimer) else None
        self._clock.arm(timer, deadline, message, message.type if message else "")
        self._event(now, "timer", op="arm", timer=timer, deadline=deadline)

    def _variable_deadline(self, now: int, timer: Timer) -> int:
        """The deadline in ms of a timer whose duration is not a parameter: forget, back-off."""
        if isinstance(timer, ForgetTimer) and timer.station is not None:
            return forgotten_at(self._known, self._joined_at[timer.station], now)
        low, high = (now + ms for ms in self._backoff)
        others = min((each.deadline for each in self._clock.running.values()), default=high + 1)
        if low == high:
            return low
        if others <= high and others == self._answer.deadline:
            raise CannotTell("the deadline of the back-off is hidden by that of another timer")
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
        """Whether a CAM has the marks of the current state (ACT-5)."""
        return are_marks(list(map(list, self.track.marks)), cam.get("marks"))

    def _send(self, now: int, m: dict[str, Json]) -> None:
        self._transmissions += 1
        tx = f"{self.id}:{self._transmissions}"
        if invalid := not_plain(m):  # the log has no form for it
            text = f"send {m['type']}: {': '.join(invalid)}"
            raise self._diverges(text, ["a message as in protocol.md section 2"])
        self._event(now, "send", tx=tx, message=m)
        self.sent.append((tx, m))

    def _event(self, now: int, ev: str, **fields: Json) -> None:
        """Write an event to the log, and feed it to the engine."""
        observed = {name: value for name, value in fields.items() if value is not None}
        if "timer" in observed:
            observed["timer"] = observed["timer"].model_dump(exclude_none=True)
        seq = self._log.event(ev, now, **observed)
        self._at = seq + 1
        fields = {"rec": "event", "seq": seq, "t_ms": now, "ev": ev, **observed}
        self._engine.feed(self._at, cast(Event, record(json.dumps(fields).encode())))

    # -- comparisons after the step

    def _compare(self, now: int) -> None:
        """Compare the phase, if reported, and the deadline; check that CAMs are sent."""
        answer, phase = self._answer, self.track.state.phase
        if answer.phase not in (None, phase):
            raise self._diverges(f"phase: expected {phase}, got {answer.phase}", [phase])
        first = self._clock.first
        wanted = None if first is None else first.deadline
        if answer.deadline != wanted:
            name = "no timer" if first is None else first.timer.name
            if first is not None and (answer.deadline or first.deadline) >= first.deadline:
                self.last = self._expiry(first)
            text = f"deadline: expected {canonical(wanted)}, got {canonical(answer.deadline)}"
            raise self._diverges(text, [f"next deadline {canonical(wanted)} ({name})"])
        if self._sends_cams and now > self._cam_ms + MAX_CAM_INTERVAL_MS:
            text = f"no CAM after {self._cam_ms} ms"
            raise self._diverges(text, ["a CAM every t_cam"], "ACT-2")

    def _expiry(self, running: Running[Timer]) -> InputStep | None:
        """The step of this timer's expiry, which the station missed or set too late."""
        engine = self._engine.copy()
        timer, t_ms = running.timer, running.deadline
        event = TimerEnd(rec="event", seq=self._at, t_ms=t_ms, ev="timer", op="expire", timer=timer)
        engine.feed(self._at, event)
        return engine.step

    def _diverges(self, what: str, wanted: list[str], rule: str = "") -> Diverges:
        """The divergence; ``rule`` is by default that of the last step."""
        step = self.last
        guard = RULES[rule] if rule else "" if step is None else step.guard
        return Diverges(self._at, what, rule or (step.rule if step else ""), wanted, guard)
