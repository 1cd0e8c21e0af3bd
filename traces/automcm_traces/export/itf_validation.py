"""The states of a counterexample as values of the specification, checked against its types."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, Any

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from automcm_spec.support.bad_input import errors_of
from automcm_spec.vocabulary.station import Message, State, Timer
from automcm_traces.export.itf import ItfError, ItfState


class ModelState(BaseModel):
    """A state of a closed model, and the step that led to it."""

    model_config = ConfigDict(strict=True)

    st: tuple[State, ...]
    net: frozenset[Message]
    clock: tuple[dict[Timer, int] | tuple[()], ...] | None = None
    """For each station of a timed model, by timer, the ticks until it is due."""
    next: tuple[int, ...] | None = None
    """For each station, the ticks until it sends a CAM."""
    lost: tuple[int, ...] | None = None
    """For each station, the ticks that its clock has lost (Drift.tla)."""
    input: Annotated[list[Any], Field(min_length=1)]
    """The input, in its JSON form."""
    station: int = 0
    """0 is the radio or time."""


def model_states(states: Sequence[ItfState]) -> list[ModelState]:
    """Raises ItfError, naming state and field, unless the states are stations with an input
    each."""
    found: list[ModelState] = []
    for index, state in enumerate(states):
        given = {"input": ["none"]} if index == 0 else {}
        try:
            one = ModelState.model_validate({**state.values, **given, **state.meta})
        except ValidationError as error:
            raise _refused(index, ": ".join(errors_of(error)[0])) from None
        found.append(one)
        stations, timed = len(found[0].st), found[0].clock is not None
        for name in ("st", "clock", "next", "lost"):
            value = getattr(one, name)
            if value is None and timed and name != "lost":
                raise _refused(index, f"{name}: missing")
            if value is not None and len(value) != stations:
                raise _refused(index, f"{name}: must have {stations} entries, one per station")
        if not 0 <= one.station <= stations:
            raise _refused(index, f"station: must be from 0 to {stations}")
    return found


def _refused(index: int, problem: str) -> ItfError:
    return ItfError(f"state {index}: not a step of a station: {problem}")
