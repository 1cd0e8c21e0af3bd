"""One run for a page: its logs, their verdicts, and the states of its stations."""

from __future__ import annotations

import json
import os
import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from itertools import islice
from pathlib import Path
from stat import S_ISREG
from typing import Any

from automcm_spec.support.bad_input import BadInput, name_of
from automcm_traces.explain.explain import Verdict, explained, together, verdicts
from automcm_traces.format.log import Event, Receive, Send
from automcm_traces.format.reader import Log, LogStream
from automcm_traces.system.clock_offsets import Clocks
from automcm_traces.system.log_merge import Merged, MergeError, merge
from automcm_traces.system.properties import SystemReport
from automcm_traces.viewer.page_follow import StateHistory, States

Json = Any
MOST_LOGS = 200
"""With more logs, comparing all pairs of logs takes too long."""
MOST_EVENTS = 100_000
"""In all logs of a run. Each event takes 5 to 7 KB while the page is made."""
MOST_BYTES = 256 * 2**20
"""In all logs of a run, whatever the number of events."""
GHOSTS = 12
"""The maximum number of stations without a log that have their own column; if there are more, all
share one."""


class PageError(Exception):
    """The logs cannot be shown as a page; the text is one line."""


@dataclass(frozen=True, slots=True)
class Part:
    """The part of the logs to show: a range of lines of the first log, and of each other log the
    lines between the first and the last message exchanged with that range."""

    first: int
    last: int = sys.maxsize

    def __str__(self) -> str:
        if self.last == sys.maxsize:
            return f"from line {self.first} on"
        return f"in lines {self.first} to {self.last}"


@dataclass(slots=True)
class Run:
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
    before: dict[str, int] = field(default_factory=dict)
    """By file, the number of events of the log before the part shown."""
    note: str = ""
    """The part shown, in a sentence; empty if all is shown."""
    renamed: tuple[str, str] = ("", "")
    """A prefix of file names, and its replacement."""

    @property
    def logs(self) -> Sequence[Log]:
        """The logs, by station."""
        return self.merged.logs

    @property
    def title(self) -> str:
        """The title of the page."""
        stations = self.merged.stations
        some = ", ".join(map(str, stations[:4])) + (", …" if stations[4:] else "")
        return f"{self.merged.run}: {some}"

    def ahead(self) -> list[int]:
        """For each log, how many ms its clock is most likely ahead of the first one."""
        if len(self.logs) == 1:
            return [0]
        clocks = Clocks(self.merged)
        spans = [clocks.ahead(0, i) for i in range(len(self.logs))]
        return [0 if span is None else span.best for span in spans]

    def judged(self) -> dict[str, Json]:
        """The verdicts, and the report on all logs together."""
        found: dict[str, Json] = self.shown(
            {
                "logs": [verdict.as_dict() for verdict in self.verdicts],
                "system": None if self.system is None else self.system.as_dict(),
            }
        )
        return found

    def shown(self, value: Json) -> Json:
        """``value`` with file names replaced for display."""
        was, name = self.renamed
        if not was:
            return value
        if isinstance(value, dict):
            return {key: self.shown(item) for key, item in value.items()}
        if isinstance(value, list):
            return [self.shown(item) for item in value]
        return value.replace(was, name) if isinstance(value, str) else value


def load(paths: Sequence[Path], late_ms: int | None = None, part: Part | None = None) -> Run:
    """Read and check the logs of one run.

    A log that cannot be read to its end is shown up to there. For a log without a header there is
    only the verdict. With a ``part``, only that part is kept in memory; each verdict is still for
    the whole log, but the logs are not checked together.

    Raises PageError, and BadInput if no log has a header.
    """
    if len(paths) > MOST_LOGS:
        raise PageError(f"{len(paths)} logs; a page shows at most {MOST_LOGS}")
    logs: list[tuple[Path, Log]] = []
    note = ""
    if part is None:
        check_size(paths)
    else:
        logs, note = _parts(paths, part)
    lines = {path: range(log.events[0][0], log.events[-1][0] + 1) for path, log in logs}
    every = range(sys.maxsize) if part is None else range(0)
    states = {path: States(lines.get(path, every)) for path in paths}
    found = [explained(path, late_ms, part is None, [states[path]]) for path in paths]
    if part is None:
        logs = [(one.path, one.log) for one in found if one.log is not None]
        refused = [one.refused for one in found if one.refused is not None]
        if refused and not logs:
            raise refused[0]
    try:
        merged = merge([_unpromised(log) if part or log.mid_session else log for _, log in logs])
    except MergeError as error:
        raise PageError(str(error)) from None
    alone = [one.verdict for one in found]
    judged = part is None and len(paths) > 1
    named = sorted(_named(merged) - set(merged.stations))
    crowded = len(named) > GHOSTS
    of_file = {log.file: (path, log) for path, log in logs}
    histories = [states[of_file[log.file][0]].history(of_file[log.file][1]) for log in merged.logs]
    vendor = {file: _vendor(path, log, part) for file, (path, log) in of_file.items()}
    ghosts = [] if crowded else named
    run = Run(
        merged,
        verdicts(found) if judged else alone,
        together(found) if judged else None,
        histories,
        ghosts,
        crowded,
        vendor,
        note=note,
    )
    run.before = {file: _before(log) for file, (_, log) in of_file.items()}
    return run


def check_size(paths: Sequence[Path]) -> None:
    """Reject logs that are too long for a page, before reading them into memory.

    Raises PageError, and BadInput for an unreadable file.
    """
    lines = size = 0
    for path in paths:
        try:
            if not S_ISREG(os.stat(path).st_mode):
                raise BadInput(path, 0, "", "must be a regular file: it is read more than once")
            with open(path, "rb") as stream:
                while block := stream.read(2**20):
                    lines += block.count(b"\n")
                    size += len(block)
        except FileNotFoundError:
            continue  # reported by its verdict
        except OSError as error:
            raise BadInput(path, 0, "", f"cannot be read: {error.strerror}") from None
    what = name_of(paths[0]) if len(paths) == 1 else f"{len(paths)} logs"
    choose = "choose a part of the first log with --from-line and --to-line"
    if lines - 2 * len(paths) > MOST_EVENTS:
        most = f"a page shows at most {MOST_EVENTS:,} events"
        raise PageError(f"{what}: {lines:,} lines; {most}: {choose}")
    if size > MOST_BYTES:
        most = f"a page shows at most {MOST_BYTES >> 20} MiB"
        raise PageError(f"{what}: {size >> 20} MiB; {most}: {choose}")


def _parts(paths: Sequence[Path], part: Part) -> tuple[list[tuple[Path, Log]], str]:
    """The part of each log to show, and a sentence about it.

    Raises PageError if the part is empty or too large, and BadInput if the first log has no header.
    """
    first = paths[0]
    own = _lines(first, part.first, part.last, 0)
    if not own.events:
        raise PageError(f"{name_of(first)}: no readable event {part}")
    exchanged = {tx for _, event in own.events if (tx := _tx(event))}
    logs = [(first, own)]
    without = []
    for path in paths[1:]:
        try:
            at = [line for line, event in _readable(LogStream(path)) if _tx(event) in exchanged]
        except BadInput:
            continue  # reported by its verdict
        if at:
            held = sum(len(log.events) for _, log in logs)
            logs.append((path, _lines(path, at[0], at[-1], held)))
        else:
            without.append(name_of(path))
    shown = ", ".join(
        f"{log.file} lines {log.events[0][0]} to {log.events[-1][0]}" for _, log in logs
    )
    note = f"A part: {shown}. Each verdict is for the whole log by itself."
    if without:
        note += f" No message of these lines is in {', '.join(without)}."
    return logs, note


def _lines(path: Path, first: int, last: int, held: int) -> Log:
    """The events in these lines; ``held`` is the number already in memory. Raises PageError,
    BadInput."""
    stream = LogStream(path)
    events: list[tuple[int, Event]] = []
    for line, event in _readable(stream):
        if line > last:
            break
        if line >= first:
            events.append((line, event))
            if len(events) + held > MOST_EVENTS:
                most = f"a page shows at most {MOST_EVENTS:,}"
                raise PageError(f"more than {MOST_EVENTS:,} events in this part; {most}")
    return stream.log(events)


def _readable(stream: LogStream) -> Iterator[tuple[int, Event]]:
    """The readable events of a log; its verdict reports why it stops."""
    try:
        yield from stream
    except BadInput:
        return


def _tx(event: Event) -> str | None:
    return event.tx if isinstance(event, Send | Receive) else None


def _unpromised(log: Log) -> Log:
    """The log with an empty ``complete``: in a part of a log, any event may be missing."""
    return replace(log, header=log.header.model_copy(update={"complete": ()}))


def _before(log: Log) -> int:
    return log.events[0][1].seq - 1 if log.events else 0


def _vendor(path: Path, log: Log, part: Part | None) -> dict[int, Json]:
    """The records of a log that may contain vendor fields, which the reader ignores; for a part,
    also the original header."""
    found = {}
    lines = {1, *(at for at, _ in log.events)}
    with open(path, "rb") as stream:
        for at, line in enumerate(islice(stream, max(lines)), 1):
            if (b'"x_' in line and at in lines) or (part is not None and at == 1):
                found[at] = json.loads(line)
    return found


def _named(merged: Merged) -> set[int]:
    """All stations that sent a message or are addressed by one."""
    found: set[int] = set()
    for log in merged.logs:
        for _, event in log.events:
            m = event.message if isinstance(event, Send | Receive) else None
            for name in ("src", "dst") if m is not None else ():
                value = m.get(name) if m is not None else None
                if type(value) is int and value > 0:
                    found.add(value)
    return found
