"""Replays the inputs of a log to an adapter, and follows the station on the specification.

Messages and timers of the log's station are not inputs.  Time passes as in the log, and the timers
of the implementation expire on their own.
"""

from __future__ import annotations

import base64
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Literal

from pydantic import ValidationError
from pydantic_core import from_json, to_json

from automcm_conformance.adapter import protocol
from automcm_conformance.adapter.process import AdapterError, Process
from automcm_conformance.exchange import transcript
from automcm_conformance.exchange.results import Line
from automcm_conformance.replay.log_survey import Survey, require_replayable, survey
from automcm_conformance.replay.renaming import Renaming
from automcm_conformance.scenarios.monitor import Monitor
from automcm_spec.log_format.log import (
    ApplicationCommand,
    Event,
    Receive,
    Restart,
    Send,
    TimerEnd,
    problems,
)
from automcm_spec.log_format.reader import LogStream, read
from automcm_spec.support import files
from automcm_spec.support.bad_input import errors_of
from automcm_traces.checker.finding import Diverges
from automcm_traces.checker.track import CannotTell
from automcm_traces.explain.explain import explain

MAX_STEP_MS = 1_000
"""The longest step in time, so that CAMs are sent in time (adapter.md allows 10 s)."""
SHOWN = 40
"""This many of the last lines of the exchange are kept."""


@dataclass(slots=True)
class Replayed:
    """The result of a replay.  ``line`` and ``input`` refer to the log that was replayed."""

    verdict: Literal["allowed", "diverges", "cannot_tell", "error"]
    """error: the adapter could not be started, or failed."""
    file: str
    line: int = 0
    """The line of the last input given; 0 if there was none."""
    input: str = ""
    event: str = ""
    """The divergence, or the reason of the other verdicts."""
    rule: str = ""
    expected: list[str] = field(default_factory=list)
    guard: str = ""
    log: str = ""
    """The new log; empty if there is none."""
    log_line: int = 0
    """The line of the divergence in the new log."""
    in_log: bool = True
    """Whether the new log alone shows the divergence; logs have no next deadline and no phase."""
    inputs: int = 0
    """How many inputs were given, of ``total``."""
    total: int = 0
    notes: list[str] = field(default_factory=list)
    """Parts left out, other parameters, and warnings of the reader."""
    stderr: list[str] = field(default_factory=list)
    exchange: list[Line] = field(default_factory=list)
    """The last lines of the exchange, unless the verdict is ``allowed``."""

    @property
    def exit_code(self) -> int:
        """The exit code of the command."""
        return {"allowed": 0, "diverges": 1, "error": 3, "cannot_tell": 4}[self.verdict]

    def as_dict(self) -> dict[str, object]:
        """The object in the output of ``--json``."""
        return asdict(self) | {"exit_code": self.exit_code}


def replay(
    path: Path,
    command: Sequence[str],
    out: Path,
    *,
    limit_s: float,
    seed: int,
) -> Replayed:
    """Give the inputs of a log to the adapter ``command``, and write the new log to ``out``.

    ``limit_s`` is the real time in seconds that an answer may take; ``seed`` is that of ``reset``.
    Raises BadInput and OSError.
    """
    found = survey(path)
    result = Replayed("allowed", str(path), total=found.inputs, notes=list(found.warnings))
    run: _Run | None = None
    try:
        require_replayable(found)
        with Process(command, limit_s=limit_s) as process:
            hello = protocol.read_hello(process.exchange([protocol.SAY_HELLO])[0])
            run = _Run(found, process, hello, result, out, seed)
            run.play()
            if problem := process.stop():
                result.notes.append(problem)
    except Diverges as d:
        wrong = d.finding
        result.verdict, result.event, result.rule = "diverges", wrong.observed, wrong.rule
        result.expected = transcript.answerable(wrong)
        result.guard, result.log_line = wrong.guard, wrong.at.line
    except CannotTell as error:
        result.verdict, result.event = "cannot_tell", str(error)
    except (AdapterError, protocol.ProtocolError) as error:
        result.verdict, result.event = "error", str(error)
        result.stderr = list(getattr(error, "stderr", ()))
    if run is not None:
        run.monitor.end("crash" if result.verdict == "error" else "clean")
    if result.verdict == "diverges":
        result.in_log = explain(read(result.log)).verdict == "diverges"
    if result.verdict == "allowed":
        result.exchange.clear()
    return result


class _Run:
    """One replay.  Keeps the last input and the counts in ``result``."""

    def __init__(
        self,
        found: Survey,
        process: Process,
        hello: protocol.HelloAnswer,
        result: Replayed,
        out: Path,
        seed: int,
    ) -> None:
        """Start a new station.  Raises the same errors as Monitor."""
        self._found, self._hello, self._result = found, hello, result
        header = found.header
        parameters, notes = found.parameters(hello.fixed, hello.features)
        result.notes += notes
        self._names = Renaming(header.station, found.numbers)
        self._now = found.first_ms
        self._expired_ms = -1
        """The time in ms at which a timer of the log last expired."""
        self._backoffs = found.backoffs if "durations" in hello.features else []
        self._skipped = 0
        files.folder(out, named=True)
        new = out / f"{found.path.stem}-replayed.ndjson"
        result.log = str(new)
        self.monitor = Monitor(
            header.station,
            process,
            new,
            result.exchange,
            hello,
            parameters,
            run=header.run,
            seed=seed,
            now=self._now,
        )

    def play(self) -> None:
        """Replay the whole log."""
        self._set_backoff()
        for line, event in LogStream(self._found.path):
            self._event(line, event)
        self._advance(self._found.last_ms)
        if self._skipped:
            text = f"{self._skipped} malformed messages cannot be given to an adapter: left out"
            self._result.notes.append(f"{text}, as a station discards them (END-5)")

    # -- the log

    def _event(self, line: int, event: Event) -> None:
        match event:
            case Send(message=m):
                self._names.logged(m)
            case TimerEnd(op="expire", t_ms=now):
                self._expired_ms = now
            case Receive() | ApplicationCommand() | Restart():
                self._input(line, event)

    def _input(self, line: int, event: Receive | ApplicationCommand | Restart) -> None:
        # Timers due at the time of a restart are lost unless the log has their expiry (END-8).
        lost = isinstance(event, Restart) and self._expired_ms != event.t_ms
        self._advance(event.t_ms - lost)
        given = self._line(event)
        if given is None:
            self._skipped += 1
            return
        command, raw = given
        self._result.line, self._result.input = line, transcript.said(command)
        self._result.inputs += 1
        self._give(event.t_ms, command, event.tx if isinstance(event, Receive) else None, raw)

    def _line(
        self, event: Receive | ApplicationCommand | Restart
    ) -> tuple[protocol.Object, str | None] | None:
        """The command for the adapter, and the base64 text for the log if a message is malformed.

        None if the adapter protocol cannot express the input.  Raises CannotTell.
        """
        if isinstance(event, Restart):
            self._needs("restart")
            return {"cmd": "restart"}, None
        if isinstance(event, ApplicationCommand):
            return self._command(event), None
        if event.raw is not None:
            malformed = _object(event.raw)
            if malformed is None or not problems(malformed):
                return None
            return {"cmd": "receive", "message": malformed}, event.raw
        m = event.message
        assert m is not None
        if problems(m):
            return {"cmd": "receive", "message": m}, base64.b64encode(to_json(m)).decode()
        command: protocol.Object = {"cmd": "receive", "message": self._names.message(m)}
        if event.planned is not None:
            self._needs("receiver")
            command["planned"] = event.planned
        return command, None

    def _command(self, event: ApplicationCommand) -> protocol.Object:
        renamed = self._names.command(
            {"name": event.command.name, **(event.command.model_extra or {})}
        )
        if need := protocol.NEEDS.get(event.command.name):
            self._needs(need)
        command = {"cmd": "command", "command": renamed}
        try:
            protocol.COMMAND.validate_python({**command, "now": event.t_ms})
        except ValidationError as error:
            place, problem = errors_of(error)[0]
            place = place.removeprefix(f"command.{renamed['name']}.")
            text = f"seq {event.seq}: command {renamed['name']} cannot be given to an adapter"
            raise CannotTell(f"{text}: {place}: {problem}") from None
        return command

    def _needs(self, feature: str) -> None:
        if feature not in self._hello.features:
            raise CannotTell(
                f"the log needs the feature {feature!r}, which the adapter does not have"
            )

    # -- the station

    def _advance(self, to: int) -> None:
        """Advance to ``to`` (ms) from deadline to deadline; timers due at ``to`` expire."""
        while True:
            due = self.monitor.deadline
            latest = self._now + MAX_STEP_MS
            at = latest if due is None else min(due, latest)
            if at > to:
                return
            self._give(max(at, self._now), {"cmd": "advance"})

    def _give(
        self, now: int, command: protocol.Object, tx: str | None = None, raw: str | None = None
    ) -> None:
        self._now = now
        self.monitor.give(now, command, tx, raw)
        del self._result.exchange[:-SHOWN]
        for _, m in self.monitor.sent:
            self._names.sent(m)
        self._set_backoff()

    def _set_backoff(self) -> None:
        """Give the next back-off the duration that it has in the log."""
        if self.monitor.backoffs < len(self._backoffs):
            ms = self._backoffs[self.monitor.backoffs]
            if ms != self.monitor.backoff:
                self.monitor.set_backoff(ms)


def _object(raw: str) -> protocol.Object | None:
    """The JSON object in these bytes, or None; None also for one that a line cannot contain."""
    try:
        value = from_json(base64.b64decode(raw, validate=True), allow_inf_nan=False)
        from_json(to_json(value), allow_inf_nan=False)  # 1e999 is infinite
    except ValueError:
        return None
    return value if isinstance(value, dict) else None
