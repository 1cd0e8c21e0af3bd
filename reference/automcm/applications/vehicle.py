"""A vehicle as an application drives it: where it is, what it follows, and its planned path.

SI units; s along the road's line, d to its left, x and y in the plane; positions are those of a
vehicle's centre.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from random import Random

import numpy as np

from automcm.kernels.road_line import RoadLine
from automcm.kernels.trajectory import Floats, Trajectory
from automcm_spec.vocabulary.messages import CAR_MM

STEP_S = 0.1
LANE_WIDTH = 3.5
STRAIGHT = RoadLine([(0, 0), (1, 0)], reach=100.0)
"""The x axis."""
ROAD_M = 600.0
"""The length of a planned path, in m."""


@dataclass(frozen=True, kw_only=True)
class Driving:
    """A driver's parameters.  Those of the IDM are common values for cars in a town."""

    acceleration: float = 1.5
    comfortable: float = 2.0
    """Comfortable deceleration of the IDM, m/s²."""
    hardest: float = 8.0
    headway_s: float = 1.0
    standstill: float = 2.0
    """Gap to the vehicle ahead when both stand, bumper to bumper, m."""
    gain: float = 1.0
    """Gain of the feedback to a prescribed speed, 1/s."""
    lane_change_s: float = 4.0


@dataclass(frozen=True, kw_only=True)
class LateBraking:
    """A model of the paper's behaviour without coordination.

    The paper has no values for it.  The values here are plausible, and ``restart_gap`` is
    calibrated to give the differences of section VI-B (automcm_evaluation.arrival), which are
    therefore fitted and not confirmed.

    A driver notices a vehicle that changes lanes when it is ``notice`` m from the middle of its
    old lane.  If that vehicle is within ``range_m`` ahead, the driver brakes at ``brake`` to a
    stop, and restarts when the gap is ``restart_gap`` m and ``restart_s`` have passed.
    """

    notice: float = 0.5
    range_m: float = 15.0
    brake: float = 3.0
    restart_gap: float = 45.0
    restart_s: float = 1.5


class PositionError:
    """The error of a measured position, along and across the road, m.

    It is a first-order Gauss-Markov process with a standard deviation of ``sigma`` along either
    axis, because an error of GNSS lasts.
    """

    TIME_S = 10.0
    """Its correlation time, an assumption."""

    def __init__(self, sigma: float, seed: str) -> None:
        self.sigma, self._random = sigma, Random(seed)
        self.along, self.across = (self._random.gauss(0, sigma) for _ in range(2))

    def step(self, after_s: float = STEP_S) -> None:
        """The error so much later."""
        kept = math.exp(-after_s / self.TIME_S)
        new = self.sigma * math.sqrt(1 - kept * kept)
        self.along = kept * self.along + self._random.gauss(0, new)
        self.across = kept * self.across + self._random.gauss(0, new)


@dataclass
class Vehicle:
    """One vehicle on the road."""

    station_id: int
    s: float
    lane: int
    speed: float
    desired: float
    length: float = CAR_MM[0] / 1000
    driving: Driving = field(default_factory=Driving)
    late: LateBraking | None = None
    """If set, it brakes late and stops for a vehicle that changes to its lane ahead."""
    acceleration: float = 0.0
    d: float = 0.0
    width: float = CAR_MM[1] / 1000
    line: RoadLine = STRAIGHT
    error: PositionError | None = None
    """Of the position that it measures."""
    target_lane: int = 0
    offset_s: float = 0.0
    """By how much the clock of its station, on which ``now`` and trajectories are, is ahead."""
    slip: float = 0.0
    """By how much its heading is to the left of the road's, rad."""
    _moved_from: int = 0
    _moving_since: float | None = None
    _profile: Trajectory | None = None
    _stopped_since: float | None = None
    _braking: bool = False

    def __post_init__(self) -> None:
        self.target_lane = self._moved_from = self.lane
        self.d = self.lane * LANE_WIDTH

    @property
    def x(self) -> float:
        """In the plane, m; as ``y``."""
        return self.line.pose(self.s, self.d)[0]

    @property
    def y(self) -> float:
        """In the plane, m."""
        return self.line.pose(self.s, self.d)[1]

    @property
    def heading(self) -> float:
        """That of the road, rad; the slip of a lane change is not simulated."""
        return self.line.pose(self.s, self.d)[2]

    @property
    def measured(self) -> tuple[float, float]:
        """Its s and d as it measures them."""
        if self.error is None:
            return self.s, self.d
        return self.s + self.error.along, self.d + self.error.across

    @property
    def changing(self) -> bool:
        """Whether it is between two lanes."""
        return self._moving_since is not None

    @property
    def lanes(self) -> frozenset[int]:
        """The lanes that it occupies: both during a lane change."""
        return frozenset({self._moved_from, self.target_lane})

    def follow(self, trajectory: Trajectory | None) -> None:
        """Drive at the speeds of this trajectory from its first time on; None ends this."""
        self._profile = trajectory

    def change_lane(self, lane: int, now: float) -> None:
        """Begin a lane change, unless one is in progress."""
        if lane != self.target_lane and not self.changing:
            self._moved_from, self.target_lane = self.lane, lane
            self._moving_since = now - self.offset_s

    @property
    def moved_m(self) -> float:
        """The distance from the middle of the lane that it leaves."""
        return abs(self.d - self._moved_from * LANE_WIDTH)

    def turn_back(self, now: float) -> None:
        """Return to the lane that it leaves, in the time that it took to come here."""
        if self._moving_since is not None:
            now -= self.offset_s
            left = self.driving.lane_change_s - (now - self._moving_since)
            self._moved_from, self.target_lane = self.target_lane, self._moved_from
            self._moving_since = now - left

    def profile_speed(self, now: float) -> float | None:
        """The prescribed speed now; None without a prescription.  A stop is permanent."""
        p = self._profile
        if p is None or now < p.t[0]:
            return None
        if now >= p.t[-1]:
            return 0.0 if p.stopped else None
        return float(p.speeds()[np.searchsorted(p.t, now, side="right") - 1])

    def zone(self, lane: int) -> Floats:
        """The lane around the vehicle as a polygon, (n, 2), m (KIN-4)."""
        low, high = (lane - 0.5) * LANE_WIDTH, (lane + 0.5) * LANE_WIDTH
        return self.line.zone(low, high, self.s - ROAD_M, self.s + ROAD_M)

    def path(self) -> tuple[Floats, Floats]:
        """The planned path: points 5 m apart and the speed at each, shape (n, 2) and (n,).

        Before a lane change, the path leads straight to the other lane within ``lane_change_s``.
        """
        s, d = self.measured
        ahead = s + np.arange(0.0, ROAD_M, 5.0)
        over = max(self.speed, 1.0) * self.driving.lane_change_s
        share = np.clip((ahead - s) / over, 0.0, 1.0)
        aside = d + share * (self.target_lane * LANE_WIDTH - d)
        return self.line.place(ahead, aside), np.full(len(ahead), self.speed)


def idm(gap: float, speed: float, ahead_speed: float, desired: float, d: Driving) -> float:
    """Acceleration by the intelligent driver model, m/s².  ``gap``: bumper to bumper, m."""
    free = 1 - (speed / max(desired, 0.1)) ** 4
    if math.isinf(gap):
        return d.acceleration * free
    approach = speed * (speed - ahead_speed) / (2 * math.sqrt(d.acceleration * d.comfortable))
    wanted = d.standstill + max(0.0, speed * d.headway_s + approach)
    return d.acceleration * (free - (wanted / max(gap, 0.1)) ** 2)
