"""The simplest application: a straight lane, and a receiver that accepts every proposal.

It is a placeholder for a scenario in simulations, tests and the demonstration; the lane change of
the paper is a separate scenario.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from automcm.service.application import (
    Advertised,
    AgreedManeuver,
    Choice,
    Kinematics,
    Proposal,
    Service,
)
from automcm_spec.vocabulary.application import Prescribe, Request
from automcm_spec.vocabulary.messages import Session, Trajectory
from automcm_spec.vocabulary.rules import RULES

DAY_MS = 86_400_000
LANE_CHANGE = Request(scenario="lane_change", details={"lane": 2})


@dataclass
class Straight:
    """Drives straight on.

    As a prescriber it chooses ``target``, or the first station that answered if ``target`` did not,
    proposes a lower speed each time, and completes after ``maneuver_ms``.
    """

    speed_mm_s: int = 8333
    target: int = 0
    think_ms: int = 50
    """The time to choose or to verify, in ms."""
    maneuver_ms: int = 3000
    refuse_first: int = 0
    """The number of proposals of a session that it refuses before it accepts one."""
    concerned_by_all: bool = True
    from_now: bool = False
    """Whether its plan begins now, as a bridge requires, or always at 0."""
    hold_ms: int = 2000
    lease_ms: int = 20_000
    place_mm: tuple[int, int] = (0, 0)
    """Where it is at midnight (UTC): along and across the road."""
    report: Callable[[str], None] = lambda text: None
    """Takes what it decides and what becomes of it, in words."""

    def attach(self, service: Service) -> None:
        """As ``Application.attach``."""
        self.service = service

    def kinematics(self, now_ms: int) -> Kinematics:
        """As ``Application.kinematics``: at midnight (UTC) it is at its place."""
        x_mm = self.place_mm[0] + self.speed_mm_s * (now_ms % DAY_MS) // 1000
        return Kinematics(x_mm, self.place_mm[1], 0, self.speed_mm_s)

    def trajectory(self, per_cent: int = 100) -> Trajectory:
        """A trajectory of one second at ``per_cent`` of the speed."""
        return Trajectory(t0=0, points=((0, 0, 0), (1000, self.speed_mm_s * per_cent // 100, 0)))

    def concerned(self, advertised: Advertised) -> Trajectory | None:
        """As ``Application.concerned``."""
        t0 = self.service.now() if self.from_now else 0
        points = self.trajectory().points
        return Trajectory(t0=t0, points=points) if self.concerned_by_all else None

    def choose(self, choice: Choice) -> None:
        """As ``Application.choose``."""
        if not choice.target and not choice.planned:
            self.service.command(choice.abort())
            return
        if not choice.target and self.target not in choice.planned:
            self.target = next(iter(choice.planned))
        self.report(f"chooses station {self.target}, proposal {choice.proposal}")
        self.service.command(self._proposal(choice), self.think_ms)

    def _proposal(self, choice: Choice) -> Prescribe:
        slower = self.trajectory(100 - 30 * min(choice.proposal, 3))
        return choice.prescribe(self.target, slower, hold_ms=self.hold_ms, lease_ms=self.lease_ms)

    def verify(self, proposal: Proposal) -> None:
        """As ``Application.verify``."""
        refused = proposal.proposal <= self.refuse_first
        words = f"{'refuses' if refused else 'accepts'} proposal {proposal.proposal}"
        self.report(f"{words} of station {proposal.session[0]}")
        answer = proposal.refuse() if refused else proposal.accept()
        self.service.command(answer, self.think_ms)

    def load(self, maneuver: AgreedManeuver) -> None:
        """As ``Application.load``."""
        session = "/".join(map(str, maneuver.session))
        self.report(f"agreement in session {session}: acts as {maneuver.role}")
        if maneuver.role == "prescriber":
            self.service.command(maneuver.complete(), self.maneuver_ms)

    def fallback(self, session: Session, reason: str) -> None:
        """Only reports it: it always drives straight on."""
        self.report(f"session {session[0]}/{session[1]} fails: {reason}")

    def finished(self, session: Session) -> None:
        """Only reports it: it always drives straight on."""
        self.report(f"session {session[0]}/{session[1]} ends as agreed")

    def refused(self, command: str, rule: str) -> None:
        """Only reports it: the answer came too late, and the session continues without it."""
        self.report(f"{command} refused by {rule}: {RULES.get(rule, '')}")
