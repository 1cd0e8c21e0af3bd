"""A station of the reference on a virtual clock, and the air between it and the kit."""

from __future__ import annotations

import json
from collections import deque
from collections.abc import Callable
from typing import Any
from unittest.mock import patch

import pytest

from automcm.links.clock import VirtualClock
from automcm.links.link import Receiver
from automcm.service.service import McService
from automcm_conformance.adapter.protocol import DEFAULTS
from automcm_conformance.live.live_cases import CASES, LiveCase, LiveResult, LiveRun
from automcm_simulation.road.straight_lane import Straight
from automcm_spec.graph.oracle import Oracle, load
from automcm_spec.graph.oracle_generation import ONE_PEER, spec_hash
from automcm_spec.vocabulary.parameters import Parameters

Json = Any
STATION = 7
JITTER = 40
BY_NAME = {case.name: case for case in CASES}
Sent = list[tuple[int, Json]]
"""What becomes of a message: copies, each with its delay."""
Radio = Callable[[Json], Sent]


@pytest.fixture(scope="module")
def oracle() -> Oracle:
    return load(ONE_PEER.path, spec_hash())


class World:
    """The station and the air around it, in virtual time: the link of the one, and the other."""

    def __init__(
        self, radio: Radio, application: Straight | None = None, parameters: Json = None
    ) -> None:
        self.clock = VirtualClock()
        self.radio = radio
        self.service = McService(
            STATION,
            application or Straight(),
            _Link(self),
            self.clock,
            parameters=Parameters(**(parameters or {})),
        )
        self.clock.run(1_000)
        self.hears: Receiver = lambda data, tx: None
        self.coming: deque[tuple[int, bytes]] = deque()
        self.service.start()

    def arrives(self, data: bytes) -> None:
        self.coming.append((self.clock.now(), data))

    def now(self) -> int:
        return self.clock.now()

    def send(self, data: bytes) -> None:
        self.clock.at(self.now() + 2, lambda: self.hears(data, None) and None)

    def receive(self, until: int) -> tuple[int, bytes] | None:
        while not self.coming and self.now() < until:
            self.clock.run(self.now() + 1)
        if not self.coming:
            return None
        return max(self.now(), self.coming[0][0]), self.coming.popleft()[1]


class _Link:
    def __init__(self, world: World) -> None:
        self._world = world

    def open(self, receive: Receiver) -> None:
        self._world.hears = receive

    def send(self, data: bytes, to: int, tx: str) -> None:
        world = self._world
        for delay, message in world.radio(json.loads(data)):
            data = json.dumps(message).encode()
            world.clock.at(world.now() + delay, lambda data=data: world.arrives(data))

    def close(self) -> None:
        pass


def fair(message: Json) -> Sent:
    return [(3, message)]


def only(type_: str, change: Radio) -> Radio:
    """A radio that is fair but for messages of a type."""
    return lambda m: change(m) if m["type"] == type_ else fair(m)


def session(oracle: Oracle, world: World, adapter: Any = None) -> LiveRun:
    return LiveRun(oracle, world, STATION, DEFAULTS, JITTER, number=5, adapter=adapter)


def judge(
    oracle: Oracle,
    name: str,
    radio: Radio,
    virtual: Callable[[LiveCase], str | None] | None = None,
) -> LiveResult:
    """``virtual``: what a case comes to in virtual time; None without an adapter."""
    live = session(oracle, World(radio), virtual)
    with patch.object(LiveRun, "in_virtual_time", lambda _, adapter, case: adapter(case)):
        return live.judge(BY_NAME[name])
