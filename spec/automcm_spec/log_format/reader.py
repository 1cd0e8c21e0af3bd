"""Reads logs, and describes in one line why a log cannot be read."""

import os
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO, Literal, TypeAlias

from pydantic import ValidationError

from automcm_spec.log_format.growing_file import LineBuffer
from automcm_spec.log_format.log import (
    UNKNOWN,
    End,
    Event,
    Header,
    Record,
    UnknownEvent,
    record,
    unknown_event,
)
from automcm_spec.log_format.problems import problems_of
from automcm_spec.support.bad_input import BadInput, name_of, one_line

LONGEST_LINE = 16 * 2**20
"""The maximum number of bytes in a line; longer lines are rejected without reading them into
memory."""


@dataclass(frozen=True)
class Notice:
    """A problem in a log that does not prevent reading it.

    After a ``gap`` (missing records) no verdict is possible. ``begins_late``: records are missing
    before the first event.
    """

    kind: Literal["begins_late", "gap", "no_end", "truncated", "unknown_event"]
    problem: str


LogEntry: TypeAlias = tuple[int, Record | Notice]
"""A line number (from 1), and the record or the notice there."""


class _Described:
    """The properties of a log that both of its forms have."""

    header: Header
    end: End | None
    begins_late: bool

    @property
    def ended(self) -> bool:
        """Whether there is an end record; without one, events may be missing at the end."""
        return self.end is not None

    @property
    def mid_session(self) -> bool:
        """Whether the state of the station is unknown when the log begins."""
        return self.begins_late or self.header.begins is not None


@dataclass(frozen=True)
class Log(_Described):
    """A complete log."""

    file: str
    header: Header
    events: list[tuple[int, Event]]
    """The events, each with its line number."""
    end: End | None
    truncated: bool
    """Whether the last line was incomplete; it is not in `events`."""
    warnings: list[str]
    """One line each: the file, the line and the problem."""
    begins_late: bool = False
    """Whether the first event was not the first of the station's log."""

    def __iter__(self) -> Iterator[tuple[int, Event]]:
        return iter(self.events)


def read(path: str | Path) -> Log:
    """Read the log at `path`. Raises BadInput."""
    stream = LogStream(path, entries=records(path))
    return stream.log(list(stream))


class GrowingLog:
    """The entries of a log while it is written, as ``records`` yields them.

    Iteration stops where ``lines`` has no further line, and can go on from there later.
    """

    def __init__(self, path: str | Path, lines: LineBuffer) -> None:
        self._lines = lines
        self._reader = _Reader(path, gaps=True)
        self._entries: Iterator[LogEntry] = iter(())

    def __iter__(self) -> Iterator[LogEntry]:
        return self

    def __next__(self) -> LogEntry:
        for entry in self._entries:
            return entry
        self._entries = self._reader.lines(self._lines)
        return next(self._entries)

    def finish(self) -> None:
        """Take the rest of the lines as the end of the log."""
        self._entries = self._reader.entries(self._lines)


def header_of(path: str | Path) -> Header:
    """The header of a log. Raises BadInput."""
    _, first = next(records(path))
    assert isinstance(first, Header), "records() yields the header first"
    return first


def records(path: str | Path, *, gaps: bool = False) -> Iterator[LogEntry]:
    """Read the log at `path` line by line: header, events, end, and notices in between.

    Raises BadInput at the first line that is wrong, after yielding the lines before it. With
    `gaps`, a jump of `seq` is a notice before the next record instead of an error.
    """
    with opened(path) as stream:
        yield from _Reader(path, gaps).entries(stream)


@contextmanager
def opened(path: str | Path) -> Iterator[BinaryIO]:
    """A log as a stream of bytes. Raises BadInput where it cannot be opened or read."""
    try:
        with open(path, "rb") as stream:
            yield stream
    except FileNotFoundError:
        raise BadInput(path, 0, "", "no such file") from None
    except IsADirectoryError:
        raise BadInput(path, 0, "", "is a directory; name a log file") from None
    except OSError as error:
        raise BadInput(path, 0, "", f"cannot be read: {error.strerror}") from None


def logs_below(paths: Iterable[Path]) -> list[Path]:
    """The logs that ``paths`` name. A folder stands for all ``.ndjson`` files below it, sorted by
    name.

    Raises BadInput for a folder that contains none or cannot be read.
    """
    found: list[Path] = []
    for path in paths:
        if not path.is_dir():
            found.append(path)
            continue
        for folder in (path, *path.rglob("*/")):
            if not os.access(folder, os.R_OK | os.X_OK):
                raise BadInput(folder, 0, "", "cannot be read")
        below = sorted(p for p in path.rglob("*.ndjson") if p.is_file())
        if not below:
            raise BadInput(path, 0, "", "contains no log (*.ndjson)")
        found += below
    return found


MOST_WARNINGS = 20
"""The maximum number of warnings that a stream keeps."""


class LogStream(_Described):
    """A log that is read lazily, so that its length does not affect memory use.

    The constructor reads the header (BadInput if that fails). Iterating, possible once, yields the
    events with their lines. It raises BadInput at the first line that cannot be read; the events
    before it are valid. It stops before a gap, unless `past_gaps`. The other attributes describe
    what has been read so far, and the whole log at the end. With the `entries` of a GrowingLog, it
    can be iterated again when there are more.
    """

    def __init__(
        self,
        path: str | Path,
        *,
        past_gaps: bool = False,
        entries: Iterator[LogEntry] | None = None,
    ) -> None:
        self.file = name_of(path)
        self.end: End | None = None
        self.truncated = False
        """Whether the last line was incomplete."""
        self.gap: tuple[int, str] | None = None
        """The line after the first gap, and what is missing. From there on no verdict is
        possible."""
        self.warnings: list[str] = []
        """One line each: the file, the line and the problem; only the first MOST_WARNINGS."""
        self.begins_late = False
        """Whether seq began above 1. What is missing there is no gap: the log was cut."""
        self.complete = False
        """Whether all events have been yielded, from the station's start on."""
        self.events = 0
        """The number of events yielded so far."""
        self._past_gaps = past_gaps
        self._entries = records(path, gaps=True) if entries is None else entries
        _, first = next(self._entries)
        assert isinstance(first, Header), "records() yields the header first"
        self.header = first

    def __iter__(self) -> Iterator[tuple[int, Event]]:
        for line, found in self._entries:
            if isinstance(found, Notice):
                self._notice(line, found)
                if self.gap is not None and not self._past_gaps:
                    return
            elif found.rec == "event":
                self.events += 1
                yield line, found
            elif found.rec == "end":
                self.end = found
        self.complete = self.gap is None and not self.mid_session

    def log(self, events: Iterable[tuple[int, Event]]) -> Log:
        """A Log with these events, which are all or some of the events yielded."""
        return Log(
            self.file,
            self.header,
            list(events),
            self.end if self.gap is None or self._past_gaps else None,
            self.truncated,
            list(self.warnings),
            self.begins_late,
        )

    def _notice(self, line: int, notice: Notice) -> None:
        self.truncated = self.truncated or notice.kind == "truncated"
        if notice.kind == "begins_late":
            self.begins_late = True
        if notice.kind == "gap" and self.gap is None:
            self.gap = line, notice.problem
        if len(self.warnings) < MOST_WARNINGS:
            self.warnings.append(one_line(f"{self.file}:{line}: {notice.problem}"))


def parse(line: bytes, *, first: bool = False) -> Record | UnknownEvent:
    """One line of a log. With ``first``, it is the first line of a file that may be no log at all.

    Raises NotJsonError or pydantic.ValidationError.
    """
    try:
        return record(line)
    except ValidationError as error:
        refused = error
    try:
        line.decode()
    except UnicodeDecodeError as error:
        problem = f"not UTF-8 at byte {error.start + 1}{_known(line, first)}"
        raise NotJsonError(problem, "text") from None
    if not line.strip():
        raise NotJsonError("empty line", "text")
    if not unknown_event(refused):
        raise _json_error(refused, line, first) from None
    try:
        return UNKNOWN.validate_json(line)
    except ValidationError as error:
        raise _json_error(error, line, first) from None


def _json_error(error: ValidationError, line: bytes, first: bool) -> Exception:
    _, problem = problems_of(error)[0]
    known = _known(line, first)
    return NotJsonError(problem + known, "json") if problem.startswith("not JSON") else error


_FILES = {
    b"\xef\xbb\xbf": "it begins with a byte order mark; write UTF-8 without one",
    b"\xff\xfe": "this is UTF-16",
    b"\xfe\xff": "this is UTF-16",
    b"\x1f\x8b": "this is a gzip file; unpack it first",
    b"\x28\xb5\x2f\xfd": "this is a zstd file; unpack it first",
    b"PK\x03\x04": "this is a zip file; unpack it first",
    b"\x89PNG": "this is a PNG image",
}


def _known(line: bytes, first: bool) -> str:
    """A hint about the kind of file, for users who pass the wrong one: recognised by its first
    bytes."""
    if line.strip() in (b"[", b"{"):
        return " (a log has one JSON object per line)"
    files = _FILES.items() if first else ()
    return next((f" ({what})" for begin, what in files if line.startswith(begin)), "")


def cut(line: bytes) -> bool:
    """Whether an invalid last line may be incomplete because the writer was interrupted.

    It lacks the line feed and either begins like an object or consists of zero bytes, which some
    file systems leave after a crash.
    """
    return not line.endswith(b"\n") and (line.startswith(b"{") or not line.strip(b"\0"))


class _Reader:
    """The state of reading a log, and the checks across lines."""

    def __init__(self, path: str | Path, gaps: bool) -> None:
        self._path = path
        self._gaps = gaps
        self._line = 0
        self._header = False
        self._running = False
        """Whether the header allows any seq at the beginning."""
        self._end = False
        self._seq = 0
        self._t_ms = 0

    def entries(self, stream: BinaryIO | LineBuffer) -> Iterator[LogEntry]:
        """The entries of all lines, and of the end of the log."""
        yield from self.lines(stream)
        if self._line == 0:
            raise BadInput(self._path, 0, "", "empty file", "order")
        if not self._end:
            yield self._line, Notice("no_end", "the log has no end record")

    def lines(self, stream: BinaryIO | LineBuffer) -> Iterator[LogEntry]:
        """The entries of the next lines, up to the last that is there."""
        while line := stream.readline(LONGEST_LINE + 1):
            self._line += 1
            if len(line) > LONGEST_LINE:
                raise self._error("", f"longer than {LONGEST_LINE} bytes", "text")
            try:
                record = parse(line, first=self._line == 1)
            except NotJsonError as error:
                if not self._header or self._end or not cut(line):
                    raise self._error("", str(error), error.rule) from None
                yield self._line, Notice("truncated", "the last line is incomplete, ignored")
                break
            except ValidationError as error:
                field, problem = problems_of(error)[0]
                if not self._header and field == "rec":
                    problem += ": the first line must be a header of automcm.trace/1"
                raise self._error(field, problem, "schema" if field else "json") from None
            first = self._seq == 0 and record.rec == "event"
            if missing := self._check(record):
                kind: Literal["begins_late", "gap"] = "begins_late" if first else "gap"
                yield self._line, Notice(kind, f"seq: {missing}")
            if isinstance(record, UnknownEvent):
                yield self._line, Notice("unknown_event", f"unknown event {record.ev!r}, ignored")
            else:
                yield self._line, record

    def _check(self, record: Record | UnknownEvent) -> str:
        """Reject a record that does not fit the previous ones; returns a description of missing
        records."""
        if record.rec == "event" and self._header and not self._end:
            if self._running and self._seq == 0:
                self._seq = record.seq - 1
            wanted, gap = self._seq + 1, ""
            if record.seq != wanted:
                gap = self._gap(record.seq, wanted, f"after {self._seq}, expected")
            if record.t_ms < self._t_ms:
                problem = f"must not decrease, from {self._t_ms} to {record.t_ms}"
                raise self._error("t_ms", problem, "t_ms")
            self._seq, self._t_ms = record.seq, record.t_ms
            return gap
        if (record.rec == "header") == self._header:
            second = "a second header: a file contains one log"
            problem = second if self._header else "the first line must be the header"
            raise self._error("rec", problem, "order")
        if self._end:
            raise self._error("rec", "a record after the end", "order")
        if record.rec == "header":
            self._header = True
            self._running = record.begins is not None
            return ""
        gap = self._gap(record.seq, self._seq, "but the last event has")
        self._end = True
        return gap

    def _gap(self, seq: int, wanted: int, but: str) -> str:
        if seq == wanted:
            return ""
        problem = f"{seq}, {but} {wanted}" if but.startswith("but") else f"{seq} {but} {wanted}"
        if seq < wanted or not self._gaps:
            raise self._error("seq", problem, "seq")
        return f"{problem}: {seq - wanted} missing"

    def _error(self, field: str, problem: str, rule: str) -> BadInput:
        return BadInput(self._path, self._line, field, problem, rule)


class NotJsonError(Exception):
    """A line that is not JSON; the text says why, `rule` is ``text`` or ``json``."""

    def __init__(self, problem: str, rule: str) -> None:
        super().__init__(problem)
        self.rule = rule
