"""Read a log, and say in one line what is wrong with one that cannot be read."""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO, Literal

from pydantic import ValidationError

from automcm_traces.log import (
    RECORD,
    End,
    Event,
    Header,
    Record,
    UnknownEvent,
    first_problem,
    unknown_event,
)

LONGEST_LINE = 16 * 2**20
"""Bytes; a longer line is refused rather than read into memory."""


class LogError(Exception):
    """A log that cannot be read; the text is one line and names file, line and field.

    `line` is 0 if the whole file is meant, `field` is "" if a whole line is.
    """

    def __init__(self, file: str | Path, line: int, field: str, problem: str) -> None:
        self.file = str(file)
        self.line = line
        self.field = field
        self.problem = problem
        place = self.file + (f":{line}" if line else "")
        super().__init__(_one_line(": ".join(part for part in (place, field, problem) if part)))


@dataclass(frozen=True)
class Notice:
    """Something odd in a log that does not keep one from reading it."""

    kind: Literal["no_end", "truncated", "unknown_event"]
    problem: str


@dataclass(frozen=True)
class Entry:
    """A record, or a notice, and the number of its line (from 1)."""

    line: int
    record: Record | Notice


@dataclass(frozen=True)
class Log:
    """A whole log."""

    file: str
    header: Header
    events: list[tuple[int, Event]]
    """Each with the number of its line."""
    end: End | None
    truncated: bool
    """The last line was cut and is not in `events`."""
    warnings: list[str]
    """One line each: file, line and what is odd."""

    @property
    def ended(self) -> bool:
        """Whether the end is there; without it events may be missing at the end."""
        return self.end is not None


def read(path: str | Path) -> Log:
    """Read the log at `path`; raises LogError."""
    header: Header | None = None
    events: list[tuple[int, Event]] = []
    end: End | None = None
    truncated = False
    warnings = []
    for entry in records(path):
        match entry.record:
            case Notice(kind, problem):
                truncated = truncated or kind == "truncated"
                warnings.append(_one_line(f"{path}:{entry.line}: {problem}"))
            case Header() as header:
                pass
            case End() as end:
                pass
            case event:
                events.append((entry.line, event))
    assert header is not None, "records() gives the header first"
    return Log(str(path), header, events, end, truncated, warnings)


def records(path: str | Path) -> Iterator[Entry]:
    """Read the log at `path` line by line: header, events, end, and notices where they belong.

    Raises LogError where the log goes wrong, after what was good before.
    """
    try:
        with open(path, "rb") as stream:
            yield from _Reader(path).entries(stream)
    except FileNotFoundError:
        raise LogError(path, 0, "", "no such file") from None
    except IsADirectoryError:
        raise LogError(path, 0, "", "is a directory, not a log") from None
    except OSError as error:
        raise LogError(path, 0, "", f"cannot be read: {error.strerror}") from None


class _Reader:
    """What has been seen of a log so far, and the checks across lines."""

    def __init__(self, path: str | Path) -> None:
        self._path = path
        self._line = 0
        self._header = False
        self._end = False
        self._seq = 0
        self._t_ms = 0

    def entries(self, stream: BinaryIO) -> Iterator[Entry]:
        while line := stream.readline(LONGEST_LINE + 1):
            self._line += 1
            if len(line) > LONGEST_LINE:
                raise self._error("", f"longer than {LONGEST_LINE} bytes")
            try:
                record = self._parse(line)
            except _NotJsonError as error:
                if not self._header or self._end or line.endswith(b"\n"):
                    raise self._error("", error.problem) from None
                yield Entry(self._line, Notice("truncated", "the last line is cut, ignored"))
                break
            self._check(record)
            if isinstance(record, UnknownEvent):
                notice = Notice("unknown_event", f"unknown event {record.ev!r}, ignored")
                yield Entry(self._line, notice)
            else:
                yield Entry(self._line, record)
        if self._line == 0:
            raise LogError(self._path, 0, "", "empty file")
        if not self._end:
            yield Entry(self._line, Notice("no_end", "the log has no end record"))

    def _parse(self, line: bytes) -> Record | UnknownEvent:
        try:
            line.decode()
        except UnicodeDecodeError as error:
            raise _NotJsonError(f"not UTF-8 at byte {error.start + 1}") from None
        if not line.strip():
            raise _NotJsonError("empty line")
        try:
            return RECORD.validate_json(line)
        except ValidationError as error:
            if not unknown_event(error):
                raise self._refused(error) from None
        try:
            return UnknownEvent.model_validate_json(line)
        except ValidationError as error:
            raise self._refused(error) from None

    def _refused(self, error: ValidationError) -> Exception:
        field, problem = first_problem(error)
        if problem.startswith("not JSON"):
            return _NotJsonError(problem)
        return self._error(field, problem)

    def _check(self, record: Record | UnknownEvent) -> None:
        """Refuse a record that does not fit what came before it."""
        if isinstance(record, Header) == self._header:
            problem = "a second header" if self._header else "the first line is no header"
            raise self._error("rec", problem)
        if self._end:
            raise self._error("rec", "a record after the end")
        if isinstance(record, Header):
            self._header = True
        elif isinstance(record, End):
            if record.seq != self._seq:
                raise self._error("seq", f"{record.seq}, but the last event has {self._seq}")
            self._end = True
        else:
            if record.seq != self._seq + 1:
                problem = f"{record.seq} after {self._seq}, expected {self._seq + 1}"
                raise self._error("seq", problem)
            if record.t_ms < self._t_ms:
                raise self._error("t_ms", f"goes back from {self._t_ms} to {record.t_ms}")
            self._seq, self._t_ms = record.seq, record.t_ms

    def _error(self, field: str, problem: str) -> LogError:
        return LogError(self._path, self._line, field, problem)


class _NotJsonError(Exception):
    """A line that is not even JSON: cut, if it is the last."""

    def __init__(self, problem: str) -> None:
        self.problem = problem


def _one_line(text: str) -> str:
    """`text` with control characters and the like escaped, and not longer than a screen's worth."""
    safe = "".join(c if c.isprintable() else ascii(c)[1:-1] for c in text)
    return safe if len(safe) <= 1000 else safe[:1000] + "..."
