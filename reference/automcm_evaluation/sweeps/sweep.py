"""Runs the cells of an experiment on all cores, and resumes after an interruption.

Each finished cell is a file, named by the hash of all that its result depends on, so that sweeps
can share a folder.  The seed of a cell depends only on the sweep's seed and the cell's values, so
that neither the order nor the number of workers matters.
"""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import as_completed
from concurrent.futures.process import BrokenProcessPool
from functools import partial
from importlib.metadata import version
from pathlib import Path
from typing import Any

from pydantic import TypeAdapter, ValidationError

from automcm_evaluation.framework.experiment import (
    Cell,
    Experiment,
    ExperimentError,
    ExperimentSettings,
    Values,
    canonical,
)
from automcm_evaluation.sweeps.catalogue import experiment
from automcm_maintenance.code_mutation import faults
from automcm_maintenance.documents import repository
from automcm_spec.support import children, files

SOURCES = [
    repository.SOURCES[f"automcm{part}"]
    for part in ("", "_evaluation", "_simulation", "_spec", "_traces")
]
ENDINGS = ".py", ".json", ".xml", ".osm"


CELL = TypeAdapter(Cell)
CELLS = "cells"
"""The folder of the finished cells, one file each."""


def seed_of(name: str, values: Values, seed: int) -> int:
    """The seed of a cell, below 2^48."""
    text = f"{seed} {name} {canonical(values)}"
    return int.from_bytes(hashlib.sha256(text.encode()).digest()[:6], "big")


def code() -> str:
    """A hash of the sources, tables and maps, as 12 hexadecimal digits.  Others may give other
    results."""
    digest = hashlib.sha256()
    for folder in SOURCES:
        for path in sorted(path for path in folder.rglob("*") if path.suffix in ENDINGS):
            name = path.relative_to(folder.parent).as_posix()
            digest.update(name.encode() + b"\0" + path.read_bytes())
    digest.update((faults.CATALOGUES / "ablations.toml").read_bytes())
    return digest.hexdigest()[:12]


def header(made: Experiment, profile: str, seed: int, settings: ExperimentSettings) -> Values:
    """The description of a sweep, for its report."""
    return {
        "experiment": made.name,
        "profile": profile,
        "seed": seed,
        "settings": settings.model_dump(mode="json"),
        "version": version("automcm"),
        "code": code(),
    }


def run_cell(name: str, values: Values, seed: int) -> Values:
    """Run one cell, in any process."""
    result: Values = json.loads(
        canonical(experiment(name).run(values, seed_of(name, values, seed)))
    )
    return result


def sweep(made: Experiment, about: Values, folder: Path, **how: Any) -> list[Cell]:
    """Run all cells, in the order of the experiment, except those that are already finished.

    ``about`` is from ``header``; ``how`` as in ``finish``, which see.
    """
    settings = made.settings.model_validate(about["settings"])
    of = {name: about[name] for name in ("experiment", "seed", "version", "code")}
    run = partial(run_cell, made.name, seed=about["seed"])
    return finish(made.cells(settings), run, of, folder, **how)


def finish(
    wanted: Sequence[Values],
    run: Callable[[Values], Values],
    of: Values,
    folder: Path,
    *,
    workers: int = 0,
    notify: Callable[[int, int], None] = lambda done, of: None,
) -> list[Cell]:
    """Run the cells with these values, in this order, except those that are already finished.

    ``run`` must be picklable; ``of`` is what a result depends on besides the values.
    ``workers``: processes; 0: one for each core.  ``notify`` gets the number of finished cells and
    of all cells.

    Raises ExperimentError for a cell that is wanted twice, a file that is no cell, and a process
    that broke off; OSError for a folder that cannot be written or a disk that is full.
    """
    kept = {canonical(values): _path(folder, of, values) for values in wanted}
    if len(kept) != len(wanted):
        raise ExperimentError("the sweep contains a cell twice")
    files.folder(folder, named=True)
    files.folder(folder / CELLS)
    missing = [v for v in wanted if not kept[canonical(v)].exists()]
    before = len(wanted) - len(missing)
    notify(before, len(wanted))
    for n, (values, result) in enumerate(_results(run, missing, workers), before + 1):
        cell = {"values": values, "result": result}
        files.write(kept[canonical(values)], canonical(cell) + "\n")
        notify(n, len(wanted))
    return [_cell(path) for path in kept.values()]


def finished(wanted: Sequence[Values], of: Values, folder: Path) -> list[tuple[Path, Cell]]:
    """The cells that are finished, with their files.  Raises ExperimentError."""
    paths = [_path(folder, of, values) for values in wanted]
    return [(path, _cell(path)) for path in paths if path.exists()]


def _path(folder: Path, of: Values, values: Values) -> Path:
    text = canonical(of | {"values": values})
    return folder / CELLS / f"{hashlib.sha256(text.encode()).hexdigest()[:24]}.json"


def _cell(path: Path) -> Cell:
    try:
        return CELL.validate_json(path.read_bytes())
    except ValidationError:
        raise ExperimentError(f"{path}: not a finished cell") from None


def _results(
    run: Callable[[Values], Values], missing: Sequence[Values], workers: int
) -> Iterator[tuple[Values, Values]]:
    """Yield each cell when it is finished."""
    workers = min(workers or os.cpu_count() or 1, len(missing))
    if workers <= 1:
        yield from ((values, run(values)) for values in missing)
        return
    with children.pool(workers) as pool:
        running = {pool.submit(run, values): values for values in missing}
        broken = set()
        try:
            for future in as_completed(running):
                if isinstance(future.exception(), BrokenProcessPool):
                    broken.add(future)
                else:
                    yield running[future], future.result()
        finally:
            for future in running:
                future.cancel()
        begun = [canonical(values) for future, values in running.items() if future in broken]
        if begun:
            raise ExperimentError(f"a process broke off; it ran {' or '.join(begun[:workers])}")
