"""What holds for all tests: they can import one another and their helpers, which cases of a sweep
are quick, and that tests may be coroutines."""

from __future__ import annotations

import asyncio
import gc
import inspect
import sys
from collections import defaultdict
from pathlib import Path

import hypothesis
import pytest

sys.path[:0] = [
    str(path) for path in sorted(Path(__file__).parent.glob("*/tests/**/")) if path.name[0] != "_"
]
hypothesis.settings.register_profile(
    "quick", hypothesis.settings.get_profile("ci"), max_examples=25
)
hypothesis.settings.register_profile("fuzz", max_examples=200_000, database=None, deadline=None)
gc.set_threshold(100_000, 20, 20)  # a tenth of the time went into looking for garbage in graphs
COROUTINE_S = 60
"""A test that is a coroutine fails after that time."""


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Of a ``sweep(n)`` all cases but n, evenly spread, are slow."""
    sweeps: dict[str, list[pytest.Item]] = defaultdict(list)
    for item in items:
        if item.get_closest_marker("sweep") and not item.get_closest_marker("deep"):
            sweeps[item.nodeid.partition("[")[0]].append(item)
    for cases in sweeps.values():
        (quick,) = cases[0].get_closest_marker("sweep").args  # type: ignore[union-attr]
        kept = {k * len(cases) // quick for k in range(quick)}
        for n, case in enumerate(cases):
            if n not in kept:
                case.add_marker("slow")


@pytest.hookimpl(tryfirst=True)
def pytest_pyfunc_call(pyfuncitem: pytest.Function) -> bool | None:
    """Runs a test that is a coroutine."""
    if not inspect.iscoroutinefunction(pyfuncitem.obj):
        return None
    names = inspect.signature(pyfuncitem.obj).parameters
    test = pyfuncitem.obj(**{name: pyfuncitem.funcargs[name] for name in names})
    asyncio.run(asyncio.wait_for(test, COROUTINE_S))
    return True
