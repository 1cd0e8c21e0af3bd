"""Who drives at the bridge, and who gets the role back (docs/bridge.md), in virtual time."""

from __future__ import annotations

import math
import random

import pytest
from bridge_stage import BRIDGED, OTHER, Operator, Recorder, World, client, here, holds

from automcm.bridge.driver_role import DriverRole
from automcm.bridge.websocket_bridge import WebSocketBridge
from automcm_simulation.road.simulation import Simulation
from automcm_simulation.road.straight_lane import Straight

LOST, RETURN, EACH = 1500, 5000, 100
SILENCE = 1700
"""The silence after which a second connection kept the role for good."""


class Road:
    """A bridged station in virtual time, and its clients, which publish every 100 ms."""

    def __init__(self, *clients: str) -> None:
        self.simulation, self.bridge, self.now = Simulation(), WebSocketBridge(), 0
        self.service = self.simulation.add(BRIDGED, self.bridge)
        self.simulation.add(OTHER, Straight())
        self.clients = {name: Operator(self.bridge, name) for name in clients}

    def run(self, ms: int, *publishing: str) -> set[object]:
        """All who drove meanwhile."""
        drivers: set[object] = set()
        until = self.now + ms
        while self.now < until:
            self.now += EACH
            self.simulation.run(self.now)
            for name in publishing:
                self.clients[name].publish("kinematics", **here(0.0, 0.0))
            drivers.add(self.bridge._role.driver)
        return drivers


def test_a_driver_that_was_silent_gets_the_role_back() -> None:
    road = Road("first", "second")
    assert road.run(2000, "first", "second") == {"first"}
    refused = road.clients["second"].statuses()
    assert set(refused) == {"topic: another connection is the driver"}
    assert "second" in road.run(SILENCE, "second")
    assert road.run(RETURN, "first", "second") == {"second"}
    assert road.run(60_000, "first", "second") == {"first"}


def test_a_session_ends_first_however_steady_the_holder() -> None:
    role = DriverRole(LOST, RETURN)
    role.publish("first", 0, False)
    for now in range(LOST, LOST + 4 * RETURN, EACH):
        assert role.publish("second", now, True)
        assert not role.publish("first", now, True)
    assert role.publish("first", now + EACH, False)
    assert not role.publish("second", now + EACH, False)


def test_a_gap_begins_the_wait_anew() -> None:
    road = Road("first", "second")
    road.run(500, "first")
    road.run(SILENCE, "second")
    road.run(RETURN - EACH, "first", "second")
    road.run(LOST, "second")
    assert road.run(RETURN, "first", "second") == {"second"}
    assert road.run(EACH, "first", "second") == {"first"}


def test_of_a_stand_in_that_falls_silent_the_role_is_taken_at_once() -> None:
    road = Road("first", "second")
    road.run(500, "first")
    road.run(SILENCE, "second")
    road.run(LOST, "first")
    assert road.run(EACH, "first") == {"first"}


def test_a_named_holder_comes_back_and_one_without_a_name_is_another() -> None:
    for holder, returns in (("first", True), (object(), False)):
        role = DriverRole(LOST, RETURN)
        assert role.publish(holder, 0, False)
        role.leave(holder)
        assert role.publish("second", 100, False)
        came = [
            now
            for now in range(200, 60_000, EACH)
            if (role.publish("second", now, False), role.publish(holder, now, False))[1]
        ]
        assert came[:1] == ([200 + RETURN] if returns else [])


def test_it_begins_to_wait_when_it_is_back() -> None:
    """However long it had driven before its connection broke."""
    role = DriverRole(LOST, RETURN)
    for now in range(0, 2 * RETURN, EACH):
        role.publish("first", now, False)
    role.leave("first")
    role.publish("second", now, False)
    assert not role.publish("first", now + EACH, False)


@pytest.mark.parametrize("seed", range(2))
def test_the_role_cannot_flap(seed: int) -> None:
    """For 10 hours a holder of random silences meets a stand-in that has none."""
    dice, role, hours = random.Random(seed), DriverRole(LOST, RETURN), 10
    quiet, lives, taken = 0, 0, 0
    for now in range(0, hours * 3_600_000, EACH):
        if dice.random() < EACH / 8000:
            quiet = now + dice.choice((1000, SILENCE, 4000))
            if dice.random() < 0.5:
                role.leave("first")
        before = role.driver
        if now >= quiet:
            role.publish("first", now, False)
        taken += before == "second" and role.driver == "first"
        lives += role.driver == "first"
        role.publish("second", now, False)
    assert 1 <= taken <= math.log2(hours * 3_600_000 / RETURN + 1)
    assert lives


async def test_a_client_leaves_with_its_last_connection() -> None:
    async with World(Recorder()) as world, client(world, name="first", drives=False) as it:
        await it.publish("kinematics", **here(0.0, 0.0))
        await holds(lambda: world.bridge._role.driver == "first")
        async with client(world, name="first", drives=False):
            await holds(lambda: len(world.bridge._clients) == 2)
        await holds(lambda: len(world.bridge._clients) == 1)
        assert world.bridge._role.driver == "first"
