"""Merging from a ramp: another scenario on the same service.

The prescriber will reach the main road at a certain time.  It asks the first of the vehicles there
that would be there at about that time to come later: on the same path, with stretched times.  It
moves over as in a lane change, and by the same rules of occupancy (APP-1 to APP-5).  Its own lane
ends, so unless it may move over it stops before that.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from automcm.applications import occupancy
from automcm.applications.lane_change import MARGIN_S, NO_RETURN_M, WAIT_MS, LaneChange
from automcm.applications.occupancy import Perception, Seen, nothing_seen
from automcm.applications.planning import LIMITS, planned, read
from automcm.applications.vehicle import LANE_WIDTH, Vehicle
from automcm.kernels.thin import thin
from automcm.kernels.trajectory import Trajectory, TrajectoryError, to_message
from automcm.service.application import Advertised, Choice, Proposal
from automcm_spec.vocabulary import messages
from automcm_spec.vocabulary.application import Command, Request

SCENARIO = "merge"
BRAKE = 1.8
"""The deceleration to a stop before the end of the ramp, m/s²; less than is comfortable."""
STOP_M = 4.0
"""The distance from the end of the ramp to which it brakes; the control stops a metre later."""


@dataclass(frozen=True, kw_only=True)
class Ramp:
    """The place and the lane where the ramp joins, and the distance of vehicles there."""

    joins_m: float
    length_m: float = 250.0
    """The length of the lane beside the main road, from ``joins_m`` to its end."""
    lane: int = 1
    apart_s: float = 2.5
    slowest: float = 0.5
    """The lowest share of its speed that a receiver accepts."""


def arrival(trajectory: Trajectory, x: float) -> float | None:
    """The time in s at which it passes x; None if it does not, or has already."""
    xs = trajectory.xy[:, 0]
    if len(xs) < 2 or not xs[0] < x <= xs[-1]:
        return None
    return float(np.interp(x, xs, trajectory.t))


def stretched(trajectory: Trajectory, factor: float) -> Trajectory:
    """The same path, ``factor`` times slower."""
    begin = trajectory.t[0]
    return Trajectory(begin + (trajectory.t - begin) * factor, trajectory.xy, trajectory.stopped)


class Merge(LaneChange):
    """A vehicle on the ramp (``signal``) or on the main road."""

    def __init__(self, vehicle: Vehicle, ramp: Ramp, occupied: Perception = nothing_seen) -> None:
        super().__init__(vehicle, occupied=occupied)
        self.ramp = ramp
        self._on_ramp = False

    def signal(self, lane: int | None = None) -> None:
        """Request to join ``lane``, by default that of the ramp.  One attempt at a time."""
        if self.wanted is not None or self.vehicle.changing:
            return
        self.wanted, self._on_ramp = self.ramp.lane if lane is None else lane, True
        self._note("signals to merge")
        details: dict[str, messages.Plain] = {"joins_mm": round(self.ramp.joins_m * 1000)}
        self.service.command(Request(scenario=SCENARIO, details=details))

    def concerned(self, advertised: Advertised) -> messages.Trajectory | None:
        """As ``Application.concerned``."""
        joins = advertised.details.get("joins_mm")
        ahead = type(joins) is int and self.vehicle.x * 1000 < joins
        if advertised.scenario != SCENARIO or self.vehicle.lane != self.ramp.lane or not ahead:
            return None
        self._intended = planned(self.vehicle, self.service.now())
        return to_message(thin(self._intended))

    def _chosen(self, choice: Choice) -> Command:
        now_ms, change_s = self.service.now(), self.vehicle.driving.lane_change_s
        now, way = now_ms / 1000, max(0.0, self.ramp.joins_m - self.vehicle.x)
        joins_s = way / max(self.vehicle.speed, 0.1)
        mine = now + joins_s
        if choice.proposal == 1:
            self._others = {s: read(f"Intention of {s}", t) for s, t in choice.planned.items()}
        known = self._known(choice.heard, choice.session)
        if choice.proposal == 1:
            self._target = self._first(mine, known or [], joins_s)
        if reason := self._blocked(known, joins_s, joins_s + change_s):
            return self._given_up(choice, reason)
        self._action_ms = round(joins_s * 1000)
        if self._target is None:
            self._note("nobody is in the way")
            self._others = {}  # their plans will be old
            self._begins_ms = now_ms + self._action_ms
            self._gives_up_ms = self._begins_ms + WAIT_MS
            return choice.proceed()
        theirs = self._others[self._target].since(now)
        at = arrival(theirs, self.ramp.joins_m)
        if at is None:
            raise TrajectoryError("planned", "its arrival time is unknown")
        later = at + (mine + self.ramp.apart_s - at) / choice.proposal
        prescribed = to_message(thin(stretched(theirs, (later - now) / (at - now))))
        lease_s = later - now + change_s + MARGIN_S
        return choice.prescribe(self._target, prescribed, hold_ms=0, lease_ms=round(lease_s * 1000))

    def _first(self, mine: float, known: list[Seen], joins_s: float) -> int | None:
        """The first station that is there at about this time (s), or whose time is unknown.

        One that comes earlier is there, too, if it is not clear by then (APP-3).
        """
        own, ends_s = self._own(self.wanted), joins_s + self.vehicle.driving.lane_change_s
        tight = {t.station_id for t in known if not occupancy.clear(own, t, joins_s, ends_s)}
        there = {s: arrival(t, self.ramp.joins_m) for s, t in self._others.items()}
        close = {s: mine if at is None else at for s, at in there.items()}
        first, last = mine - self.ramp.apart_s / 2, mine + self.ramp.apart_s
        in_the_way = [s for s, at in close.items() if at < last and (first < at or s in tight)]
        return min(in_the_way, key=lambda s: (close[s], s), default=None)

    def verify(self, proposal: Proposal) -> None:
        """As ``Application.verify``."""
        self.limits = replace(LIMITS, v_min=self.ramp.slowest * self.vehicle.speed)
        super().verify(proposal)

    # -- the ramp

    def tick(self, now_ms: int) -> None:
        """The control loop: move over where the ramp joins if the lane is free (APP-4), else stop
        before the end of the ramp."""
        if self._begins_ms is not None and not self._can_return():
            self._break_off("gives up: the ramp ends")
        super().tick(now_ms)
        if self._on_ramp:
            self.vehicle.follow(self._stop(now_ms / 1000))
            self._on_ramp = self.vehicle.changing or self.vehicle.lane != self.ramp.lane

    def _look(self, now_ms: int) -> str:
        if self.vehicle.x < self.ramp.joins_m:
            return "the ramp has not joined yet"
        return super()._look(now_ms)

    def _left_m(self) -> float:
        """The way to where it must stand."""
        v, ramp = self.vehicle, self.ramp
        return ramp.joins_m + ramp.length_m - v.length / 2 - STOP_M - v.x

    def _can_return(self) -> bool:
        """Whether it can move over up to the point of no return, and still return and stop."""
        v = self.vehicle
        moving_s = NO_RETURN_M / LANE_WIDTH * v.driving.lane_change_s
        return v.speed * moving_s + v.speed**2 / (2 * BRAKE) <= self._left_m()

    def _stop(self, now: float) -> Trajectory | None:
        """A trajectory to a stop from ``now`` (s) on if it must brake now, else None."""
        v, left = self.vehicle, self._left_m()
        if v.target_lane == self.ramp.lane or v.speed**2 < 2 * BRAKE * left:
            return None
        brake = v.speed**2 / (2 * max(left, 0.1))
        speed = max(0.0, v.speed - brake / v.driving.gain)
        xy = np.array([(v.x, v.y), (v.x + speed, v.y)])
        return Trajectory(np.array([now, now + 1]), xy)
