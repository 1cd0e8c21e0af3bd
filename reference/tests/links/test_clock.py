"""Clocks: UNIX time that never steps, and clocks that are ahead of others."""

from __future__ import annotations

import heapq
from collections.abc import Callable
from dataclasses import dataclass, field
from types import SimpleNamespace

import pytest

from automcm.links import clock as clocks
from automcm.links.clock import SLEW, AsyncioClock

EPOCH_S = 1_700_000_000.0


@dataclass
class Host:
    """An event loop and the clocks of its host."""

    monotonic: float = 500.0
    ahead: float = 0.0
    """By which the host's clock differs from UNIX time, in s."""
    set_: list[tuple[float, int, Callable[[], None]]] = field(default_factory=list)

    def time(self) -> float:
        return self.monotonic

    def wall(self) -> float:
        return EPOCH_S + self.monotonic + self.ahead

    def call_at(self, when: float, do: Callable[[], None]) -> SimpleNamespace:
        entry = when, len(self.set_), do
        heapq.heappush(self.set_, entry)
        return SimpleNamespace(cancel=lambda: self.set_.remove(entry))

    def run(self, seconds: float) -> None:
        until = self.monotonic + seconds
        while self.set_ and self.set_[0][0] <= until:
            self.monotonic, _, do = heapq.heappop(self.set_)
            do()
        self.monotonic = until


@pytest.fixture
def host(monkeypatch: pytest.MonkeyPatch) -> Host:
    made = Host()
    monkeypatch.setattr(clocks, "asyncio", SimpleNamespace(get_running_loop=lambda: made))
    monkeypatch.setattr(clocks, "time", SimpleNamespace(time=made.wall))
    return made


def unix_ms(host: Host) -> int:
    return round((EPOCH_S + host.monotonic) * 1000)


def test_two_hosts_begin_at_the_same_time(host: Host) -> None:
    assert abs(AsyncioClock().now() - unix_ms(host)) <= 1
    assert AsyncioClock(zero=499.0).now() == 1000


@pytest.mark.parametrize("step_s", [10.0, -10.0])
def test_a_step_of_the_host_s_clock_is_reported_once_and_followed_slowly(
    host: Host, step_s: float
) -> None:
    steps: list[int] = []
    clock = AsyncioClock(stepped=steps.append)
    host.ahead = step_s
    before = clock.now()
    assert abs(before - unix_ms(host)) <= 1, "not at once"
    for _ in range(1000):
        host.run(0.1)
        now = clock.now()
        assert abs(now - before - 100) <= 100 * SLEW + 1
        before = now
    assert steps == [round(step_s * 1000)]
    moved = clock.now() - unix_ms(host)
    assert abs(moved - 100 * SLEW * 1000 * (1 if step_s > 0 else -1)) <= 2


def test_a_host_s_clock_that_drifts_is_followed_and_is_no_step(host: Host) -> None:
    steps: list[int] = []
    clock = AsyncioClock(stepped=steps.append)
    for n in range(600):
        host.ahead = n * 0.1 * 200e-6
        host.run(0.1)
        assert abs(clock.now() / 1000 - host.wall()) < 0.002
    assert steps == []


def test_an_alarm_is_never_early_even_if_the_clock_slows_down(host: Host) -> None:
    clock, rung = AsyncioClock(), list[tuple[str, int]]()
    begin = clock.now()
    for name in ("first", "second"):
        clock.at(begin + 5000, lambda name=name: rung.append((name, clock.now())))  # type: ignore[misc]
    cancelled = clock.at(begin + 4000, lambda: rung.append(("cancelled", 0)))
    cancelled()
    host.ahead = -10.0
    host.run(4.99)
    clock.now()
    host.run(1)
    assert [name for name, _ in rung] == ["first", "second"]
    assert all(begin + 5000 <= at <= begin + 5001 for _, at in rung)
