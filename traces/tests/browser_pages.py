"""The eight pages that are looked at: each shows what another log does to the drawing."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from browser_stage import run
from merged_runs import killed, later, simulated
from page_rows import CORPUS

from automcm_traces.viewer import page_run
from automcm_traces.viewer.page import html
from automcm_traces.viewer.page_data import Page, load, of_runs
from automcm_traces.viewer.page_part import PagePart

EPOCH_MS = 1_732_300_000_000
LAST_MS = 2**53 - 1
"""The latest time that a log can hold."""


def four(folder: Path, seed: int = 3, loss: float = 0.3, until: int = 20_000) -> list[Path]:
    """Four vehicles; the first asks for a maneuver three times."""
    folder.mkdir(parents=True, exist_ok=True)
    stations = (1001, 2002, 3003, 4004)
    asks = (500, 7000, 13_500)
    return simulated(folder, *stations, until=until, seed=seed, loss=loss, asks=asks)


def _session(folder: Path) -> Page:
    return load(sorted((CORPUS / "pair").glob("*.ndjson")))


def _loss(folder: Path) -> Page:
    return load(four(folder / "logs"))


def _divergence(folder: Path) -> Page:
    return load([CORPUS / "bad" / "busy_accepted.ndjson"])


def _compare(folder: Path) -> Page:
    a, b = (page_run.load(four(folder / name, seed, 0.05)) for name, seed in (("a", 3), ("b", 5)))
    return of_runs(a, b)


def _hazard(folder: Path) -> Page:
    """The second station dies while it acts; the first acts on alone."""
    logs = simulated(folder, 1001, 2002, until=10_000)
    killed(logs[1], 4000)
    return load(logs)


def _long(folder: Path) -> Page:
    logs = run(folder / "logs", 120_000, 0.1, 9)
    return load(logs, part=PagePart(2000, 3000))


def _epoch(folder: Path) -> Page:
    logs = simulated(folder, 1001, 2002, 3003, until=10_000)
    return load([later(path, EPOCH_MS) for path in logs])


def _counterexample(folder: Path) -> Page:
    return load(sorted((CORPUS / "counterexamples" / "no_quarantine").glob("*.ndjson")))


PAGES: dict[str, Callable[[Path], Page]] = {
    "session": _session,
    "loss": _loss,
    "divergence": _divergence,
    "compare": _compare,
    "hazard": _hazard,
    "long": _long,
    "epoch": _epoch,
    "counterexample": _counterexample,
}


def write_all(folder: Path) -> dict[str, Path]:
    """All pages as files."""
    found = {}
    for name, made in PAGES.items():
        (folder / name).mkdir(parents=True)
        found[name] = folder / f"{name}.html"
        found[name].write_bytes(html(made(folder / name)))
    return found
