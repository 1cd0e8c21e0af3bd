"""The seven messages, the CAM, and their JSON form (docs/protocol.md, section 2).

All numbers on the wire are integers: millimetres, milliseconds, mm/s, milliradians. A broadcast
message has no ``dst`` on the wire and the value ``BROADCAST`` here. The models are frozen and
strict and reject unknown fields. So every message that ``decode`` returns is well formed (END-5)
and within the bounds of docs/messages.md.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any, Literal, Self, TypeAlias, get_args

from pydantic import (
    BaseModel,
    ConfigDict,
    Field,
    PlainValidator,
    Strict,
    TypeAdapter,
    ValidationError,
    model_validator,
)
from pydantic_core import PydanticCustomError
from typing_extensions import TypeAliasType

from automcm_spec.support.bad_input import printable

BROADCAST = 0
LIMIT = 2**53 - 1
"""The largest integer that every JSON reader represents exactly; the smallest is its negative."""
MAX_BYTES = 65_507
"""The size of the largest UDP datagram, and so the maximum size of a message and length of a
text."""
MAX_MARKS = 255
"""The maximum number of sessions in a CAM: more than a station can name (MEM-1)."""
MAX_DEPTH = 32
"""The maximum nesting depth of lists and objects in ``details``, including itself."""
MIN_EXTENT_MM, MAX_EXTENT_MM = 100, 102_100
"""The least and the greatest length or width of a vehicle: the range of VehicleLength in ETSI
TS 102 894-2.  They also bound length / width, and so the number of discs that cover a vehicle."""
CAR_MM = (4_500, 1_800)
"""Assumed length and width of a vehicle that states neither them nor a larger station type."""
_LORRY_MM = (18_750, 2_600)
"""The longest combination and the widest body that Directive 96/53/EC allows."""
EXTENTS_MM = {
    6: _LORRY_MM,  # bus
    7: (7_500, 2_200),  # lightTruck
    8: _LORRY_MM,  # heavyTruck
    9: _LORRY_MM,  # trailer
    10: _LORRY_MM,  # specialVehicle
    11: (45_000, 2_650),  # tram
    14: _LORRY_MM,  # agricultural
}
"""Assumed length and width by DE_StationType of ETSI TS 102 894-2, which has no lengths; every
other type counts as a passenger car (section 2).  Those of lightTruck and tram are our guess."""

Integer = Annotated[int, Field(ge=-LIMIT, le=LIMIT)]
Natural = Annotated[int, Field(ge=0, le=LIMIT)]
Positive = Annotated[int, Field(ge=1, le=LIMIT)]
# With the bound, pydantic also rejects invalid Unicode (a lone surrogate).
Text = Annotated[str, Field(max_length=MAX_BYTES)]
StationId = Annotated[int, Field(ge=1, le=2**32 - 1)]
ExtentMm = Annotated[int, Field(ge=MIN_EXTENT_MM, le=MAX_EXTENT_MM)]
StationType = Annotated[int, Field(ge=0, le=255)]
Array = Strict(False)
"""For a tuple that is an array in JSON; its items stay strict."""
Session = Annotated[tuple[StationId, Positive], Array]
"""A session is ``(prescriber's station_id, number)``."""

Point = Annotated[tuple[Integer, Integer, Integer], Array]
Version = Annotated[int, Field(ge=1, le=1)]
Plain = TypeAliasType("Plain", "Text | Integer | bool | list[Plain] | dict[Text, Plain]")
"""JSON without floats and nulls."""


def _details(value: Any) -> dict[str, Plain]:
    """A copy of an object of ``Plain`` within the bounds; stops at the first error.

    Pydantic's own validation would be slow: its union copies nested values once per level and
    choice, so one invalid value deep inside takes seconds (END-5).
    """
    if type(value) is not dict:
        raise _fault((), "must be an object")
    copy: dict[str, Plain] = _plain(value, ())
    return copy


def _plain(value: Any, path: tuple[str | int, ...]) -> Any:
    kind = type(value)
    if kind is str:
        if len(value) > MAX_BYTES:
            raise _fault(path, f"must have at most {MAX_BYTES} characters")
        if not value.isascii() and any("\ud800" <= c <= "\udfff" for c in value):
            raise _fault(path, "must be valid Unicode")
        return value
    if kind is int:
        if not -LIMIT <= value <= LIMIT:
            raise _fault(path, f"must be between -{LIMIT} and {LIMIT}")
        return value
    if kind is bool:
        return value
    if kind is float:
        raise _fault(path, f"must be an integer, not {value}")
    if kind is not dict and kind is not list:
        what = "null" if value is None else kind.__name__
        raise _fault(path, f"{what} is not allowed")
    if len(path) >= MAX_DEPTH:
        raise _fault(path, f"nested more than {MAX_DEPTH} levels deep")
    if kind is list:
        return [_plain(each, (*path, index)) for index, each in enumerate(value)]
    for name in value:
        if type(name) is not str:
            raise _fault(path, "a field name must be a string")
        _plain(name, path)
    return {name: _plain(each, (*path, name)) for name, each in value.items()}


Fields: TypeAlias = Mapping[str, object]
"""The JSON fields of a message or a command, well formed or not."""


def same(one: object, other: object) -> bool:
    """Whether two JSON values are equal and of equal types: 1 equals neither 1.0 nor true."""
    return one == other and _same_types([one], [other])


def _same_types(one: Any, other: Any) -> bool:
    """Whether the parts of equal objects or lists are of equal types."""
    if type(one) is dict:
        one, other = one.values(), map(other.__getitem__, one)
    for value, twin in zip(one, other, strict=True):
        kind = type(value)
        nested = kind is dict or kind is list
        if kind is not type(twin) or (nested and not _same_types(value, twin)):
            return False
    return True


def _fault(path: tuple[str | int, ...], problem: str) -> PydanticCustomError:
    return fault(".".join(map(str, path)), problem)


def fault(field: str, problem: str) -> PydanticCustomError:
    """An error at ``field`` of the validated value."""
    return PydanticCustomError("fault", "{problem}", {"field": field, "problem": problem})


Details = Annotated[
    dict[str, Plain], PlainValidator(_details, json_schema_input_type=dict[Text, Plain])
]

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
ANSWER_REASONS = frozenset({"busy", "unknown_session", "closed"})
"""A message with one of these reasons is an answer: sent once per received copy, with seq 0, never
acknowledged."""


class MessageError(ValueError):
    """Bytes that are not a message; the text names the first wrong field (END-5)."""


class Frozen(BaseModel):
    """Immutable, strict, without unknown fields."""

    model_config = ConfigDict(frozen=True, strict=True, extra="forbid")


class Trajectory(Frozen):
    """Positions over time: ``t0`` in ms, points ``(dt_ms, x_mm, y_mm)``. Opaque to the service."""

    t0: Integer
    points: Annotated[tuple[Point, ...], Array] = Field(min_length=1, fail_fast=True)


class MessageId(Frozen):
    """The message that an Ack acknowledges (END-6)."""

    type: MessageType
    seq: Natural


class _Message(Frozen):
    v: Version = 1
    src: StationId
    dst: StationId = BROADCAST
    session: Session
    seq: Positive


class Advertisement(_Message):
    """Prescriber to all: asks which stations are concerned. Repeated, never acknowledged
    (ADV-2)."""

    type: Literal["Advertisement"] = "Advertisement"
    scenario: Text
    details: Details
    planned: Trajectory | None = None


class Intention(_Message):
    """Receiver to prescriber: the trajectory that the receiver plans to drive (ADV-3)."""

    type: Literal["Intention"] = "Intention"
    planned: Trajectory
    length_mm: ExtentMm | None = None
    width_mm: ExtentMm | None = None


class Prescription(_Message):
    """Prescriber to target: a trajectory to drive instead (PRE-2). ``hold_ms`` is Δt1."""

    type: Literal["Prescription"] = "Prescription"
    proposal: Positive
    prescribed: Trajectory
    hold_ms: Natural
    lease_ms: Positive


class Acceptance(_Message):
    """Receiver to prescriber: accepts, or refuses with a reason (NEG-2 … NEG-5)."""

    type: Literal["Acceptance"] = "Acceptance"
    seq: Natural
    proposal: Positive
    accepted: bool
    reason: RefusalReason | None = None
    selected: Trajectory | None = None

    @model_validator(mode="after")
    def _consistent(self) -> Self:
        if self.accepted != (self.reason is None):
            raise fault("reason", "must be present if and only if not accepted")
        if self.accepted != (self.selected is not None):
            raise fault("selected", "must be present if and only if accepted")
        if (self.reason in ANSWER_REASONS) != (self.seq == 0):
            raise fault("seq", "must be 0 if and only if the reason is busy or unknown_session")
        return self


class Fin(_Message):
    """Prescriber to target: the maneuver is complete (ACT-3)."""

    type: Literal["Fin"] = "Fin"


class Cancel(_Message):
    """Either to the other: the session ended, with the reason (END-1, END-2)."""

    type: Literal["Cancel"] = "Cancel"
    seq: Natural
    reason: CancelReason

    @model_validator(mode="after")
    def _consistent(self) -> Self:
        if (self.reason == "closed") != (self.seq == 0):
            raise fault("seq", "must be 0 if and only if the reason is closed")
        return self


class Ack(_Message):
    """Either to the other: acknowledges the receipt of a message (END-6)."""

    type: Literal["Ack"] = "Ack"
    seq: int = Field(default=0, ge=0, le=0)
    of: MessageId


class Cam(Frozen):
    """The periodic position message, which names the sessions of its sender (ACT-2, ACT-5).

    ``station_type`` is a DE_StationType of ETSI TS 102 894-2; ``sigma_mm`` is the standard
    deviation of the position along either axis.
    """

    v: Version = 1
    type: Literal["CAM"] = "CAM"
    src: StationId
    generation_ms: Natural
    x_mm: Integer
    y_mm: Integer
    heading_mrad: Integer
    speed_mm_s: Integer
    marks: Annotated[tuple[Session, ...], Array] = Field(fail_fast=True, max_length=MAX_MARKS)
    length_mm: ExtentMm | None = None
    width_mm: ExtentMm | None = None
    station_type: StationType | None = None
    sigma_mm: Natural | None = None

    @property
    def extent_mm(self) -> tuple[int, int]:
        """The length and the width; an absent one is assumed by the station type."""
        length, width = EXTENTS_MM.get(self.station_type or 0, CAR_MM)
        return self.length_mm or length, self.width_mm or width


Message = Advertisement | Intention | Prescription | Acceptance | Fin | Cancel | Ack
Reliable = Intention | Prescription | Acceptance | Fin | Cancel
RELIABLE = tuple(model.__name__ for model in get_args(Reliable))

MESSAGE: TypeAdapter[Message | Cam] = TypeAdapter(
    Annotated[Message | Cam, Field(discriminator="type")]
)


def decode(data: bytes | str) -> Message | Cam:
    """The message in ``data``. Raises MessageError, naming the first wrong field."""
    try:
        message = MESSAGE.validate_json(data)
    except ValidationError as error:
        raise refusal(error) from None
    given = message.model_fields_set
    for name in missing(message):
        raise MessageError(f"{message.type}.{name}: Field required")
    for name in _OPTIONAL[type(message)]:
        if name in given and getattr(message, name) is None:
            raise MessageError(f"{message.type}.{name}: null is not allowed: omit the field")
    return message


_MODELS: tuple[type[Frozen], ...] = (*get_args(Message), Cam)
_REQUIRED = {model: frozenset({"v", "seq"} & model.model_fields.keys()) for model in _MODELS}
"""Fields that have a default here but are required on the wire."""
_OPTIONAL = {
    model: tuple(name for name, field in model.model_fields.items() if field.default is None)
    for model in _MODELS
}
"""Fields that are None here and absent on the wire."""


def missing(message: Message | Cam) -> frozenset[str]:
    """The fields that ``required`` names and that were not given for this message."""
    return _REQUIRED[type(message)] - message.model_fields_set


def required(fields: Fields) -> list[str]:
    """The fields with a default here that a message of this type must have on the wire; none if
    the type is unknown."""
    type_ = fields.get("type")
    return next((sorted(_REQUIRED[m]) for m in _MODELS if m.__name__ == type_), [])


def session_in(value: object) -> tuple[int, int] | None:
    """The session that a field of a message names, which may be malformed; None if it is none."""
    match value:
        case [p, number] if type(p) is int and type(number) is int:
            return p, number
    return None


def from_dict(fields: dict[str, Any]) -> Message | Cam:
    """The message with these fields, as Python values. Raises MessageError like ``decode``."""
    try:
        return MESSAGE.validate_python(fields)
    except ValidationError as error:
        raise refusal(error) from None


def refusal(error: ValidationError, *outer: str) -> MessageError:
    """The first error of pydantic as a MessageError; ``outer`` is the path of the validated
    value."""
    first = error.errors(include_url=False, include_input=False)[0]
    within = first.get("ctx", {}).get("field")
    place = ".".join(
        str(part) for part in (*outer, *first["loc"], within) if part not in (None, "")
    )
    return MessageError(short(place or "message", first["msg"]))


def short(place: str, problem: str) -> str:
    """One line of at most 200 printable characters, whatever the input contains."""
    text = printable(f"{place}: {problem}"[:200])
    return text if len(text) < 200 else text[:199] + "…"


def encode(message: Message | Cam) -> bytes:
    """Canonical compact JSON: fields in the order of the model, absent fields omitted."""
    return message.__pydantic_serializer__.to_json(message, exclude=_absent(message))


def to_dict(message: Message | Cam) -> dict[str, Any]:
    """A message as a JSON object of Python values."""
    return message.model_dump(mode="json", exclude=_absent(message))


def _absent(message: Message | Cam) -> set[str]:
    absent = {name for name in _OPTIONAL[type(message)] if getattr(message, name) is None}
    if not isinstance(message, Cam) and message.dst == BROADCAST:
        absent.add("dst")
    return absent
