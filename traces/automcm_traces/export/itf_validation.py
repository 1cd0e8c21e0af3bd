"""The schema of a counterexample's states, checked before steps are made from them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Annotated, Any, NotRequired

from pydantic import ConfigDict, Field, Strict, TypeAdapter, ValidationError
from typing_extensions import TypedDict

from automcm_spec.support.bad_input import errors_of
from automcm_traces.export.itf import ItfError, ItfState

Json = Any
Pair = Annotated[list[int], Field(min_length=2, max_length=2)]


class _Entry(TypedDict):
    type: str
    to: int
    session: Pair
    seq: int
    accepted: bool


class _Message(TypedDict):
    type: str
    src: int
    dst: int
    session: Pair
    seq: int
    proposal: int
    accepted: bool
    reason: str
    of: Annotated[list[str | int], Field(min_length=2, max_length=2)]


class _Station(TypedDict):
    phase: str
    role: str
    session: Pair
    recorded: list[int]
    withdrawn: list[int]
    target: int
    proposal: int
    deciding: bool
    heard: bool
    number: int
    joined: list[Pair]
    outbox: list[_Entry]
    quarantine: bool
    backoff: bool


_Array = Strict(False)
"""For a tuple that is a list here; its items stay strict."""
_Timer = Annotated[tuple[str], _Array] | Annotated[tuple[str, int | _Entry], _Array]
_Armed = Annotated[tuple[_Timer, int], _Array]
"""A timer, and the ticks until it is due."""


class _State(TypedDict):
    __pydantic_config__ = ConfigDict(strict=True)  # type: ignore[misc]

    st: list[_Station]
    net: list[_Message]
    clock: NotRequired[list[list[_Armed]]]
    next: NotRequired[list[int]]
    lost: NotRequired[list[int]]
    input: Annotated[list[Json], Field(min_length=1)]
    station: NotRequired[int]


_STATE = TypeAdapter(_State)
_STATE_FIELDS = ("st", "net", "clock", "next", "lost")


def check(states: Sequence[ItfState]) -> None:
    """Raise ItfError, naming state and field, unless the states are stations with an input each."""
    stations = 0
    for index, state in enumerate(states):
        found = _checked(index, state)
        stations = stations or len(found["st"])
        timed = {"clock", "next"} if "clock" in states[0].values else set()
        if lacking := sorted(timed - found.keys()):
            raise _refused(index, f"{lacking[0]}: missing")
        for name in ("st", "clock", "next", "lost"):
            if name in found and len(found[name]) != stations:
                raise _refused(index, f"{name}: must have {stations} entries, one per station")
        if not 0 <= found.get("station", 0) <= stations:
            raise _refused(index, f"station: must be from 0 to {stations}")


def _checked(index: int, state: ItfState) -> dict[str, Json]:
    given: dict[str, Json] = {"input": ["none"]} if index == 0 else {}
    given |= {name: _opened(v) for name, v in state.values.items() if name in _STATE_FIELDS}
    given |= {name: _opened(v) for name, v in state.meta.items() if name in ("input", "station")}
    try:
        _STATE.validate_python(given)
    except ValidationError as error:
        raise _refused(index, ": ".join(errors_of(error)[0])) from None
    return given


def _refused(index: int, problem: str) -> ItfError:
    return ItfError(f"state {index}: not a step of a station: {problem}")


def _opened(value: object) -> Json:
    """Plain JSON; a function that is not a record becomes a list of pairs."""
    if isinstance(value, Mapping):
        if all(isinstance(key, str) for key in value):
            return {key: _opened(item) for key, item in value.items()}
        return [[_opened(key), _opened(item)] for key, item in value.items()]
    if isinstance(value, tuple | list | frozenset):
        return [_opened(item) for item in value]
    return value
