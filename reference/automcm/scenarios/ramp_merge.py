"""Merging from a ramp: another scenario on the same service.

The prescriber will reach the end of the ramp at a certain time.  It asks the first of the vehicles
on the main road that would be there at about that time to come later: on the same path, with
stretched times.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from automcm.kernels.thin import thin
from automcm.kernels.trajectory import Trajectory, TrajectoryError, to_message
from automcm.scenarios.lane_change import LIMITS, MARGIN_S, Coordinated, judged, planned, read
from automcm.scenarios.road import Vehicle
from automcm.service.application import Advertised, AgreedManeuver, Choice, Proposal
from automcm_spec.vocabulary import messages
from automcm_spec.vocabulary.application import Command, Request

SCENARIO = "merge"


@dataclass(frozen=True, kw_only=True)
class Ramp:
    """The place and the lane where the ramp joins, and the distance of vehicles there."""

    joins_m: float
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


class Merge(Coordinated):
    """A vehicle on the ramp (``signal``) or on the main road."""

    def __init__(self, vehicle: Vehicle, ramp: Ramp) -> None:
        super().__init__(vehicle)
        self.ramp = ramp
        self.merging = self.agreed = False
        """Whether it plans to join and is allowed to."""
        self.delayed: float | None = None
        """The factor by which it was asked to slow down."""
        self._drive: AgreedManeuver | None = None
        self._asked: Trajectory | None = None

    def signal(self) -> None:
        """Request to join.  One attempt at a time."""
        if self.merging:
            return
        self.merging, self.agreed = True, False
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

    def choose(self, choice: Choice) -> None:
        """As ``Application.choose``."""
        try:
            command = self._chosen(choice)
        except TrajectoryError as error:
            self._over(str(error))
            command = choice.abort()
        self.service.command(command)

    def _chosen(self, choice: Choice) -> Command:
        now = self.service.now() / 1000
        mine = now + (self.ramp.joins_m - self.vehicle.x) / max(self.vehicle.speed, 0.1)
        if choice.proposal == 1:
            self._planned = {s: read(f"Intention of {s}", t) for s, t in choice.planned.items()}
            there = {s: arrival(t, self.ramp.joins_m) for s, t in self._planned.items()}
            first, last = mine - self.ramp.apart_s / 2, mine + self.ramp.apart_s
            close = {s: mine if at is None else at for s, at in there.items()}
            in_the_way = [s for s, at in close.items() if first < at < last]
            self._target = min(in_the_way, key=lambda s: (close[s], s), default=None)
        if self._target is None:
            self.agreed = True
            return choice.proceed()
        theirs = self._planned[self._target].since(now)
        at = arrival(theirs, self.ramp.joins_m)
        if at is None:
            raise TrajectoryError("planned: its arrival time is unknown")
        later = at + (mine + self.ramp.apart_s - at) / choice.proposal
        prescribed = to_message(thin(stretched(theirs, (later - now) / (at - now))))
        lease_s = later - now + self.vehicle.driving.lane_change_s + MARGIN_S
        return choice.prescribe(self._target, prescribed, hold_ms=0, lease_ms=round(lease_s * 1000))

    def verify(self, proposal: Proposal) -> None:
        """As ``Application.verify``."""
        self._asked = None
        try:
            asked = read("Prescription", proposal.prescribed)
            now_ms = self.service.now()
            anchored, reasons = judged(asked, self._intended, self.vehicle, now_ms, LIMITS)
            slowest = anchored.speeds().min(initial=np.inf if len(anchored) > 1 else 0)
            if not reasons and slowest >= self.ramp.slowest * self.vehicle.speed:
                self._asked = anchored
        except TrajectoryError:
            pass
        self.service.command(proposal.refuse() if self._asked is None else proposal.accept())

    def load(self, maneuver: AgreedManeuver) -> None:
        """As ``Application.load``."""
        self._drive = maneuver
        if maneuver.role == "prescriber":
            self.agreed = True
        elif self._asked is not None:
            self.delayed = float(self._asked.speeds().min()) / max(self.vehicle.speed, 0.1)
            self.vehicle.follow(self._asked)

    def tick(self, now_ms: int) -> None:
        """Change to the main road at the end of the ramp, if allowed; else stay on the ramp."""
        if self.merging and self.agreed and self.vehicle.x >= self.ramp.joins_m:
            self.vehicle.change_lane(self.ramp.lane, now_ms / 1000)
        if self.merging and self.vehicle.lane == self.ramp.lane and not self.vehicle.changing:
            self.merging = self.agreed = False
            if self._drive is not None:
                self.service.command(self._drive.complete())
                self._drive = None

    def refused(self, command: str, rule: str) -> None:
        """As ``Application.refused``."""
        super().refused(command, rule)
        if command == "request":
            self.merging = self.agreed = False

    def _over(self, how: str) -> None:
        super()._over(how)
        self.vehicle.follow(None)
        self._drive = self._asked = None
        if not self.vehicle.changing:
            self.merging = self.agreed = False
