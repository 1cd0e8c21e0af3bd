"""One run as a page shows it: its logs, what they are judged to be, and how its stations go on."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from automcm_traces.clocks import Clocks
from automcm_traces.explain import Verdict, explain_files, together
from automcm_traces.log import Event, Receive, Send
from automcm_traces.merge import Merged, MergeError, merge
from automcm_traces.page_follow import Followed, follow
from automcm_traces.properties import SystemReport
from automcm_traces.reader import Log, LogError, LogStream

Json = Any
MOST_LOGS = 200
"""Beyond, what one log says of another takes too long to work out."""
MOST_EVENTS = 1_000_000
"""Beyond, a browser cannot hold the page."""
GHOSTS = 12
"""Stations without a log that have a column each; if there are more, all share one."""


class PageError(Exception):
    """What cannot be shown as a page; the text is one line."""


@dataclass(slots=True)
class Run:
    """What a page shows of one run."""

    merged: Merged
    verdicts: list[Verdict]
    """In the order in which the logs were given."""
    system: SystemReport | None
    """What several logs say together."""
    followed: list[Followed]
    """By log."""
    ghosts: list[int] = field(default_factory=list)
    """Stations without a log that have a column of their own, after the logs."""
    crowded: bool = False
    """There are too many of them: one column for all."""
    vendor: dict[str, dict[int, Json]] = field(default_factory=dict)
    """By file and line: records with fields of a vendor, as they stand there."""
    renamed: tuple[str, str] = ("", "")
    """What stands before the names of the files, and what is shown instead."""

    @property
    def logs(self) -> Sequence[Log]:
        """Of the stations."""
        return self.merged.logs

    @property
    def title(self) -> str:
        """For the head of the page."""
        stations = self.merged.stations
        some = ", ".join(map(str, stations[:4])) + (", …" if stations[4:] else "")
        return f"{self.merged.run}: {some}"

    def ahead(self) -> list[int]:
        """By log how many ms its clock is most likely ahead of the first one's."""
        if len(self.logs) == 1:
            return [0]
        clocks = Clocks(self.merged)
        spans = [clocks.ahead(0, i) for i in range(len(self.logs))]
        return [0 if span is None else span.best for span in spans]

    def judged(self) -> dict[str, Json]:
        """The verdicts, the report on all logs together, and its hazards in words."""
        found: dict[str, Json] = self.shown(
            {
                "logs": [verdict.as_dict() for verdict in self.verdicts],
                "system": None if self.system is None else self.system.as_dict(),
            }
        )
        return found

    def shown(self, value: Json) -> Json:
        """``value`` with the names of files as they are to be shown."""
        was, name = self.renamed
        if not was:
            return value
        if isinstance(value, dict):
            return {key: self.shown(item) for key, item in value.items()}
        if isinstance(value, list):
            return [self.shown(item) for item in value]
        return value.replace(was, name) if isinstance(value, str) else value


def load(paths: Sequence[Path], late_ms: int | None = None) -> Run:
    """Read and judge the logs of one run.  A log that cannot be read to its end is shown up to
    there; of one without a header there is only the verdict.

    Raises PageError, LogError if no log has a header, and automcm_spec.oracle.OracleError if
    there is no oracle.
    """
    if len(paths) > MOST_LOGS:
        raise PageError(f"{len(paths)} logs; a page shows at most {MOST_LOGS}")
    logs, refused = [], []
    for path in paths:
        try:
            logs.append(_whole(path))
        except LogError as error:
            refused.append(error)  # its verdict says so
    if refused and not logs:
        raise refused[0]
    if sum(len(log.events) for log in logs) > MOST_EVENTS:
        raise PageError(f"more than {MOST_EVENTS} events; a page shows no more")
    try:
        merged = merge(logs)
    except MergeError as error:
        raise PageError(str(error)) from None
    verdicts = explain_files(paths, late_ms)
    system = together(paths) if len(paths) > 1 else None
    named = sorted(_named(merged) - set(merged.stations))
    crowded = len(named) > GHOSTS
    followed = [follow(log) for log in merged.logs]
    vendor = {log.file: _vendor(log) for log in merged.logs}
    return Run(merged, verdicts, system, followed, [] if crowded else named, crowded, vendor)


def _whole(path: Path) -> Log:
    """The log in a file, up to where it can be read."""
    stream = LogStream(path)
    events: list[tuple[int, Event]] = []
    try:
        for entry in stream:
            events.append(entry)
            if len(events) > MOST_EVENTS:
                raise PageError(f"{path}: more than {MOST_EVENTS} events; a page shows no more")
    except LogError:
        pass  # its verdict says where and why
    return Log(
        stream.file, stream.header, events, stream.end, stream.truncated, list(stream.warnings)
    )


def _vendor(log: Log) -> dict[int, Json]:
    """The records of a log that may have a field of a vendor, which reading leaves out."""
    found = {}
    lines = {1, *(at for at, _ in log.events)}
    with open(log.file, "rb") as stream:
        for at, line in enumerate(stream, 1):
            if b'"x_' in line and at in lines:
                found[at] = json.loads(line)
    return found


def _named(merged: Merged) -> set[int]:
    """Every station that sent or is sent a message."""
    found: set[int] = set()
    for log in merged.logs:
        for _, event in log.events:
            m = event.message if isinstance(event, Send | Receive) else None
            for name in ("src", "dst") if m is not None else ():
                value = m.get(name) if m is not None else None
                if type(value) is int and value > 0:
                    found.add(value)
    return found
