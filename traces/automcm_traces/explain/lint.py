"""Finds all format errors in a log, not only the first: for authors of log writers.

A log is read once, line by line, in bounded memory. After an error the check continues as well as
it can.
"""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO, Final, Literal

from pydantic import ValidationError
from pydantic_core import from_json

from automcm_spec.support.bad_input import BadInput, at_line, name_of, one_line
from automcm_spec.vocabulary.messages import RELIABLE, Fields
from automcm_spec.vocabulary.rules import RULES
from automcm_traces.checker.finding import At, Finding
from automcm_traces.checker.track import PHASES, ROLES
from automcm_traces.format.log import (
    End,
    Event,
    Header,
    MessageTimer,
    Receive,
    Record,
    Send,
    TimerArm,
    UnknownEvent,
    problems,
    problems_of,
)
from automcm_traces.format.number_sets import Numbers
from automcm_traces.format.reader import LONGEST_LINE, NotJsonError, cut, parse

Level = Literal["error", "warning"]

CHECKS: Final[dict[str, tuple[Level, str]]] = {
    "text": ("error", "a line is UTF-8, has 1 byte to 16 MiB, and ends with LF only"),
    "json": ("error", "a line is one JSON object"),
    "schema": ("error", "a record has the fields of its kind, of the right type, and no others"),
    "key": ("error", "no object has a duplicate key"),
    "message": ("warning", "a message is well formed (END-5)"),
    "order": ("error", "one header, then events, then one end, then nothing"),
    "seq": ("error", "seq counts from 1 without gaps or repetitions"),
    "t_ms": ("error", "t_ms never decreases"),
    "tx": ("error", "each transmission has a new id of this station"),
    "deadline": ("error", "a deadline is not in the past"),
    "cut": ("warning", "the last line is complete"),
    "end": ("warning", "the log has an end and no lost records"),
    "unknown": ("warning", "the event kind, rule, phase and role are known"),
    "complete": ("warning", "the kinds in `complete` are present, as far as this can be checked"),
}
"""The checks by name: whether a failure is an error or a warning, and what is required."""


def level(found: Finding) -> Level:
    """An error breaks the format; a warning does not."""
    return CHECKS[found.rule][0]


def as_dict(found: Finding) -> dict[str, object]:
    """The ``--json`` form."""
    return {
        "file": found.at.file,
        "line": found.at.line,
        "field": found.at.field,
        "check": found.rule,
        "level": level(found),
        "problem": found.observed,
    }


def finding_text(found: Finding) -> str:
    """The finding as one line."""
    warning = "warning: " if level(found) == "warning" else ""
    field = f"{found.at.field}: " if found.at.field else ""
    place = at_line(found.at.file, found.at.line)
    return one_line(f"{place}: {warning}{field}{found.observed} [{found.rule}]")


def lint(path: str | Path) -> Iterator[Finding]:
    """All problems of the log at ``path``, in the order of its lines.

    Raises BadInput if the file is not a log: it cannot be opened, is empty, or its first line is
    not a JSON object.
    """
    try:
        with open(path, "rb") as stream:
            yield from _Lint(name_of(path)).findings(stream)
    except FileNotFoundError:
        raise BadInput(path, 0, "", "no such file") from None
    except IsADirectoryError:
        raise BadInput(path, 0, "", "is a directory; name a log file") from None
    except OSError as error:
        raise BadInput(path, 0, "", f"cannot be read: {error.strerror}") from None


@dataclass(frozen=True, slots=True)
class Report:
    """The findings in one file: the first ones are kept, all are counted."""

    file: str
    findings: list[Finding]
    errors: int
    warnings: int
    unreadable: BadInput | None = None
    """The error, if the file is not a log."""

    @property
    def verdict(self) -> Literal["clean", "findings", "unreadable"]:
        """The verdict; warnings alone leave a log clean."""
        if self.unreadable:
            return "unreadable"
        return "findings" if self.errors else "clean"

    def as_dict(self) -> dict[str, object]:
        """The ``--json`` form."""
        return {
            "file": self.file,
            "verdict": self.verdict,
            "errors": self.errors,
            "warnings": self.warnings,
            "unreadable": str(self.unreadable or ""),
            "findings": [as_dict(finding) for finding in self.findings],
        }


def report(path: str | Path, most: int = 0) -> Report:
    """The first ``most`` findings in the log at ``path`` (0: all), and the number of all."""
    kept: list[Finding] = []
    levels: Counter[str] = Counter()
    try:
        for finding in lint(path):
            levels[level(finding)] += 1
            if not most or len(kept) < most:
                kept.append(finding)
    except BadInput as error:
        return Report(name_of(path), kept, levels["error"], levels["warning"], error)
    return Report(name_of(path), kept, levels["error"], levels["warning"])


EXIT = {"clean": 0, "findings": 1, "unreadable": 3}


def exit_code(reports: Sequence[Report]) -> int:
    """The exit code for the most severe report: findings, then unreadable."""
    codes = {EXIT[r.verdict] for r in reports}
    return next((code for code in (1, 3) if code in codes), 0)


def text(report: Report) -> str:
    """The report as text: a line for each finding, and one for the file."""
    lines = [finding_text(finding) for finding in report.findings]
    left = report.errors + report.warnings - len(report.findings)
    file = one_line(report.file)
    if left:
        lines.append(f"{file}: {left} more")
    if report.unreadable:
        lines.append(f"{report.unreadable.where}: UNREADABLE: {report.unreadable.what}")
    else:
        warned = f", {_count(report.warnings, 'warning')}" if report.warnings else ""
        found = f"{_count(report.errors, 'error')}" if report.errors else "clean"
        lines.append(f"{file}: {found}{warned}")
    return "\n".join(lines)


def _count(number: int, what: str) -> str:
    return f"{number} {what}{'' if number == 1 else 's'}"


class _Lint:
    """The state of linting one log."""

    def __init__(self, file: str) -> None:
        self._file = file
        self._line = 0
        self._header: Header | None = None
        self._ended = False
        self._seq = 0
        self._t_ms = 0
        self._sent = Numbers()
        self._kinds: Counter[str] = Counter()
        self._reliable = 0
        """The number of reliable messages sent; each must have timers."""
        self._resent = 0
        """The number of message timers armed."""

    def findings(self, stream: BinaryIO) -> Iterator[Finding]:
        while line := stream.readline(LONGEST_LINE + 1):
            self._line += 1
            if len(line) > LONGEST_LINE:
                if self._line == 1:
                    raise BadInput(self._file, 1, "", f"longer than {LONGEST_LINE} bytes", "text")
                yield self._found("text", "", f"longer than {LONGEST_LINE} bytes")
                while line and not line.endswith(b"\n"):
                    line = stream.readline(LONGEST_LINE)
                continue
            yield from self._one(line)
        if self._line == 0:
            raise BadInput(self._file, 0, "", "empty file", "order")
        yield from self._at_end()

    def _one(self, line: bytes) -> Iterator[Finding]:
        try:
            record = parse(line, first=self._line == 1)
        except NotJsonError as error:
            if self._line == 1:
                raise BadInput(self._file, 1, "", error.problem, error.rule) from None
            if cut(line) and not self._ended:
                yield self._found("cut", "", "the last line is incomplete")
            else:
                yield self._found(error.rule, "", error.problem)
            return
        except ValidationError as error:
            yield from self._refused(line, error)
        else:
            yield from self._keys(line)
            yield from self._record(record)
        if line.endswith(b"\r\n"):
            yield self._found("text", "", "must end with LF, not CR LF")
        elif not line.endswith(b"\n"):
            yield self._found("text", "", "the last line must end with LF")

    def _refused(self, line: bytes, error: ValidationError) -> Iterator[Finding]:
        """A line that is not a record. Its seq and t_ms still count, or each later line would be
        wrong."""
        value = from_json(line)
        if self._line == 1 and not isinstance(value, dict):
            raise BadInput(self._file, 1, "", "not a JSON object", "json")
        for field, problem in problems_of(error):
            yield self._found("schema" if isinstance(value, dict) else "json", field, problem)
        if not isinstance(value, dict):
            return
        yield from self._keys(line)
        if value.get("rec") == "end":
            self._ended = True
        elif value.get("rec") == "event":
            seq, t_ms = value.get("seq"), value.get("t_ms")
            yield from self._place(
                seq if type(seq) is int else self._seq + 1,
                t_ms if type(t_ms) is int else self._t_ms,
            )

    def _keys(self, line: bytes) -> Iterator[Finding]:
        again: list[str] = []

        def pairs(items: list[tuple[str, object]]) -> None:
            if len({key for key, _ in items}) < len(items):
                counts = Counter(key for key, _ in items)
                again.extend(key for key, count in counts.items() if count > 1)

        json.loads(line, object_pairs_hook=pairs, parse_int=len)  # however long a number is
        for key in again:
            yield self._found("key", key, "duplicate key in its object")

    def _record(self, record: Record | UnknownEvent) -> Iterator[Finding]:
        if isinstance(record, Header):
            if self._line != 1:
                problem = "a second header: a file contains one log"
                yield self._found("order", "rec", problem)
            else:
                self._header = record
            return
        if self._line == 1:
            yield self._found("order", "rec", "the first line must be the header")
        if self._ended:
            yield self._found("order", "rec", "a record after the end")
        if isinstance(record, End):
            yield from self._end(record)
            return
        yield from self._place(record.seq, record.t_ms)
        self._kinds[record.ev] += 1
        if isinstance(record, UnknownEvent):
            yield self._found("unknown", "ev", f"unknown kind of event {record.ev!r}")
            return
        yield from self._event(record)

    def _place(self, seq: int, t_ms: int) -> Iterator[Finding]:
        wanted = self._seq + 1
        if seq > wanted:
            problem = f"{seq} after {self._seq}: {seq - wanted} missing"
            yield self._found("seq", "seq", problem)
        elif seq == self._seq:
            yield self._found("seq", "seq", f"{seq} is repeated; expected {wanted}")
        elif seq < wanted:
            yield self._found("seq", "seq", f"must not decrease, from {self._seq} to {seq}")
        if t_ms < self._t_ms:
            yield self._found("t_ms", "t_ms", f"must not decrease, from {self._t_ms} to {t_ms}")
        self._seq, self._t_ms = seq, t_ms

    def _event(self, event: Event) -> Iterator[Finding]:
        match event:
            case Send(message=message):
                yield from self._transmission(event.tx)
                self._reliable += message["type"] in RELIABLE
                yield from self._message(message)
            case Receive(message=message) if message is not None:
                yield from self._message(message)
            case TimerArm(deadline=deadline, timer=timer):
                self._resent += isinstance(timer, MessageTimer)
                if deadline < event.t_ms:
                    problem = f"{deadline} is before t_ms {event.t_ms}"
                    yield self._found("deadline", "deadline", problem)
        if event.phase is not None and event.phase not in PHASES:
            yield self._found("unknown", "phase", f"{event.phase!r} is not a protocol phase")
        if event.role is not None and event.role not in ROLES:
            problem = f"must be one of {', '.join(ROLES)}, not {event.role!r}"
            yield self._found("unknown", "role", problem)
        if event.rule is not None and event.rule not in RULES:
            yield self._found("unknown", "rule", f"{event.rule!r} is not a protocol rule")

    def _transmission(self, tx: str) -> Iterator[Finding]:
        station, number = (int(part) for part in tx.split(":"))
        if self._header is not None and station != self._header.station:
            problem = f"{tx} must begin with {self._header.station}, the station of this log"
            yield self._found("tx", "tx", problem)
        elif not self._sent.add(number):
            yield self._found("tx", "tx", f"{tx} was used before; each transmission needs a new tx")

    def _message(self, message: Fields) -> Iterator[Finding]:
        for field, problem in problems(message):
            yield self._found("message", f"message.{field}", problem)
        broadcast = message["type"] in ("Advertisement", "CAM")
        if broadcast and "dst" in message:
            yield self._found("message", "message.dst", "not allowed in a broadcast (END-5)")
        elif not broadcast and "dst" not in message:
            yield self._found("message", "message.dst", "missing: only broadcasts omit it (END-5)")

    def _end(self, end: End) -> Iterator[Finding]:
        if end.seq > self._seq:
            problem = (
                f"{end.seq}, but the last event has {self._seq}: {end.seq - self._seq} missing"
            )
            yield self._found("seq", "seq", problem)
        elif end.seq < self._seq:
            yield self._found("seq", "seq", f"{end.seq}, but the last event has {self._seq}")
        if end.lost_records:
            yield self._found("end", "lost_records", f"{end.lost_records} events were not logged")
        self._ended = True

    def _at_end(self) -> Iterator[Finding]:
        if not self._ended:
            yield self._found("end", "", "the log has no end record")
        if self._header is None:
            return
        if "timer" in self._header.complete and self._reliable and not self._kinds["timer"]:
            problem = "promises all timers, but reliable messages have none in this log (REL-1)"
            yield self._promise(problem)
        if "send" in self._header.complete and self._resent and not self._kinds["send"]:
            problem = "promises all sent messages, but message timers are armed and nothing is sent"
            yield self._promise(problem)

    def _promise(self, problem: str) -> Finding:
        return Finding("format", "complete", at=At(self._file, 1, "complete"), observed=problem)

    def _found(self, check: str, field: str, problem: str) -> Finding:
        return Finding("format", check, at=At(self._file, self._line, field), observed=problem)
