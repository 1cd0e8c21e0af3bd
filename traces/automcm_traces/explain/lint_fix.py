"""Writes a copy of a log in which every error with a mechanical remedy is mended.

A line without such an error stays as it is, byte for byte. Nothing is invented: an event, a message
or a time that the log does not contain is left to its author.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterator
from decimal import ROUND_HALF_UP, Decimal
from pathlib import Path
from typing import Any, BinaryIO, Final, Literal, NamedTuple, get_args

from automcm_spec.support import files
from automcm_spec.support.bad_input import BadInput
from automcm_traces.format.line_problems import line_problems
from automcm_traces.format.number_sets import Numbers
from automcm_traces.format.problems import is_time

Json = Any
TimeUnit = Literal["s", "ms", "us", "ns"]
TIME_UNITS: Final = get_args(TimeUnit)
_MS: Final = {"s": Decimal(1000), "ms": Decimal(1), "us": Decimal("1e-3"), "ns": Decimal("1e-6")}
_TIMES: Final = ("t_ms", "deadline", "late_ms")
"""The times of an event."""
_BOM: Final = b"\xef\xbb\xbf"


class Change(NamedTuple):
    """One kind of change, in how many places, and the first line."""

    what: str
    times: int
    line: int

    def __str__(self) -> str:
        times = f", and {self.times - 1} more" if self.times > 1 else ""
        return f"{self.what}: line {self.line}{times}"

    def as_dict(self) -> dict[str, object]:
        """The ``--json`` form."""
        return {"what": self.what, "times": self.times, "line": self.line}


def fix(source: Path, target: Path, unit: TimeUnit | None = None) -> list[Change]:
    """Write the mended copy of ``source`` to ``target``. ``unit`` is that of the times in the log;
    None: milliseconds, and a fraction is left.

    ``target`` may be ``source``. Raises BadInput if the file is not a log, and OSError.
    """
    with source.open("rb") as log:
        top = _highest_tx(log)
        log.seek(0)
        mending = _Mending(source, unit, top)
        with files.writing(target, named=target == source) as copy:
            for line in log:
                copy.write(mending.line(line))
    return [Change(what, *where) for what, where in mending.changes.items()]


def _highest_tx(log: BinaryIO) -> int:
    used = Numbers()
    for line in log:
        value = _parsed(line)
        tx = value[0].get("tx") if value is not None else None
        if isinstance(tx, str) and (number := tx.rpartition(":")[2]).isdigit():
            used.add(int(number[:19]))
    return used.top


def _parsed(line: bytes) -> tuple[dict[str, Json], list[str]] | None:
    """The object in a line, and its keys that occur twice with the same value; None if there is no
    object that can be written again."""
    again: list[str] = []

    def pairs(items: list[tuple[str, Json]]) -> dict[str, Json]:
        found: dict[str, Json] = {}
        for key, value in items:
            if key in found:
                if json.dumps(found[key]) != json.dumps(value):
                    raise ValueError(f"{key} twice")
                again.append(key)
            found[key] = value
        return found

    def number(text: str) -> float:
        if not math.isfinite(value := float(text)):
            raise ValueError(text)
        return value

    try:
        value = json.loads(line, object_pairs_hook=pairs, parse_float=number, parse_constant=number)
        _written(value)
    except (ValueError, RecursionError):
        return None
    return (value, again) if isinstance(value, dict) else None


def _written(value: Json) -> bytes:
    return json.dumps(value, ensure_ascii=False, separators=(",", ":")).encode() + b"\n"


class _Mending:
    """The state of mending one log."""

    def __init__(self, source: Path, unit: TimeUnit | None, tx: int) -> None:
        self.changes: dict[str, tuple[int, int]] = {}
        self._source, self._unit, self._tx = source, unit, tx
        self._line = 0
        self._station: object = None
        self._was = self._seq = 0
        """The last seq, before and after."""

    def line(self, line: bytes) -> bytes:
        """The mended line; empty if it is left out."""
        self._line += 1
        if self._line == 1 and line.startswith(_BOM):
            line = line[len(_BOM) :]
            self._changed("byte order mark removed")
        if not line.strip() and line.strip(b"\0") == line:
            self._changed("empty line removed")
            return b""
        parsed = _parsed(line)
        if parsed is None:
            if self._line == 1:
                raise BadInput(self._source, 1, "", "not a JSON object: nothing to mend", "json")
            return line
        value, again = parsed
        for key in again:
            self._changed(f"{key} written once")
        if not line.endswith(b"\n") or line.endswith(b"\r\n"):
            self._changed("line ended with LF")
            line = line.rstrip(b"\r\n") + b"\n"
        before = _written(value)
        self._record(value)
        after = _written(value)
        return line if before == after and not again else after

    def _changed(self, what: str) -> None:
        times, line = self.changes.get(what, (0, self._line))
        self.changes[what] = times + 1, line

    def _record(self, value: dict[str, Json]) -> None:
        if self._unit is not None:
            self._to_ms(value, self._unit)
        self._numbers(value, "")
        for _ in range(len(value) + 1):  # a renamed field may contain a fraction
            found, supposed = line_problems(value, self._station)
            mended = [self._mend(value, path, problem) for path, problem in found]
            if not any(mended):
                break
            self._numbers(value, "")
        match supposed.get("rec"):
            case "header" if self._line == 1:
                self._station = value.get("station")
            case "event":
                self._count(value)
            case "end" if type(value.get("seq")) is int and value["seq"] >= 0:
                self._renumber(value, self._seq + max(0, value["seq"] - self._was))

    def _to_ms(self, value: dict[str, Json], unit: TimeUnit) -> None:
        """Convert the times of an event, whatever their type, and the fractions in other times."""
        parameters = value.get("parameters") if value.get("rec") == "header" else None
        if isinstance(parameters, dict):
            times = {name: v for name, v in parameters.items() if is_time(name)}
            if any(isinstance(v, float) for v in times.values()):
                for name in times:
                    self._convert(parameters, name, unit)
        for name in _TIMES if value.get("rec") == "event" else ():
            self._convert(value, name, unit)
        for within, name in list(_members(value)):
            if isinstance(within[name], float) and is_time(name):
                self._convert(within, name, unit)

    def _convert(self, within: dict[str, Json], name: str, unit: TimeUnit) -> None:
        value = within.get(name)
        if isinstance(value, bool) or not isinstance(value, int | float):
            return
        ms = int((Decimal(str(value)) * _MS[unit]).to_integral_value(ROUND_HALF_UP))
        if type(value) is int and ms == value:
            return
        self._changed(f"{name} from {unit} to ms")
        within[name] = ms
        if name == "late_ms" and ms == 0:
            del within[name]

    def _numbers(self, value: Json, path: str) -> Json:
        """Replace integral floats by integers, and fractions in vendor fields by text; remove
        nulls from objects."""
        match value:
            case dict():
                for name, inner in list(value.items()):
                    if inner is None:
                        del value[name]
                        self._changed(f"null removed from {name}")
                    else:
                        value[name] = self._numbers(inner, path if path[:2] == "x_" else name)
            case list():
                value[:] = [self._numbers(inner, path) for inner in value]
            case float() if value.is_integer() and abs(value) < 2**53:
                self._changed(f"{path} without a decimal point")
                return int(value)
            case float() if path.startswith("x_"):
                self._changed(f"{path} as text")
                return str(value)
        return value

    def _mend(self, value: dict[str, Json], path: str, problem: str) -> bool:
        """Mend one problem, if its remedy is mechanical."""
        if path == "tx" and problem.startswith("missing") and type(self._station) is int:
            self._tx += 1
            value["tx"] = f"{self._station}:{self._tx}"
            self._changed("tx counted")
            return True
        within, name = _located(value, path)
        if within is None:
            return False
        was = within[name]
        if problem.startswith("unknown field: name it"):
            new = f"x_{name}"
            while new in within:
                new += "_"
            renamed = {new if key == name else key: inner for key, inner in within.items()}
            within.clear()
            within.update(renamed)
            self._changed(f"{name} renamed to {new}")
        elif problem.startswith("must be an integer") and isinstance(was, str) and _is_number(was):
            within[name] = int(was)
            self._changed(f"{name} as a number")
        elif problem.startswith("must be sorted") and isinstance(was, list):
            within[name] = sorted(set(was))
            self._changed(f"{name} sorted")
        else:
            return False
        return True

    def _count(self, event: dict[str, Json]) -> None:
        """Number an event. Numbers that are left out stay so: there events are missing."""
        was = event.get("seq")
        if type(was) is not int:
            was = self._was + 1
        self._seq += max(1, was - self._was)
        self._was = was
        self._renumber(event, self._seq)

    def _renumber(self, record: dict[str, Json], seq: int) -> None:
        if type(record.get("seq")) is not int or record["seq"] != seq:
            record["seq"] = seq
            self._changed("seq renumbered")


def _is_number(text: str) -> bool:
    return text.isascii() and text.isdigit() and len(text) <= 16


def _members(value: Json) -> Iterator[tuple[dict[str, Json], str]]:
    """All fields of all objects inside a value, except vendor fields."""
    if isinstance(value, list):
        for inner in value:
            yield from _members(inner)
    if isinstance(value, dict):
        for name, inner in value.items():
            if not name.startswith("x_"):
                yield value, name
                yield from _members(inner)


def _located(value: Json, path: str) -> tuple[dict[str, Json] | None, str]:
    """The object and the field that a path names; a name may itself contain a dot."""
    if not isinstance(value, dict):
        return None, ""
    if path in value:
        return value, path
    for name, inner in value.items():
        if path.startswith(f"{name}.") and (found := _located(inner, path[len(name) + 1 :]))[0]:
            return found
    return None, ""
