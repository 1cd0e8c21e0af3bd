"""Counterexamples in ITF, the Informal Trace Format (ADR-015 of Apalache).

The representation of TLA+ values, in Python that of ``tla_values``, and in ITF:

=====================  =========================  ==========================================
TLA+                   Python                     ITF
=====================  =========================  ==========================================
boolean, string        bool, str                  the same
integer                int                        number, beyond 2^53-1 ``{"#bigint": "…"}``
tuple                  tuple                      ``{"#tup": […]}``
set                    frozenset                  ``{"#set": […]}``, sorted
record                 Record                     object
other function         Function                   ``{"#map": [[key, value], …]}``, sorted
=====================  =========================  ==========================================

A sequence, ``[…]``, is read as a tuple. Metadata is plain JSON, written as it is; what JSON cannot
hold becomes ``{"#unserializable": "…"}``.
"""

import json
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field

from automcm_spec.model_checking.tla_values import Function, Record, Value

DESCRIPTION = "https://apalache-mc.org/docs/adr/015adr-trace.html"
LARGEST = 2**53 - 1


class ItfError(ValueError):
    """A trace that is not ITF, or that ITF cannot represent; the text says where."""


@dataclass(frozen=True)
class ItfState:
    """One state of a trace: its variables, and metadata of the step that led to it.

    `meta` may contain ``action``, ``args``, ``rule`` and ``location``. The index of the state is
    its position in the trace.
    """

    values: Mapping[str, object]
    meta: Mapping[str, object] = field(default_factory=dict)


def encode(value: object) -> object:
    """The value as ITF. Raises ItfError for a record with a field that starts with ``#``."""
    if isinstance(value, bool | str):
        return value
    if isinstance(value, int):
        return value if abs(value) <= LARGEST else {"#bigint": str(value)}
    if isinstance(value, list):
        return [encode(item) for item in value]
    if isinstance(value, tuple):
        return {"#tup": [encode(item) for item in value]}
    if isinstance(value, frozenset):
        return {"#set": sorted((encode(item) for item in value), key=_text)}
    if isinstance(value, Mapping):
        if all(isinstance(key, str) for key in value):
            return {_field(key): encode(item) for key, item in value.items()}
        pairs = [[encode(key), encode(item)] for key, item in value.items()]
        return {"#map": sorted(pairs, key=_text)}
    return {"#unserializable": repr(value)}


def decode(value: object) -> Value:
    """The value of an ITF term. Raises ItfError if it is not ITF."""
    match value:
        case bool() | int() | str():
            return value
        case {"#bigint": str(digits), **rest} if not rest:
            if not re.fullmatch(r"-?[0-9]{1,4000}", digits, re.ASCII):
                raise ItfError(f"#bigint must be decimal digits, not {_short(digits)}")
            return int(digits)
        case list():
            return tuple(map(decode, value))
        case {"#tup": list(items), **rest} if not rest:
            return tuple(map(decode, items))
        case {"#set": list(items), **rest} if not rest:
            elements = frozenset(map(decode, items))
            _refuse_collapse(len(elements), items, "#set")
            return elements
        case {"#map": list(pairs), **rest} if not rest:
            if not all(isinstance(pair, list) and len(pair) == 2 for pair in pairs):
                raise ItfError(f"#map must be a list of pairs, not {_short(pairs)}")
            function = Function({decode(key): decode(item) for key, item in pairs})
            _refuse_collapse(len(function), pairs, "#map")
            return function
        case dict():
            return Record({_field(key): decode(item) for key, item in value.items()})
    raise ItfError(f"not an ITF value: {_short(value)}")


def to_itf(
    states: Iterable[ItfState], meta: Mapping[str, object], *, loop: int | None = None
) -> dict[str, object]:
    """The trace as an ITF object.

    `meta` goes into the trace's ``#meta`` (``description``, ``source``, …). `loop` is the index of
    the state to which the last one returns, if the trace is a lasso. Raises ItfError if states
    differ in their variables, or if `loop` is not the index of a state.
    """
    given = list(states)
    names = sorted(given[0].values) if given else []
    written = []
    for index, state in enumerate(given):
        if sorted(state.values) != names:
            raise ItfError(f"state {index} has variables {sorted(state.values)}, not {names}")
        values = {_field(name): encode(state.values[name]) for name in names}
        state_meta = {key: encode(item) for key, item in state.meta.items()}
        written.append({"#meta": {**state_meta, "index": index}, **values})
    itf: dict[str, object] = {
        "#meta": {
            **{key: encode(item) for key, item in meta.items()},
            "format": "ITF",
            "format-description": DESCRIPTION,
        },
        "vars": names,
        "states": written,
    }
    if loop is not None:
        if not 0 <= loop < len(given):
            raise ItfError(f"loop {loop} is not one of {len(given)} states")
        itf["loop"] = loop
    return itf


def from_itf(itf: Mapping[str, object]) -> list[ItfState]:
    """The states of an ITF object. Raises ItfError if it is not one.

    The index is not kept in a state's `meta`, which is otherwise as written.
    """
    names, states = itf.get("vars"), itf.get("states")
    if not isinstance(names, list) or not all(isinstance(name, str) for name in names):
        raise ItfError("'vars' must be a list of names")
    if not isinstance(states, list):
        raise ItfError("'states' must be a list")
    return [_state(index, state, names) for index, state in enumerate(states)]


def dumps(itf: Mapping[str, object]) -> str:
    """The text of an ITF object, byte-stable: sorted keys, one state per line, ASCII."""
    lines = []
    for key in sorted(itf):
        value = itf[key]
        if key == "states" and isinstance(value, list) and value:
            text = "[\n" + ",\n".join(_text(state) for state in value) + "\n]"
        else:
            text = _text(value)
        lines.append(f"{json.dumps(key)}:{text}")
    return "{" + ",\n".join(lines) + "}\n"


def _state(index: int, state: object, names: list[str]) -> ItfState:
    if not isinstance(state, dict):
        raise ItfError(f"state {index} must be an object")
    if sorted(state.keys() - {"#meta"}) != sorted(names):
        raise ItfError(f"state {index} must have the variables {sorted(names)}")
    meta = state.get("#meta", {})
    if not isinstance(meta, dict):
        raise ItfError(f"#meta of state {index} must be an object")
    try:
        values = {name: decode(state[name]) for name in names}
    except ItfError as error:
        raise ItfError(f"state {index}: {error}") from None
    return ItfState(values, {k: v for k, v in meta.items() if k != "index"})


def _refuse_collapse(kept: int, items: list[object], what: str) -> None:
    """Raise ItfError if Python treats distinct elements as equal, such as 1 and True."""
    if kept != len({_text(item) for item in items}):
        raise ItfError(f"{what} has elements that Python treats as equal: {_short(items)}")


def _field(name: str) -> str:
    if name.startswith("#"):
        raise ItfError(f"a name must not start with '#': {_short(name)}")
    return name


def _text(value: object) -> str:
    return json.dumps(value, sort_keys=True, separators=(",", ":"))


def _short(value: object) -> str:
    text = repr(value)
    return text if len(text) <= 80 else text[:77] + "..."
