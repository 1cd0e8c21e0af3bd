"""An equipped vehicle that a mover moves, as the applications of automcm.applications see it."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from automcm.applications.occupancy import Perception, Seen
from automcm.applications.vehicle import LANE_WIDTH, STEP_S, Vehicle
from automcm_simulation.traffic.mover import Body, RoadUser

THERE_M = 0.1
"""A lane change is complete this close to the middle of the lane, m."""


@dataclass
class TrafficVehicle(Vehicle):
    """Its place, speed and lane follow the mover; its control steers and sets speeds."""

    def place(self, body: Body, s: float, d: float, heading: float) -> None:
        """Take over the state from the mover; s, d and the heading of the road are on ``line``."""
        self.s, self.d = s, d
        self.speed, self.acceleration = body.speed, body.acceleration
        self.slip = math.remainder(body.heading - heading, math.tau)
        self.lane = max(0, round(d / LANE_WIDTH))
        if self.changing and abs(self.aside) < THERE_M:
            self._moved_from, self._moving_since = self.target_lane, None

    @property
    def aside(self) -> float:
        """The way to the left to the middle of the lane to which it drives, m."""
        return self.target_lane * LANE_WIDTH - self.d

    def set_speed(self, now_s: float) -> float | None:
        """The speed for the next step by the feedback to the prescribed one, m/s; None without a
        prescription (as in Road)."""
        prescribed = self.profile_speed(now_s)
        if prescribed is None:
            return None
        d = self.driving
        by = d.gain * (prescribed - self.speed)
        return max(0.0, self.speed + max(-d.comfortable, min(by, d.acceleration)) * STEP_S)


def place_all(vehicles: Sequence[TrafficVehicle], bodies: Mapping[int, Body]) -> None:
    """Take over the states of all vehicles from the mover; those on one line at a time."""
    by_line: dict[int, list[TrafficVehicle]] = {}
    for vehicle in vehicles:
        by_line.setdefault(id(vehicle.line), []).append(vehicle)
    for some in by_line.values():
        at = [bodies[vehicle.station_id] for vehicle in some]
        found = some[0].line.project(np.array([(body.x, body.y) for body in at]))
        rows = zip(
            some, at, found.s.tolist(), found.d.tolist(), found.heading.tolist(), strict=True
        )
        for vehicle, body, s, d, heading in rows:
            if math.isfinite(d):
                vehicle.place(body, s, d, heading)


class Sight:
    """What a vehicle's sensors see: every road user within ``range_m``, without error.

    Vehicles do not hide each other.
    """

    def __init__(self, users: Mapping[int, RoadUser], range_m: float) -> None:
        self._users, self._range_m = users, range_m
        self._bodies: Mapping[int, Body] = {}

    def look(self, bodies: Mapping[int, Body]) -> None:
        """All road users as they are now."""
        self._bodies = bodies

    def seen(self, number: int) -> list[Seen]:
        """What this road user sees."""
        own = self._bodies.get(number)
        if own is None:
            return []
        near, tracks = self._range_m, []
        for other, body in self._bodies.items():
            if other != number and math.hypot(body.x - own.x, body.y - own.y) <= near:
                user = self._users[other]
                tracks.append(
                    Seen(
                        x=body.x,
                        y=body.y,
                        vx=body.speed * math.cos(body.heading),
                        vy=body.speed * math.sin(body.heading),
                        length=user.length,
                        width=user.width,
                        sigma=0.0,
                    )
                )
        return tracks

    def of(self, number: int) -> Perception:
        """The perception of this road user (APP-1)."""
        return lambda region, t0_ms, t1_ms: self.seen(number)
