"""The links: the simulated radio, UDP sockets, the relay between them."""

from __future__ import annotations

import asyncio
import errno
import math
import random
import socket
import time
from collections.abc import Callable
from typing import Any

import pytest
from automcm_stage import cam

from automcm.links import relay as relay_
from automcm.links import udp_link as udp_
from automcm.links.clock import AsyncioClock, VirtualClock
from automcm.links.link import LinkError
from automcm.links.relay import Relay
from automcm.links.simulated_radio import Channel, Radio
from automcm.links.udp_link import UdpLink, address, bind
from automcm.scenarios.straight_lane import LANE_CHANGE, Straight
from automcm.service.service import McService
from automcm.service.station_process import stopping
from automcm_spec.vocabulary.messages import BROADCAST, encode
from automcm_spec.vocabulary.parameters import Parameters

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


def test_loss_in_bursts_has_the_mean_of_even_loss_and_runs_as_long_as_told() -> None:
    """A run of losses lasts the mean burst: 1000 ms, of which copies see all but the ends."""
    even, bursts = (lost_runs(Channel(loss=0.3, burst_ms=ms), 20_000) for ms in (0, 1000))
    assert abs(sum(even) / 20_000 - 0.3) < 0.02 and abs(sum(bursts) / 20_000 - 0.3) < 0.03
    stays = 0.3 + 0.7 * math.exp(-100 / (1000 * 0.7))
    assert sum(even) / len(even) == pytest.approx(1 / 0.7, rel=0.03)
    assert sum(bursts) / len(bursts) == pytest.approx(1 / (1 - stays), rel=0.12)


def test_a_burst_that_does_not_lose_all_is_longer_seldom_in_its_bad_state() -> None:
    runs = lost_runs(Channel(loss=0.3, burst_ms=1000, burst_loss=0.6), 20_000)
    assert abs(sum(runs) / 20_000 - 0.3) < 0.03
    assert sum(runs) / len(runs) < 3, "within a burst some get through"


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


def test_reordering_lets_later_copies_overtake() -> None:
    order = [n for n, _ in heard(Channel(reorder=0.3, delay_ms=(0, 99)), 500)]
    assert order != sorted(order) and sorted(order) == list(range(500))
    assert (o := [n for n, _ in heard(Channel(delay_ms=(0, 99)), 500)]) == sorted(o)


def test_the_same_seed_treats_copies_alike_and_another_does_not() -> None:
    channel = Channel(loss=0.3, duplicate=0.3, reorder=0.3)
    assert heard(channel, 200, 7) == heard(channel, 200, 7) != heard(channel, 200, 8)


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


def test_a_partition_separates_groups_only() -> None:
    radio, clock, got, links = radio_of(1, 2, 3, 4)
    radio.partition([1, 2], [3])
    for s in links:
        links[s].send(b"%d" % s, BROADCAST, "")
    clock.run(10)
    assert got == {1: [b"2", b"4"], 2: [b"1", b"4"], 3: [b"4"], 4: [b"1", b"2", b"3"]}


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
        ("burst_ms: -1.0", {"burst_ms": -1.0}),
        ("burst_ms: inf", {"burst_ms": math.inf}),
        ("burst_loss: 0.0", {"burst_loss": 0.0}),
        ("burst_loss: 0.4", {"loss": 0.5, "burst_ms": 100.0, "burst_loss": 0.4}),
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


# -- sockets


async def until(so: Callable[[], bool]) -> None:
    """Let the loop run until it is so; the time limit of the test ends it otherwise."""
    while not so():
        await asyncio.sleep(0.01)


def free_port() -> int:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sock:
        sock.bind(("127.0.0.1", 0))
        return int(sock.getsockname()[1])


QUICK = Parameters(t_timeout=200, t_resend=50, t_decide=200)


def quick(**more: Any) -> Straight:
    return Straight(think_ms=1, maneuver_ms=100, hold_ms=0, **more)


def services(links: list[Any], clock: AsyncioClock) -> list[McService]:
    """Station 1 asks; the others agree."""
    made = [
        McService(n, quick(concerned_by_all=n > 1), link, clock, parameters=QUICK, seed=n)
        for n, link in enumerate(links, 1)
    ]
    for service in made:
        service.start()
    return made


def finished(made: list[McService]) -> bool:
    """By Fin, and nothing is left to send."""
    return made[0].statistics.sent["Fin"] > 0 and not any(
        s.state.bound or s.state.outbox for s in made
    )


async def test_a_session_over_udp_with_broadcast_and_unicast() -> None:
    where = ("127.255.255.255", free_port())
    links = [UdpLink(broadcast=where) for _ in range(3)]
    made = services(links, AsyncioClock())
    await until(lambda: all(len(link._addresses) == 2 for link in links))
    made[0].command(LANE_CHANGE)
    await until(lambda: finished(made))
    assert made[0].statistics.rules["NEG-6"] == 1
    assert made[0].statistics.sent["Cancel"] > 0
    for service in made:
        s = service.statistics
        assert s.elsewhere == s.malformed == s.broken == 0  # unicast went to its addressee
        assert set(links[service.station_id - 1]._addresses) == {1, 2, 3} - {service.station_id}
        service.close()


async def test_a_session_through_a_lossy_relay_where_all_overhear_all() -> None:
    relay = Relay(channel=Channel(loss=0.2, duplicate=0.2, delay_ms=(1, 10)), seed=3)
    clock = AsyncioClock()
    links = [UdpLink(via=relay.address) for _ in range(3)]
    made = services(links, clock)
    made[0].command(LANE_CHANGE)
    await until(lambda: not any(s.state.bound or s.state.outbox for s in made))
    assert relay.radio.lost > 0
    assert sum(s.statistics.elsewhere for s in made) > 0  # MSG-1
    for service in made:
        service.close()
    relay.close()


async def test_end_5_rubbish_and_a_flood_stop_no_session() -> None:
    where = ("127.255.255.255", free_port())
    made = services([UdpLink(broadcast=where) for _ in range(2)], AsyncioClock())
    chance = random.Random(1)
    with bind("127.0.0.1", 0) as flood:
        made[0].command(LANE_CHANGE)
        for _ in range(200):
            for _ in range(10):
                flood.sendto(chance.randbytes(chance.randrange(0, 1500)), where)
            flood.sendto(encode(cam(chance.randrange(1, 2**32), 0)), where)
            await asyncio.sleep(0.002)
        await until(lambda: finished(made))
    assert made[1].statistics.malformed > 100
    for service in made:
        assert len(service.neighbours) <= 256
        service.close()


async def test_mem_1_a_link_remembers_so_many_addresses(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(udp_, "ADDRESSES", 5)

    where = ("127.255.255.255", free_port())
    link = UdpLink(broadcast=where)
    got: list[int] = []
    link.open(lambda data, tx: got.append(int(data)) or int(data))  # type: ignore[func-returns-value]
    with bind("127.0.0.1", 0) as sender:
        for n in range(1, 9):
            sender.sendto(b"%d" % n, where)
        await until(lambda: len(got) == 8)
    assert list(link._addresses) == [4, 5, 6, 7, 8]
    link.close()


async def test_mem_1_a_relay_takes_so_many_stations_and_forgets_silent_ones(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(relay_, "STATIONS", 2)

    relay = Relay()
    sockets = [bind("127.0.0.1", 0) for _ in range(3)]
    for sock in sockets:
        sock.sendto(b"", relay.address)
    await until(lambda: len(relay._stations) == 2)
    await asyncio.sleep(0.05)
    assert len(relay._stations) == 2
    for where in relay._heard:
        relay._heard[where] -= relay_.SILENCE_MS + 1
    sockets[2].sendto(b"x", relay.address)
    await until(lambda: list(relay._stations) == [sockets[2].getsockname()])
    for sock in sockets:
        sock.close()
    relay.close()


def test_a_port_in_use_is_named() -> None:
    with (
        bind("127.0.0.1", 0) as taken,
        pytest.raises(LinkError, match=rf"UDP 127.0.0.1:{taken.getsockname()[1]}: .*in use"),
    ):
        bind(*taken.getsockname())


async def test_messages_of_one_id_from_two_addresses_make_it_broadcast() -> None:
    where = ("127.255.255.255", free_port())
    link = UdpLink(broadcast=where)
    got: list[int] = []
    link.open(lambda data, tx: got.append(int(data)) or int(data))  # type: ignore[func-returns-value]
    with bind("127.0.0.1", 0) as owner, bind("127.0.0.1", 0) as forger:
        owner.sendto(b"7", where)
        await until(lambda: len(got) == 1)
        link.send(b"x", 7, "")
        await until(lambda: _has(owner))
        forger.sendto(b"7", where)
        await until(lambda: len(got) == 2)
        link.send(b"y", 7, "")
        owner.sendto(b"7", where)
        await until(lambda: len(got) == 3)
        assert not _has(owner) and not _has(forger) and link._addresses[7] is None
    link.close()


def _has(sock: socket.socket) -> bool:
    try:
        return bool(sock.recv(100))
    except BlockingIOError:
        return False


async def test_a_relay_without_reordering_keeps_the_order_and_a_seed_decides_what_is_lost() -> None:
    async def relayed(seed: int, loss: float) -> list[bytes]:
        relay = Relay(channel=Channel(loss=loss, delay_ms=(5, 5)), seed=seed)
        with bind("127.0.0.1", 0) as sender, bind("127.0.0.1", 0) as hearer:
            hearer.sendto(b"", relay.address)
            await until(lambda: len(relay._stations) == 1)
            for n in range(200):
                sender.sendto(b"%03d" % n, relay.address)
            await until(lambda: relay.radio.delivered + relay.radio.lost == 200)
            got = []
            while True:
                try:
                    got.append(hearer.recv(10))
                except BlockingIOError:
                    break
        relay.close()
        return got

    assert await relayed(1, 0.0) == [b"%03d" % n for n in range(200)]
    some = await relayed(1, 0.5)
    assert 60 < len(some) < 140
    assert await relayed(1, 0.5) == some != await relayed(2, 0.5)


@pytest.mark.parametrize(
    ("host", "broadcast"), [("0.0.0.0", "127.255.255.255"), ("127.0.0.1", "198.51.100.255")]
)
def test_a_host_that_does_not_reach_the_others_is_refused(host: str, broadcast: str) -> None:
    with pytest.raises(LinkError, match=r"host: .* does not reach"):
        UdpLink(host=host, broadcast=(broadcast, 9), allow_remote=True)


def test_a_name_is_no_address() -> None:
    with pytest.raises(LinkError, match="nowhere: no IPv4 address"):
        bind("nowhere", 0)


@pytest.mark.parametrize("host", ["192.168.1.7", "0.0.0.0"])
def test_only_loopback_unless_told_otherwise(host: str) -> None:
    with pytest.raises(LinkError, match=f"{host}: not a loopback address"):
        bind(host, 0)
    with pytest.raises(LinkError, match=f"{host}: not a loopback address"):
        UdpLink(broadcast=(host, 1))
    with pytest.raises(LinkError, match=f"{host}: not a loopback address"):
        UdpLink(via=(host, 1))


def test_an_interface_of_all_hosts_may_be_allowed() -> None:
    bind("0.0.0.0", 0, allow_remote=True).close()


@pytest.mark.parametrize("text", ["", "127.0.0.1", ":1", "127.0.0.1:", "127.0.0.1:70000", "a.b:1"])
def test_an_address_is_host_and_port(text: str) -> None:
    with pytest.raises(LinkError, match=r"HOST:PORT|no IPv4"):
        address(text)
    assert address("localhost:9") == ("127.0.0.1", 9)


async def test_what_the_system_refuses_to_send_is_counted() -> None:
    link = UdpLink(broadcast=("127.255.255.255", free_port()))
    link.open(lambda data, tx: None)
    link.send(b"x" * 70_000, BROADCAST, "")
    assert link.unsent == 1
    link.close()


async def test_the_time_for_which_the_host_slept_counts(monkeypatch: pytest.MonkeyPatch) -> None:
    clock, rung = AsyncioClock(), list[int]()
    before, asked = clock.now(), time.clock_gettime
    asleep = {time.CLOCK_BOOTTIME: 9.95}
    monkeypatch.setattr(time, "clock_gettime", lambda which: asked(which) + asleep.get(which, 0))
    later = clock.now() + 30
    assert later - before >= 9_950
    clock.at(later, lambda: rung.append(clock.now()))
    await until(lambda: bool(rung))
    assert later <= rung[0] < later + 9_950  # not as much later once more


def test_a_listener_without_a_free_descriptor_ends_no_station() -> None:
    async def run(context: dict[str, Any]) -> bool:
        over = stopping()
        asyncio.get_running_loop().call_exception_handler({"message": "m", **context})
        return over.done() and over.exception() is not None

    full = OSError(errno.EMFILE, "Too many open files")
    assert not asyncio.run(run({"exception": full, "socket": object()}))
    assert asyncio.run(run({"exception": full}))
    assert asyncio.run(run({"exception": RuntimeError("a bug"), "socket": object()}))
