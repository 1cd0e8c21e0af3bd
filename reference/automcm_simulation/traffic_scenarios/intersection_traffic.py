"""An intersection without signals: a left turn across the oncoming traffic."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cache, partial
from typing import Any

import numpy as np

from automcm.applications import occupancy
from automcm.applications.occupancy import Perception, Seen
from automcm.applications.ramp_merge import BRAKE
from automcm.applications.vehicle import LANE_WIDTH, Vehicle
from automcm.kernels.road_line import RoadLine
from automcm.service.application import heard_by
from automcm_simulation.traffic import lanelet_network
from automcm_simulation.traffic.mover import RoadUser
from automcm_simulation.traffic.sumo_mover import NETWORKS
from automcm_simulation.traffic.traffic import Traffic
from automcm_simulation.traffic.traffic_scenario import TrafficSetting
from automcm_simulation.traffic.traffic_vehicle import TrafficVehicle
from automcm_simulation.traffic_scenarios.stream import counted, stream
from automcm_simulation.traffic_scenarios.yielding import Yielding, position

SCENARIO = "left_turn"
PLACE = (600.1, 1.75)
"""Where the two ways cross in networks/intersection.nod.xml."""
LINE = RoadLine([(2000.0, PLACE[1]), (0.0, PLACE[1])])
"""The way of the oncoming vehicles there."""
REACH_M = 4.5
"""The ways are in conflict so far before and behind the place."""
TURN_M_S, TOWN_M_S = 5.0, (11.0, 13.5)
FASTEST_M_S, SPEEDS_UP = 13.9, 2.6
"""Oncoming vehicles may reach this speed with this acceleration, m/s²: SUMO's drivers."""
APART_S = 1.5
ASKS_M = 60.0


def earliest(way: float, speed: float) -> float:
    """When an oncoming vehicle may arrive at the earliest, s."""
    if way <= 0:
        return 0.0
    a = SPEEDS_UP
    return max(way / FASTEST_M_S, (math.sqrt(speed**2 + 2 * a * way) - speed) / a)


class LeftTurn(Yielding):
    """Waits before the place unless nobody comes, or whoever comes first has agreed to yield."""

    def __init__(
        self,
        vehicle: Vehicle,
        turns: bool,
        sees: Perception,
        place: tuple[float, float] = PLACE,
        line: RoadLine = LINE,
    ) -> None:
        """``place``: where the ways cross, m; ``line``: the way of the oncoming vehicles."""
        super().__init__(vehicle, SCENARIO, place)
        self._turns, self._sees, self._line = turns, sees, line
        self._goes = False

    def _through_s(self, way: float, speed: float) -> float:
        """The time until its rear has left the conflict, s; at most at the speed of the turn."""
        left, a = way + REACH_M + self.vehicle.length, self.vehicle.driving.acceleration
        return max(left / TURN_M_S, (math.sqrt(speed**2 + 2 * a * left) - speed) / a)

    def _oncoming(self) -> list[Seen]:
        now = self.service.now()
        seen = self._sees(self._line.xy, now, now)
        heard = heard_by(self.service) or ()
        known = occupancy.tracks(heard, seen, (), None, now, self._line)
        return [t for t in known if abs(t.y) < LANE_WIDTH / 2 and t.vx > -1.0]

    def _free(self, way: float) -> bool:
        """Whether nobody arrives before it is through."""
        at, _ = position(self._line, self.place)
        needed = self._through_s(way, self.vehicle.speed) + APART_S
        promised = self.promised_ms()
        known = self._oncoming()
        target = next((t for t in known if promised and t.station_id == self.target), None)
        for track in known:
            left = at - REACH_M - track.length / 2 - track.x
            if left < -2 * REACH_M - track.length or (target and track.x < target.x):
                continue  # it has passed, or is behind the target
            arrives = earliest(left, track.vx)
            if track is target and promised:
                after = (promised - self.service.now()) / 1000
                arrives = max(arrives, after * left / (left + REACH_M) if left > 0 else 0.0)
            if arrives < needed:
                return False
        return True

    def _held(self, now_ms: int) -> float | None:
        way = self.way(self.place) if self._turns else None
        if way is None or (self._goes and way < REACH_M - 1.0):
            return None  # it clears the conflict
        v, left = self.vehicle, way - REACH_M
        if v.speed**2 < 2 * BRAKE * max(left, 0.1) or v.speed < 0.5:
            self._goes = self._free(way)  # until it could no longer stop
        return None if self._goes else left

    def _wanted(self, now_ms: int) -> tuple[int, int] | None:
        way = self.way(self.place) if self._turns else None
        if way is None or way > ASKS_M or self._goes:
            return None
        begins = round(1000 * way / max(self.vehicle.speed, TURN_M_S))
        through_s = self._through_s(way, self.vehicle.speed)
        return now_ms + begins, now_ms + round(1000 * (through_s + 2 * APART_S))

    def _until(self, window: tuple[int, int], arrives_ms: int, way: float) -> int:
        """The vehicles before the target pass first; then this one starts from a stand.

        The target drives evenly, so that it is in the conflict before it arrives at the place.
        """
        now, slot_s = self.service.now(), self._through_s(REACH_M, 0.0) + 2 * APART_S
        there = max(window[1], arrives_ms + round(1000 * slot_s))
        return now + round((there - now) * way / max(way - REACH_M, 1.0))

    def _through(self, now_ms: int) -> bool:
        v = self.vehicle
        at, _ = position(v.line, self.place)
        return v.s - v.length / 2 - at > REACH_M or super()._through(now_ms)


@dataclass(frozen=True)
class Intersection:
    """A third of the vehicles turn left, the others come towards them."""

    name: str = "intersection"
    network: str = "intersection"
    turning: tuple[str, ...] = ("from_west", "to_north")
    oncoming: tuple[str, ...] = ("from_east", "to_west")

    def ways(self) -> tuple[tuple[float, float], RoadLine]:
        """Where the ways cross, and that of the oncoming vehicles."""
        return PLACE, LINE

    def users(self, setting: TrafficSetting) -> list[RoadUser]:
        """As ``Scenario.users``."""
        numbers = list(range(1, setting.vehicles + 1))
        on = partial(stream, setting, lane=0, gap_m=1000 / setting.density, desired=TOWN_M_S)
        oncoming = [n for n in numbers if n % 3]
        return on(oncoming, route=self.oncoming, first_m=1320.0) + on(
            numbers[2::3], route=self.turning, first_m=480.0
        )

    def driver(self, user: RoadUser, vehicle: TrafficVehicle, sees: Perception) -> LeftTurn:
        """As ``Scenario.driver``."""
        return LeftTurn(vehicle, user.route == self.turning, sees, *self.ways())

    def begin(self, traffic: Traffic) -> None:
        """As ``Scenario.begin``: nothing."""

    def outcome(self, traffic: Traffic) -> dict[str, Any]:
        """As ``Scenario.outcome``."""
        turning = [user.number for user in traffic.users.values() if user.route == self.turning]
        bodies, over = traffic.mover.bodies(), 0
        if turning:
            line = traffic.mover.line(self.turning)
            place, *there = [self.ways()[0], *(bodies[n][:2] for n in turning if n in bodies)]
            at, *now = line.project([place, *there]).s.tolist()
            over = len(turning) - sum(s <= at + REACH_M for s in now)
        words = ("requests", "asks nobody", "accepts to yield", "refuses to yield", "is through")
        return {"turn left": len(turning), "have turned": over} | counted(traffic, words)


@dataclass(frozen=True)
class LaneletIntersection(Intersection):
    """The same on the Lanelet2 map networks/town.osm, where the street bends."""

    name: str = "intersection-lanelet2"
    network: str = "town"
    turning: tuple[str, ...] = ("10", "31")
    oncoming: tuple[str, ...] = ("20", "22")

    def ways(self) -> tuple[tuple[float, float], RoadLine]:
        """As ``Intersection.ways``, from the lanelets."""
        return _lanelet_ways()


@cache
def _lanelet_ways() -> tuple[tuple[float, float], RoadLine]:
    lanes = lanelet_network.lane_map(NETWORKS / "town.osm")
    oncoming = lanes.line([20, 21, 22])
    turning = lanes.line([30], reach=LANE_WIDTH / 2)
    crossed = -oncoming.project(turning.xy).d  # the turn begins to the left of the oncoming way
    s = np.interp(0.0, crossed, turning.project(turning.xy).s)
    x, y = turning.place([s], [0.0])[0].tolist()
    return (x, y), oncoming
