"""Two runs, or two implementations, side by side: where do they first do something else?

Logs are aligned by station and compared step by step (an input with its effects); what an
implementation is free to choose is not compared (``automcm_traces.edit.canonical_log``).
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from difflib import SequenceMatcher
from itertools import zip_longest
from pathlib import Path

from automcm_spec.support.bad_input import BadInput
from automcm_spec.vocabulary.messages import same
from automcm_traces.edit.canonical_log import Canonical, Deed, DeedStep
from automcm_traces.explain.log_table import Logs
from automcm_traces.format.event_text import fitted, safe, said
from automcm_traces.format.reader import Log, read

SHOWN = 3
"""Steps before the difference that are shown."""
ROWS = 30
"""Rows of the table at most; the last ones."""
LONGEST = 60
"""Characters of a value that is told."""
_Fields = tuple[tuple[str, object, object], ...]


@dataclass(frozen=True, slots=True)
class Difference:
    """The first event that is not the same; one of the two may be missing."""

    a: Deed | None
    b: Deed | None
    fields: _Fields = ()
    """What differs in two events of one kind: the path of the field, and both values."""
    steps_a: tuple[DeedStep, ...] = ()
    steps_b: tuple[DeedStep, ...] = ()
    """The last steps, up to the one that differs."""


@dataclass(slots=True)
class Compared:
    """The two logs of one station, and what came of it."""

    station: int
    file_a: str
    file_b: str
    steps: int = 0
    """How many steps are the same."""
    difference: Difference | None = None
    apart_ms: int = 0
    """How far the times of steps that are the same are apart at most, each counted from the first
    step of its log."""
    apart: tuple[int, int] = (0, 0)
    """The lines where that is."""
    skipped: tuple[str, ...] = ()
    """Kinds of event that not both logs promise: they are not compared."""
    parameters: _Fields = ()
    """Those of the headers that differ."""
    pairs: list[tuple[int, int]] = field(default_factory=list)
    """Lines of the events that are the same, as far as both logs have them in one order; last, if
    both have it, the one that differs."""

    def as_dict(self) -> dict[str, object]:
        """As in ``--json``."""
        d = self.difference
        found: dict[str, object] = {
            "station": self.station,
            "a": self.file_a,
            "b": self.file_b,
            "same": d is None,
            "steps": self.steps,
            "not_compared": list(self.skipped),
            "parameters": _as_dicts(self.parameters),
            "times": {"apart_ms": self.apart_ms, "lines": list(self.apart)},
        }
        if d is not None:
            found["difference"] = {"a": _told(d.a), "b": _told(d.b), "fields": _as_dicts(d.fields)}
        return found


@dataclass(slots=True)
class Diff:
    """All stations."""

    stations: list[Compared] = field(default_factory=list)
    only_a: list[str] = field(default_factory=list)
    only_b: list[str] = field(default_factory=list)
    """Logs of stations that the other side has not."""
    first: int = 0
    """The station where A first does something else than B; 0 if none does."""

    @property
    def same(self) -> bool:
        """Is there no difference at all?"""
        return not (self.only_a or self.only_b or any(c.difference for c in self.stations))

    def as_dict(self) -> dict[str, object]:
        """As in ``--json``."""
        return {
            "same": self.same,
            "first": self.first,
            "stations": [one.as_dict() for one in self.stations],
            "only_a": self.only_a,
            "only_b": self.only_b,
        }


def diff(a: Sequence[Path], b: Sequence[Path], stations: Mapping[int, int] | None = None) -> Diff:
    """Compare logs with those of the same stations.

    ``stations`` says for a station of A which of B it is, where that has another id; a single log
    on each side is compared whatever the ids.  Raises BadInput, for two logs of one station too.
    """
    found = diff_logs([read(path) for path in a], [read(path) for path in b], stations)
    found.first = _first(a, found.stations)
    return found


def diff_logs(
    a: Sequence[Log], b: Sequence[Log], stations: Mapping[int, int] | None = None
) -> Diff:
    """As ``diff``, of logs that were read; which station is the first to differ is left open."""
    logs_a, logs_b = _by_station(a), _by_station(b)
    pairs = dict(stations or {})
    if len(logs_a) == len(logs_b) == 1 and not pairs:
        pairs = {next(iter(logs_a)): next(iter(logs_b))}
    ids = {other: one for one, other in pairs.items()}
    found = Diff()
    for station, log in logs_a.items():
        other = logs_b.pop(pairs.get(station, station), None)
        if other is None:
            found.only_a.append(log.file)
        else:
            found.stations.append(compared(log, other, ids))
    found.only_b = [log.file for log in logs_b.values()]
    return found


def _by_station(given: Sequence[Log]) -> dict[int, Log]:
    logs: dict[int, Log] = {}
    for log in given:
        station = log.header.station
        if station in logs:
            other = logs[station].file
            raise BadInput(log.file, 1, "station", f"{station} is the station of {other} too")
        logs[station] = log
    return dict(sorted(logs.items()))


def _first(paths: Sequence[Path], found: Sequence[Compared]) -> int:
    """Of several stations that differ the one that does so first in an order A could have had."""
    lines = {
        one.station: one.difference.a.line if one.difference.a is not None else 0
        for one in found
        if one.difference is not None
    }
    if len(lines) > 1:
        for row in Logs(paths).rows():
            if row.station in lines and row.line >= (lines[row.station] or 10**12):
                return row.station
    return next(iter(lines), 0)


def compared(a: Log, b: Log, ids: Mapping[int, int]) -> Compared:
    """Two logs of one station; ``ids`` are stations of B by what A calls them."""
    promised = set(a.header.complete), set(b.header.complete)
    kinds = promised[0] & promised[1]
    skipped = tuple(sorted((promised[0] | promised[1]) - kinds))
    found = Compared(a.header.station, a.file, b.file, skipped=skipped)
    parameters = a.header.parameters.model_dump(), b.header.parameters.model_dump()
    found.parameters = tuple(_paths("", *parameters))
    kept: list[tuple[DeedStep, DeedStep]] = []
    start: tuple[int, int] | None = None
    both = zip_longest(
        Canonical(a, sorted(kinds)).steps(), Canonical(b, sorted(kinds), ids).steps()
    )
    for one, other in both:
        one, other = one or DeedStep(None), other or DeedStep(None)
        kept = [*kept[-SHOWN:], (one, other)]
        first = _differ(one, other)
        if first is not None:
            shown = zip(*kept, strict=True)
            found.difference = Difference(*first, *(tuple(steps) for steps in shown))
            found.pairs += _pairs(one, other, first[:2])
            break
        found.steps += 1
        found.pairs += _pairs(one, other)
        at = one.deeds[0], other.deeds[0]
        times = at[0].event.t_ms, at[1].event.t_ms
        start = start or times
        apart = abs((times[0] - start[0]) - (times[1] - start[1]))
        if apart > found.apart_ms:
            found.apart_ms, found.apart = apart, (at[0].line, at[1].line)
    return found


def _pairs(
    a: DeedStep, b: DeedStep, last: tuple[Deed | None, Deed | None] = (None, None)
) -> list[tuple[int, int]]:
    """Lines of equal events that stand in one order, before the first that differ, and of these."""
    left, right = (
        [deed for deed in step.deeds if end is None or deed.line < end.line]
        for step, end in zip((a, b), last, strict=True)
    )
    keys = [deed.key for deed in left], [deed.key for deed in right]
    same = (
        [(0, 0, len(left))]
        if keys[0] == keys[1]
        else SequenceMatcher(None, *keys, autojunk=False).get_matching_blocks()
    )
    found = [(left[i + n].line, right[j + n].line) for i, j, size in same for n in range(size)]
    if last[0] is not None and last[1] is not None:
        found.append((last[0].line, last[1].line))
    return found


def _differ(a: DeedStep, b: DeedStep) -> tuple[Deed | None, Deed | None, _Fields] | None:
    """The first events of two steps that are not the same."""
    if (a.input and a.input.key) != (b.input and b.input.key):
        return a.input, b.input, _fields(a.input, b.input)
    left, right = _without(a.effects, b.effects), _without(b.effects, a.effects)
    if not left and not right:
        return _phases(a, b)
    if not left:
        return None, right[0], ()
    other = next((deed for deed in right if deed.kind == left[0].kind), None)
    if other is None and len(left) == len(right) == 1 and left[0].event.ev == right[0].event.ev:
        other = right[0]
    return left[0], other, _fields(left[0], other)


def _without(some: Sequence[Deed], others: Sequence[Deed]) -> list[Deed]:
    """Those that have no equal among the others."""
    left, found = Counter(deed.key for deed in others), []
    for deed in some:
        if left[deed.key]:
            left[deed.key] -= 1
        else:
            found.append(deed)
    return found


def _phases(a: DeedStep, b: DeedStep) -> tuple[Deed, Deed, _Fields] | None:
    """The input after which both say another phase or role."""
    if a.input is None or b.input is None:
        return None
    pairs = zip(("phase", "role"), a.input.phase, b.input.phase, strict=True)
    apart = tuple((name, x, y) for name, x, y in pairs if x and y and x != y)
    return (a.input, b.input, apart) if apart else None


def _fields(a: Deed | None, b: Deed | None) -> _Fields:
    if a is None or b is None or a.kind[:3] != b.kind[:3]:
        return ()
    return tuple(_paths("", a.fields, b.fields))


def _paths(path: str, a: object, b: object) -> Iterator[tuple[str, object, object]]:
    if same(a, b):
        return
    if isinstance(a, dict) and isinstance(b, dict):
        for name in sorted(a.keys() | b.keys()):
            yield from _paths(f"{path}.{name}" if path else name, a.get(name), b.get(name))
    else:
        yield path, a, b


def _told(deed: Deed | None) -> object:
    if deed is None:
        return None
    return {"line": deed.line, "t_ms": deed.event.t_ms, "event": said(deed.event)}


def _as_dicts(fields: _Fields) -> list[object]:
    return [{"field": name, "a": a, "b": b} for name, a, b in fields]


# -- for a person


def text(found: Diff, times: bool = False, width: int = 80) -> Iterator[str]:
    """What differs, in lines; with ``times`` also how far the times are apart."""
    for one in found.stations:
        yield from _station(one, times, width)
    for side, files in (("A", found.only_a), ("B", found.only_b)):
        yield from (f"{file}: only {side} has this station" for file in files)
    if found.first and len(found.stations) > 1:
        yield f"the first to differ: station {found.first}"


def _station(one: Compared, times: bool, width: int) -> Iterator[str]:
    d = one.difference
    steps = f"{one.steps} step{'' if one.steps == 1 else 's'}"
    yield f"{one.station}: " + (f"the same, {steps}" if d is None else f"DIFFERS after {steps}")
    if one.skipped:
        yield f"  not compared, for not both promise it: {', '.join(one.skipped)}"
    if one.parameters:
        told = (f"{name} {_short(x)} | {_short(y)}" for name, x, y in one.parameters)
        yield f"  parameters differ: {', '.join(told)}"
    if times:
        where = f", most at lines {one.apart[0]} and {one.apart[1]}" if one.apart_ms else ""
        yield f"  times are up to {one.apart_ms} ms apart{where}"
    if d is None:
        return
    for file, deed in ((one.file_a, d.a), (one.file_b, d.b)):
        yield f"  {file}:{deed.line}: {said(deed.event)}" if deed else f"  {file}: nothing like it"
    for name, x, y in d.fields:
        yield f"  {name}: {_short(x)} | {_short(y)}"
    each = (width - 5) // 2
    yield "  " + f"{fitted(_end_of(one.file_a, each), each)} | {_end_of(one.file_b, each)}".rstrip()
    yield from list(_rows(d, each))[-ROWS:]


def _rows(d: Difference, each: int) -> Iterator[str]:
    for a, b in zip(d.steps_a, d.steps_b, strict=True):
        for x, y in zip_longest(_paired(a, b)[0], _paired(a, b)[1]):
            mark = "!" if (x is not None and x is d.a) or (y is not None and y is d.b) else " "
            left = "" if x is None else f"{x.line:>6} {said(x.event)}"
            right = "" if y is None else f"{y.line:>6} {said(y.event)}"
            yield f"{mark} {fitted(left, each)} | {fitted(right, each)}".rstrip()


def _paired(a: DeedStep, b: DeedStep) -> tuple[list[Deed], list[Deed | None]]:
    """The events of both steps, equal ones beside each other as far as that goes."""
    left, right = a.deeds, list(b.deeds)
    beside: list[Deed | None] = []
    for deed in left:
        equal = [other for other in right if other.key == deed.key]
        alike = [other for other in right if other.kind == deed.kind]
        match = next(iter(equal + alike), None)
        if match is not None:
            right.remove(match)
        beside.append(match)
    return left, [*beside, *right]


def _end_of(text: str, width: int) -> str:
    return text if len(text) <= width else f"..{text[2 - width :]}"


def _short(value: object) -> str:
    told = "absent" if value is None else safe(str(value))
    return told if len(told) <= LONGEST else f"{told[:LONGEST]}.."
