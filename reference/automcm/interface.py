"""What passes between a station and its application: commands in, indications out.

The application layer computes, verifies and drives trajectories; the station carries them.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field, TypeAdapter

from automcm.messages import (
    Acceptance,
    Details,
    Intention,
    Natural,
    Positive,
    Prescription,
    Session,
    Text,
    Trajectory,
    to_dict,
)


class _Command(BaseModel):
    model_config = ConfigDict(frozen=True, strict=True, extra="forbid")


class Request(_Command):
    """Open a session (ADV-1)."""

    name: Literal["request"] = "request"
    scenario: Text
    details: Details = Field(default_factory=dict)
    planned: Trajectory | None = None


class Prescribe(_Command):
    """The choice of a target (PRE-2), or the next proposal to it (NEG-7)."""

    name: Literal["prescribe"] = "prescribe"
    session: Session
    proposal: Positive
    target: Natural
    prescribed: Trajectory
    hold_ms: Natural
    lease_ms: Positive


class Proceed(_Command):
    """Nobody is in the way: go alone (PRE-3)."""

    name: Literal["proceed"] = "proceed"
    session: Session


class Accept(_Command):
    """The verifier found the proposal safe (NEG-2)."""

    name: Literal["accept"] = "accept"
    session: Session
    proposal: Positive
    selected: Trajectory


class Refuse(_Command):
    """The verifier found the proposal unsafe (NEG-3)."""

    name: Literal["refuse"] = "refuse"
    session: Session
    proposal: Positive


class Complete(_Command):
    """The prescriber's maneuver is done (ACT-3)."""

    name: Literal["complete"] = "complete"
    session: Session


class Abort(_Command):
    """Break off, in any phase (END-1)."""

    name: Literal["abort"] = "abort"
    session: Session


Command = Request | Prescribe | Proceed | Accept | Refuse | Complete | Abort
COMMAND: TypeAdapter[Command] = TypeAdapter(Annotated[Command, Field(discriminator="name")])

Told = Literal[
    "choose",
    "no_participants",
    "verify",
    "undecided",
    "accepted",
    "propose",
    "fallback",
    "finished",
    "refused",
    "discarded",
]


@dataclass(frozen=True, slots=True, kw_only=True)
class Indication:
    """What the application is told.

    ``choose``: the window is closed, these ``intentions`` were recorded (PRE-1);
    ``no_participants``: nobody answered, which is not "the lane is free" (PRE-1);
    ``verify``: is ``prescription`` safe? (NEG-1); ``undecided``: no verdict in time (NEG-3);
    ``accepted``: ``acceptance`` holds the selected trajectory, ``lease_left_ms`` the time left
    (NEG-6); ``propose``: refused for ``reason``, compute proposal ``proposal`` (NEG-7);
    ``fallback``: the session is over for ``reason``, drive alone; ``finished``: over by Fin
    (ACT-3); ``refused``: the command changed nothing, by ``rule``; ``discarded``: a message
    broke the protocol, ``detail`` says how (END-5).
    """

    name: Told
    rule: str
    session: Session | None = None
    proposal: int = 0
    reason: str = ""
    detail: str = ""
    intentions: tuple[Intention, ...] = ()
    prescription: Prescription | None = None
    acceptance: Acceptance | None = None
    lease_left_ms: int | None = None

    def as_dict(self) -> dict[str, Any]:
        """For a log: only what is set."""
        out: dict[str, Any] = {"name": self.name, "rule": self.rule}
        if self.session is not None:
            out["session"] = list(self.session)
        for name in ("proposal", "reason", "detail"):
            if value := getattr(self, name):
                out[name] = value
        if self.intentions:
            out["intentions"] = [to_dict(message) for message in self.intentions]
        for name in ("prescription", "acceptance"):
            if (message := getattr(self, name)) is not None:
                out[name] = to_dict(message)
        if self.lease_left_ms is not None:
            out["lease_left_ms"] = self.lease_left_ms
        return out
