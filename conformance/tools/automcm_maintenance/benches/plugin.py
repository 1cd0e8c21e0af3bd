"""The fixtures of the benches, which are plain functions with pytest-benchmark.

A bench times a call with ``timed``, or gives another figure with ``figure``: properties of its case
in pytest's XML report.  ``beside`` names its baseline in the same run (a name without ``bench_``,
of the same parameters if there is one) and the bar for the ratio to it.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest

Figure = Callable[..., None]
"""Takes a figure, its unit and ``beside``."""
Timed = Callable[..., None]
"""Times a call in µs, over ``per``, 1 by default.  With ``rounds``, it is called as often."""
Baseline = tuple[str, float]


@pytest.fixture
def figure(record_property: Callable[[str, object], None]) -> Figure:
    """As ``Figure``."""

    def note(value: float, unit: str, beside: Baseline | None = None) -> None:
        record_property("value", value)
        record_property("unit", unit)
        if beside:
            record_property("beside", beside[0])
            record_property("at_most", beside[1])

    return note


@pytest.fixture
def timed(benchmark: Any, figure: Figure) -> Timed:
    """As ``Timed``: the least of all rounds."""

    def time(
        call: Callable[[], object], per: int = 1, rounds: int = 0, beside: Baseline | None = None
    ) -> None:
        if rounds:
            benchmark.pedantic(call, rounds=rounds)
        else:
            benchmark(call)
        figure(benchmark.stats.stats.min / per * 1e6, "µs", beside)

    return time
