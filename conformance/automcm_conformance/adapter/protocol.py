"""The lines of the adapter protocol (docs/adapter.md): their models and their error messages.

The models describe the form of a line.  The contents of messages are compared elsewhere, so a
message only needs to be an object of a known type here.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from difflib import get_close_matches
from typing import TYPE_CHECKING, Annotated, Any, Final, Literal, NoReturn, TypeVar, get_args

from pydantic import (
    AfterValidator,
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Field,
    TypeAdapter,
    ValidationError,
    create_model,
)
from pydantic_core import ErrorDetails, PydanticCustomError, from_json

from automcm_spec.vocabulary import application, parameters
from automcm_spec.vocabulary.application import Phase
from automcm_spec.vocabulary.json_schema import Generator
from automcm_spec.vocabulary.messages import MessageType, Natural, Positive, StationId
from automcm_spec.vocabulary.parameters import TIMERS

Json = Any
PROTOCOL: Final = 1

Feature = Literal["prescriber", "receiver", "restart", "durations", "cam", "clock_drift"]
NEEDS: Final[dict[str, Feature]] = {
    **dict.fromkeys(("request", "close", "prescribe", "proceed", "complete"), "prescriber"),
    **dict.fromkeys(("accept", "refuse"), "receiver"),
}
"""The feature that each command of an application needs; ``abort`` needs none."""
DEFAULTS: Final = {n: ms for n, ms in parameters.DEFAULTS.items() if n != "clock_drift"}
"""The parameters that every ``reset`` has, in ms or as counts.  ``clock_drift`` needs a feature."""
ROOM: Final = 1
"""In every graph a session needs at most this many outbox entries (MEM-1)."""
if TYPE_CHECKING:
    Timer = str
    ParameterName = str
else:
    Timer = Literal[tuple(name for name in TIMERS if name != "lease")]
    """The timers whose durations ``durations`` can set."""
    ParameterName = Literal[tuple(DEFAULTS)]

_LINES: Final[dict[str, dict[str, Json]]] = {
    model.model_fields["name"].default: model.model_json_schema(
        mode="serialization", schema_generator=Generator
    )["properties"]
    for model in get_args(application.Indication)
}
INDICATIONS: Final = {name: tuple(fields)[1:] for name, fields in _LINES.items()}
"""The required fields of each indication, by its name.  They are also the ones compared."""
MESSAGE_TYPES: tuple[MessageType, ...] = get_args(MessageType)


class ProtocolError(ValueError):
    """An invalid line of the protocol; the text is one sentence."""


class Refused(ProtocolError):
    """The adapter answered ``{"error": why}``."""

    def __init__(self, why: str) -> None:
        super().__init__(f"the adapter answered with an error: {why}")
        self.why = why


def _refusal(text: str) -> PydanticCustomError:
    return PydanticCustomError("refused", "{text}", {"text": text})


def _message(value: dict[str, Json]) -> dict[str, Json]:
    found = value.get("type")
    if found in MESSAGE_TYPES:
        return value
    if found is None:
        raise _refusal("a message needs a 'type'")
    if found == "CAM":
        raise _refusal("a CAM belongs in 'cams', not in 'messages'")
    raise _refusal(f"unknown message type {_quoted(found)}{_near(found, MESSAGE_TYPES)}")


def _cam(value: dict[str, Json]) -> dict[str, Json]:
    if value.get("type") != "CAM" or type(value.get("generation_ms")) is not int:
        raise _refusal("a CAM needs the type 'CAM' and an integer 'generation_ms'")
    return value


def _expected_type(value: Json, schema: Json) -> str:
    """The name of the expected type, or an empty string if the value has it."""
    kind = schema.get("type", "object")
    if kind != "array":
        type_, name = {"integer": (int, "an integer"), "string": (str, "a string")}.get(
            kind, (dict, "an object")
        )
        return "" if type(value) is type_ else name
    size = schema.get("maxItems")
    valid = type(value) is list and all(type(each) is int for each in value)
    valid = valid and size in (None, len(value))
    return "" if valid else f"a list of {'two ' if size else ''}integers"


def _indication(value: dict[str, Json]) -> dict[str, Json]:
    name = value.get("name")
    if name is None:
        raise _refusal("an indication needs a 'name'")
    if type(name) is not str or name not in INDICATIONS:
        raise _refusal(f"unknown indication {_quoted(name)}{_near(name, INDICATIONS)}")
    for field in INDICATIONS[name]:
        if field not in value:
            raise _refusal(f"the indication {name!r} lacks {field!r}")
        if expected := _expected_type(value[field], _LINES[name][field]):
            raise _refusal(f"{field!r} of the indication {name!r} must be {expected}")
    return value


def _present(value: Json) -> Json:
    if value is None:
        raise _refusal("null is not allowed; leave the field out")
    return value


def _version(value: int) -> int:
    if value != PROTOCOL:
        raise _refusal(f"the kit speaks version {PROTOCOL}, not {value}")
    return value


_TYPED = {"properties": {"type": {"enum": list(MESSAGE_TYPES)}}, "required": ["type"]}
_CAM = {
    "properties": {"type": {"const": "CAM"}, "generation_ms": {"type": "integer"}},
    "required": ["type", "generation_ms"],
}
_NAMED = {"oneOf": [{"properties": fields, "required": list(fields)} for fields in _LINES.values()]}
Version = Annotated[int, Field(json_schema_extra={"const": PROTOCOL}), AfterValidator(_version)]
Time = Natural
"""A time in ms on the kit's simulated clock."""
Text = Annotated[str, Field(min_length=1)]
Message = Annotated[dict[str, Json], Field(json_schema_extra=_TYPED), AfterValidator(_message)]
Cam = Annotated[dict[str, Json], Field(json_schema_extra=_CAM), AfterValidator(_cam)]
Indication = Annotated[
    dict[str, Json], Field(json_schema_extra=_NAMED), AfterValidator(_indication)
]
Object = dict[str, Json]


# Lines from the kit.


class _Line(BaseModel):
    model_config = ConfigDict(strict=True, extra="forbid", use_attribute_docstrings=True)


class Hello(_Line):
    """The first command, sent once."""

    cmd: Literal["hello"]
    protocol: Version


_Drift = Annotated[
    int | None,
    Field(ge=1, le=99, description="Percent; only with the feature clock_drift. Default: 0."),
    BeforeValidator(_present),
]
if TYPE_CHECKING:
    Parameters = _Line
else:
    Parameters = create_model(
        "Parameters",
        __base__=_Line,
        __doc__="``t_`` and ``backoff_`` are in milliseconds, the others are counts. Only"
        " ``clock_drift`` is optional.",
        **dict.fromkeys(DEFAULTS, (Natural, ...)),
        clock_drift=(_Drift, None),
    )


class Reset(_Line):
    """Replace the station with a new one."""

    cmd: Literal["reset"]
    now: Time
    """Milliseconds; may be earlier than in the command before."""
    station: StationId
    seed: Natural
    parameters: Parameters


class Receive(_Line):
    """A message has arrived."""

    cmd: Literal["receive"]
    now: Time
    message: Object
    """A message of a session or a CAM; may be malformed (END-5)."""
    planned: Annotated[Object | None, BeforeValidator(_present)] = None
    """The planned trajectory; absent if the Advertisement does not concern the application."""


class CommandLine(_Line):
    """A command of the application."""

    cmd: Literal["command"]
    now: Time
    command: Annotated[application.Command, Field(discriminator="name")]


class Advance(_Line):
    """Time passes."""

    cmd: Literal["advance"]
    now: Time


class Restart(_Line):
    """The station loses power and starts again (END-8)."""

    cmd: Literal["restart"]
    now: Time


class Durations(_Line):
    """New durations of timers in milliseconds, for timers armed from now on."""

    cmd: Literal["durations"]
    durations: dict[Timer, Positive]


class Stop(_Line):
    """End of the run; has no answer."""

    cmd: Literal["stop"]


Command = Annotated[
    Hello | Reset | Receive | CommandLine | Advance | Restart | Durations | Stop,
    Field(discriminator="cmd"),
]
COMMAND: Final[TypeAdapter[Command]] = TypeAdapter(Command)


# Lines from the adapter.


class HelloAnswer(_Line):
    """The implementation and its features."""

    protocol: Version
    name: Text
    version: Text
    issues: Text
    """Where to report bugs of the implementation."""
    features: list[Feature]
    scenarios: Annotated[list[Text], Field(min_length=1)]
    fixed: dict[ParameterName, Natural]
    """Parameters that cannot be changed, with their values."""

    def fitted(self, chosen: Mapping[str, int]) -> dict[str, int]:
        """The chosen parameters, adapted to what this implementation can be given."""
        p = {**chosen, **self.fixed}
        if "clock_drift" not in self.features:
            p.pop("clock_drift", None)
        if p["backoff_min"] > p["backoff_max"]:
            bound = p["backoff_min"] if "backoff_min" in self.fixed else p["backoff_max"]
            p["backoff_min"] = p["backoff_max"] = bound
        if "outbox_limit" not in self.fixed:
            needed = ROOM + 1 + max(p["max_participants"], p["max_rounds"])
            p["outbox_limit"] = max(p["outbox_limit"], needed)
        return p


class Answer(_Line):
    """The effects of a command."""

    messages: list[Message]
    indications: list[Indication]
    deadline: Time | None
    """The time in ms of the earliest armed timer; null if none is armed."""
    phase: Annotated[Phase | None, BeforeValidator(_present)] = None
    cams: list[Cam] = []


class ErrorAnswer(_Line):
    """The adapter does not know the command or cannot execute it."""

    error: str


Read = TypeVar("Read", HelloAnswer, Answer)


def has_float(line: bytes) -> bool:
    """Whether a line may have a number that is not an integer: faster than a regular expression."""
    if b"." in line or b"NaN" in line or b"Infinity" in line:
        return True
    return b"0e" in line.translate(_EXPONENTS)


_EXPONENTS = bytes.maketrans(b"123456789E", b"000000000e")
_ANSWER = Answer.__pydantic_validator__


def read_answer(line: bytes) -> Answer:
    """The answer to any command but hello and stop.

    Raises Refused for ``{"error": ...}``, and ProtocolError for any other invalid line.
    """
    try:
        answer: Answer = _ANSWER.validate_json(line)
    except ValidationError:
        return _read(line, Answer)  # raises an error with an explanation
    if (answer.messages or answer.indications or answer.cams) and has_float(line):
        return _read(line, Answer)
    return answer


SAY_HELLO = b'{"cmd":"hello","protocol":%d}\n' % PROTOCOL


def read_hello(line: bytes) -> HelloAnswer:
    """The answer to hello.  Raises the same errors as read_answer; a banner is shown."""
    try:
        return _read(line, HelloAnswer)
    except ProtocolError as error:
        if line.startswith(b"{"):
            raise
        raise ProtocolError(
            f"{error}; the line: {_quoted(line.decode(errors='replace'))}"
        ) from None


def _read(line: bytes, model: type[Read]) -> Read:
    value = _parse(line)
    if not isinstance(value, dict):
        raise ProtocolError(f"an answer must be an object, not {_kind(value)}")
    if "error" in value:
        if set(value) != {"error"} or not isinstance(value["error"], str):
            raise ProtocolError('"error" must be a string and the only field of its answer')
        raise Refused(value["error"])
    try:
        return model.model_validate(value)
    except ValidationError as error:
        errors = error.errors(include_url=False)
    # A misspelt field is reported as unknown and as missing; the first is more helpful.
    first = min(errors, key=lambda each: each["type"] != "extra_forbidden")
    raise ProtocolError(_explained(first, model))


def _float(text: str) -> NoReturn:
    raise ProtocolError(f"{text} is not an integer: write 1, not 1.0 or 1e0")


_DECODER = json.JSONDecoder(parse_float=_float, parse_constant=_float)


def _parse(line: bytes) -> Json:
    try:
        start = line.decode().strip()
    except UnicodeDecodeError:
        raise ProtocolError("the line is not UTF-8") from None
    try:
        from_json(line)  # rejects lone surrogates and too deep nesting
        return _DECODER.decode(start)
    except ProtocolError:
        raise
    except ValueError as error:
        why = str(error)
    if not start:
        raise ProtocolError("the line is empty: each answer is exactly one line")
    if start in ("{", "["):
        raise ProtocolError("the line is not JSON: write the whole answer on one line")
    if start.startswith("\ufeff"):
        raise ProtocolError("the line begins with a byte order mark: write UTF-8 without one")
    if start.startswith(("{'", "{messages")):
        raise ProtocolError("the line is not JSON: write names and strings in double quotes")
    if start.startswith("{"):
        raise ProtocolError(f"the line begins with an object but is not JSON: {why}")
    raise ProtocolError("the line is not JSON: did you mean to write it to standard error?")


_EXPECTED = {
    "dict_type": "an object",
    "int_type": "an integer",
    "list_type": "a list",
    "string_type": "a string",
}


def _explained(error: ErrorDetails, model: type[BaseModel]) -> str:
    """An error of pydantic as a sentence that says what to do."""
    kind, loc, found = error["type"], list(error["loc"]), error["input"]
    if kind == "extra_forbidden":
        return f"unknown field {_quoted(loc[-1])}{_near(loc[-1], model.model_fields)}"
    if kind == "missing":
        null = "; write null if no timer is armed" if loc == ["deadline"] else ""
        return f"the field {_quoted(loc[0])} is missing{null}"
    place = _place(loc)
    if loc[-1] == "[key]":
        return f"{_place(loc[:-2])}: unknown name {_quoted(found)}{_near(found, DEFAULTS)}"
    if kind.endswith("too_short"):
        return f"{place} must not be empty"
    if kind in _EXPECTED:
        null = " or null" if place == "deadline" else ""
        encoded = kind == "dict_type" and isinstance(found, str)
        hint = " (do not encode the object as a string)" if encoded else ""
        return f"{place} must be {_EXPECTED[kind]}{null}, not {_kind(found)}{hint}"
    if kind == "literal_error":
        names = error["ctx"]["expected"]
        words = names.replace("'", "").replace(" or ", ", ").split(", ")
        return f"{place} must be {names}, not {_quoted(found)}{_near(found, words)}"
    return f"{place}: {error['msg'][:1].lower()}{error['msg'][1:]}"


def _place(loc: Iterable[int | str]) -> str:
    place = ""
    for part in loc:
        place += f"[{part}]" if isinstance(part, int) else f".{part}" if place else part
    return place


def _near(word: object, known: Iterable[str]) -> str:
    lower = {name.lower(): name for name in known}
    near = get_close_matches(str(word).lower(), lower, n=1)
    return f': did you mean "{lower[near[0]]}"?' if near else ""


def _quoted(value: object) -> str:
    text = json.dumps(value)
    return text if len(text) <= 60 else text[:57] + "..."


def _kind(value: object) -> str:
    if value is None:
        return "null"
    if isinstance(value, bool):
        return str(value).lower()
    names = {str: "a string", int: "an integer", list: "a list", dict: "an object"}
    return names[type(value)]
