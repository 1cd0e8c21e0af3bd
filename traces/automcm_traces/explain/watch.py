"""Judges logs while they are written: each event once, in constant memory.

The verdict on each log is that of ``explain``. Several logs are judged together once all have
ended: what one log lacks before that may still come.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from automcm_spec.log_format.event_text import starts
from automcm_spec.log_format.growing_file import GrowingFile, LineBuffer
from automcm_spec.log_format.reader import GrowingLog, LogStream
from automcm_spec.support.bad_input import BadInput, name_of, printable
from automcm_traces.checker.finding import unreadable
from automcm_traces.explain import explain
from automcm_traces.explain.explain import Verdict, VerdictCheck
from automcm_traces.system.properties import SystemReport

What = Literal["begun", "note", "waiting", "verdict", "together", "end"]


@dataclass(frozen=True, slots=True)
class WatchReport:
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
        self._late_ms = late_ms
        self._entries = GrowingLog(file, lines)
        self._log: LogStream | None = None
        self._check: VerdictCheck | None = None

    @property
    def first_ms(self) -> int | None:
        """The time of the first event."""
        return None if self._check is None else self._check.first_ms

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
        self._check = VerdictCheck(self._log, self._late_ms, most=explain.SESSIONS)
        return self._log

    def read(self, last: bool = False) -> None:
        """Check the events that are there; with ``last``, no more will come. Sets the verdict when
        the log is over."""
        log, check = self._log, self._check
        if log is None or check is None or self.verdict is not None:
            return
        check.feed_all(log)
        if last or check.over or log.ended or log.gap is not None:
            check.end()
            self.verdict = check.verdict()

    def finish(self) -> None:
        """Take what there is as the whole log; sets the verdict."""
        if self.verdict is not None:
            return
        if isinstance(self.lines, GrowingFile) and not self.lines.open():
            error = BadInput(self.file, 0, "", "no such file")
            self.verdict = Verdict(self.file, unreadable(error))
            return
        self.lines.finish()
        self._entries.finish()
        self.begin()
        self.read(last=True)


class Watch:
    """The logs of one run that are being written."""

    def __init__(self, late_ms: int | None = None) -> None:
        self.logs: list[WatchedLog] = []
        """The logs that are not over."""
        self.verdicts: list[Verdict] = []
        """The verdicts on the logs that are over."""
        self._late_ms = late_ms
        self._paths: dict[Path, None] = {}
        """Where each log can be read again."""
        self._together: SystemReport | None = None

    def add(self, path: Path, lines: LineBuffer) -> WatchedLog:
        """Watch another log. Its lines come from ``lines``; ``path`` has them all at the end."""
        log = WatchedLog(name_of(path), lines, self._late_ms)
        self.logs.append(log)
        self._paths[path] = None
        return log

    @property
    def over(self) -> bool:
        """Whether each log has its verdict."""
        return bool(self.verdicts) and not self.logs

    def advance(self) -> list[WatchReport]:
        """Read what there is, and report what it shows."""
        reports = [*self._begun()]
        for log in self.logs:
            log.read()
        return [*reports, *self._over()]

    def finish(self) -> list[WatchReport]:
        """End the logs where they are; report their verdicts, of several logs also those on forged
        messages, and the one on all together."""
        reports = self.advance()
        for log in self.logs:
            log.finish()
        reports += self._over()
        if len(self._paths) > 1:
            found = explain.judged_logs(list(self._paths), self._late_ms)
            again, self._together = explain.verdicts_together(found)
            start_ms = self._start_ms
            for v in again:
                if v.finding.kind == "forged":
                    self.verdicts.append(v)
                    reports.append(WatchReport("verdict", explain.text(v, start_ms), v.as_dict()))
            text = self._together.text(start_ms)
            reports.append(WatchReport("together", text, self._together.as_dict()))
        return reports

    def end(self, log: WatchedLog) -> list[WatchReport]:
        """End one log where it is."""
        reports = self.advance()
        log.finish()
        return [*reports, *self._over()]

    @property
    def exit_code(self) -> int:
        """The exit code of ``explain`` for the verdicts so far."""
        return explain.exit_code(self.verdicts, self._together)

    @property
    def _start_ms(self) -> dict[str, int]:
        logs: list[Verdict | WatchedLog] = [*self.verdicts, *self.logs]
        return starts({log.file: log.first_ms for log in logs if log.first_ms is not None})

    def _begun(self) -> Iterator[WatchReport]:
        for log in self.logs:
            if (stream := log.begin()) is None:
                continue
            run, station = stream.header.run, stream.header.station
            text = printable(f"{log.file}: station {station}, run {run}")
            yield WatchReport("begun", text, {"file": log.file, "station": station, "run": run})

    def _over(self) -> Iterator[WatchReport]:
        over = [log for log in self.logs if log.verdict is not None]
        start_ms = self._start_ms
        self.logs = [log for log in self.logs if log.verdict is None]
        for verdict in (log.verdict for log in over):
            assert verdict is not None, "selected above"
            self.verdicts.append(verdict)
            yield WatchReport("verdict", explain.text(verdict, start_ms), verdict.as_dict())


def note(file: str, text: str) -> WatchReport:
    """A note about a file."""
    return WatchReport("note", printable(f"{file}: {text}"), {"file": file, "text": text})
