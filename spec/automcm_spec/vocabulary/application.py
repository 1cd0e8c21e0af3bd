"""The interface between a station and its application: commands in, indications out.

The application computes, verifies and drives trajectories; the station carries them.
"""

from __future__ import annotations

from typing import Annotated, Any, Literal, get_args

from pydantic import Field, TypeAdapter, computed_field

from automcm_spec.vocabulary.messages import (
    Acceptance,
    CancelReason,
    Details,
    Frozen,
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


class Request(Frozen):
    """Open a session (ADV-1)."""

    name: Literal["request"] = "request"
    scenario: Text
    details: Details
    planned: Trajectory | None = None


class Close(Frozen):
    """Close the advertising window before its time (ADV-9)."""

    name: Literal["close"] = "close"
    session: Session


class Prescribe(Frozen):
    """Prescribe to the chosen target (PRE-2), or send it the next proposal (NEG-7)."""

    name: Literal["prescribe"] = "prescribe"
    session: Session
    proposal: Positive
    target: StationId
    prescribed: Trajectory
    hold_ms: Natural
    lease_ms: Positive


class Proceed(Frozen):
    """No station is in the way: maneuver alone (PRE-3)."""

    name: Literal["proceed"] = "proceed"
    session: Session


class Accept(Frozen):
    """The verifier found the proposal safe (NEG-2)."""

    name: Literal["accept"] = "accept"
    session: Session
    proposal: Positive
    selected: Trajectory


class Refuse(Frozen):
    """The verifier found the proposal unsafe (NEG-3)."""

    name: Literal["refuse"] = "refuse"
    session: Session
    proposal: Positive


class Complete(Frozen):
    """The prescriber's maneuver is complete (ACT-3)."""

    name: Literal["complete"] = "complete"
    session: Session


class Abort(Frozen):
    """Abort the session, in any phase (END-1)."""

    name: Literal["abort"] = "abort"
    session: Session


Command = Request | Close | Prescribe | Proceed | Accept | Refuse | Complete | Abort
COMMAND: TypeAdapter[Command] = TypeAdapter(Annotated[Command, Field(discriminator="name")])


class _Indication(Frozen):
    """An indication to the application.

    Its fields are those of the adapter protocol (docs/adapter.md), except the excluded ones, which
    only a log contains.
    """

    def as_dict(self) -> dict[str, Any]:
        """The indication as logged: its own fields, with complete messages."""
        return {name: _json(getattr(self, name)) for name in type(self).model_fields}


def _json(value: Any) -> Any:
    if isinstance(value, tuple):
        return [_json(each) for each in value]
    return to_dict(value) if isinstance(value, Message) else value


class Choose(_Indication):
    """The window is closed and these Intentions were recorded: choose a target (PRE-1)."""

    name: Literal["choose"] = "choose"
    session: Session
    intentions: tuple[Intention, ...] = Field(exclude=True)

    @computed_field  # type: ignore[prop-decorator]
    @property
    def stations(self) -> tuple[StationId, ...]:
        """The recorded stations, in ascending order."""
        return tuple(sorted(intention.src for intention in self.intentions))


class NoParticipants(_Indication):
    """No station answered, which does not mean that the lane is free (PRE-1)."""

    name: Literal["no_participants"] = "no_participants"
    session: Session


class Verify(_Indication):
    """Verify whether this proposal is safe (NEG-1)."""

    name: Literal["verify"] = "verify"
    session: Session
    proposal: Positive
    prescription: Prescription = Field(exclude=True)

    @computed_field  # type: ignore[prop-decorator]
    @property
    def prescribed(self) -> Trajectory:
        """The prescribed trajectory."""
        return self.prescription.prescribed


class Undecided(_Indication):
    """The application gave no verdict in time (NEG-3)."""

    name: Literal["undecided"] = "undecided"
    session: Session
    proposal: Positive


class Accepted(_Indication):
    """The proposal is accepted; ``lease_left_ms`` of the lease remain (NEG-6)."""

    name: Literal["accepted"] = "accepted"
    session: Session
    proposal: Positive
    acceptance: Acceptance = Field(exclude=True)
    lease_left_ms: Natural = 0
    """Set by the station, which has the clock."""

    @computed_field  # type: ignore[prop-decorator]
    @property
    def selected(self) -> Trajectory:
        """The trajectory that the receiver will drive."""
        assert self.acceptance.selected is not None, "an accepting Acceptance has a trajectory"
        return self.acceptance.selected


class Propose(_Indication):
    """The proposal was refused for this reason: compute proposal ``proposal`` (NEG-7)."""

    name: Literal["propose"] = "propose"
    session: Session
    proposal: Positive
    reason: RefusalReason


class Fallback(_Indication):
    """The session ended for this reason: drive alone."""

    name: Literal["fallback"] = "fallback"
    session: Session
    reason: CancelReason


class Finished(_Indication):
    """The session ended with a Fin (ACT-3)."""

    name: Literal["finished"] = "finished"
    session: Session


class Refused(_Indication):
    """The command ``detail`` had no effect (CMD-1)."""

    name: Literal["refused"] = "refused"
    detail: str = Field(exclude=True)


class Discarded(_Indication):
    """A message broke the protocol; ``detail`` explains how (END-5)."""

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
