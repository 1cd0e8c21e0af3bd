"""What holds for all tests: how long they are traced, what their examples are drawn from, and that
they may be coroutines.

A test is traced for half a second, and then runs at its own speed: what loops a lot would take two
to four times as long, and covers the same lines again.  So the coverage that is printed is a little
less than all.
"""

from __future__ import annotations

import asyncio
import inspect
import signal
import sys
from collections.abc import Generator

import pytest
from coverage import Coverage
from hypothesis.internal.conjecture.providers import Constants, HypothesisProvider

TRACED_S = 0.5
"""Of its processor time, with its fixtures."""
COROUTINE_S = 60
"""A test that is a coroutine fails after that time."""


@pytest.hookimpl(wrapper=True)
def pytest_runtest_protocol() -> Generator[None, object, object]:
    """Ends the tracing after that time, and begins it anew when the test is over."""
    traced = Coverage.current() if sys.gettrace() is not None else None
    if traced is None:
        return (yield)
    before = signal.signal(signal.SIGVTALRM, lambda *_: sys.settrace(None))
    signal.setitimer(signal.ITIMER_VIRTUAL, TRACED_S)
    try:
        return (yield)
    finally:
        signal.setitimer(signal.ITIMER_VIRTUAL, 0)
        signal.signal(signal.SIGVTALRM, before)
        if sys.gettrace() is None:
            # A new tracer: the old one thinks that it is still within the calls that it saw.
            traced.stop()
            traced.start()


def pytest_configure(config: pytest.Config) -> None:
    """The same examples each time: hypothesis also draws constants that it finds in whatever
    modules are loaded, and that depends on the tests that ran before."""
    if config.getoption("--hypothesis-profile") == "ci":
        HypothesisProvider._local_constants = property(lambda self: Constants())


@pytest.hookimpl(tryfirst=True)
def pytest_pyfunc_call(pyfuncitem: pytest.Function) -> bool | None:
    """Runs a test that is a coroutine."""
    if not inspect.iscoroutinefunction(pyfuncitem.obj):
        return None
    names = inspect.signature(pyfuncitem.obj).parameters
    test = pyfuncitem.obj(**{name: pyfuncitem.funcargs[name] for name in names})
    asyncio.run(asyncio.wait_for(test, COROUTINE_S))
    return True
