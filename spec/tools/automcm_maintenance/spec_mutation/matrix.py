"""The matrix of mutants of Station and properties: each property by itself, not the first one."""

from __future__ import annotations

import hashlib
import json
import re
import threading
from collections.abc import Callable, Collection, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Literal

from pydantic import TypeAdapter, ValidationError

from automcm_maintenance.spec_mutation import matrix_modules, mutants
from automcm_maintenance.spec_mutation.matrix_modules import LIMIT, ORIGINAL, Checks
from automcm_maintenance.spec_mutation.mutant_runs import MutationError
from automcm_maintenance.spec_mutation.mutants import Mutant
from automcm_spec.model_checking import models, tlc, toolchain
from automcm_spec.model_checking.models import PROPERTY_IDS, Model
from automcm_spec.support import scratch
from automcm_spec.support.paths import TLA

CFGS = (
    "restarts",
    "one_by_one_two_sessions",
    "one_by_two",
    "unreduced",
    "two_by_one",
    "cams_without_marks",
    "together_slow",
    "station_properties",
    "cam_ahead",
    "left_alone",
    "independent_tight",
    "timed",
    "either_role",
    "promise_kept",
    "completes",
    "silence",
    "ends",
)
"""The models of the matrix, in the order in which they run: for each property the cheapest.

A property that one of them has shown to be violated is not checked again."""


@dataclass(frozen=True)
class Changed:
    """Other constants of a model, and its number of distinct states with them, which is checked."""

    constants: Mapping[str, str]
    distinct_states: int

    def of(self, cfg: str) -> str:
        """The cfg with these constants.  Raises MutationError if it has none of a name."""
        for name, value in self.constants.items():
            cfg, count = re.subn(rf"(?m)^  {name} = .*$", f"  {name} = {value}", cfg)
            if count != 1:
                raise MutationError(f"the model has no constant {name} to change")
        return cfg


CHANGED: Mapping[str, Changed] = {
    "two_by_one": Changed({"MaxRounds": "1"}, 1118),
    "station_properties": Changed({"OwnSessions": "{1}"}, 255),
    "cam_ahead": Changed({"Lease": "5"}, 6099),
    "left_alone": Changed({"Lease": "4"}, 18434),
    "independent_tight": Changed({"OutboxLimit": "2"}, 141),
    "timed": Changed({"Sendings": "1"}, 7581),
    "either_role": Changed({"MaxRounds": "3"}, 1215),
    "ends": Changed({"MaxRounds": "1"}, 1113),
}
"""The models that are smaller here, because hundreds of mutants run in them; and one with more
rounds, because a late copy of the first proposal does harm only in the third."""

COMPARED = "station_properties"
"""The model in which each answer is compared with that of the unmutated station."""

MODULE = "Station"
"""The module whose mutants are in the matrix."""

STATES = 3
"""A mutant is explored up to this multiple of the model's number of states."""

End = Literal["finished", "states", "error", "time", "left"]
ENDS: dict[End, str] = {
    "finished": "all its states were explored, or all properties were violated",
    "states": f"it has more than {STATES} times the model's states; the rest was not explored",
    "error": "TLC could not evaluate the mutant in a state, and stopped there",
    "time": "TLC did not end in time, or exceeded its memory",
    "left": "it was not explored, because another property kills it and the run was sparing",
}
"""The ways in which the exploration of a mutant ends.  Only after the first is a property that was
not violated known to hold."""

_VERSION = 1  # of the keys: raise it when a change of the code may change a result
_HEAP_MB = 2000
_BATCH = 48
_BATCH_STATES = 1_000_000
_BATCH_TEMPORAL = 6  # TLC stops at the first violation, and the rest of the batch runs again
_SHORT_STATES = 40_000
_AT = re.compile(r"^/\\ mut = (\d+)$", re.MULTILINE)
_COMMENT = re.compile(r"\\\*[^\n]*|\(\*.*?\*\)", re.DOTALL)
_ALPHABET = "Alphabet"  # of OpenStation; TLC computes it once, so it must not depend on the mutant

Notify = Callable[[str], None]


@dataclass(frozen=True)
class MatrixCell:
    """A mutant in a model: the violated properties (ids), and how the exploration ended."""

    kills: tuple[str, ...]
    end: End


@dataclass
class MatrixRow:
    """A mutant: the first model that violates each property, and the models that did not finish."""

    mutant: Mutant
    kills: dict[str, str] = field(default_factory=dict)
    unfinished: dict[str, End] = field(default_factory=dict)
    models: int = 0


@dataclass(frozen=True)
class _Unit:
    """What one run checks: a model, one temporal property of it, or the safety of that."""

    model: Model
    checks: Checks
    source: str
    distinct_states: int

    @property
    def name(self) -> str:
        """The model, and its property if it is temporal."""
        return f"{self.model.cfg} {' '.join(self.checks.temporal)}".strip()


_KEPT = TypeAdapter(tuple[str, list[str], End])


class Cells:
    """Finished cells, one line of JSON for each, by the hash of all that a result depends on."""

    def __init__(self, path: Path | None) -> None:
        self._path = path
        self._lock = threading.Lock()
        self._found: dict[str, MatrixCell] = {}
        if path is not None and path.is_file():
            for line in path.read_text(encoding="utf-8").splitlines():
                try:
                    key, kills, end = _KEPT.validate_json(line)
                except ValidationError:
                    continue  # a line that a killed run did not finish
                self._found[key] = MatrixCell(tuple(kills), end)

    def get(self, key: str) -> MatrixCell | None:
        """The kept cell; one that ran out of time is tried again."""
        cell = self._found.get(key)
        return None if cell is None or cell.end == "time" else cell

    def put(self, key: str, cell: MatrixCell) -> None:
        """Keep a cell."""
        with self._lock:
            self._found[key] = cell
            if self._path is not None:
                self._path.parent.mkdir(parents=True, exist_ok=True)
                with self._path.open("a", encoding="utf-8") as file:
                    file.write(json.dumps([key, cell.kills, cell.end]) + "\n")


class _Stopped(Exception):
    """The run is being interrupted."""


class Matrix:
    """The units, the modules, and the cells."""

    def __init__(
        self,
        chosen: Sequence[Model],
        tla: Path = TLA,
        cells: Path | None = None,
        module: str = MODULE,
        sparing: bool = False,
    ) -> None:
        self.stop = tlc.TlcStop()
        self._sparing = sparing
        self._module = module
        self._cells = Cells(cells)
        self._texts = {p.stem: p.read_text(encoding="utf-8") for p in sorted(tla.glob("*.tla"))}
        self._source = self._texts[module].encode()
        self._spans = mutants.definitions(self._source)
        self.units = [unit for model in chosen for unit in self._of(model)]
        self._fixed = _reached(_ALPHABET, "\n".join(map(self._texts.__getitem__, self._texts)))

    def _of(self, model: Model) -> list[_Unit]:
        changed = CHANGED.get(model.cfg, Changed({}, model.distinct_states or 1))
        cfg = changed.of(model.config)
        try:
            checks = matrix_modules.checks(
                model.module, cfg, self._texts, compared=model.cfg == COMPARED
            )
        except matrix_modules.Unsupported as error:
            raise MutationError(f"{model.cfg}: {error}") from error
        read = models.extended(model.module, self._texts, instances=True) - {self._module}
        rest = [_COMMENT.sub("", self._texts[name]) for name in sorted(read)]
        source = "\0".join([cfg, *rest, toolchain.SHA256, str((_VERSION, STATES))])
        each = [one for name in checks.temporal for one in _halves(checks, name)] or [checks]
        return [_Unit(model, one, source, changed.distinct_states) for one in each]

    def key(self, unit: _Unit, mutant: Mutant | None, known: Collection[str]) -> str:
        """The hash of all that a cell depends on."""
        text = self._source if mutant is None else mutant.apply(self._source)
        asked = [name for name in unit.checks.names if id_of(name) not in known]
        parts = [unit.source, _COMMENT.sub("", text.decode()), unit.name, *asked]
        return hashlib.sha256("\0".join(parts).encode()).hexdigest()

    def run(
        self, wanted: Sequence[Mutant], jobs: int, notify: Notify
    ) -> tuple[list[MatrixRow], bool]:
        """The rows of the mutants, and whether all cells are known.

        On Ctrl-C the active runs are killed.  The next run with the same cells continues.  Raises
        MutationError if a property is violated without a mutant, or if a tool fails.
        """
        rows = {n: MatrixRow(mutant) for n, mutant in enumerate(wanted, start=1)}
        total = len(self.units) * len(rows)
        for place, unit in enumerate(self.units):

            def told(left: int, place: int = place, unit: _Unit = unit) -> None:
                done = place * len(rows) + len(rows) - left
                notify(f"{done} of {total} cells: {unit.name}, {len(rows) - left} of {len(rows)}")

            if not self._unit(unit, rows, jobs, told):
                return list(rows.values()), False
        return list(rows.values()), True

    def _unit(
        self, unit: _Unit, rows: Mapping[int, MatrixRow], jobs: int, told: Callable[[int], None]
    ) -> bool:
        """Fill the cells of a unit; False if interrupted."""
        ids = [id_of(name) for name in unit.checks.names]
        todo: dict[int, str] = {}
        for n, row in rows.items():
            row.models += 1
            if "error" in row.unfinished.values() or all(id_ in row.kills for id_ in ids):
                continue
            key = self.key(unit, row.mutant, row.kills)
            if (cell := self._cells.get(key)) is not None:
                _enter(row, unit, cell)
            elif unit.checks.temporal and self._spared(row):
                row.unfinished[unit.name] = "left"
            else:
                todo[n] = key
        told(len(todo))
        if not todo:
            return True
        try:
            self._original(unit)
            seen = self._seen(unit, {n: rows[n].mutant for n in todo})

            def keep(found: Mapping[int, MatrixCell]) -> None:
                for n, cell in found.items():
                    self._cells.put(todo.pop(n), cell)
                    _enter(rows[n], unit, cell)
                told(len(todo))

            keep({n: MatrixCell((), "finished") for n in todo if n not in seen})
            if together := len(alike := self._alike(unit)) > 1:
                self._together(alike, rows, todo, jobs, keep)
            self._explore(unit, {n: rows[n] for n in todo}, jobs, keep, alone=together)
        except (KeyboardInterrupt, _Stopped):
            return False
        return True

    def _together(
        self,
        alike: Sequence[_Unit],
        rows: Mapping[int, MatrixRow],
        todo: Mapping[int, str],
        jobs: int,
        keep: Callable[[Mapping[int, MatrixCell]], None],
    ) -> None:
        """Explore temporal properties of the same behaviour in one run.

        The cells of a mutant that violates none are kept.  Of any other, the run does not say which
        property it violates.
        """
        names = tuple(dict.fromkeys(name for unit in alike for name in unit.checks.temporal))
        joint = replace(alike[0], checks=replace(alike[0].checks, temporal=names))
        keys = {n: self.key(joint, rows[n].mutant, rows[n].kills) for n in todo}

        def clean(found: Mapping[int, MatrixCell]) -> None:
            holds = {n: c for n, c in found.items() if not c.kills and c.end != "time"}
            for n in found.keys() - holds.keys():
                self._cells.put(keys[n], found[n])
            for n, cell in holds.items():
                for other in alike[1:]:
                    self._cells.put(self.key(other, rows[n].mutant, rows[n].kills), cell)
            keep(holds)

        new = {n: rows[n] for n in todo if self._cells.get(keys[n]) is None}
        self._explore(joint, new, jobs, clean)

    def _alike(self, unit: _Unit) -> list[_Unit]:
        """It, and the later units that check another temporal property of the same behaviour."""

        def explored(one: _Unit) -> tuple[str, ...]:
            c = one.checks
            rest = " ".join(_COMMENT.sub("", c.rest).split())
            return c.module, rest, c.init, c.next, c.variables, c.fairness, c.view

        if not unit.checks.temporal:
            return [unit]
        later = self.units[self.units.index(unit) :]
        return [one for one in later if one.checks.temporal and explored(one) == explored(unit)]

    def _explore(
        self,
        unit: _Unit,
        rows: Mapping[int, MatrixRow],
        jobs: int,
        keep: Callable[[Mapping[int, MatrixCell]], None],
        alone: bool = False,
    ) -> None:
        """Explore the mutants in batches, or each alone, and keep the cells of each."""
        wanted = {n: row.mutant for n, row in rows.items()}
        batches = [[n] for n in wanted] if alone else self._batches(unit, wanted)
        with ThreadPoolExecutor(max_workers=jobs) as pool:
            futures = [
                pool.submit(
                    self._explored,
                    unit,
                    {n: rows[n].mutant for n in batch},
                    {n: set(rows[n].kills) for n in batch},
                )
                for batch in batches
            ]
            try:
                for future in as_completed(futures):
                    keep(future.result())
            except BaseException:
                self.stop.now()
                pool.shutdown(cancel_futures=True)
                raise

    def _spared(self, row: MatrixRow) -> bool:
        """Whether a property kills it, and the run is sparing."""
        return self._sparing and bool(set(row.kills) - {matrix_modules.ORACLE})

    def _batches(self, unit: _Unit, wanted: Mapping[int, Mutant]) -> list[list[int]]:
        """The mutants in the order of the text; alone, those that change the alphabet."""
        share = unit.distinct_states / (unit.model.distinct_states or 1)
        states = round((unit.model.states or 1) * share) or 1
        size = max(4, min(_BATCH, _BATCH_STATES // states))
        size = _BATCH_TEMPORAL if unit.checks.temporal else size
        fixed = self._fixed_in(unit)
        alone = [[n] for n, mutant in wanted.items() if mutant.operator in fixed]
        rest = [n for n, mutant in wanted.items() if mutant.operator not in fixed]
        return [*(rest[i : i + size] for i in range(0, len(rest), size)), *alone]

    def _seen(self, unit: _Unit, wanted: Mapping[int, Mutant]) -> set[int]:
        """The mutants of which an operator has another value somewhere in the unmutated model.

        The others have the same states and steps as the model, and need not be explored.  All are
        explored if TLC does not say which mutant it could not evaluate.
        """
        fixed = self._fixed_in(unit)
        seen = {n for n, mutant in wanted.items() if mutant.operator in fixed}
        while left := {n: mutant for n, mutant in wanted.items() if n not in seen}:
            text = matrix_modules.compared(self._source, self._spans, left)

            def read(line: str) -> None:
                if (found := matrix_modules.printed(line)) is not None:
                    seen.add(found[0])

            try:
                self._tlc(unit, text, [ORIGINAL], {}, read)
            except tlc.TlcError as error:
                self._check(error)
                before = len(seen)
                for line in re.findall(r"[Ll]ine (\d+), .* in Station$", error.nested, re.M):
                    if (n := matrix_modules.version_at(text, int(line))) in left:
                        seen.add(n)
                if len(seen) == before:
                    return set(wanted)
            else:
                break
        return seen

    def _fixed_in(self, unit: _Unit) -> Collection[str]:
        """The operators on which the alphabet of the model depends."""
        read = models.extended(unit.model.module, self._texts)
        return self._fixed if "OpenStation" in read else ()

    def _original(self, unit: _Unit) -> None:
        """Without a mutant nothing may be violated; else the matrix would mean nothing."""
        key = self.key(unit, None, ())
        cell = self._cells.get(key)
        if cell is None:
            cell = self._explored(unit, {ORIGINAL: None}, {})[ORIGINAL]
            self._cells.put(key, cell)
        if cell != MatrixCell((), "finished"):
            raise MutationError(f"{unit.name} is not as expected without a mutant: {cell}")

    def _explored(
        self,
        unit: _Unit,
        batch: Mapping[int, Mutant | None],
        known: Mapping[int, Collection[str]],
    ) -> dict[int, MatrixCell]:
        """The cells of a batch.

        TLC stops at a mutant that it cannot evaluate, and at a temporal property that is violated.
        Then the others are explored again, without what is already known.  If TLC does not say
        which mutant it was, both halves of the batch are explored.
        """
        kills: dict[int, set[str]] = {n: set() for n in batch}
        limited: set[int] = set()
        cells: dict[int, MatrixCell] = {}
        ids = {id_of(name) for name in unit.checks.names}

        def end(n: int, how: End) -> None:
            cells[n] = MatrixCell(tuple(sorted(kills[n])), how)

        def settled(n: int) -> set[str]:
            return kills[n] | set(known.get(n, ()))

        left = list(batch)
        while left:
            culprit, how = self._run(unit, {n: batch[n] for n in left}, settled, kills, limited)
            if how == "finished" and culprit is None:
                for n in left:
                    end(n, "states" if n in limited and ids - settled(n) else "finished")
                break
            if culprit is None and len(left) > 1:
                middle = len(left) // 2
                for half in (left[:middle], left[middle:]):
                    part = {n: batch[n] for n in half}
                    for n, cell in self._explored(
                        unit, part, {n: settled(n) for n in half}
                    ).items():
                        kills[n] |= set(cell.kills)
                        end(n, cell.end)
                break
            done = [left[0] if culprit is None else culprit]
            end(done[0], how)
            for n in left:
                if n not in done and (n in limited or ids <= settled(n)):
                    end(n, "finished" if ids <= settled(n) else "states")
                    done.append(n)
            left = [n for n in left if n not in done]
        return cells

    def _run(
        self,
        unit: _Unit,
        batch: Mapping[int, Mutant | None],
        settled: Callable[[int], set[str]],
        kills: Mapping[int, set[str]],
        limited: set[int],
    ) -> tuple[int | None, End]:
        """One run of TLC: the mutant at which it stopped, if any, and the reason."""
        skipped = {
            n: {name for name in unit.checks.names if id_of(name) in settled(n)} for n in batch
        }

        def read(line: str) -> None:
            if (found := matrix_modules.printed(line)) is not None:
                n, name = found
                if name == LIMIT:
                    limited.add(n)
                else:
                    kills[n].add(id_of(name))

        changed = {n: mutant for n, mutant in batch.items() if mutant is not None}
        text = matrix_modules.station(self._source, self._spans, changed)
        try:
            result = self._tlc(unit, text, list(batch), skipped, read)
        except tlc.TlcError as error:
            return self._failure(error, batch)
        if result.outcome == "holds":
            if list(batch) == [ORIGINAL] and result.distinct_states != unit.distinct_states:
                counts = f"{result.distinct_states} states, not {unit.distinct_states}"
                raise MutationError(f"{unit.name} without a mutant has {counts}")
            return None, "finished"
        number = result.trace[-1].values.get("mut") if result.trace else None
        if not unit.checks.temporal or not isinstance(number, int) or number not in batch:
            raise MutationError(f"{unit.name}: TLC reports {result.property}, not a mutant")
        kills[number].add(id_of(unit.checks.temporal[0]))
        return number, "finished"

    def _tlc(
        self,
        unit: _Unit,
        station: bytes,
        numbers: Sequence[int],
        known: Mapping[int, Collection[str]],
        read: Callable[[str], None],
    ) -> tlc.TlcResult:
        """One run of TLC on a generated Station."""
        if self.stop.stopped:
            raise _Stopped
        limit = STATES * unit.distinct_states
        with scratch.folder("matrix") as folder:
            for name in models.extended(unit.model.module, self._texts, instances=True):
                (folder / f"{name}.tla").write_text(self._texts[name], encoding="utf-8")
            (folder / f"{self._module}.tla").write_bytes(station)
            if unit.checks.compared:
                original = matrix_modules.beside(self._source)
                (folder / f"{matrix_modules.BESIDE}.tla").write_bytes(original)
            module, cfg = matrix_modules.matrix(unit.checks, numbers, known, limit)
            (folder / f"{matrix_modules.MODULE}.tla").write_text(module, encoding="utf-8")
            path = folder / f"{matrix_modules.MODULE}.cfg"
            path.write_text(cfg, encoding="utf-8")
            return tlc.run(
                matrix_modules.MODULE,
                path,
                tla_dir=folder,
                extra=("-lncheck", "final"),
                heap_mb=_HEAP_MB,
                timeout_s=120 + 6 * unit.model.seconds * len(numbers),
                on_print=read,
                stop=self.stop,
                short=not unit.checks.temporal
                and len(numbers) * (unit.model.states or 1) < _SHORT_STATES,
            )

    def _check(self, error: tlc.TlcError) -> None:
        if self.stop.stopped:
            raise _Stopped from error
        if error.kind in ("java", "disk"):
            raise MutationError(str(error)) from error

    def _failure(
        self, error: tlc.TlcError, batch: Mapping[int, Mutant | None]
    ) -> tuple[int | None, End]:
        self._check(error)
        if error.kind in ("timeout", "memory"):
            return None, "time"
        if error.kind == "parse" and len(batch) == 1:
            raise MutationError(f"mutant {next(iter(batch.values()))}: {error}") from error
        found = _AT.search(error.state or "")
        number = int(found[1]) if found else None
        return number if number in batch else None, "error"


def id_of(name: str) -> str:
    """The id of a property, or its name if it has none."""
    return PROPERTY_IDS.get(name, name)


def _halves(checks: Checks, name: str) -> list[Checks]:
    """The checks of a temporal property: its safety, of many mutants in one run, then the whole."""
    whole = replace(checks, temporal=(name,))
    if name not in checks.parts:
        return [whole]
    entry, step = checks.parts[name]
    return [replace(checks, temporal=(), steps={name: step}, entries={name: entry}), whole]


def _enter(row: MatrixRow, unit: _Unit, cell: MatrixCell) -> None:
    for id_ in cell.kills:
        row.kills.setdefault(id_, unit.model.cfg)
    if cell.end != "finished":
        row.unfinished[unit.name] = cell.end


def _reached(name: str, text: str) -> set[str]:
    """The operators that a definition mentions, directly or indirectly."""
    text = _COMMENT.sub("", text)
    bodies = {
        found[1]: set(re.findall(r"\w+", found[2]))
        for found in re.finditer(
            r"^(\w+)(?:\([^)]*\))?\s*==(.*?)(?=^\S|\Z)", text, re.MULTILINE | re.DOTALL
        )
    }
    reached: set[str] = set()
    left = {name} & set(bodies)
    while left:
        one = left.pop()
        reached.add(one)
        left |= (bodies[one] & set(bodies)) - reached
    return reached
