"""The log format ``automcm.trace/1``: the records of a station's log.

A log is NDJSON (UTF-8, one JSON object per line, lines end with a line feed), one file per station:
a header, events, an end. Three rules apply to every line:

* an absent field was *not observed*; there is no null;
* numbers are integers (times in milliseconds, lengths in millimetres); there are no floats;
* keys that start with ``x_`` are vendor fields and ignored; any other unknown key is rejected.

The reader checks the order of lines, ``seq`` and ``t_ms``, not this module.
"""

import base64
import binascii
import json
from typing import TYPE_CHECKING, Annotated, Any, Final, Literal, Self, get_args

from pydantic import (
    AfterValidator,
    BaseModel,
    ConfigDict,
    Field,
    StrictBool,
    StrictInt,
    StrictStr,
    TypeAdapter,
    ValidationError,
    create_model,
    model_validator,
)
from pydantic.dataclasses import dataclass
from pydantic_core import CoreSchema, SchemaValidator, core_schema
from typing_extensions import TypeAliasType

from automcm_spec.log_format.problems import not_an_integer, not_plain, problems_of
from automcm_spec.vocabulary import application, messages
from automcm_spec.vocabulary.messages import (
    LIMIT,
    MESSAGE,
    Array,
    Fields,
    Natural,
    Positive,
    StationId,
    fault,
    missing,
    required,
)
from automcm_spec.vocabulary.parameters import DEFAULTS, IN_HEADER, TIMERS, UNITS, longest_delay

SCHEMA: Final = "automcm.trace/1"

Value = TypeAliasType(
    "Value", "StrictInt | StrictStr | list[Value] | dict[str, Value] | StrictBool"
)
"""Plain JSON without null and float."""

EventKind = Literal["command", "indication", "receive", "restart", "send", "timer"]
EVENT_KINDS: Final[tuple[EventKind, ...]] = get_args(EventKind)
"""All kinds, sorted: ``complete`` of a log that promises everything."""


def _typed_message(message: dict[str, Value]) -> dict[str, Value]:
    if not isinstance(message.get("type"), str):
        raise fault("type", "a message must have a string 'type'")
    return message


def _base64(text: str) -> str:
    try:
        base64.b64decode(text, validate=True)
    except (binascii.Error, ValueError):
        raise fault("", "must be base64") from None
    return text


def _sorted_kinds(kinds: tuple[EventKind, ...]) -> tuple[EventKind, ...]:
    if list(kinds) != (wanted := sorted(set(kinds))):
        raise fault("", f"must be sorted, without duplicates: {json.dumps(wanted)}")
    return kinds


Deadline = Annotated[int, Field(ge=0, le=2 * (2**53 - 1))]
"""A time and a lease later: each may be the largest integer of a message (ACT-4)."""
Percent = Annotated[int, Field(ge=0, le=99)]
Name = Annotated[str, Field(min_length=1)]
Transmission = Annotated[str, Field(pattern=r"^[1-9][0-9]{0,9}:[0-9]{1,19}$")]
Message = Annotated[
    dict[str, Value],
    Field(json_schema_extra={"properties": {"type": {"type": "string"}}, "required": ["type"]}),
    AfterValidator(_typed_message),
]
Base64 = Annotated[
    str, Field(json_schema_extra={"contentEncoding": "base64"}), AfterValidator(_base64)
]


def transmission(tx: str) -> tuple[int, int]:
    """The station and the counter of a transmission id."""
    station, counter = tx.split(":")
    return int(station), int(counter)


def source_of(message: Fields | None, tx: str | None = None) -> int:
    """The station that sent a received message, by its ``tx`` or else as it says; 0 if it names
    none."""
    if tx is not None:
        return transmission(tx)[0]
    src = None if message is None else message.get("src")
    return src if type(src) is int and 0 < src <= LIMIT else 0


def _without_vendor_fields(data: Any) -> Any:
    if not isinstance(data, dict):
        return data
    if wrong := not_plain(data):
        raise fault(*wrong)
    return {key: value for key, value in data.items() if not key.startswith("x_")}


_STRICT = ConfigDict(strict=True, extra="forbid")
_DESCRIBED = _STRICT | ConfigDict(use_attribute_docstrings=True)
"""For classes that describe their fields; reading the descriptions slows the start."""


class Part(BaseModel):
    """An object of the log: immutable, strict, without unknown fields except vendor fields."""

    model_config = _STRICT | ConfigDict(frozen=True)
    _plain = model_validator(mode="before")(_without_vendor_fields)


class Implementation(Part):
    """The implementation that wrote the log."""

    name: Name
    version: Name


class Spec(Part):
    """The specification the implementation was built against."""

    name: Literal["Station"]
    hash: Name


if TYPE_CHECKING:
    Parameters = Part
else:
    _OF_UNIT = {"ms": Natural, "percent": Percent, "count": Positive}
    Parameters = create_model(
        "Parameters",
        __base__=Part,
        __doc__="The known parameters of the station: ``t_`` in milliseconds, ``clock_drift`` in"
        " percent\n(0 if absent), the others are counts.",
        **{name: (_OF_UNIT[UNITS[name]] | None, None) for name in IN_HEADER},
    )


class Header(Part, use_attribute_docstrings=True):
    """The first line: the writer of the log, and what the log promises."""

    rec: Literal["header"]
    schema_version: Literal["automcm.trace/1"] = Field(alias="schema")
    run: Name
    """The name of the run, equal in the logs of all its stations."""
    station: StationId
    implementation: Implementation
    spec: Spec | None = None
    parameters: Parameters
    complete: Annotated[
        tuple[EventKind, ...],
        Array,
        Field(json_schema_extra={"uniqueItems": True}),
        AfterValidator(_sorted_kinds),
    ]
    """The event kinds of which the log contains all events, sorted: only there does absent mean
    "no"."""
    begins: Literal["running"] | None = None
    """``running``: the station was already running when the log began, so its state is unknown.
    Absent: the log begins with the station."""

    @property
    def known(self) -> dict[str, int]:
        """The parameters that the header states."""
        return self.parameters.model_dump(exclude_none=True)

    @property
    def t_resend(self) -> int:
        """The parameter in ms; its default if the header lacks it."""
        return self.known.get("t_resend") or DEFAULTS["t_resend"]

    @property
    def longest_delay(self) -> int:
        """D in ms. By default a timer may be late by as much."""
        return longest_delay({"t_resend": self.t_resend})

    @property
    def unobserved(self) -> list[str]:
        """The event kinds of which the log may lack events."""
        return sorted({*EVENT_KINDS} - {*self.complete})

    @model_validator(mode="before")
    @classmethod
    def _known_version(cls, data: Any) -> Any:
        found = data.get("schema", SCHEMA) if isinstance(data, dict) else SCHEMA
        if found != SCHEMA:
            raise fault("schema", f"must be {SCHEMA!r}; the version {found!r} is not supported")
        return data


class MessageKey(Part, use_attribute_docstrings=True):
    """Names the message that a resend or giveup timer belongs to."""

    type: Name
    to: StationId | None = None
    """Absent for a broadcast."""
    session: Annotated[tuple[StationId, Natural], Array]
    """The prescriber's station id and the number of the session."""
    seq: Natural


class MessageTimer(Part):
    """A timer of one message in the outbox."""

    name: Literal["giveup", "resend"]
    message: MessageKey | None = None


class ForgetTimer(Part):
    """The timer after which the station may forget the sessions of a prescriber."""

    name: Literal["forget"]
    station: StationId | None = None


class PlainTimer(Part):
    """A timer that exists once per station."""

    name: Literal[tuple(sorted(TIMERS.keys() - {"giveup", "resend", "forget"}))]  # type: ignore[valid-type]


Timer = Annotated[MessageTimer | ForgetTimer | PlainTimer, Field(discriminator="name")]


def _with_its_names(schema: dict[str, Any]) -> None:
    number = {"type": "integer"}
    pair = {"type": "array", "items": number, "minItems": 2, "maxItems": 2}
    schema["properties"] |= {"session": pair, "proposal": number, "target": number}


class Command(Part):
    """A command of the application; its own fields stand beside the name."""

    model_config = ConfigDict(extra="allow", json_schema_extra=_with_its_names)

    __pydantic_extra__: dict[str, Value]
    name: Literal[application.names(application.Command)]  # type: ignore[valid-type]

    @model_validator(mode="after")
    def _names_what_it_means(self) -> Self:
        given = self.model_extra or {}
        session = given.get("session", [0, 0])
        if not isinstance(session, list) or [type(n) for n in session] != [int, int]:
            raise fault("session", "must be a station id and a number, such as [1001, 1]")
        for name in ("proposal", "target"):
            if type(given.get(name, 0)) is not int:
                raise fault(name, not_an_integer(given[name], name))
        return self


class Indication(Part):
    """An indication to the application; its own fields stand beside the name."""

    model_config = ConfigDict(extra="allow")

    __pydantic_extra__: dict[str, Value]
    name: Name


@dataclass(config=_STRICT, frozen=True, slots=True, kw_only=True)
class EventBase:
    """The fields of every event. Its slots take half the memory of a model."""

    _plain = model_validator(mode="before")(_without_vendor_fields)
    rec: Literal["event"]
    seq: Annotated[Positive, Field(description="Counts from 1; the only order within a station.")]
    t_ms: Annotated[Natural, Field(description="Monotonic time in milliseconds; never decreases.")]
    rule: Annotated[Name | None, Field(description="The deciding rule: an untrusted hint.")] = None
    phase: Annotated[Name | None, Field(description="The station's phase after the step.")] = None
    role: Annotated[Name | None, Field(description="The station's role after the step.")] = None
    late_ms: Annotated[
        Positive | None, Field(description="The delay in ms: an untrusted hint.")
    ] = None

    @property
    def is_cam(self) -> bool:
        """Whether a CAM was sent or received."""
        message = self.message if isinstance(self, OF_MESSAGE) else None
        return message is not None and message["type"] == "CAM"

    @property
    def is_cam_timer(self) -> bool:
        """Whether this concerns the timer that each CAM of the partner re-arms."""
        return isinstance(self, OF_TIMER) and self.timer.name == "cam"

    @property
    def is_expiry(self) -> bool:
        """Whether a timer expired."""
        return isinstance(self, TimerEnd) and self.op == "expire"

    @property
    def is_input(self) -> bool:
        """Whether a step of the station begins with this event."""
        return self.is_expiry or isinstance(self, _ALWAYS_INPUT)


_ONE_FORM = ConfigDict(
    json_schema_extra={
        "oneOf": [{"required": ["message"]}, {"required": ["raw"]}],
        "dependentRequired": {"rejected": ["raw"]},
    }
)


@dataclass(config=_DESCRIBED | _ONE_FORM, frozen=True, slots=True, kw_only=True)
class Receive(EventBase):
    """A message was received, or bytes that are not a message."""

    ev: Literal["receive"]
    tx: Transmission | None = None
    """``<station>:<counter>``, unique per transmission; all its receivers log the same value.
    Absent if the link does not provide it."""
    message: Message | None = None
    raw: Base64 | None = None
    """The received bytes, if they are not a message or are rejected."""
    rejected: Name | None = None
    """Why a secured link discarded the bytes, such as ``stale``: the station did not receive
    them."""
    planned: dict[str, Value] | None = None
    """The planned trajectory of the application, if the Advertisement concerns it."""

    def _check(self) -> Self:
        if (self.message is None) == (self.raw is None):
            raise fault("message", "exactly one of 'message' and 'raw' must be present")
        if self.rejected is not None and self.raw is None:
            raise fault("rejected", "allowed only with 'raw'")
        type_ = None if self.message is None else self.message["type"]
        if self.planned is not None and type_ != "Advertisement":
            raise fault("planned", "allowed only with an Advertisement")
        return self

    _consistent = model_validator(mode="after")(_check)


@dataclass(config=_DESCRIBED, frozen=True, slots=True, kw_only=True)
class Send(EventBase):
    """A message was passed to the link."""

    ev: Literal["send"]
    tx: Transmission
    """``<station>:<counter>``, new for each transmission, including retransmissions."""
    message: Message


@dataclass(config=_DESCRIBED, frozen=True, slots=True, kw_only=True)
class TimerArm(EventBase):
    """A timer was armed or re-armed."""

    ev: Literal["timer"]
    op: Literal["arm"]
    timer: Timer
    deadline: Deadline
    """The time of its expiry, on the clock of `t_ms`."""


@dataclass(config=_STRICT, frozen=True, slots=True, kw_only=True)
class TimerEnd(EventBase):
    """A timer was stopped or expired."""

    ev: Literal["timer"]
    op: Literal["stop", "expire"]
    timer: Timer


@dataclass(config=_STRICT, frozen=True, slots=True, kw_only=True)
class ApplicationCommand(EventBase):
    """The application gave a command."""

    ev: Literal["command"]
    command: Command


@dataclass(config=_STRICT, frozen=True, slots=True, kw_only=True)
class ApplicationIndication(EventBase):
    """The station gave its application an indication."""

    ev: Literal["indication"]
    indication: Indication


@dataclass(config=_STRICT, frozen=True, slots=True, kw_only=True)
class Restart(EventBase):
    """The station restarted without memory of its sessions."""

    ev: Literal["restart"]


class End(Part, use_attribute_docstrings=True):
    """The last line; no line may follow."""

    rec: Literal["end"]
    seq: Natural
    """`seq` of the last event, 0 if there is none."""
    reason: Name
    """The reason for the end of the log; LogWriter writes ``clean`` or ``crash``."""
    lost_records: Natural
    """The number of events that the implementation failed to log."""


TimerEvent = Annotated[TimerArm | TimerEnd, Field(discriminator="op")]
OF_MESSAGE: Final = Receive, Send
"""The events that have a ``message``."""
OF_TIMER: Final = TimerArm, TimerEnd
"""The events that have a ``timer``."""
_ALWAYS_INPUT: Final = Receive, ApplicationCommand, Restart
Event = Receive | Send | TimerArm | TimerEnd | ApplicationCommand | ApplicationIndication | Restart
_TaggedEvent = Annotated[
    Receive | Send | TimerEvent | ApplicationCommand | ApplicationIndication | Restart,
    Field(discriminator="ev"),
]
Record = Header | Event | End

RECORD: Final[TypeAdapter[Record]] = TypeAdapter(
    Annotated[Header | _TaggedEvent | End, Field(discriminator="rec")]
)
"""Validates one line; ``RECORD.validate_json(line)`` raises pydantic.ValidationError."""


class CamFields(dict[str, Any]):
    """The fields of a well-formed CAM."""

    __slots__ = ()


def _cam_fields() -> CoreSchema:
    """Like the schema of Cam, but gives CamFields (faster), with the fields in the order of Cam."""
    cs, model, fields = core_schema, messages.Cam.__pydantic_core_schema__, {}
    for name, field in model["schema"]["fields"].items():
        form = field["schema"]
        if name == "marks":  # lists, as in JSON
            mark = cs.chain_schema([*form["items_schema"], cs.list_schema(strict=False)])
            form = cs.list_schema(mark, max_length=form["max_length"])
        required = form.get("default", 0) is not None
        form = form["schema"] if form["type"] == "default" else form
        fields[name] = cs.typed_dict_field(form, required=required)
    form = cs.typed_dict_schema(fields, config=model["config"], extra_behavior="forbid")
    return cs.no_info_after_validator_function(CamFields, form)


_LATER: Final = "_without_vendor_fields", "_typed_message", "_check"
"""The checks that ``record`` makes itself."""


def _without_checks(schema: Any, message: CoreSchema | None = None) -> Any:
    """A part of a record's schema without the checks of ``_LATER``, with this form of messages, if
    any; of a union's choices, the first that fits is taken."""
    if isinstance(schema, list):
        return [_without_checks(item, message) for item in schema]
    if not isinstance(schema, dict):
        return schema
    has_check = schema.get("type") in ("function-before", "function-after")
    check = schema["function"]["function"] if has_check else None
    if check is _typed_message and message is not None:
        return message
    if getattr(check, "__name__", "") in _LATER:
        return _without_checks(schema["schema"], message)
    first = {"mode": "left_to_right"} if schema.get("type") == "union" else {}
    return {key: _without_checks(item, message) for key, item in schema.items()} | first


_CAMS: Final = TypeAdapter[Any](Annotated[Receive | Send, Field(discriminator="ev")])
_QUICK: Final = SchemaValidator(_without_checks(RECORD.core_schema), _use_prebuilt=False)
_QUICK_CAM: Final = SchemaValidator(
    _without_checks(_CAMS.core_schema, _cam_fields()), _use_prebuilt=False
)
"""Not prebuilt, because a prebuilt validator would include the checks of the classes."""


_FREE: Final = {ApplicationCommand: "command", ApplicationIndication: "indication"}
"""The parts of events that may have any field."""


def record(line: bytes) -> Record:
    """One line, validated as by RECORD, in about half the time: only lines that may contain nulls
    or vendor fields, and lines that are rejected, are checked for these."""
    found: Record
    if b'"CAM"' in line and b"null" not in line:
        try:
            found = _QUICK_CAM.validate_json(line)
            return found._check() if isinstance(found, Receive) else found
        except ValueError:
            pass
    try:
        found = _QUICK.validate_json(line)
        if isinstance(found, OF_MESSAGE) and found.message is not None:
            _typed_message(found.message)
        if isinstance(found, Receive):
            found._check()
    except ValueError:
        return RECORD.validate_json(line)
    free = _FREE.get(type(found))
    vendor = free and [key for key in getattr(found, free).model_extra or () if key[:2] == "x_"]
    return RECORD.validate_json(line) if vendor or b"null" in line else found


@dataclass(config=_STRICT | ConfigDict(extra="ignore"), frozen=True, slots=True, kw_only=True)
class UnknownEvent(EventBase):
    """An event of a kind that this version does not know; its other fields are ignored."""

    ev: str


UNKNOWN: Final = TypeAdapter(UnknownEvent)


def unknown_event(error: ValidationError) -> bool:
    """Whether a line was rejected only because its kind of event is unknown."""
    first = error.errors(include_url=False, include_input=False)[0]
    return first["type"] == "union_tag_invalid" and first["loc"] == ("event",)


_VALIDATE: Final = MESSAGE.validator.validate_python


def typed(m: Fields) -> messages.Message | CamFields | list[tuple[str, str]]:
    """The message with these fields, or the list of its malformed fields with the problem of each
    (END-5). The addressee is not part of the form."""
    if isinstance(m, CamFields):
        return m
    try:
        message: messages.Message | messages.Cam = _VALIDATE(m)
    except ValidationError as error:
        return problems_of(error)
    absent = missing(message)
    if absent:
        return [(name, "missing") for name in sorted(absent)]
    return CamFields(m) if isinstance(message, messages.Cam) else message


def problems(m: Fields) -> list[tuple[str, str]]:
    """All problems of a malformed message (``typed``); empty for a well-formed one."""
    found = typed(m)
    if not isinstance(found, list):
        return []
    absent = [(name, "missing") for name in required(m) if name not in m]
    return [*found, *(one for one in absent if one not in found)]
