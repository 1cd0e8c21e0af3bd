"""What passes between a station and its application: commands in, indications out.

The application layer computes, verifies and drives trajectories; the station carries them.
"""

from __future__ import annotations

from typing import Annotated, Any, Literal, get_args

from pydantic import BaseModel, ConfigDict, Field, TypeAdapter, computed_field

from automcm_spec.vocabulary.messages import (
    Acceptance,
    CancelReason,
    Details,
    Intention,
    Message,
    Natural,
    Positive,
    Prescription,
    RefusalReason,
    Session,
    StationId,
    Text,
    Trajectory,
    to_dict,
)

Phase = Literal[
    "STANDALONE",
    "ADVERTISING",
    "CHOOSING",
    "PRESCRIBING",
    "INTENDING",
    "WAITING",
    "NEGOTIATING",
    "ACTUATING",
]
Role = Literal["none", "prescriber", "receiver"]


class _Command(BaseModel):
    model_config = ConfigDict(frozen=True, strict=True, extra="forbid")


class Request(_Command):
    """Open a session (ADV-1)."""

    name: Literal["request"] = "request"
    scenario: Text
    details: Details
    planned: Trajectory | None = None


class Prescribe(_Command):
    """The choice of a target (PRE-2), or the next proposal to it (NEG-7)."""

    name: Literal["prescribe"] = "prescribe"
    session: Session
    proposal: Positive
    target: StationId
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


class _Indication(BaseModel):
    """What the application is told.  The fields are those of an adapter's line (docs/adapter.md),
    but for the excluded ones, which a log has as well."""

    model_config = ConfigDict(frozen=True, strict=True, extra="forbid")

    def as_dict(self) -> dict[str, Any]:
        """As a log has it: its own fields, with messages whole."""
        return {name: _json(getattr(self, name)) for name in type(self).model_fields}


def _json(value: Any) -> Any:
    if isinstance(value, tuple):
        return [_json(each) for each in value]
    return to_dict(value) if isinstance(value, Message) else value


class Choose(_Indication):
    """The window is closed, these Intentions were recorded: choose (PRE-1)."""

    name: Literal["choose"] = "choose"
    session: Session
    intentions: tuple[Intention, ...] = Field(exclude=True)

    @computed_field  # type: ignore[prop-decorator]
    @property
    def stations(self) -> tuple[StationId, ...]:
        """Those recorded, ascending."""
        return tuple(sorted(intention.src for intention in self.intentions))


class NoParticipants(_Indication):
    """Nobody answered, which is not "the lane is free" (PRE-1)."""

    name: Literal["no_participants"] = "no_participants"
    session: Session


class Verify(_Indication):
    """Is this safe? (NEG-1)"""

    name: Literal["verify"] = "verify"
    session: Session
    proposal: Positive
    prescription: Prescription = Field(exclude=True)

    @computed_field  # type: ignore[prop-decorator]
    @property
    def prescribed(self) -> Trajectory:
        """The trajectory."""
        return self.prescription.prescribed


class Undecided(_Indication):
    """There was no verdict in time (NEG-3)."""

    name: Literal["undecided"] = "undecided"
    session: Session
    proposal: Positive


class Accepted(_Indication):
    """The proposal is accepted; ``lease_left_ms`` is left of the lease (NEG-6)."""

    name: Literal["accepted"] = "accepted"
    session: Session
    proposal: Positive
    acceptance: Acceptance = Field(exclude=True)
    lease_left_ms: Natural = 0
    """Filled in by the station, which has the clock."""

    @computed_field  # type: ignore[prop-decorator]
    @property
    def selected(self) -> Trajectory:
        """The trajectory that the receiver drives."""
        assert self.acceptance.selected is not None, "an Acceptance that accepts has one"
        return self.acceptance.selected


class Propose(_Indication):
    """Refused for this reason: compute proposal ``proposal`` (NEG-7)."""

    name: Literal["propose"] = "propose"
    session: Session
    proposal: Positive
    reason: RefusalReason


class Fallback(_Indication):
    """The session is over for this reason: drive alone."""

    name: Literal["fallback"] = "fallback"
    session: Session
    reason: CancelReason


class Finished(_Indication):
    """The session is over by Fin (ACT-3)."""

    name: Literal["finished"] = "finished"
    session: Session


class Refused(_Indication):
    """The command ``detail`` changed nothing (CMD-1)."""

    name: Literal["refused"] = "refused"
    detail: str = Field(exclude=True)


class Discarded(_Indication):
    """A message broke the protocol; ``detail`` says how (END-5)."""

    name: Literal["discarded"] = "discarded"
    detail: str = Field(exclude=True)


Indication = (
    Choose
    | NoParticipants
    | Verify
    | Undecided
    | Accepted
    | Propose
    | Fallback
    | Finished
    | Refused
    | Discarded
)


def names(union: Any) -> tuple[str, ...]:
    """The names of all commands, or of all indications."""
    return tuple(model.model_fields["name"].default for model in get_args(union))
