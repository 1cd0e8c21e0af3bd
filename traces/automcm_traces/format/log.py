"""The log format ``automcm.trace/1``: what one line of a station's log may say.

A log is NDJSON (UTF-8, one JSON object a line, lines end with a line feed), one file a station:
a header, events, an end. Three rules hold on every line:

* an absent field was *not observed*; there is no null;
* numbers are integers (times in milliseconds, lengths in millimetres); there is no float;
* a key that starts with ``x_`` belongs to the vendor and is ignored, any other unknown key is
  refused.

The order of lines, ``seq`` and ``t_ms`` across lines are the reader's business, not this module's.
"""

import base64
import binascii
from collections.abc import Mapping
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
from pydantic_core import ErrorDetails, SchemaValidator
from typing_extensions import TypeAliasType

from automcm_spec.vocabulary import application, messages
from automcm_spec.vocabulary.messages import (
    MESSAGE,
    Array,
    Fields,
    MessageType,
    StationId,
    fault,
    missing,
)
from automcm_spec.vocabulary.parameters import DEFAULTS, IN_HEADER, UNITS, longest_delay

SCHEMA: Final = "automcm.trace/1"

Value = TypeAliasType(
    "Value", "StrictBool | StrictInt | StrictStr | list[Value] | dict[str, Value]"
)
"""Plain JSON without null and float."""

EventKind = Literal["command", "indication", "receive", "restart", "send", "timer"]


def not_plain(value: object) -> tuple[str, str] | None:
    """Find the first thing in `value` that a log cannot hold.

    Returns the path to it (``message.points[0]``) and what is wrong, or None if all is plain.
    """
    if isinstance(value, (int, str)):
        return None
    if isinstance(value, (list, tuple)):
        for index, item in enumerate(value):
            if odd := not_plain(item):
                return _join(f"[{index}]", odd[0]), odd[1]
        return None
    if isinstance(value, dict):
        for key, item in value.items():
            if not isinstance(key, str):
                return "", f"the key {key!r} is not a string"
            if odd := not_plain(item):
                return _join(key, odd[0]), odd[1]
        return None
    if value is None:
        return "", "null is not allowed: leave out what was not observed"
    if isinstance(value, float):
        return "", "a float is not allowed: use an integer"
    return "", f"a {type(value).__name__} is not JSON"


def _join(outer: str, inner: str) -> str:
    """The path `inner` as seen from what holds it at `outer`."""
    return f"{outer}.{inner}" if outer and inner and not inner.startswith("[") else outer + inner


def _typed_message(message: dict[str, Value]) -> dict[str, Value]:
    if not isinstance(message.get("type"), str):
        raise fault("type", "a message needs a string 'type'")
    return message


def _base64(text: str) -> str:
    try:
        base64.b64decode(text, validate=True)
    except (binascii.Error, ValueError):
        raise fault("", "not base64") from None
    return text


def _sorted_kinds(kinds: tuple[EventKind, ...]) -> tuple[EventKind, ...]:
    if list(kinds) != sorted(set(kinds)):
        raise fault("", "must be sorted and without repetition")
    return kinds


Natural = Annotated[int, Field(ge=0, le=2**53 - 1)]
"""No more than a float holds exactly, as in a message (docs/messages.md)."""
Positive = Annotated[int, Field(ge=1, le=2**53 - 1)]
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


class Part(BaseModel):
    """An object of the log: immutable, strict, closed but for vendor fields."""

    model_config = ConfigDict(
        frozen=True, strict=True, extra="forbid", use_attribute_docstrings=True
    )

    @model_validator(mode="before")
    @classmethod
    def _without_vendor_fields(cls, data: Any) -> Any:
        if not isinstance(data, dict):
            return data
        if odd := not_plain(data):
            raise fault(*odd)
        return {key: value for key, value in data.items() if not key.startswith("x_")}


class Implementation(Part):
    """What wrote the log."""

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
        __doc__="Parameters of the station, those it tells: ``t_`` in milliseconds, ``clock_drift``"
        " in percent\n(0 if it is not told), the others counts.",
        **{name: (_OF_UNIT[UNITS[name]] | None, None) for name in IN_HEADER},
    )


class Header(Part):
    """The first line: who writes, and what the reader may rely on."""

    rec: Literal["header"]
    schema_version: Literal["automcm.trace/1"] = Field(alias="schema")
    run: Name
    """Names the run; the logs of all stations of one run share it."""
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
    """Kinds of event of which the log holds all, sorted: only there does missing mean "no"."""

    @property
    def known(self) -> dict[str, int]:
        """The parameters that it tells."""
        return self.parameters.model_dump(exclude_none=True)

    @property
    def longest_delay(self) -> int:
        """D, ms, with the default where the header does not tell t_resend.  A timer may be as
        late, unless told otherwise."""
        return longest_delay({"t_resend": self.known.get("t_resend") or DEFAULTS["t_resend"]})

    @property
    def unobserved(self) -> list[str]:
        """The kinds of event of which it may lack some."""
        return sorted({*get_args(EventKind)} - {*self.complete})

    @model_validator(mode="before")
    @classmethod
    def _known_version(cls, data: Any) -> Any:
        found = data.get("schema", SCHEMA) if isinstance(data, dict) else SCHEMA
        if found != SCHEMA:
            raise fault("schema", f"unsupported version {found!r}, this is {SCHEMA!r}")
        return data


class MessageKey(Part):
    """Names the message a resend or giveup timer belongs to."""

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
    """The timer after which the memory of one prescriber may go."""

    name: Literal["forget"]
    station: StationId | None = None


class PlainTimer(Part):
    """A timer of which a station has one."""

    name: Literal["advertise", "answer", "backoff", "cam", "decide", "hold", "lease", "quarantine"]


Timer = Annotated[MessageTimer | ForgetTimer | PlainTimer, Field(discriminator="name")]


def _with_its_names(schema: dict[str, Any]) -> None:
    number = {"type": "integer"}
    pair = {"type": "array", "items": number, "minItems": 2, "maxItems": 2}
    schema["properties"] |= {"session": pair, "proposal": number, "target": number}


class Command(Part):
    """A command of the application, with its own fields beside the name."""

    model_config = ConfigDict(extra="allow", json_schema_extra=_with_its_names)

    __pydantic_extra__: dict[str, Value]
    name: Literal[application.names(application.Command)]  # type: ignore[valid-type]

    @model_validator(mode="after")
    def _names_what_it_means(self) -> Self:
        given = self.model_extra or {}
        session = given.get("session", [0, 0])
        if not isinstance(session, list) or [type(n) for n in session] != [int, int]:
            raise fault("session", "a station and a number are needed")
        for name in ("proposal", "target"):
            if type(given.get(name, 0)) is not int:
                raise fault(name, "an integer is needed")
        return self


class Indication(Part):
    """What the station tells its application, with its own fields beside the name."""

    model_config = ConfigDict(extra="allow")

    __pydantic_extra__: dict[str, Value]
    name: Name


class EventBase(Part):
    """What every event has."""

    rec: Literal["event"]
    seq: Positive
    """1 for the first event, then one more each: the only order within a station."""
    t_ms: Natural
    """The station's monotonic clock in milliseconds; never decreases."""
    rule: Name | None = None
    """Id of the rule the implementation believes decided: a hint, never trusted."""
    phase: Name | None = None
    """The station's phase after the step."""
    role: Name | None = None
    """The station's role after the step."""
    late_ms: Positive | None = None
    """By how much the station was late for this, in milliseconds, by its own clock: its process
    was stopped, or got too little processor.  A hint, never trusted."""


class Receive(EventBase):
    """Something arrived: a message, or bytes that were none."""

    model_config = ConfigDict(
        json_schema_extra={"oneOf": [{"required": ["message"]}, {"required": ["raw"]}]}
    )

    ev: Literal["receive"]
    tx: Transmission | None = None
    """``<station>:<counter>``, one for each transmission; all who receive it log the same.
    Absent where the link does not tell."""
    message: Message | None = None
    raw: Base64 | None = None
    """The bytes, if they were no message."""
    planned: dict[str, Value] | None = None
    """The trajectory planned by an application that an Advertisement concerns."""

    @model_validator(mode="after")
    def _consistent(self) -> Self:
        if (self.message is None) == (self.raw is None):
            raise fault("message", "needs exactly one of 'message' and 'raw'")
        advertised = self.message is not None and self.message["type"] == "Advertisement"
        if self.planned is not None and not advertised:
            raise fault("planned", "only with an Advertisement")
        return self


class Send(EventBase):
    """A message was handed to the link."""

    ev: Literal["send"]
    tx: Transmission
    """``<station>:<counter>``, new for each transmission, a retransmission too."""
    message: Message


class TimerArm(EventBase):
    """A timer was armed, or armed anew."""

    ev: Literal["timer"]
    op: Literal["arm"]
    timer: Timer
    deadline: Natural
    """When it expires, on the clock of `t_ms`."""


class TimerEnd(EventBase):
    """A timer was stopped, or expired."""

    ev: Literal["timer"]
    op: Literal["stop", "expire"]
    timer: Timer


class ApplicationCommand(EventBase):
    """The application gave a command."""

    ev: Literal["command"]
    command: Command


class ApplicationIndication(EventBase):
    """The application was told something."""

    ev: Literal["indication"]
    indication: Indication


class Restart(EventBase):
    """The station came back without memory of its sessions."""

    ev: Literal["restart"]


class End(Part):
    """The last line: nothing follows."""

    rec: Literal["end"]
    seq: Natural
    """`seq` of the last event, 0 if there was none."""
    reason: Name
    """Why the log ends; LogWriter says ``clean`` or ``crash``."""
    lost_records: Natural
    """How many events the implementation failed to log."""


TimerEvent = Annotated[TimerArm | TimerEnd, Field(discriminator="op")]
Event = Receive | Send | TimerArm | TimerEnd | ApplicationCommand | ApplicationIndication | Restart
_TaggedEvent = Annotated[
    Receive | Send | TimerEvent | ApplicationCommand | ApplicationIndication | Restart,
    Field(discriminator="ev"),
]
Record = Header | Event | End

RECORD: Final[TypeAdapter[Record]] = TypeAdapter(
    Annotated[Header | _TaggedEvent | End, Field(discriminator="rec")]
)
"""Validates one line: ``RECORD.validate_json(line)`` raises pydantic.ValidationError."""


def _without_checks(schema: Any) -> Any:
    """RECORD's schema for lines in which nothing is null and no field is the vendor's."""
    if isinstance(schema, list):
        return [_without_checks(item) for item in schema]
    if not isinstance(schema, dict):
        return schema
    check = schema["function"]["function"] if schema.get("type") == "function-before" else None
    if getattr(check, "__name__", "") == "_without_vendor_fields":
        return _without_checks(schema["schema"])
    return {key: _without_checks(item) for key, item in schema.items()}


_QUICK: Final = SchemaValidator(_without_checks(RECORD.core_schema), _use_prebuilt=False)
"""Not prebuilt, or it would take the classes' own validators, checks and all."""


def record(line: bytes) -> Record:
    """One line, validated as by RECORD, in about half the time.

    Nearly all lines hold neither null nor a field of the vendor's, so what looks for them walks
    only those that may, and those that are refused.
    """
    if b"null" not in line:
        try:
            found: Record = _QUICK.validate_json(line)
        except ValidationError:
            return RECORD.validate_json(line)
        match found:  # these two keep every field, and must not keep the vendor's
            case ApplicationCommand(command=free) | ApplicationIndication(indication=free):
                if any(key.startswith("x_") for key in free.model_extra or {}):
                    return RECORD.validate_json(line)
        return found
    return RECORD.validate_json(line)


class UnknownEvent(EventBase):
    """An event of a kind this version does not know; its other fields are ignored."""

    model_config = ConfigDict(extra="ignore")

    ev: str


def unknown_event(error: ValidationError) -> bool:
    """Whether a line was refused only because it is an event of a kind not known here."""
    first = error.errors(include_url=False, include_input=False)[0]
    return first["type"] == "union_tag_invalid" and first["loc"] == ("event",)


_VALIDATE: Final = MESSAGE.validator.validate_python


def typed(m: Fields) -> messages.Message | messages.Cam | list[tuple[str, str]]:
    """The message that this is, or each field in which it is not what the protocol says (END-5),
    and what is wrong with it.  Where it goes is not its form."""
    try:
        message: messages.Message | messages.Cam = _VALIDATE(m)
    except ValidationError as error:
        return problems_of(error)
    absent = missing(message)
    return [(name, "missing") for name in sorted(absent)] if absent else message


def problems(m: Fields) -> list[tuple[str, str]]:
    """What is wrong with a message (``typed``); nothing if it is right."""
    found = typed(m)
    return found if isinstance(found, list) else []


_PROBLEMS = {
    "dict_type": "not a JSON object",
    "extra_forbidden": "unknown field",
    "missing": "missing",
    "model_attributes_type": "not a JSON object",
    "model_type": "not a JSON object",
    "union_tag_not_found": "missing",
}


def first_problem(error: ValidationError) -> tuple[str, str]:
    """The first of ``problems_of``."""
    return problems_of(error)[0]


def problems_of(error: ValidationError) -> list[tuple[str, str]]:
    """Each field (a path such as ``message.seq``, "" for the whole line) and what is wrong."""
    return [_problem(one) for one in error.errors(include_url=False, include_input=False)]


def _problem(error: ErrorDetails) -> tuple[str, str]:
    context: Mapping[str, object] = error.get("ctx", {})
    if error["type"] == "json_invalid":
        return "", f"not JSON: {context['error']}".replace(" at line 1 column", " at column")
    path = _path(error)
    for inner in (str(context.get("discriminator", "")).strip("'"), str(context.get("field", ""))):
        path = _join(path, inner)
    if error["type"] == "union_tag_invalid":
        return path, f"{context['tag']!r} is none of {context['expected_tags']}"
    return path, _PROBLEMS.get(error["type"], error["msg"])


_TAGS = frozenset(("header", "end", *get_args(MessageType), "CAM"))
"""What pydantic puts first into a path: which model was chosen for a line or a message."""


def _path(error: ErrorDetails) -> str:
    """The path of an error without the tags pydantic adds for each discriminated union."""
    loc = error["loc"]
    if loc[:1] == ("event",):
        loc = loc[3:] if loc[1:2] == ("timer",) else loc[2:]
        if loc[:1] == ("timer",):
            loc = ("timer", *loc[2:])
    elif loc and loc[0] in _TAGS:
        loc = loc[1:]
    path = ""
    for part in loc:
        path = _join(path, f"[{part}]" if isinstance(part, int) else part)
    return path
