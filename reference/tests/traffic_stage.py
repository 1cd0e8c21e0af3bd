"""A stage for stations in traffic without SUMO: the small road of automcm_simulation moves them."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

from automcm.applications.vehicle import STRAIGHT, Vehicle
from automcm.kernels.road_line import RoadLine
from automcm_simulation.radio.radio import RadioModel
from automcm_simulation.road.road import Road
from automcm_simulation.traffic.even_radio import EvenRadio
from automcm_simulation.traffic.mover import Body, RoadUser
from automcm_simulation.traffic.traffic import Traffic
from automcm_simulation.traffic.traffic_scenario import TrafficSetting
from automcm_simulation.traffic_scenarios.lane_change_traffic import LaneChanges

SIDE_M_S = 3.5 / 4
"""A vehicle steers aside at this speed."""


class RoadMover:
    """Moves straight ahead, keeps the distance, and steers aside as it is told."""

    def __init__(self, users: Sequence[RoadUser]) -> None:
        self._vehicles = {
            u.number: Vehicle(u.number, u.at_m, u.lane, u.speed, u.desired, u.length, width=u.width)
            for u in users
        }
        self._road = Road(list(self._vehicles.values()))
        self._speeds: dict[int, float | None] = {}
        self._aside: dict[int, float] = {}
        self.gone: set[int] = set()

    def line(self, route: tuple[str, ...]) -> RoadLine:
        return STRAIGHT

    def bodies(self) -> Mapping[int, Body]:
        return {
            n: Body(v.s, v.d, 0.0, v.speed, v.acceleration)
            for n, v in sorted(self._vehicles.items())
            if n not in self.gone
        }

    def control(
        self, number: int, speed: float | None, aside: float, limit: float | None = None
    ) -> None:
        if limit is not None:
            speed = limit if speed is None else min(speed, limit)
        self._speeds[number], self._aside[number] = speed, aside

    def step(self) -> None:
        self._road.step()
        for number, vehicle in self._vehicles.items():
            if (speed := self._speeds.get(number)) is not None:
                vehicle.speed = min(speed, vehicle.speed + 0.2)
            aside = self._aside.get(number, 0.0)
            vehicle.d += max(-SIDE_M_S * 0.1, min(aside, SIDE_M_S * 0.1))
            vehicle.lane = vehicle.target_lane = vehicle._moved_from = round(vehicle.d / 3.5)

    def close(self) -> None:
        """Nothing to end."""


TWO = LaneChanges("lane-change", "two_lanes", lanes=2)


def traffic(
    seed: int = 0,
    vehicles: int = 8,
    loss: float = 0.0,
    penetration: float = 1.0,
    duration_s: float = 30.0,
    logs: Path | None = None,
    scenario: LaneChanges = TWO,
    radio: RadioModel | None = None,
    observe: Callable[[Traffic], None] = lambda traffic: None,
) -> tuple[Traffic, RoadMover]:
    """Traffic before its run."""
    setting = TrafficSetting(
        seed=seed, vehicles=vehicles, penetration=penetration, duration_s=duration_s
    )
    users = scenario.users(setting)
    mover = RoadMover(users)
    made = Traffic(
        scenario, setting, mover, users, radio or EvenRadio(loss, seed), logs=logs, observe=observe
    )
    return made, mover
