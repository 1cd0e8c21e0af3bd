"""The seven messages, the CAM, and their JSON form (docs/protocol.md, section 2).

Integers on the wire: millimetres, milliseconds, mm/s, milliradians.  A message that is
broadcast has no ``dst`` on the wire; inside it is ``BROADCAST``.  The models are frozen and
strict and refuse unknown fields, so whatever ``decode`` returns is well formed (END-5).
"""

from __future__ import annotations

from typing import Annotated, Any, Literal, Self

from pydantic import (
    BaseModel,
    ConfigDict,
    Field,
    TypeAdapter,
    ValidationError,
    model_validator,
)
from typing_extensions import TypeAliasType

BROADCAST = 0

StationId = Annotated[int, Field(ge=1, le=2**32 - 1)]
Session = tuple[StationId, Annotated[int, Field(ge=1)]]
"""A session is ``(prescriber's station_id, number)``."""

Version = Annotated[int, Field(ge=1, le=1)]
Plain = TypeAliasType("Plain", "str | int | bool | list[Plain] | dict[str, Plain]")
"""JSON without floats and nulls."""

MessageType = Literal[
    "Advertisement", "Intention", "Prescription", "Acceptance", "Fin", "Cancel", "Ack"
]
RefusalReason = Literal["unsafe", "undecided", "busy", "unknown_session"]
CancelReason = Literal[
    "not_selected",
    "not_needed",
    "no_agreement",
    "timeout",
    "cam_loss",
    "lease_expired",
    "abort",
    "closed",
]
ANSWER_REASONS = frozenset({"busy", "unknown_session"})
"""Refusals that are answers: sent once for each copy, seq 0, never acknowledged."""


class MessageError(ValueError):
    """Bytes that are no message; the text names the first offending field (END-5)."""


class _Frozen(BaseModel):
    model_config = ConfigDict(frozen=True, strict=True, extra="forbid")


class Trajectory(_Frozen):
    """Positions over time: ``t0`` in ms, points ``(dt_ms, x_mm, y_mm)``.  Opaque to the service."""

    t0: int
    points: tuple[tuple[int, int, int], ...] = Field(min_length=1)


class MessageId(_Frozen):
    """What an Ack acknowledges (END-6)."""

    type: MessageType
    seq: int = Field(ge=0)


class _Message(_Frozen):
    v: Version = 1
    src: StationId
    dst: StationId = BROADCAST
    session: Session
    seq: int = Field(ge=1)


class Advertisement(_Message):
    """prescriber → all: who is concerned?  Repeated, never acknowledged (ADV-2)."""

    type: Literal["Advertisement"] = "Advertisement"
    scenario: str
    details: dict[str, Plain]
    planned: Trajectory | None = None


class Intention(_Message):
    """receiver → prescriber: what I plan to drive (ADV-3)."""

    type: Literal["Intention"] = "Intention"
    planned: Trajectory


class Prescription(_Message):
    """prescriber → target: drive this instead (PRE-2).  ``hold_ms`` is Δt1."""

    type: Literal["Prescription"] = "Prescription"
    proposal: int = Field(ge=1)
    prescribed: Trajectory
    hold_ms: int = Field(ge=0)
    lease_ms: int = Field(ge=1)


class Acceptance(_Message):
    """receiver → prescriber: yes, or no and why (NEG-2 … NEG-5)."""

    type: Literal["Acceptance"] = "Acceptance"
    seq: int = Field(ge=0)
    proposal: int = Field(ge=1)
    accepted: bool
    reason: RefusalReason | None = None
    selected: Trajectory | None = None

    @model_validator(mode="after")
    def _consistent(self) -> Self:
        if self.accepted != (self.reason is None):
            raise ValueError("reason: present if and only if not accepted")
        if self.accepted != (self.selected is not None):
            raise ValueError("selected: present if and only if accepted")
        if (self.reason in ANSWER_REASONS) != (self.seq == 0):
            raise ValueError("seq: 0 if and only if the reason is busy or unknown_session")
        return self


class Fin(_Message):
    """prescriber → target: the maneuver is done (ACT-3)."""

    type: Literal["Fin"] = "Fin"


class Cancel(_Message):
    """either → the other: the session is over, and why (END-1, END-2)."""

    type: Literal["Cancel"] = "Cancel"
    seq: int = Field(ge=0)
    reason: CancelReason

    @model_validator(mode="after")
    def _consistent(self) -> Self:
        if (self.reason == "closed") != (self.seq == 0):
            raise ValueError("seq: 0 if and only if the reason is closed")
        return self


class Ack(_Message):
    """either: I have received that message (END-6)."""

    type: Literal["Ack"] = "Ack"
    seq: int = Field(default=0, ge=0, le=0)
    of: MessageId


class Cam(_Frozen):
    """The periodic position message, with the sessions its sender is in (ACT-2, ACT-5)."""

    v: Version = 1
    type: Literal["CAM"] = "CAM"
    src: StationId
    generation_ms: int = Field(ge=0)
    x_mm: int
    y_mm: int
    heading_mrad: int
    speed_mm_s: int
    marks: tuple[Session, ...]


Message = Advertisement | Intention | Prescription | Acceptance | Fin | Cancel | Ack
Reliable = Intention | Prescription | Acceptance | Fin | Cancel

_ADAPTER: TypeAdapter[Message | Cam] = TypeAdapter(
    Annotated[Message | Cam, Field(discriminator="type")]
)


def decode(data: bytes | str) -> Message | Cam:
    """The message in ``data``.  Raises MessageError, naming the first field that is wrong."""
    try:
        message = _ADAPTER.validate_json(data)
    except ValidationError as error:
        first = error.errors(include_url=False, include_input=False)[0]
        place = ".".join(str(part) for part in first["loc"]) or "message"
        raise MessageError(_short(place, first["msg"])) from None
    for name in _REQUIRED & type(message).model_fields.keys() - message.model_fields_set:
        raise MessageError(f"{message.type}.{name}: Field required")
    for name, value in message:
        if value is None and name in message.model_fields_set:
            raise MessageError(f"{message.type}.{name}: null is not allowed: leave the field out")
    return message


_REQUIRED = {"v", "seq"}
"""Fields that have a default here but not on the wire."""


def _short(place: str, problem: str) -> str:
    """One line of bounded length, whatever the sender wrote."""
    text = f"{place}: {problem}"
    return text if len(text) <= 200 else text[:199] + "…"


def encode(message: Message | Cam) -> bytes:
    """Canonical compact JSON: field order of the model, absent fields left out."""
    return message.__pydantic_serializer__.to_json(message, exclude=_absent(message))


def to_dict(message: Message | Cam) -> dict[str, Any]:
    """The JSON object of a message, as Python values."""
    return message.model_dump(mode="json", exclude=_absent(message))


def _absent(message: Message | Cam) -> set[str]:
    return {name for name, value in message if value is None or (name, value) == ("dst", 0)}
