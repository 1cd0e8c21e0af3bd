"""One run as a page shows it: its logs, what they are judged to be, and how its stations go on."""

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
from automcm_traces.viewer.page_follow import Followed, States

Json = Any
MOST_LOGS = 200
"""Beyond, what one log says of another takes too long to work out."""
MOST_EVENTS = 100_000
"""In all logs of a run.  Each takes 5 to 7 KB while the page is made."""
MOST_BYTES = 256 * 2**20
"""In all logs of a run, however few their events are."""
GHOSTS = 12
"""Stations without a log that have a column each; if there are more, all share one."""


class PageError(Exception):
    """What cannot be shown as a page; the text is one line."""


@dataclass(frozen=True, slots=True)
class Part:
    """What to show of logs: so many lines of the first one, and of each other log what stands
    between the first and the last message that was exchanged with them."""

    first: int
    last: int = sys.maxsize

    def __str__(self) -> str:
        if self.last == sys.maxsize:
            return f"from line {self.first} on"
        return f"in lines {self.first} to {self.last}"


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
    before: dict[str, int] = field(default_factory=dict)
    """By file, how many events of the log stand before what is shown of it."""
    note: str = ""
    """Which part is shown, in a sentence; empty if all is."""
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


def load(paths: Sequence[Path], late_ms: int | None = None, part: Part | None = None) -> Run:
    """Read and judge the logs of one run.  A log that cannot be read to its end is shown up to
    there; of one without a header there is only the verdict.

    Of a ``part``, only that is held in memory. Each verdict is still the one on the whole log, but
    the logs are not judged together.

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
        merged = merge([_unpromised(log) if part else log for _, log in logs])
    except MergeError as error:
        raise PageError(str(error)) from None
    alone = [one.verdict for one in found]
    judged = part is None and len(paths) > 1
    named = sorted(_named(merged) - set(merged.stations))
    crowded = len(named) > GHOSTS
    of_file = {log.file: (path, log) for path, log in logs}
    followed = [states[of_file[log.file][0]].followed(of_file[log.file][1]) for log in merged.logs]
    vendor = {file: _vendor(path, log, part) for file, (path, log) in of_file.items()}
    ghosts = [] if crowded else named
    run = Run(
        merged,
        verdicts(found) if judged else alone,
        together(found) if judged else None,
        followed,
        ghosts,
        crowded,
        vendor,
        note=note,
    )
    run.before = {file: _before(log) for file, (_, log) in of_file.items()}
    return run


def check_size(paths: Sequence[Path]) -> None:
    """Refuse logs that are too long for a page, before any of them is held in memory.

    Raises PageError, and BadInput for what cannot be read.
    """
    lines = size = 0
    for path in paths:
        try:
            if not S_ISREG(os.stat(path).st_mode):
                raise BadInput(path, 0, "", "is no file; a page reads a log more than once")
            with open(path, "rb") as stream:
                while block := stream.read(2**20):
                    lines += block.count(b"\n")
                    size += len(block)
        except FileNotFoundError:
            continue  # its verdict says so
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
    """What is shown of each log, and which lines those are.

    Raises PageError if that is nothing, or too much, and BadInput if the first has no header.
    """
    first = paths[0]
    own = _lines(first, part.first, part.last, 0)
    if not own.events:
        raise PageError(f"{name_of(first)}: no event that can be read {part}")
    exchanged = {tx for _, event in own.events if (tx := _tx(event))}
    logs = [(first, own)]
    without = []
    for path in paths[1:]:
        try:
            at = [line for line, event in _readable(LogStream(path)) if _tx(event) in exchanged]
        except BadInput:
            continue  # its verdict says so
        if at:
            held = sum(len(log.events) for _, log in logs)
            logs.append((path, _lines(path, at[0], at[-1], held)))
        else:
            without.append(name_of(path))
    shown = ", ".join(
        f"{log.file} lines {log.events[0][0]} to {log.events[-1][0]}" for _, log in logs
    )
    note = f"A part: {shown}. Each log is judged as a whole, and by itself."
    if without:
        note += f" No message of these lines is in {', '.join(without)}."
    return logs, note


def _lines(path: Path, first: int, last: int, held: int) -> Log:
    """The events in these lines; ``held`` are in memory already.  Raises PageError, BadInput."""
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
    """The events up to where the log can be read; its verdict says where and why."""
    try:
        yield from stream
    except BadInput:
        return


def _tx(event: Event) -> str | None:
    return event.tx if isinstance(event, Send | Receive) else None


def _unpromised(log: Log) -> Log:
    """A part of a log: what is missing in it may stand before or after."""
    return replace(log, header=log.header.model_copy(update={"complete": []}))


def _before(log: Log) -> int:
    return log.events[0][1].seq - 1 if log.events else 0


def _vendor(path: Path, log: Log, part: Part | None) -> dict[int, Json]:
    """The records of a log that may have a field of a vendor, which reading leaves out; of a part
    also the header as it stands there."""
    found = {}
    lines = {1, *(at for at, _ in log.events)}
    with open(path, "rb") as stream:
        for at, line in enumerate(islice(stream, max(lines)), 1):
            if (b'"x_' in line and at in lines) or (part is not None and at == 1):
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
