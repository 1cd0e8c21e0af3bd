"""A pedestrian crosses two lanes, seen by one vehicle and by nobody else.

The others see the pedestrian only from HIDDEN_M on.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np

from automcm.applications.occupancy import Perception, Seen
from automcm.applications.vehicle import LANE_WIDTH, Vehicle
from automcm.kernels.trajectory import Floats
from automcm_simulation.traffic.mover import RoadUser
from automcm_simulation.traffic.traffic import Traffic
from automcm_simulation.traffic.traffic_scenario import TrafficSetting
from automcm_simulation.traffic.traffic_vehicle import TrafficVehicle
from automcm_simulation.traffic_scenarios.stream import counted, stream
from automcm_simulation.traffic_scenarios.yielding import Yielding

SCENARIO = "pedestrian"
CROSSES_M = 600.0
"""Where the path crosses the road (networks/crossing.nod.xml)."""
STOP_M = 3.0
"""Vehicles stop so far before."""
RIGHT_M, LEFT_M = 13.0, 20.0
"""y of the sides of the road."""
FROM_M = 5.0
"""y from which on a pedestrian is one who will cross."""
HIDDEN_M = 35.0
PERSON_M = 0.6
WALKS_M_S = (1.0, 1.6)
TOWN_M_S = (7.5, 8.3)
"""A zone of 30 km/h."""


def persons(found: Sequence[Seen]) -> list[Seen]:
    """Those who will cross, or do."""
    return [t for t in found if t.length <= PERSON_M and FROM_M < t.y < LEFT_M + PERSON_M]


class Crossing(Yielding):
    """Stops for whoever crosses; the vehicle that sees a hidden pedestrian asks the other lane."""

    def __init__(self, vehicle: Vehicle, sees: Perception, asks: bool) -> None:
        other = RIGHT_M + LANE_WIDTH * 1.5
        super().__init__(vehicle, SCENARIO, (CROSSES_M - STOP_M, other))
        self._sees, self._asks = sees, asks

    def _persons(self, now_ms: int) -> list[Seen]:
        return persons(self._sees(self.vehicle.zone(self.vehicle.lane), now_ms, now_ms))

    def _wanted(self, now_ms: int) -> tuple[int, int] | None:
        if not self._asks or not (found := self._persons(now_ms)):
            return None
        ends = max((LEFT_M + PERSON_M - t.y) / max(t.vy, 0.5) for t in found)
        return now_ms, now_ms + round(1000 * ends)

    def _held(self, now_ms: int) -> float | None:
        v = self.vehicle
        left = CROSSES_M - STOP_M - v.length / 2 - v.x
        return left if left > -STOP_M / 2 and self._persons(now_ms) else None

    def _through(self, now_ms: int) -> bool:
        return not self._persons(now_ms)


def hidden(sees: Perception, vehicle: Vehicle) -> Perception:
    """Without the pedestrians that are further away than HIDDEN_M."""

    def seen(region: Floats, t0_ms: int, t1_ms: int) -> list[Seen]:
        x, y = vehicle.x, vehicle.y
        return [
            t
            for t in sees(region, t0_ms, t1_ms)
            if t.length > PERSON_M or float(np.hypot(t.x - x, t.y - y)) <= HIDDEN_M
        ]

    return seen


@dataclass(frozen=True)
class PedestrianCrossing:
    """Two lanes; the first vehicle on the right always has a station, and sees the pedestrian."""

    name: str = "crossing"
    network: str = "crossing"

    def users(self, setting: TrafficSetting) -> list[RoadUser]:
        """As ``Scenario.users``."""
        numbers = list(range(1, setting.vehicles + 1))
        on = partial(stream, setting, route=("road",), desired=TOWN_M_S)
        gap, draw = 2000 / setting.density, setting.random("pedestrian")
        seer, *right = on(
            numbers[::2], lane=0, first_m=CROSSES_M - draw.uniform(100, 130), gap_m=gap
        )
        left = on(numbers[1::2], lane=1, first_m=CROSSES_M - draw.uniform(105, 160), gap_m=gap)
        walks = RoadUser(
            number=setting.vehicles + 1,
            route=("path",),
            lane=0,
            at_m=0.0,
            speed=0.0,
            desired=draw.uniform(*WALKS_M_S),
            equipped=False,
            length=PERSON_M,
            width=PERSON_M,
            kind="person",
            begins_s=round(draw.uniform(0.0, 5.0), 1),
        )
        return [replace(seer, equipped=True), *right, *left, walks]

    def driver(self, user: RoadUser, vehicle: TrafficVehicle, sees: Perception) -> Crossing:
        """As ``Scenario.driver``."""
        first = user.number == 1
        return Crossing(vehicle, sees if first else hidden(sees, vehicle), first)

    def begin(self, traffic: Traffic) -> None:
        """As ``Scenario.begin``: nothing."""

    def outcome(self, traffic: Traffic) -> dict[str, Any]:
        """As ``Scenario.outcome``."""
        words = ("requests", "asks nobody", "accepts to yield", "refuses to yield", "is through")
        return counted(traffic, words)
