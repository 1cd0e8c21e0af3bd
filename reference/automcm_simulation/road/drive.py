"""A simulated road with a service in each vehicle, for ``automcm simulate``."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path
from types import MappingProxyType
from typing import Protocol

from automcm.applications.lane_change import LaneChange, Plan
from automcm.applications.vehicle import STEP_S, Driving, LateBraking, Vehicle
from automcm.core.state import State
from automcm.core.station import Effects
from automcm.encoding.codec import JSON, Codec
from automcm.links.simulated_radio import Channel
from automcm.service.application import Application
from automcm_simulation.road.road import Road, Sample
from automcm_simulation.road.simulation import Simulation
from automcm_spec.vocabulary.parameters import Parameters

STEP_MS = round(STEP_S * 1000)
NO_OFFSETS: Mapping[int, int] = MappingProxyType({})
NAMES = {1: "prescriber", 2: "A", 3: "B", 4: "C"}


class Driver(Application, Protocol):
    """An application with its own control loop."""

    @property
    def vehicle(self) -> Vehicle:
        """The vehicle that it drives."""

    def tick(self, now_ms: int) -> None:
        """Called after every step of the road."""


class SimulatedDrive:
    """The vehicles of these drivers, their services and a radio; ``others`` have no radio.

    A given ``simulation`` determines the seed, the channel and the logs.  ``offsets_ms`` says by
    how much the clock of a station is ahead of the road's, at least 0.
    """

    def __init__(
        self,
        drivers: Sequence[Driver],
        *,
        seed: int = 0,
        channel: Channel | None = None,
        parameters: Parameters | None = None,
        logs: Path | None = None,
        codec: Codec = JSON,
        simulation: Simulation | None = None,
        others: Sequence[Vehicle] = (),
        offsets_ms: Mapping[int, int] = NO_OFFSETS,
    ) -> None:
        self.drivers = drivers
        self.road = Road([*(driver.vehicle for driver in drivers), *others])
        self.simulation = simulation or Simulation(seed=seed, channel=channel, logs=logs)
        self.sent: list[tuple[int, int, str]] = []
        """Time in ms, station and type of each message except CAMs."""
        for driver in drivers:
            offset_ms = offsets_ms.get(driver.vehicle.station_id, 0)
            driver.vehicle.offset_s = offset_ms / 1000
            self._add(driver, parameters, codec, offset_ms)
        self.simulation.clock.at(STEP_MS, self._step)

    def _add(
        self, driver: Driver, parameters: Parameters | None, codec: Codec, offset_ms: int
    ) -> None:
        station_id = driver.vehicle.station_id

        def observe(before: State, effects: Effects) -> None:
            self.sent += [(effects.now_ms, station_id, m.type) for m in effects.messages]

        self.simulation.add(
            station_id,
            driver,
            parameters,
            observers=(observe,),
            codec=codec,
            offset_ms=offset_ms,
        )

    def _step(self) -> None:
        clock, services = self.simulation.clock, self.simulation.services
        self.road.step()
        for driver in self.drivers:
            driver.tick(services[driver.vehicle.station_id].now())
        clock.at(clock.now() + STEP_MS, self._step)

    def run(self, until_s: float) -> None:
        """Run to a time in s, and end the logs."""
        self.simulation.run(round(until_s * 1000))


@dataclass(frozen=True, kw_only=True)
class FourVehicles:
    """The setting of the paper's Fig. 6: a prescriber beside receivers A, B and C.

    ``gap_m`` is from centre to centre in the other lane; B begins ``beside_m`` behind the
    prescriber.  With ``vehicles`` below 4, C and then A are left out.
    """

    vehicles: int = 4
    speed_kmh: float = 30.0
    gap_m: float = 22.0
    beside_m: float = 3.0
    coordinated: bool = True
    signal_s: float = 1.0
    until_s: float = 40.0
    seed: int = 0
    plan: Plan = field(default_factory=Plan)
    late: LateBraking = field(default_factory=LateBraking)
    driving: Driving = field(default_factory=Driving)

    def __post_init__(self) -> None:
        if not 2 <= self.vehicles <= 4:
            raise ValueError(f"vehicles must be 2, 3 or 4, not {self.vehicles}")
        if self.speed_kmh <= 0:
            raise ValueError(f"speed_kmh must be positive, not {self.speed_kmh}")

    def run(
        self,
        *,
        channel: Channel | None = None,
        parameters: Parameters | None = None,
        logs: Path | None = None,
    ) -> SimulatedDrive:
        """Run the drive to its end."""
        drive = self.on(Simulation(seed=self.seed, channel=channel, logs=logs), parameters)
        drive.run(self.until_s)
        return drive

    def on(
        self,
        simulation: Simulation,
        parameters: Parameters | None = None,
        driver: Callable[[Vehicle, Plan], LaneChange] = LaneChange,
    ) -> SimulatedDrive:
        """The drive on this simulation, before its start.

        ``driver`` makes each vehicle's application.
        """
        speed = self.speed_kmh / 3.6
        places = {1: 0.0, 3: -self.beside_m}
        if self.vehicles > 2:
            places[2] = self.gap_m - self.beside_m
        if self.vehicles > 3:
            places[4] = -self.gap_m - self.beside_m
        late = None if self.coordinated else self.late
        vehicles = [
            Vehicle(n, places[n], min(n, 2) - 1, speed, speed, driving=self.driving)
            for n in sorted(places)
        ]
        for receiver in vehicles[1:]:
            receiver.late = late
        drivers = [driver(vehicle, self.plan) for vehicle in vehicles]
        drive = SimulatedDrive(drivers, parameters=parameters, simulation=simulation)
        prescriber = drivers[0]
        clock = drive.simulation.clock

        def signal() -> None:
            if self.coordinated:
                prescriber.signal(1)
            else:
                prescriber.vehicle.change_lane(1, clock.now() / 1000)

        clock.at(round(self.signal_s * 1000), signal)
        return drive


def arrival_s(samples: Sequence[Sample], x: float) -> float | None:
    """The first time in s at which a vehicle reaches ``x`` m, interpolated; None if never."""
    for before, after in pairwise(samples):
        if after.x >= x > before.x:
            return before.t + (after.t - before.t) * (x - before.x) / (after.x - before.x)
    return None
