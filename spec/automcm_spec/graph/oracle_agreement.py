"""Compares the compiled station with a graph written by TLC, for every state and every input.

For each state it compares the invariant, the marks, and the offered inputs; for each offered input
the next state, the messages, the indication, the rule, and the timers.
"""

from __future__ import annotations

from collections.abc import Callable
from copy import copy
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Any

from automcm_spec.graph.oracle import Effect, Oracle
from automcm_spec.vocabulary.json_forms import canonical
from automcm_spec.vocabulary.station import Input, OpenStation, State

LIMIT = 20
"""The maximum number of differences kept; all are counted."""


@dataclass(frozen=True, slots=True)
class OracleDifference:
    """A difference: TLC's value and the compiled one. ``input`` is None for a property of the
    state; ``state`` is also None for the alphabet."""

    state: State | None
    input: Input | None
    expected: Any
    actual: Any

    def __str__(self) -> str:
        lines = [f"compiled station: {canonical(self.input)} in {canonical(self.state)}"]
        lines += [f"  TLC      {canonical(self.expected)}", f"  compiled {canonical(self.actual)}"]
        return "\n".join(lines)


@dataclass(slots=True)
class Agreement:
    """The result of a comparison."""

    states: int = 0
    inputs: int = 0
    differences: int = 0
    found: list[OracleDifference] = field(default_factory=list)


def compare(oracle: Oracle, station: OpenStation) -> Agreement:
    """Compare every state and every input."""
    result = Agreement()

    def differ(state: State | None, value: Input | None, expected: Any, actual: Any) -> None:
        result.differences += 1
        if len(result.found) < LIMIT:
            result.found.append(OracleDifference(state, value, expected, actual))

    # The armed timers of a state are computed for each of its inputs.
    station = copy(station)
    station.__dict__["armed"] = lru_cache(maxsize=8)(station.armed)
    alphabet = _tried(lambda: station.alphabet)
    if canonical(alphabet) != canonical(oracle.inputs):
        differ(None, None, oracle.inputs, alphabet)
    effects: dict[int, tuple[Any, ...]] = {}
    for n, st in enumerate(oracle.states):
        result.states += 1
        wanted = True, oracle.marks[n]
        facts = _tried(lambda st: (station.station_type_inv(station.me, st), station.marks(st)), st)
        if facts != wanted or _kinds(facts) != _kinds(wanted):
            differ(st, None, wanted, facts)
        for i in range(len(oracle.inputs)):
            answer, given = oracle.answer(n, i), oracle.inputs[i]
            offered = _tried(station.offered, st, given)
            if offered is not (answer is not None):
                differ(st, given, {"offered": answer is not None}, offered)
            if answer is None:
                continue
            result.inputs += 1
            if id(answer.effect) not in effects:
                effects[id(answer.effect)] = _typed(answer.effect)
            expected = (oracle.states[answer.next], *effects[id(answer.effect)])
            outcome = _tried(station.step, station.me, st, given)
            if outcome != expected or not _is_exact(outcome, expected, st):
                differ(st, given, expected, outcome)
    return result


def _tried(call: Callable[..., Any], *given: Any) -> Any:
    """The result, or the exception as text: a wrong compiler may cause any exception."""
    try:
        return call(*given)
    except Exception as error:
        return (f"{type(error).__name__}: {error}",)


def _typed(effect: Effect) -> tuple[Any, ...]:
    arm, stop = frozenset(effect.arm), frozenset(effect.stop)
    return frozenset(effect.messages), effect.indication, effect.rule, arm, stop


def _is_exact(outcome: tuple[Any, ...], expected: tuple[Any, ...], st: State) -> bool:
    """Whether equal values also have equal types: Python treats True and 1 as equal."""
    new, out, _, _, arm, stop = outcome
    return (new is st and not (out or arm or stop)) or _kinds(outcome) == _kinds(expected)


def _kinds(value: Any) -> Any:
    """The types of a value's parts, in its shape."""
    if isinstance(value, tuple):
        return tuple(map(_kinds, value))
    if isinstance(value, frozenset):
        return frozenset(map(_kinds, value)) if value else value
    return type(value)
