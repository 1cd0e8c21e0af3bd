"""Traffic with stations: a mover, and a service in each equipped vehicle, in one simulated time."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any

from automcm.core.outcome import ReceivedCam
from automcm.core.state import State
from automcm.core.station import Effects
from automcm.encoding.codec import JSON, Codec
from automcm.links.link import Link
from automcm_simulation.radio.radio import RadioModel
from automcm_simulation.radio.radio_link import RadioLinks
from automcm_simulation.road.drive import Driver
from automcm_simulation.road.hazard_measures import Watched
from automcm_simulation.traffic import distance_guard
from automcm_simulation.traffic.mover import AUTOMATED, STEP_MS, Mover, RoadUser
from automcm_simulation.traffic.shared_codec import SharedCodec
from automcm_simulation.traffic.traffic_measures import Measures
from automcm_simulation.traffic.traffic_scenario import Scenario, TrafficSetting
from automcm_simulation.traffic.traffic_service import TrafficService
from automcm_simulation.traffic.traffic_vehicle import Sight, TrafficVehicle, place_all
from automcm_spec.vocabulary.application import Abort, Fallback, NoParticipants, Request
from automcm_spec.vocabulary.messages import Session


class Stations(Watched):
    """The services on a radio with positions, which records hazards (S-5, T-2)."""

    def __init__(self, radio: RadioModel, seed: int, logs: Path | None) -> None:
        super().__init__(seed=seed, logs=logs, service=partial(TrafficService, recent={}))
        self.links = RadioLinks(self.clock, radio)
        self.requested = 0
        """Sessions that were requested (ADV-1), without requests that were refused."""
        self.ended: Counter[str] = Counter()
        """Sessions that their prescriber left before the end, by reason."""
        self.began: dict[Session, int] = {}
        """When each was requested, ms."""
        self.partners: dict[Session, set[int]] = {}
        """The stations that were in each."""

    def link(self, station_id: int) -> Link:
        """As in Simulation."""
        return self.links.link(station_id)

    def _note(self, station_id: int, before: State, effects: Effects) -> None:
        if isinstance(effects.input, ReceivedCam):
            return
        super()._note(station_id, before, effects)
        session = effects.state.session
        if isinstance(effects.input, Request) and session not in (None, before.session):
            self.requested += 1
            self.began[session] = effects.now_ms
        if isinstance(effects.input, Abort) and effects.rule == "END-1":
            self.ended["abort"] += before.role == "prescriber"
        if session is not None:
            self.partners.setdefault(session, set()).add(station_id)
        for indication in effects.indications:
            if isinstance(indication, NoParticipants):
                self.ended["no_participants"] += 1
            elif isinstance(indication, Fallback) and before.role == "prescriber":
                self.ended[indication.reason] += 1


class Traffic:
    """A scenario with its mover, services and measures.

    Each step of STEP_MS: the mover moves everybody; then every application takes its control step;
    messages and timers run in between, in integer milliseconds.
    """

    def __init__(
        self,
        scenario: Scenario,
        setting: TrafficSetting,
        mover: Mover,
        users: Sequence[RoadUser],
        radio: RadioModel,
        *,
        logs: Path | None = None,
        codec: Codec = JSON,
        observe: Callable[[Traffic], None] = lambda traffic: None,
    ) -> None:
        """``observe`` is called after every step."""
        self.scenario, self.setting, self.mover = scenario, setting, mover
        self.users = {user.number: user for user in users}
        self.stations = Stations(radio, setting.seed, logs)
        self.clock = self.stations.clock
        self.sight = Sight(self.users, setting.sight_m)
        self.drivers: dict[int, Driver] = {}
        """The applications of all stations, by station id."""
        self.fixed: dict[int, tuple[float, float]] = {}
        """The places of the road-side units."""
        self.measures = Measures(self.users)
        self._vehicles: dict[int, TrafficVehicle] = {}
        self._gone: set[int] = set()
        self._codec, self._observe = SharedCodec(codec), observe
        self._look()
        scenario.begin(self)

    def add_road_side(self, station_id: int, x: float, y: float, driver: Driver) -> None:
        """Add a station that stands at this place, m.  Raises ValueError for a used id."""
        self.fixed[station_id] = x, y
        self._start(station_id, driver)

    def run(self, progress: Callable[[int], None] = lambda now_ms: None) -> None:
        """Run to the end of the setting, and end the logs."""
        until_ms = round(self.setting.duration_s * 1000)

        def step() -> None:
            self.mover.step()
            self._look()
            progress(self.clock.now())
            self.clock.at(self.clock.now() + STEP_MS, step)

        self.clock.at(STEP_MS, step)
        self.stations.run(until_ms)

    def _look(self) -> None:
        """Take over the states from the mover, and let every application control its vehicle."""
        bodies, now = self.mover.bodies(), self.clock.now()
        for number, user in self.users.items():
            there = number in bodies
            if user.equipped and there and number not in self._vehicles:
                self._enter(user)
            elif number in self._vehicles and not there and number not in self._gone:
                self._gone.add(number)
                self.stations.crash(number)
        driven = [v for number, v in self._vehicles.items() if number in bodies]
        place_all(driven, bodies)
        self.sight.look(bodies)
        positions = {v.station_id: (bodies[v.station_id].x, bodies[v.station_id].y) for v in driven}
        self.stations.links.move(positions | self.fixed)
        for number, driver in self.drivers.items():
            if number in self.fixed or number in bodies:
                if number not in self.stations.services:
                    self._start(number, driver)
                driver.tick(now)
        of, sight_m = {v.station_id for v in driven}, self.setting.sight_m
        limits = distance_guard.limits(of, bodies, self.users, sight_m)
        for vehicle in driven:
            number = vehicle.station_id
            speed = vehicle.set_speed(now / 1000)
            self.mover.control(number, speed, vehicle.aside, limits.get(number))
        self.measures.step(now, bodies, self)
        self._observe(self)

    def _enter(self, user: RoadUser) -> None:
        vehicle = TrafficVehicle(
            user.number,
            0.0,
            user.lane,
            user.speed,
            user.desired,
            user.length,
            AUTOMATED,
            width=user.width,
            line=self.mover.line(user.route),
        )
        self._vehicles[user.number] = vehicle
        sees = self.sight.of(user.number)
        self.drivers[user.number] = self.scenario.driver(user, vehicle, sees)

    def _start(self, station_id: int, driver: Driver) -> None:
        self.drivers[station_id] = driver
        self.stations.add(station_id, driver, codec=self._codec)

    @property
    def vehicles(self) -> dict[int, TrafficVehicle]:
        """The equipped vehicles, by number."""
        return self._vehicles

    def record(self) -> dict[str, Any]:
        """The statistics of the run so far, for JSON."""
        return self.measures.record(self)
