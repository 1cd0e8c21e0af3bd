"""What a scenario in traffic consists of; docs/adding-a-scenario.md leads through one.

A scenario names a network and its road users, and gives each equipped one an application.  All
else is common: the mover, the radio, the services, perception, logs, measures and the page.
"""

from __future__ import annotations

from dataclasses import dataclass
from random import Random
from typing import TYPE_CHECKING, Any, Protocol

from automcm.applications.occupancy import Perception
from automcm_simulation.road.drive import Driver
from automcm_simulation.traffic.mover import RoadUser
from automcm_simulation.traffic.traffic_vehicle import TrafficVehicle

if TYPE_CHECKING:
    from automcm_simulation.traffic.traffic import Traffic


@dataclass(frozen=True, kw_only=True)
class TrafficSetting:
    """What is set for one run."""

    seed: int = 0
    vehicles: int = 40
    density: float = 40.0
    """Vehicles per km of road, over all lanes."""
    penetration: float = 1.0
    """The share of equipped vehicles, from 0 to 1."""
    duration_s: float = 60.0
    sight_m: float = 100.0
    """The range of the vehicles' sensors."""

    def __post_init__(self) -> None:
        if self.vehicles < 1:
            raise ValueError(f"vehicles must be at least 1, not {self.vehicles}")
        if not self.density > 0:
            raise ValueError(f"density must be positive, not {self.density} vehicles per km")
        if not 0 <= self.penetration <= 1:
            raise ValueError(f"penetration must be from 0 to 1, not {self.penetration}")
        if not 0 < self.duration_s <= 3600:
            raise ValueError(f"duration_s must be above 0 and at most 3600, not {self.duration_s}")

    def random(self, what: str) -> Random:
        """A generator for one purpose, so that no draw shifts those of another."""
        return Random(f"{self.seed}/{what}")


class Scenario(Protocol):
    """A scenario in traffic.  The same setting gives the same scenario."""

    @property
    def name(self) -> str:
        """As in ``--scenario``."""

    @property
    def network(self) -> str:
        """One of the folder ``networks``."""

    def users(self, setting: TrafficSetting) -> list[RoadUser]:
        """Everybody who drives or walks, with unique numbers from 1 on."""

    def driver(self, user: RoadUser, vehicle: TrafficVehicle, sees: Perception) -> Driver:
        """The application of an equipped vehicle; ``tick`` is called after every step."""

    def begin(self, traffic: Traffic) -> None:
        """Called before the first step: add road-side units, set alarms on ``traffic.clock``."""

    def outcome(self, traffic: Traffic) -> dict[str, Any]:
        """What the record says of this scenario alone, for JSON."""
