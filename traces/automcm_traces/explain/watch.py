"""Judges logs while they are written: each event once, in constant memory.

The verdict on each log is that of ``explain``. Hazards between several logs are reported as soon as
the logs show them; the other properties of the system need the complete logs.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any, Literal

from automcm_spec.support.bad_input import BadInput, printable
from automcm_traces.checker.finding import unreadable
from automcm_traces.checker.follow import Check
from automcm_traces.explain import explain
from automcm_traces.explain.explain import Noted, Verdict
from automcm_traces.format.event_text import starts
from automcm_traces.format.growing_file import GrowingFile, LineBuffer
from automcm_traces.format.log import Event
from automcm_traces.format.reader import GrowingLog, LogStream
from automcm_traces.system.hazards import Hazard
from automcm_traces.system.live_hazards import LiveHazards, Window

STEP_MS = 200
"""Logs that are behind are read in steps of this many ms of their clocks."""
What = Literal["begun", "note", "waiting", "hazard", "withdrawn", "verdict", "end"]


@dataclass(frozen=True, slots=True)
class Report:
    """One thing to report."""

    what: What
    text: str
    """One line or more; the first names the file and the line."""
    fields: dict[str, Any]

    def as_dict(self) -> dict[str, Any]:
        """The ``--json`` form."""
        return {"report": self.what} | self.fields


class WatchedLog:
    """One log that is being written. The lines come from ``lines``."""

    def __init__(self, file: str, lines: LineBuffer, late_ms: int | None = None) -> None:
        self.file, self.lines = file, lines
        self.verdict: Verdict | None = None
        """The verdict, once the log is over."""
        self.window: Window | None = None
        self.t_ms = 0
        self._late_ms = late_ms
        self._entries = GrowingLog(file, lines)
        self._noted: Noted | None = None
        self._log: LogStream | None = None
        self._check: Check | None = None
        self._events: Iterator[tuple[int, Event]] = iter(())
        self._exhausted = True
        """Whether ``_events`` had no further event."""

    @property
    def first_ms(self) -> int | None:
        """The time of the first event."""
        return None if self._noted is None else self._noted.first_ms

    def begin(self) -> LogStream | None:
        """The log, when its header has come for the first time."""
        if self._log is not None or self.verdict is not None:
            return None
        try:
            self._log = LogStream(self.file, entries=self._entries)
        except StopIteration:
            return None
        except BadInput as error:
            self.verdict = Verdict(self.file, unreadable(error))
            return None
        self.window = Window(self._log)
        self._noted = Noted(self._log, explain.SESSIONS)
        watchers = [*self._noted.watchers, self.window]
        self._check = Check(self._log, self._late_ms, watchers)
        return self._log

    def read(self, until_ms: int | None) -> bool:
        """Check the events that are there, up to the first after ``until_ms``; whether there may be
        more. Sets the verdict when the log is over."""
        log, check = self._log, self._check
        if log is None or check is None or self.verdict is not None:
            return False
        if self._exhausted:
            self._events, self._exhausted = iter(log), False
        try:
            while not check.over and (until_ms is None or self.t_ms <= until_ms):
                at, event = next(self._events)
                self.t_ms = event.t_ms
                check.feed(at, event)
        except StopIteration:
            self._exhausted = True
            if log.ended or log.gap is not None:
                self._end(check)
            return False
        except BadInput as error:
            check.stop(unreadable(error))
        if check.over:
            self._end(check)
        return not check.over

    def finish(self) -> None:
        """Take what there is as the whole log; sets the verdict."""
        if self.verdict is not None:
            return
        if isinstance(self.lines, GrowingFile) and not self.lines.open():
            self.verdict = Verdict(
                self.file, unreadable(BadInput(self.file, 0, "", "no such file"))
            )
            return
        self.lines.finish()
        self._entries.finish()
        self.begin()
        while self.read(None):
            pass
        if self._check is not None and self.verdict is None:
            self._end(self._check)

    def _end(self, check: Check) -> None:
        assert self._noted is not None, "the check has begun"
        self.verdict = self._noted.verdict(check.end())


class Watch:
    """The logs of one run that are being written."""

    def __init__(self, late_ms: int | None = None) -> None:
        self.logs: list[WatchedLog] = []
        """The logs that are not over."""
        self.verdicts: list[Verdict] = []
        """The verdicts on the logs that are over."""
        self._late_ms = late_ms
        self._hazards = LiveHazards()
        self._problem = ""
        self._first_ms: dict[str, int] = {}

    def add(self, file: str, lines: LineBuffer) -> WatchedLog:
        """Watch another log."""
        log = WatchedLog(file, lines, self._late_ms)
        self.logs.append(log)
        return log

    @property
    def over(self) -> bool:
        """Whether no log goes on: each has its verdict, or its station has stopped."""
        stopped = self._hazards.silent
        return bool(self.verdicts) and all(
            log.window is not None and log.window.made.station in stopped for log in self.logs
        )

    def advance(self) -> list[Report]:
        """Read what there is, and report what it shows."""
        reports = [*self._begun()]
        more = list(self.logs)
        while more:
            until_ms = min(log.t_ms for log in more) + STEP_MS
            more = [log for log in more if log.read(until_ms)]
            self._first_ms |= {
                log.file: log.first_ms for log in self.logs if log.first_ms is not None
            }
            reports += self._system()
            reports += self._over()
        return reports

    def finish(self) -> list[Report]:
        """End the logs where they are, and report their verdicts."""
        reports = self.advance()
        for log in self.logs:
            log.finish()
        return [*reports, *self._over(), *self._system()]

    def end(self, log: WatchedLog) -> list[Report]:
        """End one log where it is, and judge the others without it from now on."""
        reports = self.advance()
        log.finish()
        reports += [*self._over(), *self._system()]
        if log.window is not None:
            self._hazards.remove(log.window)
        return reports

    @property
    def exit_code(self) -> int:
        """The exit code of ``explain`` for the verdicts so far."""
        return 1 if self._hazards.violated else explain.exit_code(self.verdicts)

    @property
    def _start_ms(self) -> dict[str, int]:
        return starts(self._first_ms)

    def _begun(self) -> Iterator[Report]:
        for log in self.logs:
            if (stream := log.begin()) is None or log.window is None:
                continue
            self._hazards.add(log.window)
            run, station = stream.header.run, stream.header.station
            text = printable(f"{log.file}: station {station}, run {run}")
            yield Report("begun", text, {"file": log.file, "station": station, "run": run})

    def _over(self) -> Iterator[Report]:
        over = [log for log in self.logs if log.verdict is not None]
        self.logs = [log for log in self.logs if log.verdict is None]
        for verdict in (log.verdict for log in over):
            assert verdict is not None, "selected above"
            self.verdicts.append(verdict)
            yield Report("verdict", explain.text(verdict, self._start_ms), verdict.as_dict())

    def _system(self) -> Iterator[Report]:
        new, withdrawn = self._hazards.found()
        for one in new:
            yield Report("hazard", _hazard(one, self._start_ms), one.as_dict())
        for one in withdrawn:
            text = f"{one.since}: withdrawn: the log of station {one.target} shows no hazard"
            yield Report("withdrawn", printable(text), one.as_dict())
        if self._hazards.problem != self._problem:
            self._problem = self._hazards.problem
            text = f"together: CANNOT TELL: {self._problem}"
            yield Report("note", printable(text), {"text": text})


def note(file: str, text: str) -> Report:
    """A note about a file."""
    return Report("note", printable(f"{file}: {text}"), {"file": file, "text": text})


def _hazard(one: Hazard, start_ms: Mapping[str, int]) -> str:
    state = "so far" if one.open else "over"
    text = f"{one.until}: {state}: {one.text(start_ms)}"
    return "\n".join(map(printable, text.split("\n")))
