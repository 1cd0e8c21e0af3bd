"""The part of long logs that a page shows."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from stat import S_ISREG

from automcm_spec.log_format.event_text import session_of
from automcm_spec.log_format.log import Event, Receive, Send
from automcm_spec.log_format.reader import Log, LogStream
from automcm_spec.support.bad_input import BadInput, name_of
from automcm_traces.explain.explain import JudgedLog

MOST_EVENTS = 100_000
"""In all logs of a run. Each event takes 5 to 7 KB while the page is made."""
MOST_BYTES = 256 * 2**20
"""In all logs of a run, whatever the number of events."""
WINDOW = 10_000
"""Of logs that are too long, at most this many lines of one log are shown unless a part is
chosen."""
CHOOSE = "choose a part with --session, --from-ms, --to-ms, --from-line or --to-line"


class PageError(Exception):
    """The logs cannot be shown as a page; the text is one line."""


@dataclass(frozen=True, slots=True)
class PagePart:
    """The part of the logs to show: a range of lines of one log, and of each other log the lines
    between the first and the last message exchanged with that range."""

    first: int = 1
    last: int = sys.maxsize
    session: tuple[int, int] | None = None
    """Only from the first to the last event that names this session."""
    from_ms: int = 0
    to_ms: int = sys.maxsize
    """Only events between these times, from the first event of the log."""

    def __str__(self) -> str:
        if self.session is not None:
            return f"of session {self.session[0]}/{self.session[1]}"
        if self.from_ms or self.to_ms < sys.maxsize:
            until = "" if self.to_ms == sys.maxsize else f" to {self.to_ms:,} ms"
            return f"from {self.from_ms:,} ms{until or ' on'}"
        if self.last == sys.maxsize:
            return f"from line {self.first} on"
        return f"in lines {self.first} to {self.last}"

    def of_lines(self, path: Path) -> PagePart | None:
        """The lines of the session in a log, if it chooses a session; None if the log has none.

        Raises BadInput.
        """
        if self.session is None:
            return self
        events = _readable(LogStream(path))
        found = [line for line, event in events if session_of(event) == self.session]
        return replace(self, first=found[0], last=found[-1]) if found else None


def too_long(paths: Sequence[Path]) -> str:
    """Why the logs are too long for a page, without reading them into memory; empty if they are
    not. Raises BadInput for an unreadable file."""
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
    if lines - 2 * len(paths) > MOST_EVENTS:
        return f"{what}: {lines:,} lines; a page shows at most {MOST_EVENTS:,} events"
    if size > MOST_BYTES:
        return f"{what}: {size >> 20} MiB; a page shows at most {MOST_BYTES >> 20} MiB"
    return ""


def around(found: Sequence[JudgedLog]) -> tuple[list[Path], PagePart]:
    """The lines around the first divergence, or the first lines of the first log; and the files in
    the order in which ``parts`` takes them."""
    paths = [one.path for one in found]
    window = min(WINDOW, MOST_EVENTS // (2 * len(paths) - 1))  # the others may have more events
    marked = [one for one in found if one.verdict.verdict == "diverges"]
    if not marked:
        readable = [one.path for one in found if one.refused is None]
        paths.sort(key=lambda path: path not in readable[:1])
        return paths, PagePart(1, window)
    paths.sort(key=lambda path: path != marked[0].path)
    first = max(1, marked[0].verdict.finding.at.line - window * 3 // 4)
    return paths, PagePart(first, first + window - 1)


def parts(paths: Sequence[Path], part: PagePart) -> tuple[list[tuple[Path, Log]], str]:
    """The part of each log to show, and a sentence about it. The part is taken from the first log
    that has a session, otherwise from the first.

    Raises PageError if the part is empty or too large, and BadInput if that log has no header.
    """
    first, chosen = paths[0], None
    for path in paths if part.session is not None else paths[:1]:
        first, chosen = path, part.of_lines(path)
        if chosen is not None:
            break
    own = None if chosen is None else _lines(first, chosen, 0)
    if own is None or not own.events:
        where = "the logs" if part.session is not None and paths[1:] else name_of(paths[0])
        raise PageError(f"{where}: no readable event {part}")
    exchanged = {tx for _, event in own.events if (tx := _tx(event))}
    logs = [(first, own)]
    without = []
    for path in paths:
        if path == first:
            continue
        try:
            at = [line for line, event in _readable(LogStream(path)) if _tx(event) in exchanged]
        except BadInput:
            continue  # reported by its verdict
        if at:
            held = sum(len(log.events) for _, log in logs)
            logs.append((path, _lines(path, PagePart(at[0], at[-1]), held)))
        else:
            without.append(name_of(path))
    shown = ", ".join(
        f"{log.file} lines {log.events[0][0]} to {log.events[-1][0]}" for _, log in logs
    )
    note = f"A part: {shown}. Each verdict is for the whole log by itself."
    if without:
        note += f" No message of these lines is in {', '.join(without)}."
    return logs, note


def _lines(path: Path, part: PagePart, held: int) -> Log:
    """The events of a part, by line and time; ``held`` is the number already in memory. Raises
    PageError, BadInput."""
    stream = LogStream(path)
    events: list[tuple[int, Event]] = []
    start: int | None = None
    for line, event in _readable(stream):
        start = event.t_ms if start is None else start
        if line > part.last or event.t_ms - start > part.to_ms:
            break
        if line >= part.first and event.t_ms - start >= part.from_ms:
            events.append((line, event))
            if len(events) + held > MOST_EVENTS:
                raise PageError(f"more than {MOST_EVENTS:,} events in this part; {CHOOSE}")
    return stream.log(events)


def _readable(stream: LogStream) -> Iterator[tuple[int, Event]]:
    """The readable events of a log; its verdict reports why it stops."""
    try:
        yield from stream
    except BadInput:
        return


def _tx(event: Event) -> str | None:
    return event.tx if isinstance(event, Send | Receive) else None
