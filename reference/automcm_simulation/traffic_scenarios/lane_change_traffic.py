"""Lane changes on two and on four lanes: the application of automcm.applications.lane_change."""

from __future__ import annotations

from dataclasses import dataclass
from random import Random
from typing import Any

from automcm.applications.lane_change import LaneChange, Plan
from automcm.applications.occupancy import Perception
from automcm_simulation.traffic.mover import AUTOMATED, RoadUser
from automcm_simulation.traffic.traffic import Traffic
from automcm_simulation.traffic.traffic_scenario import TrafficSetting
from automcm_simulation.traffic.traffic_vehicle import TrafficVehicle
from automcm_simulation.traffic_scenarios.stream import CAR_M, SPREAD, counted, equipped

DESIRED_KMH = (90.0, 130.0)
LORRY_KMH = 80.0
LORRIES = 0.1
"""The share of lorries."""
LORRY_M = 10.0, 18.0
LORRY_WIDTH_M = 2.5
MEAN_M = (1 - LORRIES) * sum(CAR_M) / 2 + LORRIES * sum(LORRY_M) / 2
BEGIN_M, END_M = 100.0, 12_000.0
"""Where the last vehicle starts, and where the road ends (networks/four_lanes.nod.xml)."""
SETTLED_S = 3.0
"""The first wish comes after this time, when CAMs have been heard."""
WISH_S = 20.0
"""Each equipped vehicle wishes for another lane so often, on average."""
RETRIES = 1


@dataclass(frozen=True)
class LaneChanges:
    """``lanes`` lanes; every equipped vehicle wishes for a neighbouring lane now and then."""

    name: str
    network: str
    lanes: int

    def users(self, setting: TrafficSetting) -> list[RoadUser]:
        """As ``Scenario.users``: in each lane at drawn distances, at a speed that these allow."""
        draw = setting.random("users")
        users: list[RoadUser] = []
        gap = max(2 * AUTOMATED.standstill, 1000 * self.lanes / setting.density - MEAN_M)
        numbers = list(range(1, setting.vehicles + 1))
        for lane in range(self.lanes):
            rear = BEGIN_M
            for number in numbers[lane :: self.lanes]:
                users.append(self._user(setting, draw, number, lane, rear, SPREAD[0] * gap))
                rear = users[-1].at_m + gap * draw.uniform(*SPREAD)
        furthest = max(user.at_m for user in users)
        if furthest > END_M:
            raise ValueError(
                f"vehicles: {setting.vehicles} of {setting.density:g} per km take "
                f"{furthest / 1000:.1f} km, the road has {END_M / 1000:g} km"
            )
        return users

    def _user(
        self,
        setting: TrafficSetting,
        draw: Random,
        number: int,
        lane: int,
        rear: float,
        least_m: float,
    ) -> RoadUser:
        lorry = draw.random() < LORRIES
        length = draw.uniform(*(LORRY_M if lorry else CAR_M))
        desired = (LORRY_KMH if lorry else draw.uniform(*DESIRED_KMH)) / 3.6
        allowed = max(0.0, (least_m - AUTOMATED.standstill) / (1.2 * AUTOMATED.headway_s))
        return RoadUser(
            number=number,
            route=("road",),
            lane=lane,
            at_m=rear + length,
            speed=min(desired, LORRY_KMH / 3.6, allowed),
            desired=desired,
            equipped=equipped(setting, number),
            length=length,
            width=LORRY_WIDTH_M if lorry else 1.8,
        )

    def driver(self, user: RoadUser, vehicle: TrafficVehicle, sees: Perception) -> LaneChange:
        """As ``Scenario.driver``."""
        return LaneChange(vehicle, Plan(retries=RETRIES), occupied=sees)

    def begin(self, traffic: Traffic) -> None:
        """As ``Scenario.begin``: every driver wishes for a lane at drawn times."""
        for number, driver in traffic.drivers.items():
            assert isinstance(driver, LaneChange)
            draw = traffic.setting.random(f"wishes/{number}")
            self._wish(traffic, number, driver, draw, SETTLED_S)

    def _wish(
        self, traffic: Traffic, number: int, driver: LaneChange, draw: Random, after_s: float
    ) -> None:
        wait = after_s + draw.expovariate(1 / WISH_S)

        def signal() -> None:
            lanes = [n for n in (driver.vehicle.lane - 1, driver.vehicle.lane + 1)]
            lane = draw.choice([n for n in lanes if 0 <= n < self.lanes])
            if not driver.busy and number in traffic.mover.bodies():
                driver.signal(lane)
            self._wish(traffic, number, driver, draw, 0.0)

        traffic.clock.at(traffic.clock.now() + round(wait * 1000), signal)

    def outcome(self, traffic: Traffic) -> dict[str, Any]:
        """As ``Scenario.outcome``: what the drivers have done."""
        return counted(traffic, KINDS)


KINDS = (
    *("signals", "nobody is in the way", "is accepted", "accepts", "refuses", "moves over"),
    *("has changed lanes", "returns", "gives up", "drives alone"),
)
"""The beginnings of a story's lines that are counted."""
