"""Compares the reference with an oracle: every state, every input, every refusal.

The walk follows shortest paths, so the reference really reaches each state, and the first
difference has a shortest path.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from automcm_spec.graph.oracle import Oracle, OracleAnswer
from automcm_spec.vocabulary.json_forms import canonical, to_json
from automcm_spec.vocabulary.rules import NO_GRAPH, RULES, line
from automcm_spec.vocabulary.station import Input

if TYPE_CHECKING:
    from automcm_maintenance.verify.spec_mapping import Reference

LIMIT = 20
"""At most this many differences of each rule are kept; all are counted."""


@dataclass(frozen=True, slots=True)
class Divergence:
    """One difference: the inputs that lead to it, the expected answer and the actual answer."""

    inputs: list[Input]
    """The shortest sequence from the initial state; the answer to the last one differs."""
    rule: str
    line: int
    """The line of the rule in Station.tla."""
    expected: dict[str, Any]
    actual: dict[str, Any]

    def as_dict(self) -> dict[str, Any]:
        """The object in the output of ``--json``."""
        return {
            "inputs": to_json(self.inputs),
            "rule": self.rule,
            "line": self.line,
            "expected": {name: to_json(value) for name, value in self.expected.items()},
            "actual": {name: to_json(value) for name, value in self.actual.items()},
        }


@dataclass(slots=True)
class WalkResult:
    """The results of the walk so far."""

    states: int = 0
    inputs: int = 0
    divergences: list[Divergence] = field(default_factory=list)
    decided: Counter[str] = field(default_factory=Counter)
    """The number of inputs that each rule decides."""
    differing: Counter[str] = field(default_factory=Counter)
    """The number of differences among them."""

    @property
    def differences(self) -> int:
        """The number of all differences, including those not kept."""
        return self.differing.total()


def expected_of(oracle: Oracle, answer: OracleAnswer) -> dict[str, Any]:
    """The specification's answer, with the names of a report."""
    effect = answer.effect
    return {
        "state": oracle.states[answer.next],
        "messages": effect.messages,
        "told": effect.indication,
        "arm": effect.arm,
        "stop": effect.stop,
    }


def _apply(adapter: Reference, value: Input) -> dict[str, Any]:
    """The implementation's answer; an exception counts as a wrong answer."""
    try:
        messages, indications, arm, stop = adapter.apply(value)
        return {
            "state": adapter.state(),
            "messages": _ordered(messages),
            "told": indications,
            "arm": _ordered(arm),
            "stop": _ordered(stop),
        }
    except Exception as error:  # foreign code may raise any exception
        return {"error": f"{type(error).__name__}: {error}"}


def _ordered(values: Sequence[Any]) -> tuple[Any, ...]:
    """In the order of an Effect."""
    return tuple(sorted(values, key=canonical) if len(values) > 1 else values)


def walk(
    oracle: Oracle,
    adapter: Reference,
    *,
    stop_at_first: bool = False,
) -> WalkResult:
    """Compare every state and every possible input, with a new adapter.

    An exception of the implementation is a difference.  If it cannot enter a state, no input is
    compared there.
    """
    result = WalkResult()

    def differ(
        state: int, value: Input | None, rule: str, exp: dict[str, Any], act: dict[str, Any]
    ) -> None:
        result.differing[rule] += 1
        if result.differing[rule] <= LIMIT:
            inputs = [oracle.inputs[i] for i in oracle.path(state)]
            inputs += [] if value is None else [value]
            where = line(rule, inputs[-1]) if inputs else 0
            result.divergences.append(Divergence(inputs, rule, where, exp, act))

    reached: dict[int, Any] = {0: adapter.station.state}
    for n, state in enumerate(oracle.states):
        here = {"state": state, "marks": oracle.marks[n]}
        answers: Iterable[OracleAnswer] = oracle.answers(n)
        try:
            adapter.put(state)
            round_trip = {"state": adapter.state(), "marks": adapter.marks()}
        except Exception as error:  # for example an unknown field of the state
            round_trip, answers = {"error": f"{type(error).__name__}: {error}"}, ()
        if round_trip != here:
            differ(n, None, "ACT-5", here, round_trip)
        base = reached.pop(n, None) or adapter.station.state
        for answer in answers:
            value = oracle.inputs[answer.input]
            adapter.put_state(base)
            actual = _apply(adapter, value)
            expected = expected_of(oracle, answer)
            result.inputs += 1
            result.decided[answer.effect.rule] += 1
            if actual != expected:
                differ(n, value, answer.effect.rule, expected, actual)
            elif oracle.parents[answer.next] == (n, answer.input) and answer.next != n:
                reached[answer.next] = adapter.station.state
        result.states += 1
        if stop_at_first and result.differences:
            break
    return result


def explain(divergence: Divergence) -> str:
    """A difference as text: the inputs that lead to it, the spec's answer and the code's."""
    parts = [f"{divergence.rule} (Station.tla:{divergence.line})"]
    parts += [f"  {n}. {canonical(value)}" for n, value in enumerate(divergence.inputs, 1)]
    if "error" in divergence.actual:
        return "\n".join([*parts, f"  code raises {divergence.actual['error']}"])
    for name, value in divergence.expected.items():
        actual = divergence.actual[name]
        if actual != value:
            parts.append(f"  {name}: spec {canonical(value)}")
            parts.append(f"  {' ' * len(name)}  code {canonical(actual)}")
    return "\n".join(parts)


@dataclass(slots=True)
class Coverage:
    """``covered``: the rules whose removal the walk detected, with the rule it reported."""

    covered: dict[str, str] = field(default_factory=dict)
    uncovered: list[str] = field(default_factory=list)


def covered(
    oracle: Oracle, ablated: Callable[[str], Reference], *, wanted: Iterable[str] = RULES
) -> Coverage:
    """Walk ``ablated``, the reference without one rule, until there is a difference; each in turn.

    Rules that no graph can cover are listed with the test that covers them.
    """
    result = Coverage()
    for rule in wanted:
        if rule in NO_GRAPH:
            continue
        found = walk(oracle, ablated(rule), stop_at_first=True).divergences
        if found:
            result.covered[rule] = found[0].rule
        else:
            result.uncovered.append(rule)
    return result
