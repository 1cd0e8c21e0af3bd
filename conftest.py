"""What is marked ``no_cover`` runs without tracing in the workers of xdist too.

There pytest-cov begins twice, and its marker pauses only the second: what loops a lot would take
two to four times as long.
"""

from __future__ import annotations

import sys
from collections.abc import Generator

import pytest


@pytest.hookimpl(wrapper=True, trylast=True)  # within the pause of pytest-cov
def pytest_runtest_call(item: pytest.Item) -> Generator[None, object, object]:
    """Traced again when the test is over."""
    if item.get_closest_marker("no_cover") is None:
        return (yield)
    trace = sys.gettrace()
    sys.settrace(None)
    try:
        return (yield)
    finally:
        sys.settrace(trace)
