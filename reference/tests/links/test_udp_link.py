"""UDP sockets, the relay between them, and the clock of the host."""

from __future__ import annotations

import asyncio
import random
import select
import socket
import time
from collections.abc import Callable, Iterator
from typing import Any

import pytest
from automcm_stage import cam

from automcm.links import udp_link as udp_
from automcm.links.clock import AsyncioClock
from automcm.links.link import LinkError
from automcm.links.simulated_radio import Channel
from automcm.links.udp_link import UdpLink, address, bind
from automcm.service.service import McService
from automcm_simulation.radio import relay as relay_
from automcm_simulation.radio.relay import Relay
from automcm_simulation.road.straight_lane import LANE_CHANGE, Straight
from automcm_spec.vocabulary.messages import BROADCAST, encode
from automcm_spec.vocabulary.parameters import Parameters

# -- sockets


async def until(so: Callable[[], bool]) -> None:
    """Let the loop run until it is so; the time limit of the test ends it otherwise."""
    while not so():
        await asyncio.sleep(0.01)


@pytest.fixture
def where() -> Iterator[tuple[str, int]]:
    """Where to broadcast: a port that a socket keeps from others, and the links share."""
    with bind("127.255.255.255", 0) as kept:
        kept.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        yield kept.getsockname()


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


async def test_a_session_over_udp_with_broadcast_and_unicast(where: tuple[str, int]) -> None:
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


async def test_end_5_rubbish_and_a_flood_stop_no_session(where: tuple[str, int]) -> None:
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


async def test_mem_1_a_link_remembers_so_many_addresses(
    monkeypatch: pytest.MonkeyPatch, where: tuple[str, int]
) -> None:
    monkeypatch.setattr(udp_, "ADDRESSES", 5)

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
    sockets[0].sendto(b"after the third", relay.address)
    await until(lambda: bool(select.select([sockets[1]], [], [], 0)[0]))
    assert len(relay._stations) == 2
    for where in relay._received_ms:
        relay._received_ms[where] -= relay_.SILENCE_MS + 1
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


async def test_messages_of_one_id_from_two_addresses_make_it_broadcast(
    where: tuple[str, int],
) -> None:
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
    with pytest.raises(LinkError, match=r"--host .* cannot reach"):
        UdpLink(host=host, broadcast=(broadcast, 9), allow_remote=True)


@pytest.mark.parametrize("host", ["192.168.1.7", "0.0.0.0"])
def test_only_loopback_unless_told_otherwise(host: str) -> None:
    with pytest.raises(LinkError, match=f"{host} is not a loopback address"):
        bind(host, 0)
    with pytest.raises(LinkError, match=f"{host} is not a loopback address"):
        UdpLink(broadcast=(host, 1))
    with pytest.raises(LinkError, match=f"{host} is not a loopback address"):
        UdpLink(via=(host, 1))


@pytest.mark.parametrize("text", ["", "127.0.0.1", ":1", "127.0.0.1:", "127.0.0.1:70000", "a.b:1"])
def test_an_address_is_host_and_port(text: str) -> None:
    with pytest.raises(LinkError, match=r"HOST:PORT|an IPv4 address"):
        address(text)
    assert address("localhost:9") == ("127.0.0.1", 9)


async def test_the_time_for_which_the_host_slept_counts(monkeypatch: pytest.MonkeyPatch) -> None:
    clock, rung = AsyncioClock(), list[int]()
    before, asked, wall = clock.now(), time.clock_gettime, time.time
    asleep = {time.CLOCK_BOOTTIME: 9.95}
    monkeypatch.setattr(time, "clock_gettime", lambda which: asked(which) + asleep.get(which, 0))
    monkeypatch.setattr(time, "time", lambda: wall() + 9.95)
    later = clock.now() + 30
    assert later - before >= 9_950
    clock.at(later, lambda: rung.append(clock.now()))
    await until(lambda: bool(rung))
    assert later <= rung[0] < later + 9_950  # not as much later once more


async def test_what_the_system_refuses_to_send_is_counted(where: tuple[str, int]) -> None:
    link = UdpLink(broadcast=where)
    link.open(lambda data, tx: None)
    link.send(b"x" * 70_000, BROADCAST, "")
    assert link.unsent == 1
    link.close()
