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


SLEW = 0.004
"""By how much an AsyncioClock runs faster or slower, at most, to follow the host's clock.

Two of them then differ in rate by at most 0.8 percent, besides their quartzes; ``clock_drift``
allows 1 percent."""
CLOSE_S = 0.001
"""An AsyncioClock that is this close to the host's clock runs at the rate of the monotonic time."""
ROUNDING_S = 2e-6
"""An alarm is set so much later, because the time when it fires must not be before its own."""
STEP_MS = 100
"""A larger change of the host's clock between two readings is reported as a step."""


class Clock(Protocol):
    """Time in ms that never decreases, and one-shot alarms."""

    def now(self) -> int:
        """The time in ms."""

    def at(self, when_ms: int, do: Callable[[], None]) -> Cancel:
        """Call ``do`` at ``when_ms`` or as soon as possible after it; the result cancels it."""


class _Alarms:
    """Alarms by their times; those for the same time in the order of setting."""

    def __init__(self) -> None:
        self._set = 0
        self._waiting: list[tuple[int, int, list[Callable[[], None]]]] = []

    def add(self, when_ms: int, do: Callable[[], None]) -> Cancel:
        what = [do]
        self._set += 1
        heapq.heappush(self._waiting, (when_ms, self._set, what))
        return what.clear

    def first_ms(self) -> int | None:
        """The time of the first one that is not cancelled."""
        while self._waiting and not self._waiting[0][2]:
            heapq.heappop(self._waiting)
        return self._waiting[0][0] if self._waiting else None

    def take(self) -> Callable[[], None]:
        """Remove the first one, after ``first_ms``."""
        return heapq.heappop(self._waiting)[2][0]


class VirtualClock:
    """Time that passes only in ``run``.  Alarms for the same time fire in the order of setting."""

    def __init__(self) -> None:
        self._now = 0
        self._alarms = _Alarms()

    def now(self) -> int:
        """The time in ms."""
        return self._now

    def at(self, when_ms: int, do: Callable[[], None]) -> Cancel:
        """As ``Clock.at``."""
        return self._alarms.add(max(when_ms, self._now), do)

    def run(self, until_ms: int) -> None:
        """Fire every alarm up to and including ``until_ms``, and set the time to it."""
        while (first := self._alarms.first_ms()) is not None and first <= until_ms:
            self._now = first
            self._alarms.take()()
        self._now = max(self._now, until_ms)


def _suspended() -> float:
    """The time for which the host was suspended since its start, in s; 0 if unknown."""
    if not hasattr(time, "CLOCK_BOOTTIME"):
        return 0.0
    return time.clock_gettime(time.CLOCK_BOOTTIME) - time.clock_gettime(time.CLOCK_MONOTONIC)


class AsyncioClock:
    """The running event loop's clock: milliseconds of UNIX time, as on the wire.

    It begins at the host's clock, continues with the monotonic time, and follows the host's clock
    by at most ``SLEW``; it never steps.  ``stepped`` is called with the milliseconds by which the
    host's clock has stepped, if more than ``STEP_MS``.  With ``zero`` it is the monotonic time less
    ``zero`` (s) instead, for processes of one host.

    It includes the time for which the host is suspended, because its peers continue.
    """

    def __init__(
        self, zero: float | None = None, stepped: Callable[[int], None] = lambda ms: None
    ) -> None:
        self._loop = asyncio.get_running_loop()
        self._slept_before = _suspended()
        self._alarms = _Alarms()
        self._timer: asyncio.TimerHandle | None = None
        self._stepped = stepped
        self._follows = zero is None
        self._read = self._monotonic()
        """The monotonic time of the last reading, in s."""
        self._offset = time.time() - self._read if zero is None else -zero
        """From the monotonic time to the present one, in s."""
        self._host = self._offset
        """From the monotonic time to the host's clock, as last read, in s."""

    def _slept(self) -> float:
        slept = _suspended() - self._slept_before
        return slept if slept > 0.001 else 0.0  # the two clocks are read one after the other

    def _monotonic(self) -> float:
        return self._loop.time() + self._slept()

    def _follow(self, monotonic: float) -> None:
        """Approach the host's clock."""
        host = time.time() - monotonic
        if abs(step := host - self._host) > STEP_MS / 1000:
            self._stepped(round(step * 1000))
        if abs(host - self._offset) > CLOSE_S:
            most = SLEW * (monotonic - self._read)
            self._offset += max(-most, min(host - self._offset, most))
        self._host, self._read = host, monotonic

    def now(self) -> int:
        """The time in ms."""
        monotonic = self._monotonic()
        if self._follows:
            self._follow(monotonic)
        return int((monotonic + self._offset) * 1000)

    def at(self, when_ms: int, do: Callable[[], None]) -> Cancel:
        """As ``Clock.at``."""
        cancel = self._alarms.add(when_ms, do)
        self._wait()
        return cancel

    def _wait(self) -> None:
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None
        if (first := self._alarms.first_ms()) is not None:
            when = first / 1000 - self._offset - self._slept() + ROUNDING_S
            self._timer = self._loop.call_at(when, self._ring)

    def _ring(self) -> None:
        self._timer = None
        first = self._alarms.first_ms()
        do = self._alarms.take() if first is not None and self.now() >= first else None
        self._wait()  # for the next one, or again if the clock has slowed down
        if do is not None:
            do()


class OffsetClock:
    """A clock that is ``offset_ms`` ahead of another one."""

    def __init__(self, clock: Clock, offset_ms: int) -> None:
        self._clock, self._offset_ms = clock, offset_ms

    def now(self) -> int:
        """The time in ms."""
        return self._clock.now() + self._offset_ms

    def at(self, when_ms: int, do: Callable[[], None]) -> Cancel:
        """As ``Clock.at``."""
        return self._clock.at(when_ms - self._offset_ms, do)
