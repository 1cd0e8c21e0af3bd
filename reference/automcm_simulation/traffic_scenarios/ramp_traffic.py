"""Merging from a ramp: the vehicle asks for itself, or a road-side unit asks for whoever comes."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import partial
from typing import Any

from automcm.applications.occupancy import Perception
from automcm.applications.ramp_merge import Merge, Ramp
from automcm.applications.vehicle import LANE_WIDTH, Vehicle
from automcm.kernels.road_line import RoadLine
from automcm_simulation.road.drive import Driver
from automcm_simulation.traffic.mover import Body, RoadUser
from automcm_simulation.traffic.traffic import Traffic
from automcm_simulation.traffic.traffic_scenario import TrafficSetting
from automcm_simulation.traffic.traffic_vehicle import TrafficVehicle
from automcm_simulation.traffic_scenarios.stream import counted, stream
from automcm_simulation.traffic_scenarios.yielding import Yielding

ROUTE = ("before", "beside", "after")
RAMP = Ramp(joins_m=2000.0)
"""As in networks/ramp.nod.xml.  Lane 0 is the ramp."""
RIGHT_M = -1.5 * LANE_WIDTH
"""y of lane 0."""
MAIN_M_S, RAMP_M_S = (20.0, 25.0), (19.0, 22.0)
FIRST_M = {0: 1720.0, 1: 1780.0}
"""Where the first vehicle of each lane starts."""
RAMP_GAP_M = 90.0
SIGNAL_M = 250.0
"""So far before the place where the ramp joins it is planned who drives first."""
EVERY_MS = 3000
UNIT = 9999
"""Station id of the road-side unit."""


class RampUnit(Yielding):
    """A fixed station that opens gaps for the vehicles on the ramp, with or without stations.

    They move over by their own rules: nobody relies on the gap.
    """

    def __init__(self, on_ramp: Callable[[], Iterable[Body]]) -> None:
        """``on_ramp``: its detectors."""
        line = RoadLine([(0.0, RIGHT_M), (1.0, RIGHT_M)], reach=100.0)
        beside = Vehicle(UNIT, RAMP.joins_m, 0, 0.0, 0.0, line=line)
        beside.d = -2 * LANE_WIDTH
        super().__init__(beside, "ramp_unit", (RAMP.joins_m, RIGHT_M + LANE_WIDTH))
        self._on_ramp = on_ramp

    def _wanted(self, now_ms: int) -> tuple[int, int] | None:
        coming = [
            round(1000 * (RAMP.joins_m - body.x) / max(body.speed, 1.0))
            for body in self._on_ramp()
            if 0 < RAMP.joins_m - body.x < SIGNAL_M
        ]
        if not coming:
            return None
        at, apart = now_ms + min(coming), round(1000 * RAMP.apart_s)
        return at - apart // 2, at + apart


@dataclass(frozen=True)
class Ramps:
    """One lane with a ramp; a quarter of the vehicles come from it."""

    name: str
    unit: bool
    """Whether a road-side unit is the prescriber."""
    network: str = "ramp"

    def users(self, setting: TrafficSetting) -> list[RoadUser]:
        """As ``Scenario.users``."""
        numbers = list(range(1, setting.vehicles + 1))
        on = partial(stream, setting, route=ROUTE)
        gap = 1000 / setting.density
        main = [n for n in numbers if n % 4]
        return on(main, lane=1, first_m=FIRST_M[1], gap_m=gap, desired=MAIN_M_S) + on(
            numbers[3::4],
            lane=0,
            first_m=FIRST_M[0],
            gap_m=max(gap, RAMP_GAP_M),
            desired=RAMP_M_S,
            stations=not self.unit,
        )

    def driver(self, user: RoadUser, vehicle: TrafficVehicle, sees: Perception) -> Driver:
        """As ``Scenario.driver``."""
        if self.unit:
            return Yielding(vehicle, "ramp_unit", (RAMP.joins_m, RIGHT_M + LANE_WIDTH))
        return Merge(vehicle, RAMP, occupied=sees)

    def begin(self, traffic: Traffic) -> None:
        """As ``Scenario.begin``: the unit is set up, or those on the ramp request every while."""
        if self.unit:
            place = RAMP.joins_m, RIGHT_M - 2 * LANE_WIDTH
            traffic.add_road_side(UNIT, *place, RampUnit(partial(_on_ramp, traffic)))
            return
        traffic.clock.at(EVERY_MS, partial(self._ask, traffic))

    def _ask(self, traffic: Traffic) -> None:
        for number, driver in traffic.drivers.items():
            assert isinstance(driver, Merge)
            v = driver.vehicle
            near = -RAMP.length_m / 2 < RAMP.joins_m - v.x < SIGNAL_M
            if near and v.lane == 0 and not driver.busy and number in traffic.mover.bodies():
                driver.signal()
        traffic.clock.at(traffic.clock.now() + EVERY_MS, partial(self._ask, traffic))

    def outcome(self, traffic: Traffic) -> dict[str, Any]:
        """As ``Scenario.outcome``."""
        ramp = [user.number for user in traffic.users.values() if user.lane == 0]
        bodies = traffic.mover.bodies()
        over = sum(n not in bodies or bodies[n].y > RIGHT_M + LANE_WIDTH / 2 for n in ramp)
        words = (
            ("signals", "nobody is in the way", "is accepted", "gives up", "returns"),
            ("requests", "asks nobody", "accepts to yield", "refuses to yield"),
        )[self.unit]
        return {"on the ramp": len(ramp), "have merged": over} | counted(traffic, words)


def _on_ramp(traffic: Traffic) -> list[Body]:
    bodies = traffic.mover.bodies().values()
    return [body for body in bodies if abs(body.y - RIGHT_M) < LANE_WIDTH / 2]
