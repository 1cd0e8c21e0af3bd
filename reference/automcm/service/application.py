"""The application interface: what a scenario is asked and told, and what it may do.

The service asks with the content of messages and is answered with the commands of
automcm_spec.vocabulary.application.  A scenario never sees an Ack, a retransmission or a timer; the
service never looks into a trajectory (section IV of the paper: facility layer and application
layer).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Protocol

from automcm_spec.vocabulary.application import (
    Abort,
    Accept,
    Command,
    Complete,
    Prescribe,
    Proceed,
    Refuse,
    Role,
)
from automcm_spec.vocabulary.messages import Plain, Session, Trajectory


@dataclass(frozen=True, slots=True)
class Kinematics:
    """Where the vehicle is, for its CAM: mm, milliradians, mm/s."""

    x_mm: int = 0
    y_mm: int = 0
    heading_mrad: int = 0
    speed_mm_s: int = 0


@dataclass(frozen=True, slots=True)
class Advertised:
    """A maneuver that another station wants to make (ADV-3)."""

    session: Session
    scenario: str
    details: Mapping[str, Plain]
    planned: Trajectory | None


@dataclass(frozen=True, slots=True)
class Choice:
    """Whom to ask for what?  (PRE-1, NEG-7)

    For proposal 1, ``planned`` holds what each receiver plans, by station id, and ``target`` is
    0: it is to be chosen.  Later the target is fixed and ``reason`` says why it refused.
    """

    session: Session
    proposal: int
    planned: Mapping[int, Trajectory]
    target: int = 0
    reason: str = ""

    def prescribe(
        self, target: int, prescribed: Trajectory, *, hold_ms: int, lease_ms: int
    ) -> Prescribe:
        """Ask ``target`` to drive this, beginning ``hold_ms`` after it accepts.

        Its commitment ends ``lease_ms`` after it accepts at the latest (ACT-4).
        """
        return Prescribe(
            session=self.session,
            proposal=self.proposal,
            target=target,
            prescribed=prescribed,
            hold_ms=hold_ms,
            lease_ms=lease_ms,
        )

    def proceed(self) -> Proceed:
        """Nobody is in the way (PRE-3)."""
        return Proceed(session=self.session)

    def abort(self) -> Abort:
        """Give the maneuver up (END-1)."""
        return Abort(session=self.session)


@dataclass(frozen=True, slots=True)
class Proposal:
    """Is it safe to drive this?  (NEG-1)  ``hold_ms`` and ``lease_ms`` as in ``Choice``."""

    session: Session
    proposal: int
    prescribed: Trajectory
    hold_ms: int
    lease_ms: int

    def accept(self) -> Accept:
        """Yes; the selected trajectory is the prescribed one (NEG-2)."""
        return Accept(session=self.session, proposal=self.proposal, selected=self.prescribed)

    def refuse(self) -> Refuse:
        """No (NEG-3)."""
        return Refuse(session=self.session, proposal=self.proposal)


@dataclass(frozen=True, slots=True)
class Drive:
    """It is agreed: drive (ACT-1).

    ``selected`` is what the receiver drives, anchored at its acceptance.  Up to ``start_ms`` (on
    the service's clock; Δt1 after the acceptance) it holds what was planned anyway (KIN-5); a
    prescriber learns of the acceptance later, and for it this is the time it was told.  The
    commitment ends at ``until_ms`` at the latest (ACT-4).
    """

    session: Session
    role: Role
    selected: Trajectory
    start_ms: int
    until_ms: int

    def complete(self) -> Complete:
        """The prescriber's maneuver is done (ACT-3)."""
        return Complete(session=self.session)

    def abort(self) -> Abort:
        """Break off (END-1)."""
        return Abort(session=self.session)


class Service(Protocol):
    """What an application may do with the service it is attached to."""

    def now(self) -> int:
        """The time in ms, on the clock of ``Drive``."""

    def command(self, command: Command, after_ms: int = 0) -> None:
        """Give a command, now or later.  From within a callback: once the callback is over."""


class Application(Protocol):
    """A scenario.  Every method returns at once; an answer is a command, now or later."""

    def attach(self, service: Service) -> None:
        """Called once, before anything else."""

    def kinematics(self, now_ms: int) -> Kinematics:
        """Where the vehicle is now."""

    def concerned(self, advertised: Advertised) -> Trajectory | None:
        """What it plans to drive, or None if the maneuver does not concern it (ADV-3)."""

    def choose(self, choice: Choice) -> None:
        """To be answered by ``prescribe``, ``proceed`` or ``abort`` within t_decide (PRE-1)."""

    def verify(self, proposal: Proposal) -> None:
        """To be answered by ``accept`` or ``refuse`` within t_decide (NEG-1)."""

    def load(self, drive: Drive) -> None:
        """Both have agreed.  A prescriber answers ``complete`` when it is done."""

    def fallback(self, session: Session, reason: str) -> None:
        """The session is over: drive alone.  ``reason`` is that of a Cancel, or
        ``no_participants``, which does not mean that the lane is free (PRE-1)."""

    def finished(self, session: Session) -> None:
        """The session is over by the prescriber's Fin: drive alone again (ACT-3)."""

    def refused(self, command: str, rule: str) -> None:
        """A command changed nothing; ``undecided``: an answer did not come in time (NEG-3)."""
