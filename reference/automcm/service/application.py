"""The application interface: the calls that a scenario receives and the commands that it gives.

The service passes the content of messages to the scenario, which answers with the commands of
automcm_spec.vocabulary.application.  A scenario does not handle Acks, retransmissions or timers;
the service does not interpret trajectories (section IV of the paper: facility layer and application
layer).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence, Set
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

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
from automcm_spec.vocabulary.messages import Cam, Plain, Session, Trajectory

HEARD_MS = 30_000
"""A station is passed on to the application for this time after its last CAM (APP-1)."""

CURRENT_MS = 500
"""An older position is unknown (ACT-2)."""


@dataclass(frozen=True, slots=True)
class Kinematics:
    """The vehicle's position, heading and speed for its CAM: mm, milliradians, mm/s.

    ``length_mm`` and ``width_mm`` are its extent, ``sigma_mm`` is the standard deviation of the
    position along either axis; None if unknown.
    """

    x_mm: int
    y_mm: int
    heading_mrad: int
    speed_mm_s: int
    length_mm: int | None = None
    width_mm: int | None = None
    sigma_mm: int | None = None


@dataclass(frozen=True, slots=True)
class Heard:
    """The last CAM of another station (APP-1): when it arrived, on the service's clock, and its
    content.  The service fills in an extent that the CAM leaves out (``Cam.extent_mm``); the error
    of the position stays None if unknown."""

    station_id: int
    received_ms: int
    x_mm: int
    y_mm: int
    heading_mrad: int
    speed_mm_s: int
    marks: tuple[Session, ...] = ()
    length_mm: int | None = None
    width_mm: int | None = None
    sigma_mm: int | None = None
    in_step: bool = True
    """Whether its clock may be within 100 ms of the service's (APP-6)."""

    @classmethod
    def of(cls, cam: Cam, received_ms: int) -> Heard:
        """A CAM received at this time."""
        length_mm, width_mm = cam.extent_mm
        return cls(
            station_id=cam.src,
            received_ms=received_ms,
            x_mm=cam.x_mm,
            y_mm=cam.y_mm,
            heading_mrad=cam.heading_mrad,
            speed_mm_s=cam.speed_mm_s,
            marks=cam.marks,
            length_mm=length_mm,
            width_mm=width_mm,
            sigma_mm=cam.sigma_mm,
        )

    def bound_elsewhere(self, session: Session | None) -> bool:
        """Whether its marks name another session: ADV-4 then keeps it from answering."""
        return any(mark != session for mark in self.marks)


CloseWindow = Callable[[Set[int], Sequence[Heard]], bool]
"""May the window close now (ADV-9)?  Its arguments: the stations that have answered, of which at
least one has not withdrawn, and those heard lately (``Surroundings.heard``)."""


def all_answered(answered: Set[int], heard: Sequence[Heard]) -> bool:
    """ADV-9.4: has every known neighbour answered?  False if no neighbour is known."""
    return bool(heard) and all(each.station_id in answered for each in heard)


@dataclass(frozen=True, slots=True)
class Advertised:
    """A maneuver that another station plans (ADV-3)."""

    session: Session
    scenario: str
    details: Mapping[str, Plain]
    planned: Trajectory | None


@dataclass(frozen=True, slots=True)
class Choice:
    """The question which target to prescribe which trajectory (PRE-1, NEG-7).

    For proposal 1, ``planned`` holds the planned trajectory of each receiver by station id, and
    ``target`` is 0: the application chooses it.  For later proposals the target is fixed, and
    ``reason`` is the reason of its refusal.  ``heard`` holds the stations whose CAMs were heard
    lately, whether they answered or not (APP-1); None if the service does not pass on CAMs.
    ``planned`` lacks the stations whose clocks are out of step (APP-6), and may be empty.
    """

    session: Session
    proposal: int
    planned: Mapping[int, Trajectory]
    target: int = 0
    reason: str = ""
    heard: tuple[Heard, ...] | None = None

    def prescribe(
        self, target: int, prescribed: Trajectory, *, hold_ms: int, lease_ms: int
    ) -> Prescribe:
        """Propose ``prescribed`` to ``target``, beginning ``hold_ms`` after its acceptance.

        Its commitment ends at the latest ``lease_ms`` after its acceptance (ACT-4).
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
        """No vehicle is in the way (PRE-3)."""
        return Proceed(session=self.session)

    def abort(self) -> Abort:
        """Give up the maneuver (END-1)."""
        return Abort(session=self.session)


@dataclass(frozen=True, slots=True)
class Proposal:
    """The question whether ``prescribed`` is safe (NEG-1).

    ``hold_ms`` and ``lease_ms`` are as in ``Choice.prescribe``.
    """

    session: Session
    proposal: int
    prescribed: Trajectory
    hold_ms: int
    lease_ms: int

    def accept(self) -> Accept:
        """Accept it; the selected trajectory is the prescribed one (NEG-2)."""
        return Accept(session=self.session, proposal=self.proposal, selected=self.prescribed)

    def refuse(self) -> Refuse:
        """Refuse it as unsafe (NEG-3)."""
        return Refuse(session=self.session, proposal=self.proposal)


@dataclass(frozen=True, slots=True)
class AgreedManeuver:
    """An agreed maneuver (ACT-1).

    ``selected`` is the receiver's trajectory, which starts at its acceptance.  Up to ``start_ms``
    (on the service's clock; Δt1 after the acceptance) it equals the planned trajectory (KIN-5).
    For a prescriber, ``start_ms`` is the time at which it receives the acceptance.  The commitment
    ends at ``until_ms`` at the latest (ACT-4).
    """

    session: Session
    role: Role
    selected: Trajectory
    start_ms: int
    until_ms: int

    def complete(self) -> Complete:
        """The prescriber has finished its maneuver (ACT-3)."""
        return Complete(session=self.session)

    def abort(self) -> Abort:
        """Break off (END-1)."""
        return Abort(session=self.session)


class Service(Protocol):
    """The service, as far as the attached application may use it."""

    def now(self) -> int:
        """The time in ms, on the clock of ``AgreedManeuver.start_ms``."""

    def command(self, command: Command, after_ms: int = 0) -> None:
        """Give a command, now or later.  From within a callback, it takes effect after it."""


@runtime_checkable
class Surroundings(Protocol):
    """A service that passes on the CAMs that it hears."""

    def heard(self) -> tuple[Heard, ...] | None:
        """The stations heard within HEARD_MS, in the order in which they were heard last.

        None if unknown: at the far end of a bridge without a recent message.
        """


def heard_by(service: Service) -> tuple[Heard, ...] | None:
    """The stations that the service has heard; None if it does not pass on CAMs (APP-1)."""
    return service.heard() if isinstance(service, Surroundings) else None


class Application(Protocol):
    """A scenario.  Every method must return at once; the answer is a command, now or later."""

    def attach(self, service: Service) -> None:
        """Called once, before anything else."""

    def kinematics(self, now_ms: int) -> Kinematics | None:
        """The vehicle's position, heading and speed, at most CURRENT_MS old; None if unknown: the
        station then sends no CAM (ACT-2)."""

    def concerned(self, advertised: Advertised) -> Trajectory | None:
        """The planned trajectory, or None if the maneuver does not concern the vehicle (ADV-3)."""

    def choose(self, choice: Choice) -> None:
        """Must be answered by ``prescribe``, ``proceed`` or ``abort`` within t_decide (PRE-1)."""

    def verify(self, proposal: Proposal) -> None:
        """Must be answered by ``accept`` or ``refuse`` within t_decide (NEG-1)."""

    def load(self, maneuver: AgreedManeuver) -> None:
        """Both stations have agreed.  A prescriber gives ``complete`` when it has finished."""

    def fallback(self, session: Session, reason: str) -> None:
        """The session has ended: drive alone.

        ``reason`` is that of a Cancel, or ``no_participants``, which does not mean that the lane is
        free (PRE-1).
        """

    def finished(self, session: Session) -> None:
        """The prescriber's Fin has ended the session: drive alone (ACT-3)."""

    def refused(self, command: str, rule: str) -> None:
        """A command was refused; ``undecided``: the answer came too late (NEG-3)."""


def check_methods(application: object) -> None:
    """Raises TypeError if a method of ``Application`` is missing; the text names it."""
    methods = [name for name in vars(Application) if not name.startswith("_")]
    missing = [name for name in methods if not callable(getattr(application, name, None))]
    if missing:
        raise TypeError(
            f"{type(application).__name__} lacks {', '.join(missing)}: "
            f"an Application has {', '.join(methods)}"
        )
