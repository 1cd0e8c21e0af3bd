"""Clocks: what time it is, in integer milliseconds, and "wake me at".

The station is given the time and reads no clock.  The service is given a ``Clock``: a virtual
one in simulations and tests, asyncio's in a process of its own.
"""

from __future__ import annotations

import asyncio
import heapq
import time
from collections.abc import Callable
from typing import Protocol

Cancel = Callable[[], None]


class Clock(Protocol):
    """Time in ms that never goes back, and one-shot alarms."""

    def now(self) -> int:
        """The time in ms."""

    def at(self, when_ms: int, do: Callable[[], None]) -> Cancel:
        """Call ``do`` at ``when_ms`` or as soon as possible after it; the result calls it off."""


class VirtualClock:
    """Time that passes only in ``run``.  Of alarms for one instant, the first set rings first."""

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
        """Ring every alarm up to and at ``until_ms``; then it is ``until_ms``."""
        while self._alarms and self._alarms[0][0] <= until_ms:
            self._now, _, what = heapq.heappop(self._alarms)
            if what:
                what[0]()
        self._now = max(self._now, until_ms)


def _suspended() -> float:
    """How long the host has slept since it started, in s; 0 where the system does not tell."""
    if not hasattr(time, "CLOCK_BOOTTIME"):
        return 0.0
    return time.clock_gettime(time.CLOCK_BOOTTIME) - time.clock_gettime(time.CLOCK_MONOTONIC)


class AsyncioClock:
    """The running event loop's clock: the host's monotonic time, so that a process that comes
    back goes on where it was.  ``zero`` is the time in seconds that counts as 0.

    The time for which the host sleeps after the start counts too: its peers are awake.
    """

    def __init__(self, zero: float = 0.0) -> None:
        self._loop = asyncio.get_running_loop()
        self._zero = zero
        self._slept_before = _suspended()
        self._set = 0

    def _slept(self) -> float:
        slept = _suspended() - self._slept_before
        return slept if slept > 0.001 else 0.0  # the two clocks are not read at one instant

    def now(self) -> int:
        """The time in ms."""
        return int((self._loop.time() + self._slept() - self._zero) * 1000)

    def at(self, when_ms: int, do: Callable[[], None]) -> Cancel:
        """As ``Clock.at``."""
        # A hair late rather than early: woken early, now() would still be before when_ms.  And a
        # hair later than the one set before: asyncio does not keep the order of equal times.
        self._set = self._set % 10_000 + 1
        when = self._zero + when_ms / 1000 - self._slept() + self._set * 1e-8
        return self._loop.call_at(when, do).cancel
