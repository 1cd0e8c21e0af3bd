"""The lines of the adapter protocol (docs/adapter.md): what each may hold, and what is wrong.

The models say the form of a line.  Whether a message is the right one is compared elsewhere, so
of a message no more is asked than that it is an object of a known type.
"""

from __future__ import annotations

import json
from collections.abc import Iterable
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
DEFAULTS: Final = {n: ms for n, ms in parameters.DEFAULTS.items() if n != "clock_drift"}
"""Of the parameters that ``reset`` always gives; ``clock_drift`` needs the feature."""
if TYPE_CHECKING:
    Timer = str
    ParameterName = str
else:
    Timer = Literal[tuple(name for name in TIMERS if name != "lease")]
    """Those of which ``durations`` can say how long they last."""
    ParameterName = Literal[tuple(DEFAULTS)]

_LINES: Final[dict[str, dict[str, Json]]] = {
    model.model_fields["name"].default: model.model_json_schema(
        mode="serialization", schema_generator=Generator
    )["properties"]
    for model in get_args(application.Indication)
}
INDICATIONS: Final = {name: tuple(fields)[1:] for name, fields in _LINES.items()}
"""The fields that are needed and compared, by name."""
MESSAGE_TYPES: tuple[MessageType, ...] = get_args(MessageType)


class ProtocolError(ValueError):
    """A line that is none of the protocol; the text is one sentence."""


class Refused(ProtocolError):
    """The adapter answered ``{"error": why}``; ``why`` is its text."""

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
        raise _refusal("a CAM is no message of a session: it belongs into 'cams'")
    raise _refusal(f"no message has the type {_quoted(found)}{_near(found, MESSAGE_TYPES)}")


def _cam(value: dict[str, Json]) -> dict[str, Json]:
    if value.get("type") != "CAM" or type(value.get("generation_ms")) is not int:
        raise _refusal("a CAM has the type 'CAM' and an integer 'generation_ms'")
    return value


def _kind_wanted(value: Json, schema: Json) -> str:
    """What the kind of a value should be, if it is another; what it says is compared elsewhere."""
    kind = schema.get("type", "object")
    if kind != "array":
        type_, what = {"integer": (int, "an integer"), "string": (str, "a text")}.get(
            kind, (dict, "an object")
        )
        return "" if type(value) is type_ else what
    size = schema.get("maxItems")
    right = type(value) is list and all(type(each) is int for each in value)
    right = right and size in (None, len(value))
    return "" if right else f"a list of {'two ' if size else ''}integers"


def _indication(value: dict[str, Json]) -> dict[str, Json]:
    name = value.get("name")
    if name is None:
        raise _refusal("an indication needs a 'name'")
    if type(name) is not str or name not in INDICATIONS:
        raise _refusal(f"no indication has the name {_quoted(name)}{_near(name, INDICATIONS)}")
    for field in INDICATIONS[name]:
        if field not in value:
            raise _refusal(f"the indication {name!r} lacks {field!r}")
        if what := _kind_wanted(value[field], _LINES[name][field]):
            raise _refusal(f"{field!r} of the indication {name!r} should be {what}")
    return value


def _present(value: Json) -> Json:
    if value is None:
        raise _refusal("null: leave the field out")
    return value


def _version(value: int) -> int:
    if value != PROTOCOL:
        raise _refusal(f"this is version {PROTOCOL}, not {value}")
    return value


_TYPED = {"properties": {"type": {"enum": list(MESSAGE_TYPES)}}, "required": ["type"]}
_CAM = {
    "properties": {"type": {"const": "CAM"}, "generation_ms": {"type": "integer"}},
    "required": ["type", "generation_ms"],
}
_NAMED = {"oneOf": [{"properties": fields, "required": list(fields)} for fields in _LINES.values()]}
Version = Annotated[int, Field(json_schema_extra={"const": PROTOCOL}), AfterValidator(_version)]
Time = Natural
"""Milliseconds on the clock that the kit moves."""
Text = Annotated[str, Field(min_length=1)]
Message = Annotated[dict[str, Json], Field(json_schema_extra=_TYPED), AfterValidator(_message)]
Cam = Annotated[dict[str, Json], Field(json_schema_extra=_CAM), AfterValidator(_cam)]
Indication = Annotated[
    dict[str, Json], Field(json_schema_extra=_NAMED), AfterValidator(_indication)
]
Object = dict[str, Json]


# What the kit writes.


class _Line(BaseModel):
    model_config = ConfigDict(strict=True, extra="forbid", use_attribute_docstrings=True)


class Hello(_Line):
    """The first command, once."""

    cmd: Literal["hello"]
    protocol: Version


_Drift = Annotated[
    int | None,
    Field(ge=1, le=99, description="Percent, with the feature of that name; absent: 0."),
    BeforeValidator(_present),
]
if TYPE_CHECKING:
    Parameters = _Line
else:
    Parameters = create_model(
        "Parameters",
        __base__=_Line,
        __doc__="``t_`` and ``backoff_`` in milliseconds, the others counts; only ``clock_drift``"
        " may lack.",
        **dict.fromkeys(DEFAULTS, (Natural, ...)),
        clock_drift=(_Drift, None),
    )


class Reset(_Line):
    """A new station."""

    cmd: Literal["reset"]
    now: Time
    """Milliseconds; may be less than before."""
    station: StationId
    seed: Natural
    parameters: Parameters


class Receive(_Line):
    """A message has arrived."""

    cmd: Literal["receive"]
    now: Time
    message: Object
    """One of the seven or a CAM; may be malformed (END-5)."""
    planned: Annotated[Object | None, BeforeValidator(_present)] = None
    """What the application would drive; absent: the Advertisement does not concern it."""


class CommandLine(_Line):
    """The application wants something."""

    cmd: Literal["command"]
    now: Time
    command: Annotated[application.Command, Field(discriminator="name")]


class Advance(_Line):
    """Time passes."""

    cmd: Literal["advance"]
    now: Time


class Restart(_Line):
    """Power lost and back (END-8)."""

    cmd: Literal["restart"]
    now: Time


class Durations(_Line):
    """Timers of these names last so many milliseconds from now on."""

    cmd: Literal["durations"]
    durations: dict[Timer, Positive]


class Stop(_Line):
    """The end; it has no answer."""

    cmd: Literal["stop"]


Command = Annotated[
    Hello | Reset | Receive | CommandLine | Advance | Restart | Durations | Stop,
    Field(discriminator="cmd"),
]
COMMAND: Final[TypeAdapter[Command]] = TypeAdapter(Command)


# What the adapter answers.


class HelloAnswer(_Line):
    """Who the implementation is."""

    protocol: Version
    name: Text
    version: Text
    issues: Text
    """Where to report a bug in it."""
    features: list[Feature]
    scenarios: Annotated[list[Text], Field(min_length=1)]
    fixed: dict[ParameterName, Natural]
    """Parameters that it cannot change, with their values."""


class Answer(_Line):
    """What a command brought about."""

    messages: list[Message]
    indications: list[Indication]
    deadline: Time | None
    """The time in ms of the earliest timer that is armed; null if none is."""
    phase: Annotated[Phase | None, BeforeValidator(_present)] = None
    cams: list[Cam] = []


class ErrorAnswer(_Line):
    """The adapter does not know the command, or cannot carry it out."""

    error: str


Read = TypeVar("Read", HelloAnswer, Answer)


def has_float(line: bytes) -> bool:
    """Whether a number in a line may be no integer; to search by a pattern takes ten times as
    long."""
    if b"." in line or b"NaN" in line or b"Infinity" in line:
        return True
    digits = line.translate(_ZEROS)
    return b"0e" in digits or b"0E" in digits


_ZEROS = bytes.maketrans(b"123456789", b"000000000")


def read_answer(line: bytes) -> Answer:
    """The answer to any command but hello and stop.

    Raises Refused for ``{"error": ...}``, else ProtocolError if the line is none.
    """
    try:
        answer = Answer.model_validate_json(line)
    except ValidationError:
        return _read(line, Answer)  # says what is wrong
    if (answer.messages or answer.indications or answer.cams) and has_float(line):
        return _read(line, Answer)
    return answer


def read_hello(line: bytes) -> HelloAnswer:
    """The answer to hello.  Raises as read_answer does."""
    return _read(line, HelloAnswer)


def _read(line: bytes, model: type[Read]) -> Read:
    value = _parse(line)
    if not isinstance(value, dict):
        raise ProtocolError(f"{_kind(value)} stands where the answer, an object, is needed")
    if "error" in value:
        if set(value) != {"error"} or not isinstance(value["error"], str):
            raise ProtocolError('an answer with "error" holds a text there and nothing else')
        raise Refused(value["error"])
    try:
        return model.model_validate(value)
    except ValidationError as error:
        errors = error.errors(include_url=False)
    # A misspelt field is unknown and, in its right spelling, missing: the first says more.
    first = min(errors, key=lambda each: each["type"] != "extra_forbidden")
    raise ProtocolError(_explained(first, value, model))


def _float(text: str) -> NoReturn:
    raise ProtocolError(f"{text} is no integer: there are no floats in a line")


_DECODER = json.JSONDecoder(parse_float=_float, parse_constant=_float)


def _parse(line: bytes) -> Json:
    try:
        start = line.decode().strip()
    except UnicodeDecodeError:
        raise ProtocolError("this line is not UTF-8") from None
    try:
        from_json(line)  # refuses half of a surrogate pair, and what is nested too deep
        return _DECODER.decode(start)
    except ProtocolError:
        raise
    except ValueError as error:
        why = str(error)
    if not start:
        raise ProtocolError("this line is empty: an answer is one line, and nothing else is")
    if start in ("{", "["):
        raise ProtocolError("this line is not JSON: the whole answer stands on one line")
    if start.startswith(("{'", "{messages")):
        raise ProtocolError("this line is not JSON: names and texts stand in double quotes")
    if start.startswith("{"):
        raise ProtocolError(f"this line is not JSON, though it begins like an object: {why}")
    raise ProtocolError("this line is not JSON: did you mean to write it to standard error?")


_NEEDED = {
    "dict_type": "an object",
    "int_type": "an integer",
    "list_type": "a list",
    "string_type": "a text",
}


def _explained(error: ErrorDetails, value: dict[str, Json], model: type[BaseModel]) -> str:
    """The first error of pydantic in a sentence that says what to do."""
    kind, loc, found = error["type"], list(error["loc"]), error["input"]
    if kind == "extra_forbidden":
        return f"unknown field {_quoted(loc[-1])}{_near(loc[-1], model.model_fields)}"
    if kind == "missing":
        null = ": null says that no timer is armed" if loc == ["deadline"] else ""
        return f"the field {_quoted(loc[0])} is missing{null}"
    place = _place(loc)
    if loc[-1] == "[key]":
        return f"{_place(loc[:-2])}: unknown name {_quoted(found)}{_near(found, DEFAULTS)}"
    if kind.endswith("too_short"):
        return f"{place} is empty"
    if kind in _NEEDED:
        null = " or null" if place == "deadline" else ""
        text = kind == "dict_type" and isinstance(found, str)
        hint = ", and not a text that holds it" if text else ""
        return f"{place}: {_kind(found)} stands where {_NEEDED[kind]}{null} is needed{hint}"
    if kind == "literal_error":
        names = error["ctx"]["expected"]
        words = names.replace("'", "").replace(" or ", ", ").split(", ")
        return f"{place}: {_quoted(found)} is none of {names}{_near(found, words)}"
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
    names = {str: "a text", int: "an integer", list: "a list", dict: "an object"}
    return names[type(value)]
