"""The lane change (sections V and VI of the paper), both roles.

The prescriber moves over to another lane.  A receiver there that would come too close is
prescribed to drive slower for a while, until the prescriber has its gap; the vehicles behind
that one follow it by themselves.  Everything computed is a kernel (docs/kernels.md).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from automcm import messages
from automcm.application import Advertised, Choice, Drive, Kinematics, Proposal, Service
from automcm.interface import Request
from automcm.messages import Session
from automcm.road import LANE_WIDTH, ROAD_M, Vehicle
from automcm.trajectory.collide import collision
from automcm.trajectory.convert import convert
from automcm.trajectory.core import Floats, Trajectory, TrajectoryError, from_message, to_message
from automcm.trajectory.discover import Candidate, discover
from automcm.trajectory.prescribe import prescribe
from automcm.trajectory.thin import thin
from automcm.trajectory.verify import Limits, Reason, verify

SCENARIO = "lane_change"
LEASE_MS = 30_000
LIMITS = Limits(acceleration=3.0, deceleration=3.0, v_max=130 / 3.6)
"""With these a step of Table I's 20 km/h may be driven, down and up again."""


@dataclass(frozen=True, kw_only=True)
class Plan:
    """What the prescriber goes by.  Defaults: Table I of the paper where it has them."""

    hold_s: float = 2.0
    """Δt1."""
    delta_v: float = 20 / 3.6
    """ΔV, m/s."""
    gain_m: float = 20.0
    """D_add: by how much the gap grows."""
    v_min: float = 1.0
    threshold_m: float = 8.0
    """Centre to centre; closer is a collision (KIN-3)."""
    clock_error_s: float = 0.0


def kinematics(vehicle: Vehicle) -> Kinematics:
    """For a CAM."""
    return Kinematics(
        x_mm=round(vehicle.x * 1000),
        y_mm=round(vehicle.y * 1000),
        speed_mm_s=round(vehicle.speed * 1000),
    )


def planned(vehicle: Vehicle, now_ms: int) -> Trajectory:
    """What it would drive alone: its path as positions over time (KIN-1)."""
    xy, speed = vehicle.path()
    return convert(xy, speed, np.array([vehicle.x, vehicle.y]), now_ms / 1000)


def intention(vehicle: Vehicle, now_ms: int) -> messages.Trajectory:
    """The same, for a message: thinned (KIN-2)."""
    return to_message(thin(planned(vehicle, now_ms)))


def shifted(trajectory: Trajectory, seconds: float) -> Trajectory:
    """The same later."""
    return Trajectory(trajectory.t + seconds, trajectory.xy, trajectory.stopped)


def lane_zone(lane: int) -> Floats:
    """The lane as a polygon (KIN-4)."""
    low, high = (lane - 0.5) * LANE_WIDTH, (lane + 0.5) * LANE_WIDTH
    far = 100 * ROAD_M
    return np.array([[-far, low], [far, low], [far, high], [-far, high]])


class LaneChange:
    """A vehicle that may ask for a lane change, and joins those of others.

    ``tick`` is its own control loop, to be called every 0.1 s or so.  ``zone`` gives a lane as a
    polygon, by default of the simulated road, or of a map (maps.LaneMap.zone).
    """

    def __init__(
        self,
        vehicle: Vehicle,
        plan: Plan | None = None,
        limits: Limits | None = None,
        zone: Callable[[int], Floats] = lane_zone,
    ) -> None:
        self._zone = zone
        self.vehicle, self.plan, self.limits = vehicle, plan or Plan(), limits or LIMITS
        self.wanted: int | None = None
        """The lane it wants to be in."""
        self.story: list[tuple[int, str]] = []
        """What it did, with times in ms."""
        self._drive: Drive | None = None
        self._begins_ms: int | None = None
        self._proposal: tuple[Proposal, Trajectory] | None = None

    def attach(self, service: Service) -> None:
        self.service = service

    def kinematics(self, now_ms: int) -> Kinematics:
        return kinematics(self.vehicle)

    # -- prescriber

    def signal(self, lane: int) -> None:
        """The trigger: the turn signal is set for this lane."""
        self.wanted = lane
        planned_ = intention(self._moved_over(), self.service.now())
        self._tell(f"signals for lane {lane}")
        self.service.command(Request(scenario=SCENARIO, details={"lane": lane}, planned=planned_))

    def _moved_over(self) -> Vehicle:
        """Itself, as if it changed lanes now."""
        assert self.wanted is not None
        v = self.vehicle
        as_if = Vehicle(v.station_id, v.x, v.lane, v.speed, v.desired, driving=v.driving)
        as_if.change_lane(self.wanted, 0.0)
        return as_if

    def choose(self, choice: Choice) -> None:
        """Discover whom to ask, if anybody (KIN-3, KIN-4), and for what (KIN-5)."""
        if choice.proposal == 1:
            self._others = {s: from_message(t) for s, t in choice.planned.items()}
            self._target = self._discover()
        if self._target is None:
            self._tell("nobody is in the way")
            self.service.command(choice.proceed())
            self._begins_ms = self.service.now()
            return
        now = self.service.now()
        slower = self.plan.delta_v * 0.7 ** (choice.proposal - 1)
        theirs = self._others[self._target]
        try:
            wanted = prescribe(
                theirs,
                now / 1000,
                hold=self.plan.hold_s,
                delta_v=slower,
                gain=self.plan.gain_m,
                v_min=self.plan.v_min,
            )
        except TrajectoryError as error:
            self._tell(f"gives up: {error}")
            self.service.command(choice.abort())
            return
        self._tell(f"prescribes {self._target} to drive {slower * 3.6:.0f} km/h slower")
        self._action_ms = round(self._action_s(slower, theirs) * 1000)
        prescribed = to_message(thin(wanted))
        self.service.command(
            choice.prescribe(
                self._target,
                prescribed,
                hold_ms=round(self.plan.hold_s * 1000),
                lease_ms=LEASE_MS,
            )
        )

    def _action_s(self, slower: float, theirs: Trajectory) -> float:
        """Δt1 + Δt2 (KIN-5)."""
        speed = float(theirs.speeds()[0]) if len(theirs) > 1 else 0.0
        lost = min(slower, max(speed - self.plan.v_min, 1e-9))
        return self.plan.hold_s + self.plan.gain_m / lost

    def _discover(self) -> int | None:
        """Whom to ask: the leader of those in the lane that would come too close."""
        assert self.wanted is not None
        mine = planned(self._moved_over(), self.service.now())
        near = [
            Candidate(station_id, theirs.xy[0], direction(theirs))
            for station_id, theirs in self._others.items()
            if collision(mine, theirs, self.plan.threshold_m, clock_error=self.plan.clock_error_s)
        ]
        self._tell(f"would come too close to {[c.station_id for c in near] or 'nobody'}")
        return discover(near, self._zone(self.wanted))

    # -- receiver

    def concerned(self, advertised: Advertised) -> messages.Trajectory | None:
        wanted_here = (advertised.scenario, advertised.details.get("lane")) == (
            SCENARIO,
            self.vehicle.lane,
        )
        return intention(self.vehicle, self.service.now()) if wanted_here else None

    def verify(self, proposal: Proposal) -> None:
        """Safe?  Anchored at its acceptance, which is now (NEG-2, KIN-6)."""
        now = self.service.now()
        reasons: tuple[str, ...]
        try:
            prescribed = from_message(proposal.prescribed)
            anchored = shifted(prescribed, now / 1000 - float(prescribed.t[0]))
            reasons = self._unsafe(anchored, now)
        except TrajectoryError as error:
            reasons = (str(error),)
        if reasons:
            self._tell(f"refuses: {', '.join(reasons)}")
            self.service.command(proposal.refuse())
            return
        self._tell("accepts to drive slower")
        self._proposal = proposal, anchored
        self.service.command(proposal.accept())

    def _unsafe(self, anchored: Trajectory, now_ms: int) -> tuple[Reason, ...]:
        return verify(anchored, planned(self.vehicle, now_ms), now_ms / 1000, self.limits)

    # -- both

    def load(self, drive: Drive) -> None:
        """Agreed.  A receiver loads the trajectory, a prescriber waits for its gap."""
        self._drive = drive
        if drive.role == "receiver":
            assert self._proposal is not None
            self._tell("loads the trajectory")
            self.vehicle.follow(self._proposal[1])
        else:
            self._tell("is accepted, and waits for the gap")
            self._begins_ms = self.service.now() + self._action_ms

    def tick(self, now_ms: int) -> None:
        """The prescriber's control loop: move over when it is time; tell when it is done."""
        if self.wanted is None:
            return
        if self._begins_ms is not None and now_ms >= self._begins_ms:
            self._begins_ms = None
            self._tell("moves over")
            self.vehicle.change_lane(self.wanted, now_ms / 1000)
        if self.vehicle.lane == self.wanted and not self.vehicle.changing:
            self.wanted = None
            self._tell("has changed lanes")
            if self._drive is not None:
                self.service.command(self._drive.complete())
                self._drive = None

    def fallback(self, session: Session, reason: str) -> None:
        """Drive alone: give up what is not begun; what is begun the planner on board ends."""
        self._tell(f"drives alone: {reason}")
        self._alone()

    def finished(self, session: Session) -> None:
        self._tell("is done")
        self._alone()

    def _alone(self) -> None:
        self._drive = self._proposal = self._begins_ms = None
        self.vehicle.follow(None)
        if not self.vehicle.changing:
            self.wanted = None

    def refused(self, command: str, rule: str) -> None:
        self._tell(f"{command} is refused by {rule}")

    def _tell(self, what: str) -> None:
        self.story.append((self.service.now(), what))


def direction(trajectory: Trajectory) -> Floats:
    """Of travel at its beginning, shape (2,); ahead (1, 0) for a vehicle that stands."""
    if len(trajectory) < 2:
        return np.array([1.0, 0.0])
    step = trajectory.xy[1] - trajectory.xy[0]
    length = float(np.hypot(*step))
    ahead: Floats = step / length if length else np.array([1.0, 0.0])
    return ahead
