"""Finds all format errors in a log, not only the first: for authors of log writers.

A log is read once, line by line, in bounded memory. After an error the check continues as well as
it can.
"""

from __future__ import annotations

import json
import re
import shlex
from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO, Final, Literal

from pydantic import ValidationError
from pydantic_core import from_json

from automcm_spec.log_format.line_problems import line_problems, plain
from automcm_spec.log_format.log import EVENT_KINDS, problems, transmission
from automcm_spec.log_format.number_sets import Numbers
from automcm_spec.log_format.private_keys import private_keys
from automcm_spec.log_format.problems import join
from automcm_spec.log_format.reader import LONGEST_LINE, NotJsonError, cut, opened, parse
from automcm_spec.support.bad_input import BadInput, at_line, name_of, one_line
from automcm_spec.vocabulary.messages import RELIABLE
from automcm_spec.vocabulary.rules import RULES
from automcm_traces.checker.finding import Finding, Where
from automcm_traces.checker.track import PHASES, ROLES

Json = Any
Level = Literal["error", "warning"]

CHECKS: Final[dict[str, tuple[Level, str]]] = {
    "text": ("error", "a line is UTF-8, has 1 byte to 16 MiB, and ends with LF only"),
    "json": ("error", "a line is one JSON object"),
    "schema": ("error", "a record has the fields of its kind, of the right type, and no others"),
    "key": ("error", "no object has a duplicate key"),
    "private_key": ("error", "no field has a private key"),
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
    with opened(path) as stream:
        yield from _Lint(name_of(path)).findings(stream)


@dataclass(frozen=True, slots=True)
class LintReport:
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


def report(path: str | Path, most: int = 0) -> LintReport:
    """The first ``most`` findings in the log at ``path`` (0: all), and the number of all."""
    kept: list[Finding] = []
    levels: Counter[str] = Counter()
    unreadable = None
    try:
        for finding in lint(path):
            levels[level(finding)] += 1
            if not most or len(kept) < most:
                kept.append(finding)
    except BadInput as error:
        unreadable = error
    return LintReport(name_of(path), kept, levels["error"], levels["warning"], unreadable)


FIRST = 5
"""The number of errors that explain shows of a log that it cannot read."""


@dataclass(slots=True)
class Repeated:
    """An error, and in how many places of the file it occurs: the same field and problem but for
    numbers."""

    first: Finding
    times: int = 1

    def __str__(self) -> str:
        found, times = self.first, self.times
        more = f" (and {_count(times - 1, 'time')} more)" if times > 1 else ""
        field = f"{found.at.field}: " if found.at.field else ""
        return one_line(f"line {found.at.line}: {field}{found.observed}{more}")

    def as_dict(self) -> dict[str, object]:
        """The ``--json`` form."""
        return as_dict(self.first) | {"times": self.times}


def kinds_of_error(path: str | Path) -> list[Repeated]:
    """One error of each kind in the log at ``path``, by its first line; none if it is no log."""
    kinds: dict[tuple[str, str, str], Repeated] = {}
    with suppress(BadInput):
        for finding in lint(path):
            field, problem = (_NUMBERS.sub("", x) for x in (finding.at.field, finding.observed))
            one = kinds.get(kind := (finding.rule, field, problem))
            if one is not None:
                one.times += 1
            elif level(finding) == "error":
                kinds[kind] = Repeated(finding)
    return list(kinds.values())


_NUMBERS: Final = re.compile(r"[0-9.e+-]+")


def errors_text(kinds: Sequence[Repeated], path: str | Path) -> list[str]:
    """The first ``FIRST`` of these kinds of error as lines, and how to see the others."""
    if not kinds:
        return []
    lines = [str(kind) for kind in kinds[:FIRST]]
    left = f"{len(kinds) - FIRST} more kinds of error; " if len(kinds) > FIRST else ""
    lint_ = f"automcm trace lint {shlex.quote(name_of(path))}"
    return [*lines, f"{left}all: {lint_}"]


def exit_code(reports: Sequence[LintReport]) -> int:
    """The exit code for the most severe report: findings, then unreadable."""
    verdicts = {r.verdict for r in reports}
    return 1 if "findings" in verdicts else 3 if "unreadable" in verdicts else 0


def text(report: LintReport) -> str:
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
        self._station: object = None
        """The station in the header, whatever its type; None if there is no header."""
        self._promised: object = ()
        self._running = False
        """Whether the header says that the log begins in mid-session."""
        self._ended = False
        self._first = True
        """Whether no event was seen."""
        self._seq = 0
        self._lines = 0
        """The number of lines since the last event; some may be events that cannot be read."""
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
            self._lines += 1
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
        refused = False
        try:
            parse(line, first=self._line == 1)
        except NotJsonError as error:
            if self._line == 1:
                raise BadInput(self._file, 1, "", str(error), error.rule) from None
            if cut(line) and not self._ended:
                yield self._found("cut", "", "the last line is incomplete")
            else:
                yield self._found(error.rule, "", str(error))
            return
        except ValidationError:
            refused = True
        value = from_json(line)
        if isinstance(value, dict):
            yield from self._record(value, line, refused)
        elif self._line == 1:
            raise BadInput(self._file, 1, "", "not a JSON object", "json")
        else:
            yield self._found("json", "", "not a JSON object")
        if line.endswith(b"\r\n"):
            yield self._found("text", "", "must end with LF, not CR LF")
        elif not line.endswith(b"\n"):
            yield self._found("text", "", "the last line must end with LF")

    def _keys(self, line: bytes) -> Iterator[Finding]:
        again: list[str] = []

        def pairs(items: list[tuple[str, object]]) -> None:
            if len({key for key, _ in items}) < len(items):
                counts = Counter(key for key, _ in items)
                again.extend(key for key, count in counts.items() if count > 1)

        json.loads(line, object_pairs_hook=pairs, parse_int=len)  # however long a number is
        for key in again:
            yield self._found("key", key, "duplicate key in its object")

    def _record(self, value: dict[str, Json], line: bytes, refused: bool) -> Iterator[Finding]:
        """One line. ``refused``: it breaks the format. Its right fields count all the same."""
        for field in private_keys(value, line):
            problem = "contains a private key: remove it here, and replace the key everywhere"
            yield self._found("private_key", field, problem)
        found = line_problems(value) if refused else []
        wrong = {field for field, _ in found}
        for field, problem in found:
            if field == "seq" and type(value.get("seq")) is int:  # as well said by _place
                continue
            yield self._found("schema", field, problem)
        yield from self._keys(line)
        rec = value.get("rec")
        if rec == "header":
            if self._line != 1:
                yield self._found("order", "rec", "a second header: a file contains one log")
            else:
                self._station, self._promised = value.get("station"), value.get("complete")
                self._running = "begins" in value
            return
        if self._line == 1:
            yield self._found("order", "rec", "the first line must be the header")
        if self._ended:
            yield self._found("order", "rec", "a record after the end")
        if rec == "end":
            yield from self._end(value)
        elif rec == "event" or "ev" in value:
            yield from self._place(value)
            yield from self._event(value, wrong)

    def _place(self, value: dict[str, Json]) -> Iterator[Finding]:
        wanted, seq, t_ms = self._seq + 1, value.get("seq"), value.get("t_ms")
        if isinstance(seq, float) and seq.is_integer():
            seq = int(seq)
        if type(seq) is not int:
            seq = wanted
        elif self._first and seq < 1:
            problem = f"must count from 1, not from {seq}: add {1 - seq} to each, also in the end"
            yield self._found("seq", "seq", problem)
        elif self._first and seq > 1 and not self._running:
            mark = 'if the log was cut here, its header needs "begins": "running"'
            yield self._found("seq", "seq", f"must count from 1, not from {seq}; {mark}")
        elif seq > (known := self._seq + self._lines) and not self._first:
            problem = f"{seq} after {self._seq}: {seq - known} missing"
            yield self._found("seq", "seq", problem)
        elif seq == self._seq:
            yield self._found("seq", "seq", f"{seq} is repeated; expected {wanted}")
        elif seq < wanted:
            yield self._found("seq", "seq", f"must not decrease, from {self._seq} to {seq}")
        self._seq, self._first, self._lines = seq, False, 0
        if type(t_ms) is not int:
            return
        if t_ms < self._t_ms:
            yield self._found("t_ms", "t_ms", f"must not decrease, from {self._t_ms} to {t_ms}")
        self._t_ms = t_ms

    def _event(self, value: dict[str, Json], wrong: set[str]) -> Iterator[Finding]:
        ev, message = value.get("ev"), value.get("message")
        if isinstance(ev, str) and "ev" not in wrong:
            self._kinds[ev] += 1
            if ev not in EVENT_KINDS:
                yield self._found("unknown", "ev", f"unknown kind of event {ev!r}")
                return
        if ev == "send" and "tx" in value and "tx" not in wrong:
            yield from self._transmission(value["tx"])
        if ev in ("send", "receive") and isinstance(message, dict):
            self._reliable += ev == "send" and message.get("type") in RELIABLE
            yield from self._message(message)
        if ev == "timer" and value.get("op") == "arm":
            timer, deadline, t_ms = (value.get(name) for name in ("timer", "deadline", "t_ms"))
            self._resent += isinstance(timer, dict) and timer.get("name") in ("giveup", "resend")
            if type(deadline) is int and type(t_ms) is int and deadline < t_ms:
                problem = f"{deadline} is before t_ms {t_ms}"
                yield self._found("deadline", "deadline", problem)
        phase, role, rule = (value.get(name) for name in ("phase", "role", "rule"))
        if isinstance(phase, str) and phase not in PHASES and "phase" not in wrong:
            yield self._found("unknown", "phase", f"{phase!r} is not a protocol phase")
        if isinstance(role, str) and role not in ROLES and "role" not in wrong:
            problem = f"must be one of {', '.join(ROLES)}, not {role!r}"
            yield self._found("unknown", "role", problem)
        if isinstance(rule, str) and rule not in RULES and "rule" not in wrong:
            yield self._found("unknown", "rule", f"{rule!r} is not a protocol rule")

    def _transmission(self, tx: str) -> Iterator[Finding]:
        station, number = transmission(tx)
        if type(self._station) is int and station != self._station:
            problem = f"{tx} must begin with {self._station}, the station of this log"
            yield self._found("tx", "tx", problem)
        elif not self._sent.add(number):
            yield self._found("tx", "tx", f"{tx} was used before; each transmission needs a new tx")

    def _message(self, message: dict[str, Json]) -> Iterator[Finding]:
        if not isinstance(message.get("type"), str):
            return
        for field, problem in problems(plain(message, {})):
            yield self._found("message", join("message", field), problem)
        broadcast = message["type"] in ("Advertisement", "CAM")
        if broadcast and "dst" in message:
            yield self._found("message", "message.dst", "not allowed in a broadcast (END-5)")
        elif not broadcast and "dst" not in message:
            yield self._found("message", "message.dst", "missing: only broadcasts omit it (END-5)")

    def _end(self, end: dict[str, Json]) -> Iterator[Finding]:
        seq, lost = end.get("seq"), end.get("lost_records")
        if type(seq) is int and seq < 0:
            yield self._found("seq", "seq", f"must be at least 0, not {seq}")
        elif type(seq) is int and not self._seq <= seq < (known := self._seq + self._lines):
            missing = f": {seq - known + 1} missing" if seq > self._seq else ""
            yield self._found("seq", "seq", f"{seq}, but the last event has {self._seq}{missing}")
        if type(lost) is int and lost > 0:
            yield self._found("end", "lost_records", f"{lost} events were not logged")
        self._ended = True

    def _at_end(self) -> Iterator[Finding]:
        if not self._ended:
            yield self._found("end", "", "the log has no end record")
        if not isinstance(self._promised, list | tuple):
            return
        self._line = 1  # that of the header
        if "timer" in self._promised and self._reliable and not self._kinds["timer"]:
            problem = "promises all timers, but reliable messages have none in this log (REL-1)"
            yield self._found("complete", "complete", problem)
        if "send" in self._promised and self._resent and not self._kinds["send"]:
            problem = "promises all sent messages, but message timers are armed and nothing is sent"
            yield self._found("complete", "complete", problem)

    def _found(self, check: str, field: str, problem: str) -> Finding:
        return Finding("format", check, at=Where(self._file, self._line, field), observed=problem)
