"""One run for a page: its logs, their verdicts, and the states of its stations."""

from __future__ import annotations

import json
import sys
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from itertools import islice, takewhile
from pathlib import Path
from typing import Any

from automcm_spec.log_format.log import Receive, Send
from automcm_spec.log_format.reader import Log, LogStream
from automcm_spec.support.bad_input import BadInput
from automcm_traces.checker.follow import Check
from automcm_traces.explain.explain import JudgedLog, Verdict, judged_log, verdicts_together
from automcm_traces.system.fates import ANYONE
from automcm_traces.system.log_merge import Merged, MergeError, merge
from automcm_traces.system.properties import SystemReport
from automcm_traces.viewer.page_follow import StateHistory, States
from automcm_traces.viewer.page_part import CHOOSE, PageError, PagePart, around, parts, too_long

Json = Any
MOST_LOGS = 200
"""With more logs, comparing all pairs of logs takes too long."""
GHOSTS = 12
"""The maximum number of stations without a log that have their own column; if there are more, all
share one."""


@dataclass(slots=True)
class PageRun:
    """The data of one run."""

    merged: Merged
    verdicts: list[Verdict]
    """In the order of the given logs."""
    system: SystemReport | None
    """The report on several logs together."""
    histories: list[StateHistory]
    """By log."""
    ghosts: list[int] = field(default_factory=list)
    """Stations without a log that have their own column, after the logs."""
    crowded: bool = False
    """Whether they are too many and share one column."""
    vendor: dict[str, dict[int, Json]] = field(default_factory=dict)
    """By file and line, the original records that contain vendor fields."""
    note: str = ""
    """The part shown, in a sentence; empty if all is shown."""
    counterexample: Json = None
    """What it shows, if it is a counterexample (page_counterexample.py)."""

    @property
    def logs(self) -> Sequence[Log]:
        """The logs, by station."""
        return self.merged.logs

    @property
    def title(self) -> str:
        """The title of the page."""
        if self.counterexample is not None:
            return f"{self.counterexample['model']}, counterexample found by TLC"
        stations = self.merged.stations
        some = ", ".join(map(str, stations[:4])) + (", …" if stations[4:] else "")
        return f"{self.merged.run}: {some}"

    def judged(self) -> dict[str, Json]:
        """The verdicts, and the report on all logs together."""
        return {
            "logs": [verdict.as_dict() for verdict in self.verdicts],
            "system": None if self.system is None else self.system.as_dict(),
        }


def load(
    paths: Sequence[Path], late_ms: int | None = None, part: PagePart | None = None
) -> PageRun:
    """Read and check the logs of one run.

    A log that cannot be read to its end is shown up to there. For a log without a header there is
    only the verdict. With a ``part``, only that part is kept in memory; each verdict is still for
    the whole log, but the logs are not checked together. Logs that are too long are shown in part:
    around the first divergence, or from the start.

    Raises PageError, and BadInput if no log has a header.
    """
    if len(paths) > MOST_LOGS:
        raise PageError(f"{len(paths)} logs; a page shows at most {MOST_LOGS}")
    logs: list[tuple[Path, Log]] = []
    found: list[JudgedLog] = []
    note = reason = ""
    if part is not None:
        logs, note = parts(paths, part)
    elif reason := too_long(paths):
        found = [judged_log(path, late_ms, keep=False) for path in paths]
        ordered, part = around(found)
        logs, note = parts(ordered, part)
        note += f" {reason}. {CHOOSE.capitalize()} to see another."
    lines = {path: range(log.events[0][0], log.events[-1][0] + 1) for path, log in logs}
    every = range(sys.maxsize) if part is None else range(0)
    states = {path: States(lines.get(path, every)) for path in paths}
    if reason:
        for path, span in lines.items():
            _until(path, span[-1], late_ms, states[path])
    else:
        known: dict[str, Send | Receive] = {}
        keep = part is None
        found = [judged_log(path, late_ms, keep, [states[path]], known) for path in paths]
    if part is None:
        logs = [(one.path, one.log) for one in found if one.log is not None]
        refused = [one.refused for one in found if one.refused is not None]
        if refused and not logs:
            raise refused[0]
    try:
        # In a part of a log, any event may be missing.
        change: dict[str, object] = {"complete": ()} if part else {}
        copies = [replace(log, header=log.header.model_copy(update=change)) for _, log in logs]
        merged = merge(copies)
    except MergeError as error:
        raise PageError(str(error)) from None
    judged, system = [one.verdict for one in found], None
    if part is None and len(paths) > 1:
        judged, system = verdicts_together(found)
    drawn = {station for a in merged.arrows() for station in (a.source, a.to)}
    named = sorted(drawn - {*merged.stations, ANYONE})
    crowded = len(named) > GHOSTS
    of_file = {log.file: (path, log) for path, log in logs}
    histories = [states[of_file[log.file][0]].history(of_file[log.file][1]) for log in merged.logs]
    vendor = {file: _vendor(path, log, part) for file, (path, log) in of_file.items()}
    ghosts = [] if crowded else named
    return PageRun(merged, judged, system, histories, ghosts, crowded, vendor, note)


def check_size(paths: Sequence[Path]) -> None:
    """Reject logs that are too long for a page, before reading them into memory.

    Raises PageError, and BadInput for an unreadable file.
    """
    if reason := too_long(paths):
        raise PageError(f"{reason}: {CHOOSE}")


def _until(path: Path, last: int, late_ms: int | None, states: States) -> None:
    """Record the states of a log up to a line."""
    stream = LogStream(path)
    with suppress(BadInput):
        Check(stream, late_ms, [states]).read(takewhile(lambda e: e[0] <= last, stream))


def _vendor(path: Path, log: Log, part: PagePart | None) -> dict[int, Json]:
    """The records of a log that may contain vendor fields, which the reader ignores; for a part,
    also the original header."""
    found = {}
    lines = {1, *(at for at, _ in log.events)}
    with open(path, "rb") as stream:
        for at, line in enumerate(islice(stream, max(lines)), 1):
            vendor = b'"x_' in line and at in lines and not _is_plain_cam(line)
            if vendor or (part is not None and at == 1):
                found[at] = json.loads(line)
    return found


def _is_plain_cam(line: bytes) -> bool:
    """Whether the only field of a line that looks like a vendor field is ``x_mm`` of a CAM."""
    return b'"CAM"' in line and b'"x_mm"' in line and line.count(b'"x_') == 1
