"""The lane change (sections V and VI of the paper), both roles.

The prescriber changes to another lane.  It prescribes a receiver there that would come too close to
drive slower until the gap is large enough; the vehicles behind that receiver follow it without a
prescription.  All computations are kernels (docs/kernels.md).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

from automcm.applications import occupancy
from automcm.applications.occupancy import Perception, Seen, nothing_seen
from automcm.applications.planning import (
    LIMITS,
    direction,
    gained_at,
    intention,
    judged,
    nobody,
    planned,
    read,
)
from automcm.applications.prediction import Neighbour, neighbours
from automcm.applications.vehicle import LANE_WIDTH, Vehicle
from automcm.kernels.collide import collision, common_time
from automcm.kernels.discover import Candidate, discover
from automcm.kernels.extents import Extent, clearance
from automcm.kernels.prescribe import prescribe
from automcm.kernels.road_line import RoadLine
from automcm.kernels.thin import thin
from automcm.kernels.trajectory import Floats, Trajectory, TrajectoryError, to_message
from automcm.kernels.verify import Limits
from automcm.service.application import (
    Advertised,
    AgreedManeuver,
    Choice,
    Heard,
    Kinematics,
    Proposal,
    Service,
    heard_by,
)
from automcm_spec.vocabulary import messages
from automcm_spec.vocabulary.application import Command, Request
from automcm_spec.vocabulary.messages import Session

SCENARIO = "lane_change"
MARGIN_S = 10.0
"""The time by which a lease exceeds the expected duration of the maneuver."""
UNKNOWN_S = 0.5
"""The time from now on for which another's position may be unknown, because clocks differ."""
FRESH_MS = 300
"""The target's CAM must be newer than this when the lane change begins (APP-4)."""
WAIT_MS = 5000
"""The longest wait for a gap that is not open in time (APP-4)."""
NO_RETURN_M = (LANE_WIDTH + occupancy.WIDTH_M) / 2
"""The point of no return: the vehicle has left its old lane (APP-5)."""
SLACK_M = 2.0
"""The gap is opened this much wider than needed."""


@dataclass(frozen=True, kw_only=True)
class Plan:
    """The prescriber's settings.  The defaults are those of the paper's Table I, if it has any."""

    hold_s: float = 2.0
    """Δt1."""
    delta_v: float = 20 / 3.6
    """ΔV, m/s."""
    gain_m: float = 20.0
    """D_add: the growth of the gap, in m."""
    v_min: float = 1.0
    threshold_m: float = 8.0
    """Minimum distance from centre to centre, in m (KIN-3), of the paper's application."""
    clock_error_s: float = 0.0
    retries: int = 0
    """How often it requests again after it has given up (APP-2)."""
    retry_s: float = 5.0
    """The wait before each."""


class Coordinated:
    """The common part of the applications of all scenarios: a vehicle and a service."""

    def __init__(self, vehicle: Vehicle) -> None:
        self.vehicle = vehicle
        self.ended: list[str] = []
        """The ends of sessions, and refused commands."""

    def attach(self, service: Service) -> None:
        """As ``Application.attach``."""
        self.service = service

    def kinematics(self, now_ms: int) -> Kinematics:
        """As ``Application.kinematics``."""
        v = self.vehicle
        x, y, heading = v.line.pose(*v.measured)
        return Kinematics(
            x_mm=round(1000 * x),
            y_mm=round(1000 * y),
            heading_mrad=round(1000 * (heading + v.slip)),
            speed_mm_s=round(1000 * v.speed),
            length_mm=round(1000 * v.length),
            width_mm=round(1000 * v.width),
            sigma_mm=None if v.error is None else round(1000 * v.error.sigma),
        )

    def fallback(self, session: Session, reason: str) -> None:
        """As ``Application.fallback``."""
        self._over(reason)

    def finished(self, session: Session) -> None:
        """As ``Application.finished``."""
        self._over("finished")

    def refused(self, command: str, rule: str) -> None:
        """As ``Application.refused``."""
        self.ended.append(f"{command} {rule}")

    def _over(self, how: str) -> None:
        self.ended.append(how)


class LaneChange(Coordinated):
    """A vehicle that can request a lane change, and joins those of others.

    Call ``tick``, its control loop, about every 0.1 s.  ``zone`` gives a lane as a polygon (KIN-4),
    by default that of the vehicle's road; it can be that of a map (lanelet_map.LaneMap.zone).
    ``occupied`` is the vehicle's own perception (APP-1).
    """

    def __init__(
        self,
        vehicle: Vehicle,
        plan: Plan | None = None,
        limits: Limits | None = None,
        zone: Callable[[int], Floats] | None = None,
        occupied: Perception = nothing_seen,
    ) -> None:
        super().__init__(vehicle)
        self.occupied = occupied
        self._zone = zone or vehicle.zone
        self.plan, self.limits = plan or Plan(), limits or LIMITS
        self.wanted: int | None = None
        """The lane to which it changes."""
        self.story: list[tuple[int, str]] = []
        """Its actions, with times in ms."""
        self._drive: AgreedManeuver | None = None
        self._begins_ms: int | None = None
        self._gives_up_ms = 0
        self._others: dict[int, Trajectory] = {}
        self._target: int | None = None
        self._proposal: tuple[Proposal, Trajectory] | None = None
        self._lines: dict[int, RoadLine] = {}
        self._retries = 0
        """How often it may still request again."""
        self._again: tuple[int, int] | None = None
        """When (ms), and for which lane, it requests again."""

    @property
    def busy(self) -> bool:
        """Whether it wants another lane, is between two, or will request again."""
        return self.wanted is not None or self._again is not None or self.vehicle.changing

    # -- prescriber

    def signal(self, lane: int) -> None:
        """Set the turn signal for this lane, which triggers a lane change.  One at a time."""
        if self.wanted is not None or self.vehicle.changing or lane == self.vehicle.lane:
            self._note(f"does not signal for lane {lane}")
            return
        self._retries = self.plan.retries
        self._request(lane)

    def _request(self, lane: int) -> None:
        self.wanted, self._again = lane, None
        planned_ = intention(self._moved_over(), self.service.now())
        self._note(f"signals for lane {lane}")
        self.service.command(Request(scenario=SCENARIO, details={"lane": lane}, planned=planned_))

    def _moved_over(self) -> Vehicle:
        """The vehicle's own trajectory if it changed lanes now."""
        assert self.wanted is not None
        v = self.vehicle
        as_if = replace(v, _moving_since=None)
        as_if.change_lane(self.wanted, 0.0)
        return as_if

    def choose(self, choice: Choice) -> None:
        """Choose the target, if there is one (KIN-3, KIN-4), and its trajectory (KIN-5)."""
        try:
            command = self._chosen(choice)
        except TrajectoryError as error:
            self._note(f"gives up: {error}")
            self._alone()
            command = choice.abort()
        self.service.command(command)

    def _chosen(self, choice: Choice) -> Command:
        now_ms, change_s = self.service.now(), self.vehicle.driving.lane_change_s
        if choice.proposal == 1:
            self._others = {s: read(f"Intention of {s}", t) for s, t in choice.planned.items()}
        known = self._known(choice.heard, choice.session)
        if choice.proposal == 1:
            self._target = self._discover(known, choice.heard or ())
        if self._target is None:
            if reason := self._blocked(known, 0.0, change_s):
                return self._given_up(choice, reason)
            self._note("nobody is in the way")
            self._begins_ms, self._gives_up_ms = now_ms, now_ms + FRESH_MS
            return choice.proceed()
        plan, now = self.plan, now_ms / 1000
        slower = plan.delta_v * 0.7 ** (choice.proposal - 1)
        theirs = self._others[self._target].since(now)
        gain = max(plan.gain_m, self._missing(theirs, known))
        asked = prescribe(
            theirs, now, hold=plan.hold_s, delta_v=slower, gain=gain, v_min=plan.v_min
        )
        action_s = gained_at(theirs, asked, gain) - now
        if reason := self._blocked(known, action_s, action_s + change_s):
            return self._given_up(choice, reason)
        lease_s = action_s + change_s + MARGIN_S
        prescribed = to_message(thin(asked))
        self._note(f"prescribes {self._target} to drive {slower * 3.6:.0f} km/h slower")
        self._action_ms = round(action_s * 1000)
        return choice.prescribe(
            self._target,
            prescribed,
            hold_ms=round(plan.hold_s * 1000),
            lease_ms=round(lease_s * 1000),
        )

    def _given_up(self, choice: Choice, reason: str) -> Command:
        self._note(f"gives up: {reason}")
        self._alone()
        return choice.abort()

    def _missing(self, theirs: Trajectory, known: list[Seen] | None) -> float:
        """The gain at which the target's gap is as wide as needed, at the present speeds, m."""
        v = self.vehicle
        speeds = theirs.speeds()
        speed = max(v.speed, float(speeds[0]) if len(speeds) else 0.0)
        gap = occupancy.needed_gap(speed, v.speed) + speed * occupancy.LATENCY_S + SLACK_M
        own = self._own(self.wanted)
        target = next((t for t in known or () if t.station_id == self._target), None)
        if target is None:
            at = float(self._line(self.wanted).project(theirs.xy[:1]).s[0])
            return at - own.x + gap + (own.length + occupancy.LENGTH_M) / 2
        gap += (own.length + target.length) / 2 + occupancy.error(own, target)
        return target.x - own.x + gap

    def _too_close(self, mine: Trajectory, theirs: Trajectory, heard: Heard | None) -> bool:
        """Whether their discs come closer than LEAST_M (KIN-3)."""
        own = Extent(self.vehicle.length, self.vehicle.width)
        other = occupancy.extent_of(heard)
        found = clearance(mine, theirs, own, other, occupancy.LEAST_M)
        return found is not None and found.since is not None

    def _discover(self, known: list[Seen] | None, heard: tuple[Heard, ...]) -> int | None:
        """The target: the leader of the vehicles in the lane that would come too close.

        A vehicle whose position during the lane change is unknown counts as too close; so does one
        that would have to brake hard (APP-3).
        """
        assert self.wanted is not None
        now, change_s = self.service.now() / 1000, self.vehicle.driving.lane_change_s
        mine = planned(self._moved_over(), self.service.now())
        needed = now + change_s
        own = self._own(self.wanted)
        tight = {t.station_id for t in known or () if not occupancy.clear(own, t, 0.0, change_s)}
        near = []
        for station_id, theirs in self._others.items():
            common = common_time(mine, theirs)
            sure = common is not None and common[0] <= now + UNKNOWN_S and common[1] >= needed
            last = next((h for h in heard if h.station_id == station_id), None)
            risk = self._too_close(mine, theirs, last)
            if risk or not sure or station_id in tight:
                here = theirs.since(now) if sure and theirs.t[0] <= now else theirs
                near.append(Candidate(station_id, here.xy[0], direction(here)))
        self._note(f"would come too close to {[c.station_id for c in near] or 'nobody'}")
        return discover(near, self._zone(self.wanted))

    # -- occupancy (APP-1 to APP-5)

    def _line(self, lane: int | None) -> RoadLine:
        """The middle of a lane."""
        assert lane is not None
        if lane not in self._lines:
            self._lines[lane] = self.vehicle.line.parallel(lane * LANE_WIDTH)
        return self._lines[lane]

    def _own(self, lane: int | None) -> Seen:
        return occupancy.own_track(self.vehicle, self._line(lane))

    def _known(self, heard: tuple[Heard, ...] | None, session: Session | None) -> list[Seen] | None:
        """Everyone in the wanted lane that is known (APP-1); None if the service passes on no
        CAMs."""
        return self._in_lane(self.wanted, heard, session)

    def _in_lane(
        self, lane: int | None, heard: tuple[Heard, ...] | None, session: Session | None
    ) -> list[Seen] | None:
        if heard is None:
            return None
        line, now = self._line(lane), self.service.now()
        assert lane is not None
        last = now + round(self.vehicle.driving.lane_change_s * 1000)
        seen = self.occupied(self._zone(lane), now, last)
        own = self._own(lane)
        all_ = occupancy.tracks(heard, seen, self._others, session, now, line, own.sigma or 0.0)
        return [track for track in all_ if occupancy.in_lane(own, track)]

    def _around(self, prescribed: Trajectory) -> tuple[Neighbour | None, Neighbour | None]:
        """The vehicles ahead and behind in the own lane, as far as known (KIN-6)."""
        lane = self.vehicle.lane
        known = self._in_lane(lane, heard_by(self.service), None) or []
        line, now = self._line(lane), self.service.now() / 1000
        own = self._own(lane)
        return neighbours(own, known, prescribed, line, now)

    def _blocked(
        self, known: list[Seen] | None, begins_s: float, ends_s: float, *, now_open: bool = False
    ) -> str:
        """Why the lane is not free from ``begins_s`` to ``ends_s`` from now, or "" (APP-2).

        Vehicles behind the target follow it.  ``now_open``: the target must be behind, and its gap
        open.
        """
        if known is None:
            return "no CAMs: its surroundings are unknown"
        own = self._own(self.wanted)
        if math.isnan(own.x):
            return "its own place on the road is unknown"
        hardest = occupancy.HARDEST if self.vehicle.changing else occupancy.FORCED
        target = next((t for t in known if t.station_id == self._target), None)
        shield = target if target is not None and (target.x < own.x or not now_open) else None
        for track in known:
            if shield is not None and track.x < shield.x:
                continue
            if track is target and not now_open:
                continue
            if not occupancy.clear(own, track, begins_s, ends_s, hardest):
                return f"{track.name} is in the way"
        return ""

    def _look(self, now_ms: int) -> str:
        """Why it must not be in the other lane; empty if it may (APP-4, APP-5)."""
        session = self._drive.session if self._drive is not None else None
        heard = heard_by(self.service)
        if self._drive is not None and not self.vehicle.changing:
            told = next((h for h in heard or () if h.station_id == self._target), None)
            if told is None or now_ms - told.received_ms > FRESH_MS or session not in told.marks:
                return f"no fresh CAM of {self._target}"
        return self._blocked(
            self._known(heard, session), 0.0, self.vehicle.driving.lane_change_s, now_open=True
        )

    # -- receiver

    def concerned(self, advertised: Advertised) -> messages.Trajectory | None:
        """As ``Application.concerned``."""
        lane = advertised.details.get("lane")
        if advertised.scenario != SCENARIO or type(lane) is not int or lane != self.vehicle.lane:
            return None
        self._intended = planned(self.vehicle, self.service.now())
        return to_message(thin(self._intended))

    def verify(self, proposal: Proposal) -> None:
        """Check the proposal, starting at the present time and position (NEG-2, KIN-6)."""
        reasons: tuple[str, ...]
        try:
            prescribed = read("Prescription", proposal.prescribed)
            now_ms = self.service.now()
            anchored, reasons = judged(
                prescribed, self._intended, self.vehicle, now_ms, self.limits, self._around
            )
        except TrajectoryError as error:
            reasons = (str(error),)
        if self.vehicle.changing or self._begins_ms is not None:
            reasons = ("it changes lanes itself", *reasons)
        if reasons:
            self._note(f"refuses: {', '.join(reasons)}")
            self.service.command(proposal.refuse())
            return
        self._note("accepts to drive slower")
        self._proposal = proposal, anchored
        self.service.command(proposal.accept())

    # -- both

    def load(self, maneuver: AgreedManeuver) -> None:
        """Load the trajectory (receiver), or begin to wait for the gap (prescriber)."""
        self._drive = maneuver
        if maneuver.role == "receiver":
            assert self._proposal is not None
            self._note("loads the trajectory")
            self.vehicle.follow(self._proposal[1])
        else:
            self._note("is accepted, and waits for the gap")
            self._begins_ms = self.service.now() + self._action_ms
            last_ms = maneuver.until_ms - round(self.vehicle.driving.lane_change_s * 1000)
            self._gives_up_ms = min(self._begins_ms + WAIT_MS, last_ms)

    def tick(self, now_ms: int) -> None:
        """The prescriber's control loop: change lanes at the right time, then complete."""
        if self.wanted is None:
            if self._again is not None and now_ms >= self._again[0] and not self.vehicle.changing:
                self._request(self._again[1])
        elif self.vehicle.changing:
            self._watch(now_ms)
        elif self._begins_ms is not None and now_ms >= self._begins_ms:
            self._begin(now_ms)
        elif self.vehicle.lane == self.wanted:
            self.wanted = None
            self._note("has changed lanes")
            if self._drive is not None:
                self.service.command(self._drive.complete())
                self._drive = None

    def _begin(self, now_ms: int) -> None:
        """Move over if the lane is free now; wait, or give up (APP-4)."""
        assert self.wanted is not None
        if reason := self._look(now_ms):
            if now_ms >= self._gives_up_ms:
                self._break_off(f"gives up: {reason}")
            return
        self._begins_ms = None
        self._note("moves over")
        self.vehicle.change_lane(self.wanted, now_ms / 1000)

    def _watch(self, now_ms: int) -> None:
        """Return if the lane is no longer free, before the point of no return (APP-5)."""
        if self.vehicle.moved_m < NO_RETURN_M and (reason := self._look(now_ms)):
            self.vehicle.turn_back(now_ms / 1000)
            self._break_off(f"returns: {reason}")

    def _break_off(self, why: str) -> None:
        self._note(why)
        if self._drive is not None:
            self.service.command(self._drive.abort())
        self._alone()
        self._gives_up_lane()

    def fallback(self, session: Session, reason: str) -> None:
        """Drive alone: give up a lane change that has not begun, or finish it."""
        self._note(f"drives alone: {reason}")
        self._alone()

    def finished(self, session: Session) -> None:
        """As ``Application.finished``."""
        self._note("is done")
        self._alone()

    def _alone(self) -> None:
        self._drive = self._proposal = self._begins_ms = None
        self.vehicle.follow(None)
        if not self.vehicle.changing:
            self._gives_up_lane()

    def _gives_up_lane(self) -> None:
        """Request it again later, if the plan says so (APP-2)."""
        if self.wanted is not None and self._retries:
            self._retries -= 1
            self._again = self.service.now() + round(self.plan.retry_s * 1000), self.wanted
        self.wanted = None

    def refused(self, command: str, rule: str) -> None:
        """As ``Application.refused``."""
        self._note(f"{command} is refused by {rule}")
        if command == "request":
            self._gives_up_lane()

    def _note(self, what: str) -> None:
        self.story.append((self.service.now(), what))


class PaperLaneChange(LaneChange):
    """The paper's application, for its evaluation: it counts answers and does not look, so that the
    protocol is measured alone (APP-2 to APP-5 are added)."""

    def _known(self, heard: tuple[Heard, ...] | None, session: Session | None) -> list[Seen]:
        return []

    def _look(self, now_ms: int) -> str:
        return ""

    def _missing(self, theirs: Trajectory, known: list[Seen] | None) -> float:
        return 0.0

    def _too_close(self, mine: Trajectory, theirs: Trajectory, heard: Heard | None) -> bool:
        plan = self.plan
        return bool(collision(mine, theirs, plan.threshold_m, clock_error=plan.clock_error_s))

    def _around(self, prescribed: Trajectory) -> tuple[None, None]:
        return nobody(prescribed)
