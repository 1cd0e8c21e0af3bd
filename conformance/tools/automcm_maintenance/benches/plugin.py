"""The pytest plugin of the benches: plain functions with pytest-benchmark, and a file of figures.

A bench times a call with the fixture ``timed``, or gives another figure with ``figure``; the
decorator ``beside`` names its baseline in the same run and the bar for the ratio to it.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Generator
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, TypeVar

import pytest


@dataclass(frozen=True, slots=True)
class BenchRow:
    """One figure.  ``beside``: its baseline; ``at_most``: the bar, above which the ratio falls
    short."""

    name: str
    value: float
    unit: str
    beside: str | None = None
    at_most: float | None = None


@dataclass(frozen=True, slots=True)
class BenchRun:
    """All figures of a run, and why a bench was left out, by name."""

    rows: list[BenchRow]
    skipped: dict[str, str]

    def ratio(self, row: BenchRow) -> float | None:
        """The ratio to the baseline, if there is another row of that name and it was measured."""
        values = {each.name: each.value for each in self.rows if each is not row}
        _, bracket, parameters = row.name.partition("[")
        for baseline in (f"{row.beside}{bracket}{parameters}", row.beside):
            if baseline in values:
                return row.value / values[baseline]
        return None


Bench = TypeVar("Bench", bound=Callable[..., None])
Figure = Callable[[float, str], None]
"""Takes a figure and its unit."""
Timed = Callable[..., None]
"""Times a call in µs, over ``per``, 1 by default.  With ``rounds``, it is called as often."""
_RUN = pytest.StashKey[BenchRun]()


def beside(baseline: str, at_most: float) -> Callable[[Bench], Bench]:
    """A bench's baseline: a name without ``bench_``, of the same parameters if there is one."""

    def mark(bench: Bench) -> Bench:
        bench.beside = baseline, at_most  # type: ignore[attr-defined]
        return bench

    return mark


@pytest.fixture
def figure(request: pytest.FixtureRequest) -> Figure:
    """As ``Figure``."""

    def note(value: float, unit: str) -> None:
        name, to = request.node.name.removeprefix("bench_"), request.config.stash[_RUN].rows
        to.append(BenchRow(name, value, unit, *getattr(request.function, "beside", ())))

    return note


@pytest.fixture
def timed(benchmark: Any, figure: Figure) -> Timed:
    """As ``Timed``: the least of all rounds."""

    def time(call: Callable[[], object], per: int = 1, rounds: int = 0) -> None:
        if rounds:
            benchmark.pedantic(call, rounds=rounds)
        else:
            benchmark(call)
        figure(benchmark.stats.stats.min / per * 1e6, "µs")

    return time


def pytest_addoption(parser: pytest.Parser) -> None:
    """The file of the figures."""
    parser.addoption("--figures", type=Path)


def pytest_configure(config: pytest.Config) -> None:
    """Begin without figures."""
    config.stash[_RUN] = BenchRun([], {})


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(item: pytest.Item) -> Generator[None, Any, Any]:
    """Note why a bench is left out."""
    report = yield
    if report.skipped:
        reason = report.longrepr[2].removeprefix("Skipped: ")
        item.config.stash[_RUN].skipped[item.name.removeprefix("bench_")] = reason
    return report


def pytest_sessionfinish(session: pytest.Session) -> None:
    """Write the figures."""
    run = session.config.stash[_RUN]
    path = session.config.getoption("--figures")
    path.write_text(json.dumps(asdict(run)), encoding="utf-8")
