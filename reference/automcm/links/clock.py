"""Clocks: the time in integer milliseconds, and one-shot alarms.

The station gets the time with each input and reads no clock.  The service gets a ``Clock``: a
virtual one in simulations and tests, asyncio's in a process.
"""

from __future__ import annotations

import asyncio
import heapq
import time
from collections.abc import Callable
from typing import Protocol

Cancel = Callable[[], None]


class Clock(Protocol):
    """Time in ms that never decreases, and one-shot alarms."""

    def now(self) -> int:
        """The time in ms."""

    def at(self, when_ms: int, do: Callable[[], None]) -> Cancel:
        """Call ``do`` at ``when_ms`` or as soon as possible after it; the result cancels it."""


class VirtualClock:
    """Time that passes only in ``run``.  Alarms for the same time fire in the order of setting."""

    def __init__(self) -> None:
        self._now = 0
        self._set = 0
        self._alarms: list[tuple[int, int, list[Callable[[], None]]]] = []

    def now(self) -> int:
        """The time in ms."""
        return self._now

    def at(self, when_ms: int, do: Callable[[], None]) -> Cancel:
        """As ``Clock.at``."""
        what = [do]
        self._set += 1
        heapq.heappush(self._alarms, (max(when_ms, self._now), self._set, what))
        return what.clear

    def run(self, until_ms: int) -> None:
        """Fire every alarm up to and including ``until_ms``, and set the time to it."""
        while self._alarms and self._alarms[0][0] <= until_ms:
            self._now, _, what = heapq.heappop(self._alarms)
            if what:
                what[0]()
        self._now = max(self._now, until_ms)


def _suspended() -> float:
    """The time for which the host was suspended since its start, in s; 0 if unknown."""
    if not hasattr(time, "CLOCK_BOOTTIME"):
        return 0.0
    return time.clock_gettime(time.CLOCK_BOOTTIME) - time.clock_gettime(time.CLOCK_MONOTONIC)


class AsyncioClock:
    """The running event loop's clock: the host's monotonic time, less ``zero`` (s).

    The time continues over a restart of the process.  It includes the time for which the host is
    suspended, because its peers continue.
    """

    def __init__(self, zero: float = 0.0) -> None:
        self._loop = asyncio.get_running_loop()
        self._zero = zero
        self._slept_before = _suspended()
        self._set = 0

    def _slept(self) -> float:
        slept = _suspended() - self._slept_before
        return slept if slept > 0.001 else 0.0  # the two clocks are read one after the other

    def now(self) -> int:
        """The time in ms."""
        return int((self._loop.time() + self._slept() - self._zero) * 1000)

    def at(self, when_ms: int, do: Callable[[], None]) -> Cancel:
        """As ``Clock.at``."""
        # The offset makes an alarm fire slightly late, because now() must not be before when_ms,
        # and after earlier alarms, because asyncio does not keep the order of equal times.
        self._set = self._set % 10_000 + 1
        when = self._zero + when_ms / 1000 - self._slept() + self._set * 1e-8
        return self._loop.call_at(when, do).cancel
