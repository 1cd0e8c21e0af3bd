"""Runs the cells of an experiment on all cores or on Dask, and resumes after an interruption.

Each finished cell is written to ``cells.ndjson`` at once.  The seed of a cell depends only on the
sweep's seed and the cell's values, so that neither the order nor the number of workers matters.
"""

from __future__ import annotations

import hashlib
import json
import os
import shutil
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from functools import partial
from importlib import import_module, resources
from importlib.metadata import version
from multiprocessing import get_context
from pathlib import Path
from typing import Any

from pydantic import TypeAdapter
from pydantic_core import from_json

from automcm_evaluation.framework.experiment import (
    Cell,
    Experiment,
    ExperimentError,
    Settings,
    Values,
    canonical,
)
from automcm_evaluation.sweeps.catalogue import experiment
from automcm_spec.support import children, files

FREE_BYTES = 50_000_000
"""Minimum free bytes on the disk to start a sweep."""
CONNECT_S = 10.0
"""How long to wait for a Dask scheduler."""
SOURCES = [
    Path(str(resources.files(name)))
    for name in (
        "automcm",
        "automcm_evaluation",
        "automcm_simulation",
        "automcm_spec",
        "automcm_traces",
    )
]
ENDINGS = ".py", ".json", ".xml", ".osm"


CELL = TypeAdapter(Cell)


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
    return digest.hexdigest()[:12]


def header(made: Experiment, profile: str, seed: int, settings: Settings) -> Values:
    """The description of a sweep; only sweeps with equal ones can share cells."""
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


def sweep(
    made: Experiment,
    about: Values,
    folder: Path,
    *,
    workers: int = 0,
    scheduler: str = "",
    again: bool = False,
    notify: Callable[[int, int], None] = lambda done, of: None,
) -> list[Cell]:
    """Run all cells, in the order of the experiment, except those that are already finished.

    ``about`` is from ``header``.  ``workers``: processes; 0: one for each core.  ``scheduler``: a
    Dask scheduler's address, in place of processes of this machine.  ``again``: repeat
    finished cells, and discard those of another sweep.  ``notify`` gets the number of finished
    cells and of all cells.

    Raises ExperimentError for settings that cannot work, a folder with cells of another sweep,
    a missing extra, and a process that broke off; OSError for a folder that cannot be written or a
    disk that is full.
    """
    settings = made.settings.model_validate(about["settings"])
    run = partial(run_cell, made.name, seed=about["seed"])
    return finish(
        made.cells(settings),
        run,
        about,
        folder,
        workers=workers,
        scheduler=scheduler,
        again=again,
        notify=notify,
    )


def finish(
    wanted: Sequence[Values],
    run: Callable[[Values], Values],
    about: Values,
    folder: Path,
    *,
    workers: int = 0,
    scheduler: str = "",
    again: bool = False,
    notify: Callable[[int, int], None] = lambda done, of: None,
) -> list[Cell]:
    """Run the cells with these values, in this order, except those that are already finished.

    ``run`` must be picklable.  A folder with another ``about`` is refused.  Otherwise as ``sweep``.
    """
    texts = [canonical(values) for values in wanted]
    if len(set(texts)) != len(texts):
        raise ExperimentError("the sweep contains a cell twice")
    kept = folder / "cells.ndjson"
    prepare(folder)
    try:
        done = resumed(kept, about)
    except ExperimentError:
        if not again:
            raise
        kept.unlink()
        done = resumed(kept, about)
    missing = [
        values for values, text in zip(wanted, texts, strict=True) if again or text not in done
    ]
    notify(len(wanted) - len(missing), len(wanted))
    ran = len(wanted) - len(missing)
    files.refuse_links(kept)
    with kept.open("a", encoding="utf-8") as file:
        for values, result in _results(run, missing, workers, scheduler):
            file.write(canonical({"values": values, "result": result}) + "\n")
            file.flush()
            done[canonical(values)] = result
            ran += 1
            notify(ran, len(wanted))
    return [Cell(values, done[text]) for values, text in zip(wanted, texts, strict=True)]


def prepare(folder: Path) -> None:
    """Make the folder and check that it can be written before a long run.  Raises OSError."""
    files.folder(folder, named=True)
    probe = folder / ".probe"
    try:
        files.write(probe, b"probe")
    finally:
        probe.unlink(missing_ok=True)
    free = shutil.disk_usage(folder).free
    if free < FREE_BYTES:
        raise OSError(f"{folder}: {free:,} bytes are free, but {FREE_BYTES:,} are required")


def resumed(kept: Path, about: Values) -> dict[str, Values]:
    """The results in a file by the cells' values, as text; the file can then be appended to.

    A truncated last line is removed; a new file begins with ``about``.  Of a repeated cell the last
    result counts.  Raises ExperimentError for
    a file of another sweep, or for an invalid one.
    """
    data = kept.read_bytes() if kept.exists() else b""
    lines = data.split(b"\n")[:-1]
    if not lines:
        files.write(kept, canonical(about) + "\n")
        return {}
    found = {}
    for number, line in enumerate(lines, 1):
        try:
            if number > 1:
                cell = CELL.validate_json(line)
                found[canonical(cell.values)] = cell.result
                continue
            value = from_json(line)
        except ValueError:
            raise ExperimentError(f"{kept}:{number}: not a finished cell") from None
        if value != about:
            names = [
                name
                for name in about
                if not isinstance(value, dict) or value.get(name) != about[name]
            ]
            raise ExperimentError(
                f"{kept} belongs to another sweep ({', '.join(names)} differ); "
                "give another --out, or --again to discard it"
            )
    whole = sum(len(line) + 1 for line in lines)
    if whole < len(data):
        os.truncate(kept, whole)
    return found


def _results(
    run: Callable[[Values], Values], missing: Sequence[Values], workers: int, scheduler: str
) -> Iterator[tuple[Values, Values]]:
    """Yield each cell when it is finished."""
    if not missing:
        return
    if scheduler:
        yield from _on_dask(run, missing, scheduler)
        return
    workers = min(workers or os.cpu_count() or 1, len(missing))
    if workers == 1:
        for values in missing:
            yield values, run(values)
        return
    with ProcessPoolExecutor(
        workers, get_context("spawn"), initializer=children.end_with_parent
    ) as pool:
        running: dict[Future[Values], Values] = {
            pool.submit(run, values): values for values in missing
        }
        try:
            while running:
                for future in wait(running, return_when=FIRST_COMPLETED).done:
                    if not isinstance(future.exception(), BrokenProcessPool):
                        yield running.pop(future), future.result()
                        continue
                    begun = [canonical(values) for values in running.values()][:workers]
                    raise ExperimentError(f"a process broke off; it ran {' or '.join(begun)}")
        finally:
            pool.shutdown(cancel_futures=True)


def _on_dask(
    run: Callable[[Values], Values], missing: Sequence[Values], scheduler: str
) -> Iterator[tuple[Values, Values]]:
    try:
        dask: Any = import_module("distributed")
    except ModuleNotFoundError as error:
        if error.name != "distributed":
            raise
        raise ExperimentError("--scheduler needs Dask: pip install 'automcm[dask]'") from None
    with dask.Client(scheduler, timeout=CONNECT_S) as client:
        futures = {client.submit(run, values, pure=False): values for values in missing}
        for future in dask.as_completed(futures):
            yield futures[future], future.result()
