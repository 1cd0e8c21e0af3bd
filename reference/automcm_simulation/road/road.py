"""A road with vehicles, simulated in steps of 0.1 s.

A vehicle follows the one ahead by the intelligent driver model (Treiber, Hennecke and Helbing,
2000), and a prescribed trajectory by feedback to its stepwise speed, as the solid line of the
paper's Fig. 4.  Without coordination a driver notices a vehicle in the way late: it brakes hard,
stops and restarts (section VI-B).  SI units; s along the road's line, d to its left, x and y in the
plane; positions are those of a vehicle's centre.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from automcm.applications.vehicle import LANE_WIDTH, STEP_S, LateBraking, Vehicle, idm


@dataclass(frozen=True, slots=True)
class Sample:
    """The state of one vehicle at one time; x is along the road's line and y to its left, m."""

    t: float
    station_id: int
    x: float
    y: float
    speed: float
    acceleration: float


class Road:
    """The vehicles, their simulation, and the recorded samples."""

    def __init__(self, vehicles: list[Vehicle]) -> None:
        ids = [vehicle.station_id for vehicle in vehicles]
        if len(set(ids)) != len(ids):
            raise ValueError(f"station_id: must be unique, not {ids}")
        if len({id(vehicle.line) for vehicle in vehicles}) > 1:
            raise ValueError("line: must be the same for all vehicles")
        self.vehicles = vehicles
        self.t = 0.0
        self.samples: list[Sample] = []
        self._record()

    def ahead(self, of: Vehicle) -> Vehicle | None:
        """The next vehicle ahead on one of its lanes."""
        inn = [v for v in self.vehicles if v is not of and v.s > of.s and v.lanes & of.lanes]
        return min(inn, key=lambda v: v.s, default=None)

    def gap(self, behind: Vehicle, front: Vehicle | None) -> float:
        """The gap to the vehicle ahead, bumper to bumper, m; infinite without one."""
        if front is None:
            return math.inf
        way = (front.s - behind.s) * behind.line.scale(behind.s, behind.d)
        return way - (front.length + behind.length) / 2

    def step(self) -> None:
        """Advance by STEP_S: all vehicles decide on the present state, then all move."""
        decided = [self._decide(vehicle) for vehicle in self.vehicles]
        for vehicle, acceleration in zip(self.vehicles, decided, strict=True):
            self._move(vehicle, acceleration)
        self.t = round(self.t + STEP_S, 6)
        self._record()

    def _decide(self, v: Vehicle) -> float:
        front = self.ahead(v)
        gap = self.gap(v, front)
        if v.late is not None and (braking := self._late(v, v.late)) is not None:
            return braking
        d = v.driving
        if v.late is not None and front is not None and front.changing:
            gap, front = math.inf, None  # not noticed yet
        following = idm(gap, v.speed, front.speed if front else 0.0, v.desired, d)
        prescribed = v.profile_speed(self.t + v.offset_s)
        if prescribed is not None:
            feedback = d.gain * (prescribed - v.speed)
            following = min(following, max(feedback, -d.comfortable))
        return max(following, -d.hardest)

    def _late(self, v: Vehicle, late: LateBraking) -> float | None:
        """The acceleration after a late notice; None without one."""
        if not v._braking:
            others = (o for o in self.vehicles if o is not v and o.changing)
            v._braking = any(
                v.lane == o.target_lane
                and abs(o.d - o._moved_from * LANE_WIDTH) >= late.notice
                and -o.length <= o.s - v.s <= late.range_m
                for o in others
            )
            if not v._braking:
                return None
        if v.speed > 0:
            front = self.ahead(v)
            ahead = front.speed if front else 0.0
            following = idm(self.gap(v, front), v.speed, ahead, v.desired, v.driving)
            return max(min(-late.brake, following), -v.driving.hardest)
        v._stopped_since = self.t if v._stopped_since is None else v._stopped_since
        waited = self.t - v._stopped_since >= late.restart_s
        if waited and self.gap(v, self.ahead(v)) >= late.restart_gap:
            v._braking, v._stopped_since = False, None
            return None
        return 0.0

    def _move(self, v: Vehicle, acceleration: float) -> None:
        """Move with constant acceleration for one step, but never backwards."""
        after = v.speed + acceleration * STEP_S
        if after < 0:
            way = v.speed**2 / (2 * -acceleration)
            v.speed, v.acceleration = 0.0, -v.speed / STEP_S
        else:
            way = (v.speed + after) / 2 * STEP_S
            v.speed, v.acceleration = after, acceleration
        v.s += way / v.line.scale(v.s, v.d)
        if v.error is not None:
            v.error.step()
        if v._moving_since is not None:
            share = (self.t + STEP_S - v._moving_since) / v.driving.lane_change_s + 1e-9
            v.d = LANE_WIDTH * (v._moved_from + min(share, 1) * (v.target_lane - v._moved_from))
            if share >= 0.5:
                v.lane = v.target_lane
            if share >= 1:
                v._moved_from, v._moving_since = v.target_lane, None

    def _record(self) -> None:
        self.samples += [
            Sample(self.t, v.station_id, v.s, v.d, v.speed, v.acceleration) for v in self.vehicles
        ]

    def of(self, station_id: int) -> list[Sample]:
        """The recorded samples of one vehicle, in order of time."""
        return [sample for sample in self.samples if sample.station_id == station_id]
