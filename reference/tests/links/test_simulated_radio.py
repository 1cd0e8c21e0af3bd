"""The simulated radio and the virtual clock."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import pytest

from automcm.links.clock import VirtualClock
from automcm.links.simulated_radio import Channel, Radio
from automcm_spec.vocabulary.messages import BROADCAST

# -- simulated


def heard(channel: Channel, copies: int, seed: int = 1) -> list[tuple[int, int]]:
    """What 2 hears of ``copies`` datagrams sent 100 ms apart by 1: (number, when)."""
    clock = VirtualClock()
    radio = Radio(clock, channel, seed)
    got: list[tuple[int, int]] = []
    radio.link(2).open(lambda data, tx: got.append((int(data), clock.now())))
    link = radio.link(1)
    for n in range(copies):
        clock.at(100 * n, lambda n=n: link.send(b"%d" % n, BROADCAST, ""))  # type: ignore[misc]
    clock.run(100 * copies + 1000)
    return got


def test_a_perfect_radio_delivers_each_once_after_its_delay() -> None:
    assert heard(Channel(delay_ms=(3, 3)), 5) == [(n, 100 * n + 3) for n in range(5)]


def lost_runs(channel: Channel, copies: int) -> list[int]:
    """How many copies in a row were lost, each time some were; copies 100 ms apart."""
    got = {n for n, _ in heard(channel, copies)}
    pattern = "".join(" x"[n not in got] for n in range(copies))
    return [len(run) for run in pattern.split()]


@pytest.mark.slow
def test_loss_in_bursts_has_the_mean_of_even_loss_and_runs_as_long_as_told() -> None:
    """A run of losses lasts the mean burst: 1000 ms, of which copies see all but the ends."""
    even, bursts = (lost_runs(Channel(loss=0.3, burst_ms=ms), 20_000) for ms in (0, 1000))
    assert abs(sum(even) / 20_000 - 0.3) < 0.02 and abs(sum(bursts) / 20_000 - 0.3) < 0.03
    stays = 0.3 + 0.7 * math.exp(-100 / (1000 * 0.7))
    assert sum(even) / len(even) == pytest.approx(1 / 0.7, rel=0.03)
    assert sum(bursts) / len(bursts) == pytest.approx(1 / (1 - stays), rel=0.12)


@pytest.mark.parametrize(("loss", "share"), [(0.0, 1.0), (1.0, 0.0)])
def test_bursts_of_no_loss_and_of_all(loss: float, share: float) -> None:
    assert len(heard(Channel(loss=loss, burst_ms=200), 100)) == 100 * share


def test_each_way_has_bursts_of_its_own() -> None:
    radio, clock, got, links = radio_of(1, 2)
    radio.channel = Channel(loss=0.5, burst_ms=1000, delay_ms=(1, 1))
    for n in range(3000):
        clock.at(100 * n, lambda n=n: [links[s].send(b"%d" % n, 3 - s, "") for s in links])  # type: ignore[misc]
    clock.run(301_000)
    both = len(set(got[1]) & set(got[2])) / 3000
    assert abs(both - 0.25) < 0.05, "independent of one another"


def test_duplication_and_delay_are_as_told() -> None:
    got = heard(Channel(duplicate=0.5, delay_ms=(10, 30)), 4000)
    assert abs(len(got) / 4000 - 1.5) < 0.03
    delays = {when - 100 * n for n, when in got}
    assert (min(delays), max(delays)) == (10, 30)


def radio_of(*stations: int) -> tuple[Radio, VirtualClock, dict[int, list[bytes]], dict[int, Any]]:
    clock = VirtualClock()
    radio = Radio(clock, Channel(delay_ms=(1, 1)), 1)
    got: dict[int, list[bytes]] = {s: [] for s in stations}
    links = {s: radio.link(s) for s in stations}
    for s in stations:
        links[s].open(lambda data, tx, s=s: got[s].append(data))
    return radio, clock, got, links


def test_a_cut_is_one_way_until_it_is_mended() -> None:
    radio, clock, got, links = radio_of(1, 2)
    radio.cut(1, 2)
    links[1].send(b"there", 2, "")
    links[2].send(b"back", 1, "")
    clock.run(10)
    assert (got[1], got[2]) == ([b"back"], [])
    radio.mend()
    links[1].send(b"there", 2, "")
    clock.run(20)
    assert got[2] == [b"there"]


def test_unicast_reaches_its_addressee_alone_and_a_closed_link_nobody() -> None:
    _, clock, got, links = radio_of(1, 2, 3)
    links[1].send(b"x", 2, "")
    links[3].close()
    links[1].send(b"y", BROADCAST, "")
    clock.run(10)
    assert got == {1: [], 2: [b"x", b"y"], 3: []}


def test_mem_1_a_radio_with_a_capacity_holds_no_more() -> None:
    clock = VirtualClock()
    radio = Radio(clock, Channel(), capacity=10)
    radio.link(2).open(lambda data, tx: None)
    link = radio.link(1)
    for _ in range(25):
        link.send(b"x", BROADCAST, "")
    assert (radio.in_flight, radio.lost) == (10, 15)
    clock.run(1000)
    assert (radio.in_flight, radio.delivered) == (0, 10)


@pytest.mark.parametrize(
    ("text", "bad"),
    [
        ("loss", {"loss": 1.5}),
        ("duplicate", {"duplicate": -0.1}),
        ("reorder", {"reorder": 2}),
        ("delay_ms", {"delay_ms": (5, 4)}),
        ("delay_ms", {"delay_ms": (-1, 4)}),
        ("burst_ms must be .*, not -1.0", {"burst_ms": -1.0}),
        ("burst_ms must be .*, not inf", {"burst_ms": math.inf}),
        ("burst_loss must be .*, not 0.0", {"burst_loss": 0.0}),
        ("burst_loss must be .*, not 0.4", {"loss": 0.5, "burst_ms": 100.0, "burst_loss": 0.4}),
    ],
)
def test_a_channel_that_cannot_be_is_refused_by_name(text: str, bad: dict[str, Any]) -> None:
    with pytest.raises(ValueError, match=text):
        Channel(**bad)


# -- the virtual clock


def test_alarms_ring_in_order_and_may_be_called_off() -> None:
    clock, rung = VirtualClock(), list[tuple[str, int]]()

    def alarm(name: str) -> Callable[[], None]:
        return lambda: rung.append((name, clock.now()))

    clock.at(20, alarm("c"))
    clock.at(10, alarm("a"))
    off = clock.at(10, alarm("off"))
    clock.at(10, alarm("b"))
    clock.at(31, alarm("late"))
    off()
    clock.run(30)
    clock.at(5, alarm("past"))
    clock.run(30)
    assert rung == [("a", 10), ("b", 10), ("c", 20), ("past", 30)] and clock.now() == 30
