"""Merging from a ramp: another scenario on the same service.

The prescriber will be at the place where the ramp joins at a certain time.  Of the vehicles on
the main road that would be there at about that time it asks the first to come later: the same
path, the times stretched.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from automcm import messages
from automcm.application import Advertised, Choice, Drive, Kinematics, Proposal, Service
from automcm.interface import Request
from automcm.messages import Session
from automcm.road import Vehicle
from automcm.scenarios.lane_change import LEASE_MS, intention, kinematics
from automcm.trajectory.core import Trajectory, from_message, to_message
from automcm.trajectory.thin import thin

SCENARIO = "merge"


@dataclass(frozen=True, kw_only=True)
class Ramp:
    """Where the ramp joins which lane, and by how much vehicles keep apart there."""

    joins_m: float
    lane: int = 1
    apart_s: float = 2.5
    slowest: float = 0.5
    """Share of its speed below which a receiver does not go."""


def arrival(trajectory: Trajectory, x: float) -> float | None:
    """When it passes x, in s; None if it does not, or has already."""
    xs = trajectory.xy[:, 0]
    if len(xs) < 2 or not xs[0] < x <= xs[-1]:
        return None
    return float(np.interp(x, xs, trajectory.t))


def stretched(trajectory: Trajectory, factor: float) -> Trajectory:
    """The same path, ``factor`` times slower."""
    begin = trajectory.t[0]
    return Trajectory(begin + (trajectory.t - begin) * factor, trajectory.xy, trajectory.stopped)


class Merge:
    """A vehicle on the ramp (``signal``) or on the main road."""

    def __init__(self, vehicle: Vehicle, ramp: Ramp) -> None:
        self.vehicle, self.ramp = vehicle, ramp
        self.merging = False
        self.delayed: float | None = None
        """By which factor it was asked to slow down."""
        self.ended: list[str] = []
        self._drive: Drive | None = None

    def attach(self, service: Service) -> None:
        self.service = service

    def kinematics(self, now_ms: int) -> Kinematics:
        return kinematics(self.vehicle)

    def signal(self) -> None:
        """It wants to join."""
        self.merging = True
        details: dict[str, messages.Plain] = {"joins_mm": round(self.ramp.joins_m * 1000)}
        self.service.command(Request(scenario=SCENARIO, details=details))

    def concerned(self, advertised: Advertised) -> messages.Trajectory | None:
        joins = advertised.details.get("joins_mm")
        ahead = isinstance(joins, int) and self.vehicle.x * 1000 < joins
        if advertised.scenario != SCENARIO or self.vehicle.lane != self.ramp.lane or not ahead:
            return None
        return intention(self.vehicle, self.service.now())

    def choose(self, choice: Choice) -> None:
        now = self.service.now() / 1000
        mine = now + (self.ramp.joins_m - self.vehicle.x) / max(self.vehicle.speed, 0.1)
        if choice.proposal == 1:
            self._planned = {s: from_message(t) for s, t in choice.planned.items()}
            there = {s: arrival(t, self.ramp.joins_m) for s, t in self._planned.items()}
            close = {
                s: at
                for s, at in there.items()
                if at is not None and mine - self.ramp.apart_s / 2 < at < mine + self.ramp.apart_s
            }
            self._target = min(close, key=lambda s: (close[s], s), default=None)
        if self._target is None:
            self.service.command(choice.proceed())
            return
        theirs = self._planned[self._target]
        at = arrival(theirs, self.ramp.joins_m)
        assert at is not None
        later = mine + self.ramp.apart_s / choice.proposal
        factor = (later - theirs.t[0]) / (at - theirs.t[0])
        prescribed = to_message(thin(stretched(theirs, factor)))
        self.service.command(
            choice.prescribe(self._target, prescribed, hold_ms=0, lease_ms=LEASE_MS)
        )

    def verify(self, proposal: Proposal) -> None:
        asked = from_message(proposal.prescribed)
        share = float(asked.speeds().min()) / max(self.vehicle.speed, 0.1)
        self._asked = asked
        answer = proposal.accept() if share >= self.ramp.slowest else proposal.refuse()
        self.service.command(answer)

    def load(self, drive: Drive) -> None:
        self._drive = drive
        if drive.role == "receiver":
            self.delayed = float(self._asked.speeds().min()) / self.vehicle.speed
            later = drive.start_ms / 1000 - self._asked.t[0]
            self.vehicle.follow(Trajectory(self._asked.t + later, self._asked.xy))

    def tick(self, now_ms: int) -> None:
        """The vehicle on the ramp joins where the ramp does."""
        if self.merging and self.vehicle.x >= self.ramp.joins_m:
            self.vehicle.change_lane(self.ramp.lane, now_ms / 1000)
        if self.merging and self.vehicle.lane == self.ramp.lane and not self.vehicle.changing:
            self.merging = False
            if self._drive is not None:
                self.service.command(self._drive.complete())
                self._drive = None

    def fallback(self, session: Session, reason: str) -> None:
        self.ended.append(reason)
        self.vehicle.follow(None)

    def finished(self, session: Session) -> None:
        self.ended.append("finished")
        self.vehicle.follow(None)

    def refused(self, command: str, rule: str) -> None:
        self.ended.append(f"{command} {rule}")
