"""Compares two runs, or two implementations, and finds where their behaviour first differs.

Logs are aligned by station and compared step by step (an input with its effects). Details that an
implementation may choose are not compared (``automcm_traces.edit.canonical_log``).
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from difflib import SequenceMatcher
from itertools import zip_longest
from pathlib import Path

from automcm_spec.log_format.event_text import fitted, safe, summary
from automcm_spec.log_format.reader import Log, read
from automcm_spec.support.bad_input import BadInput
from automcm_spec.vocabulary.messages import same
from automcm_traces.edit.canonical_log import Canonical, CanonicalEvent, CanonicalStep
from automcm_traces.explain.log_table import Logs

SHOWN = 3
"""The number of steps shown before the difference."""
ROWS = 30
"""The maximum number of table rows shown; the last ones."""
LONGEST = 60
"""The maximum length of a value shown, in characters."""
_Fields = tuple[tuple[str, object, object], ...]


@dataclass(frozen=True, slots=True)
class RunDifference:
    """The first event that differs; one of the two may be missing."""

    a: CanonicalEvent | None
    b: CanonicalEvent | None
    fields: _Fields = ()
    """The differences between two events of one kind: the path of the field, and both values."""
    steps: tuple[tuple[CanonicalStep, CanonicalStep], ...] = ()
    """The last steps of both logs, up to and including the one that differs."""


@dataclass(slots=True)
class StationDiff:
    """The two logs of one station, and the result of comparing them."""

    station: int
    file_a: str
    file_b: str
    steps: int = 0
    """The number of equal steps."""
    difference: RunDifference | None = None
    apart_ms: int = 0
    """The maximum time difference of equal steps, each time measured from the first step of its
    log."""
    apart: tuple[int, int] = (0, 0)
    """The lines with that difference."""
    skipped: tuple[str, ...] = ()
    """Event kinds that are not compared, because one of the logs does not promise them."""
    parameters: _Fields = ()
    """The header parameters that differ."""
    pairs: list[tuple[int, int]] = field(default_factory=list)
    """The lines of equal events, as far as both logs have them in the same order; the last pair is
    the one that differs, if both logs have it."""

    def as_dict(self) -> dict[str, object]:
        """The ``--json`` form."""
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
            found["difference"] = {
                "a": _as_dict(d.a),
                "b": _as_dict(d.b),
                "fields": _as_dicts(d.fields),
            }
        return found


@dataclass(slots=True)
class Diff:
    """The comparison of all stations."""

    stations: list[StationDiff] = field(default_factory=list)
    only_a: list[str] = field(default_factory=list)
    only_b: list[str] = field(default_factory=list)
    """Logs of stations that the other side lacks."""
    first: int = 0
    """The station at which A first differs from B; 0 if there is none."""
    warnings: list[str] = field(default_factory=list)
    """What may be missing in the logs, one line each."""

    @property
    def same(self) -> bool:
        """Whether there is no difference at all."""
        return not (self.only_a or self.only_b or any(c.difference for c in self.stations))

    def as_dict(self) -> dict[str, object]:
        """The ``--json`` form."""
        return {
            "same": self.same,
            "first": self.first,
            "stations": [one.as_dict() for one in self.stations],
            "only_a": self.only_a,
            "only_b": self.only_b,
            "warnings": self.warnings,
        }


def diff(a: Sequence[Path], b: Sequence[Path], stations: Mapping[int, int] | None = None) -> Diff:
    """Compare logs with the logs of the same stations.

    ``stations`` maps stations of A to stations of B with other ids. If both sides have one log,
    they are compared whatever their ids. Raises BadInput, also for two logs of one station.
    """
    found = diff_logs([read(path) for path in a], [read(path) for path in b], stations)
    found.first = _first(a, found.stations)
    return found


def diff_logs(
    a: Sequence[Log], b: Sequence[Log], stations: Mapping[int, int] | None = None
) -> Diff:
    """As ``diff``, for logs already read; it does not determine the first station that differs."""
    logs_a, logs_b = _by_station(a), _by_station(b)
    pairs = dict(stations or {})
    if len(logs_a) == len(logs_b) == 1 and not pairs:
        pairs = {next(iter(logs_a)): next(iter(logs_b))}
    ids = {other: one for one, other in pairs.items()}
    found = Diff(warnings=[text for log in (*a, *b) for text in _missing(log)])
    for station, log in logs_a.items():
        other = logs_b.pop(pairs.get(station, station), None)
        if other is None:
            found.only_a.append(log.file)
        else:
            found.stations.append(compared(log, other, ids))
    found.only_b = [log.file for log in logs_b.values()]
    return found


def _missing(log: Log) -> Iterator[str]:
    yield from log.warnings
    if log.end is not None and log.end.lost_records:
        yield f"{log.file}: lost {log.end.lost_records} records"


def _by_station(given: Sequence[Log]) -> dict[int, Log]:
    logs: dict[int, Log] = {}
    for log in given:
        station = log.header.station
        if station in logs:
            other = logs[station].file
            raise BadInput(log.file, 1, "station", f"{station} is also the station of {other}")
        logs[station] = log
    return dict(sorted(logs.items()))


def _first(paths: Sequence[Path], found: Sequence[StationDiff]) -> int:
    """The station that differs first, in one possible order of A's events."""
    differ = [(one.station, one.difference) for one in found if one.difference is not None]
    places = ((station, d.a or d.steps[-1][0].input) for station, d in differ)
    lines = {station: 0 if at is None else at.line for station, at in places}
    if len(lines) > 1:
        for row in Logs(paths).rows():
            if row.station in lines and row.line >= (lines[row.station] or 10**12):
                return row.station
    return next(iter(lines), 0)


def compared(a: Log, b: Log, ids: Mapping[int, int]) -> StationDiff:
    """Compare two logs of one station; ``ids`` maps stations of B to their ids in A."""
    promised = set(a.header.complete), set(b.header.complete)
    kinds = sorted(promised[0] & promised[1])
    skipped = tuple(sorted(promised[0] ^ promised[1]))
    found = StationDiff(a.header.station, a.file, b.file, skipped=skipped)
    parameters = a.header.parameters.model_dump(), b.header.parameters.model_dump()
    found.parameters = tuple(_paths("", *parameters))
    kept: list[tuple[CanonicalStep, CanonicalStep]] = []
    start: tuple[int, int] | None = None
    both = zip_longest(Canonical(a, kinds).steps(), Canonical(b, kinds, ids).steps())
    for one, other in both:
        one, other = one or CanonicalStep(None), other or CanonicalStep(None)
        one, other = _observed(one, other), _observed(other, one)
        kept = [*kept[-SHOWN:], (one, other)]
        first = _differ(one, other)
        if first is not None:
            found.difference = RunDifference(*first, tuple(kept))
            found.pairs += _pairs(one, other, first[:2])
            break
        found.steps += 1
        found.pairs += _pairs(one, other)
        at = one.events[0], other.events[0]
        times = at[0].event.t_ms, at[1].event.t_ms
        start = start or times
        apart = abs((times[0] - start[0]) - (times[1] - start[1]))
        if apart > found.apart_ms:
            found.apart_ms, found.apart = apart, (at[0].line, at[1].line)
    return found


def _observed(step: CanonicalStep, other: CanonicalStep) -> CanonicalStep:
    """The step, its indications without the fields that the other log lacks: an absent field was
    not observed (docs/trace-format.md)."""
    told = (entry.fields.get("indication") for entry in other.effects)
    names = {one["name"]: one.keys() for one in told if one}

    def stated(entry: CanonicalEvent) -> CanonicalEvent:
        one = entry.fields.get("indication")
        if one is None or one["name"] not in names:
            return entry
        kept = {name: value for name, value in one.items() if name in names[one["name"]]}
        return replace(entry, fields=entry.fields | {"indication": kept})

    return replace(step, effects=[stated(entry) for entry in step.effects])


def _pairs(
    a: CanonicalStep,
    b: CanonicalStep,
    last: tuple[CanonicalEvent | None, CanonicalEvent | None] = (None, None),
) -> list[tuple[int, int]]:
    """The lines of equal events in the same order, before the first events that differ, and of
    these."""
    left, right = (
        [entry for entry in step.events if end is None or entry.line < end.line]
        for step, end in zip((a, b), last, strict=True)
    )
    keys = [entry.key for entry in left], [entry.key for entry in right]
    same = (
        [(0, 0, len(left))]
        if keys[0] == keys[1]
        else SequenceMatcher(None, *keys, autojunk=False).get_matching_blocks()
    )
    found = [(left[i + n].line, right[j + n].line) for i, j, size in same for n in range(size)]
    if last[0] is not None and last[1] is not None:
        found.append((last[0].line, last[1].line))
    return found


def _differ(
    a: CanonicalStep, b: CanonicalStep
) -> tuple[CanonicalEvent | None, CanonicalEvent | None, _Fields] | None:
    """The first events of two steps that differ."""
    if (a.input and a.input.key) != (b.input and b.input.key):
        return a.input, b.input, _fields(a.input, b.input)
    left, right = _without(a.effects, b.effects), _without(b.effects, a.effects)
    if not left:
        return (None, right[0], ()) if right else _phases(a, b)
    other = next((entry for entry in right if entry.kind == left[0].kind), None)
    if other is None and len(left) == len(right) == 1 and left[0].event.ev == right[0].event.ev:
        other = right[0]
    return left[0], other, _fields(left[0], other)


def _without(
    some: Sequence[CanonicalEvent], others: Sequence[CanonicalEvent]
) -> list[CanonicalEvent]:
    """The events that have no equal among the others."""
    left, found = Counter(entry.key for entry in others), []
    for entry in some:
        if left[entry.key]:
            left[entry.key] -= 1
        else:
            found.append(entry)
    return found


def _phases(
    a: CanonicalStep, b: CanonicalStep
) -> tuple[CanonicalEvent, CanonicalEvent, _Fields] | None:
    """The inputs of two steps, if both state the phase or role after it and these differ."""
    if a.input is None or b.input is None:
        return None
    one, other = a.input.event, b.input.event
    pairs = ("phase", one.phase, other.phase), ("role", one.role, other.role)
    apart = tuple((name, x, y) for name, x, y in pairs if x and y and x != y)
    return (a.input, b.input, apart) if apart else None


def _fields(a: CanonicalEvent | None, b: CanonicalEvent | None) -> _Fields:
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


def _as_dict(entry: CanonicalEvent | None) -> object:
    if entry is None:
        return None
    return {"line": entry.line, "t_ms": entry.event.t_ms, "event": summary(entry.event)}


def _as_dicts(fields: _Fields) -> list[object]:
    return [{"field": name, "a": a, "b": b} for name, a, b in fields]


# -- text


def text(found: Diff, times: bool = False, width: int = 80) -> Iterator[str]:
    """The differences as lines; with ``times``, also the time differences."""
    for one in found.stations:
        yield from _station(one, times, width)
    for side, files in (("A", found.only_a), ("B", found.only_b)):
        yield from (f"{file}: only {side} has this station" for file in files)
    if found.first and len(found.stations) > 1:
        yield f"station {found.first} differs first"
    yield from (f"warning: {text}" for text in found.warnings)


def _station(one: StationDiff, times: bool, width: int) -> Iterator[str]:
    d = one.difference
    steps = f"{one.steps} step{'' if one.steps == 1 else 's'}"
    yield f"{one.station}: " + (f"the same, {steps}" if d is None else f"DIFFERS after {steps}")
    if one.skipped:
        yield f"  not compared, because one log does not promise it: {', '.join(one.skipped)}"
    if one.parameters:
        shown = (f"{name} {_short(x)} | {_short(y)}" for name, x, y in one.parameters)
        yield f"  parameters differ: {', '.join(shown)}"
    if times:
        where = f", most at lines {one.apart[0]} and {one.apart[1]}" if one.apart_ms else ""
        yield f"  times are up to {one.apart_ms} ms apart{where}"
    if d is None:
        return
    for file, entry in ((one.file_a, d.a), (one.file_b, d.b)):
        event = f"{entry.line}: {summary(entry.event)}" if entry else " nothing like it"
        yield f"  {file}:{event}"
    for name, x, y in d.fields:
        yield f"  {name}: {_short(x)} | {_short(y)}"
    each = (width - 5) // 2
    yield "  " + f"{fitted(_end_of(one.file_a, each), each)} | {_end_of(one.file_b, each)}".rstrip()
    yield from list(_rows(d, each))[-ROWS:]


def _rows(d: RunDifference, each: int) -> Iterator[str]:
    for a, b in d.steps:
        for x, y in zip_longest(a.events, _beside(a, b)):
            mark = "!" if (x is not None and x is d.a) or (y is not None and y is d.b) else " "
            left = "" if x is None else f"{x.line:>6} {summary(x.event)}"
            right = "" if y is None else f"{y.line:>6} {summary(y.event)}"
            yield f"{mark} {fitted(left, each)} | {fitted(right, each)}".rstrip()


def _beside(a: CanonicalStep, b: CanonicalStep) -> list[CanonicalEvent | None]:
    """The events of ``b``, beside equal events of ``a`` where possible."""
    left, beside = list(b.events), list[CanonicalEvent | None]()
    for entry in a.events:
        equal = [other for other in left if other.key == entry.key]
        alike = [other for other in left if other.kind == entry.kind]
        match = next(iter(equal + alike), None)
        if match is not None:
            left.remove(match)
        beside.append(match)
    return [*beside, *left]


def _end_of(text: str, width: int) -> str:
    return text if len(text) <= width else f"..{text[2 - width :]}"


def _short(value: object) -> str:
    shown = "absent" if value is None else safe(str(value))
    return shown if len(shown) <= LONGEST else f"{shown[:LONGEST]}.."
