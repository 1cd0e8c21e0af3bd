"""Why a line or a message is rejected: the path of each wrong field, and what to write instead."""

import json
from collections.abc import Mapping
from typing import Final, get_args

from pydantic import ValidationError
from pydantic_core import ErrorDetails

from automcm_spec.vocabulary.messages import MessageType
from automcm_spec.vocabulary.parameters import UNITS


def not_plain(value: object, name: str = "") -> tuple[str, str] | None:
    """The path (``message.points[0]``) and the problem of the first value inside `value` that a log
    cannot contain; None if there is none. `name` is the field that holds `value`."""
    if isinstance(value, (int, str)):
        return None
    if isinstance(value, (list, tuple)):
        for index, item in enumerate(value):
            if wrong := not_plain(item):
                return join(f"[{index}]", wrong[0]), wrong[1]
        return None
    if isinstance(value, dict):
        for key, item in value.items():
            if not isinstance(key, str):
                return "", f"the key {key!r} is not a string"
            if wrong := not_plain(item, key):
                return join(key, wrong[0]), wrong[1]
        return None
    return "", unfit(value, name)


def unfit(value: object, name: str) -> str:
    """The problem of a null, a float, or a value that is not JSON, in the field `name`."""
    if value is None:
        return "null is not allowed: omit a field that was not observed"
    if isinstance(value, float):
        return not_an_integer(value, name)
    return f"must be a JSON value, not a Python {type(value).__name__}"


def not_an_integer(value: object, name: str) -> str:
    """The problem of a value that should be an integer, in the field `name`."""
    is_time = name.endswith("_ms") or name == "deadline" or UNITS.get(name) == "ms"
    unit = " number of milliseconds" if is_time else ""
    match value:
        case bool() | int() | float():
            shown = str(value).lower()
        case str():
            shown = json.dumps(value[:40], ensure_ascii=False)
        case list():
            shown = "a list"
        case _:
            shown = "an object"
    return f"must be an integer{unit}, not {shown}"


def join(outer: str, inner: str) -> str:
    """The path `inner` relative to the object that contains `outer`."""
    return f"{outer}.{inner}" if outer and inner and not inner.startswith("[") else outer + inner


_PROBLEMS: Final = {
    "bool_type": "must be true or false",
    "dict_type": "not a JSON object",
    "greater_than_equal": "must be at least {ge}",
    "less_than_equal": "must be at most {le}",
    "list_type": "must be a list",
    "literal_error": "must be {expected}",
    "model_attributes_type": "not a JSON object",
    "model_type": "not a JSON object",
    "string_too_short": "must not be empty",
    "string_type": "must be a string",
    "tuple_type": "must be a list",
}
_EXAMPLES: Final = {
    "tx": 'the station and the number of its transmission, such as "7:1"; each copy has its own'
}
"""What to write where neither the type nor a bound says it."""


def problems_of(error: ValidationError) -> list[tuple[str, str]]:
    """Each wrong field (a path such as ``message.seq``, "" for the whole line) and its problem."""
    return [_problem(one) for one in error.errors(include_url=False)]


def _problem(error: ErrorDetails) -> tuple[str, str]:
    context: Mapping[str, object] = error.get("ctx", {})
    if error["type"] == "json_invalid":
        return "", f"not JSON: {context['error']}".replace(" at line 1 column", " at column")
    path = _path(error)
    for inner in (str(context.get("discriminator", "")).strip("'"), str(context.get("field", ""))):
        path = join(path, inner)
    name = path.rpartition(".")[2]
    match error["type"]:
        case "union_tag_invalid":
            return path, f"must be one of {context['expected_tags']}, not {context['tag']!r}"
        case "missing" | "union_tag_not_found":
            return path, f"missing: {_EXAMPLES[name]}" if name in _EXAMPLES else "missing"
        case "extra_forbidden" | "unexpected_keyword_argument":
            remedy = f": name it x_{name}, or omit it" if error["loc"][0] in _RECORDS else ""
            return path, f"unknown field{remedy}"
        case "int_type":
            return path, not_an_integer(error["input"], name)
        case "string_pattern_mismatch" if name in _EXAMPLES:
            return path, f"must be {_EXAMPLES[name]}"
    text = _PROBLEMS.get(error["type"])
    return path, text.format(**context) if text else error["msg"]


_RECORDS: Final = ("header", "event", "end")
"""The tags of a line: only there vendor keys are allowed."""
_TAGS: Final = frozenset(("header", "end", *get_args(MessageType), "CAM"))
"""The tags with which pydantic begins a path: the model chosen for a line or a message."""


def _path(error: ErrorDetails) -> str:
    """The path of an error, without the tags that pydantic adds for discriminated unions."""
    loc = error["loc"]
    if loc[:1] == ("event",):
        loc = loc[3:] if loc[1:2] == ("timer",) else loc[2:]
        if loc[:1] == ("timer",):
            loc = ("timer", *loc[2:])
    elif loc and loc[0] in _TAGS:
        loc = loc[1:]
    path = ""
    for part in loc:
        path = join(path, f"[{part}]" if isinstance(part, int) else part)
    return path
