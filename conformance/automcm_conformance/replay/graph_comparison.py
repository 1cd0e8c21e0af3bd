"""Walks an oracle through an implementation: every state, every input, every refusal.

An implementation stands behind an ``Adapter``.  The walk follows shortest paths, so each state
is one that the implementation really reached, and the first difference met is a shortest one.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from typing import Any, Protocol

from automcm_spec.graph.oracle import Answer, Oracle
from automcm_spec.vocabulary.json_forms import canonical, to_json
from automcm_spec.vocabulary.rules import NO_GRAPH, RULES, line
from automcm_spec.vocabulary.station import Input, Message, Session, State, Timer

LIMIT = 20
"""Differences kept of each rule; the walk goes on counting."""


class Adapter(Protocol):
    """What the walk needs of an implementation."""

    def reset(self) -> None:
        """The initial state."""

    def put(self, state: State) -> None:
        """Be in this state."""

    def put_state(self, state: Any) -> None:
        """Be in this state, which ``save`` gave."""

    def save(self) -> Any:
        """The state, for ``put_state``."""

    def state(self) -> State:
        """The state it is in."""

    def marks(self) -> frozenset[Session]:
        """The sessions that its CAM would name."""

    def apply(
        self, value: Input
    ) -> tuple[Sequence[Message], tuple[str, ...], Sequence[Timer], Sequence[Timer]]:
        """Take an input: messages, indication, timers armed and timers stopped, in any order."""


@dataclass(frozen=True, slots=True)
class Divergence:
    """One difference: how to get there, what the spec says, what the code does."""

    inputs: list[Input]
    """Shortest sequence from the initial state; the last one is answered differently."""
    rule: str
    line: int
    """Of Station.tla."""
    expected: dict[str, Any]
    actual: dict[str, Any]

    def as_dict(self) -> dict[str, Any]:
        """As in ``--json``."""
        return {
            "inputs": to_json(self.inputs),
            "rule": self.rule,
            "line": self.line,
            "expected": {name: to_json(value) for name, value in self.expected.items()},
            "actual": {name: to_json(value) for name, value in self.actual.items()},
        }


@dataclass(slots=True)
class Comparison:
    """What the walk has compared so far."""

    states: int = 0
    inputs: int = 0
    divergences: list[Divergence] = field(default_factory=list)
    decided: Counter[str] = field(default_factory=Counter)
    """Of the inputs, how many each rule decides."""
    differing: Counter[str] = field(default_factory=Counter)
    """How many differences there are where each rule decides."""

    @property
    def differences(self) -> int:
        """All of them, those not kept too."""
        return self.differing.total()


def expected_of(oracle: Oracle, answer: Answer) -> dict[str, Any]:
    """The spec's answer, in the words of a report."""
    effect = answer.effect
    return {
        "state": oracle.states[answer.next],
        "messages": effect.messages,
        "told": effect.told,
        "arm": effect.arm,
        "stop": effect.stop,
    }


def _apply(adapter: Adapter, value: Input) -> dict[str, Any]:
    """The implementation's answer; an exception is an answer too, a wrong one."""
    try:
        messages, indications, arm, stop = adapter.apply(value)
        return {
            "state": adapter.state(),
            "messages": _ordered(messages),
            "told": indications,
            "arm": _ordered(arm),
            "stop": _ordered(stop),
        }
    except Exception as error:  # whatever a stranger's code raises
        return {"error": f"{type(error).__name__}: {error}"}


def _ordered(values: Sequence[Any]) -> tuple[Any, ...]:
    """As in an Effect."""
    return tuple(sorted(values, key=canonical) if len(values) > 1 else values)


def walk(
    oracle: Oracle,
    adapter: Adapter,
    *,
    transitions_only: bool = False,
    stop_at_first: bool = False,
    on_state: Callable[[int], None] | None = None,
) -> Comparison:
    """Compare every state and every offered input (or only those that change something).

    What the implementation raises is a difference.  In a state that it cannot be put into, no
    input is compared.
    """
    result = Comparison()

    def differ(
        state: int, value: Input | None, rule: str, exp: dict[str, Any], act: dict[str, Any]
    ) -> None:
        result.differing[rule] += 1
        if result.differing[rule] <= LIMIT:
            inputs = [oracle.inputs[i] for i in oracle.path(state)]
            inputs += [] if value is None else [value]
            where = line(rule, inputs[-1]) if inputs else 0
            result.divergences.append(Divergence(inputs, rule, where, exp, act))

    adapter.reset()
    reached: dict[int, Any] = {0: adapter.save()}
    for n, state in enumerate(oracle.states):
        if on_state is not None:
            on_state(n)
        here = {"state": state, "marks": oracle.marks[n]}
        answers: Iterable[Answer] = oracle.changes(n) if transitions_only else oracle.answers(n)
        try:
            adapter.put(state)
            round_trip = {"state": adapter.state(), "marks": adapter.marks()}
        except Exception as error:  # for example, a field of the state that it does not know
            round_trip, answers = {"error": f"{type(error).__name__}: {error}"}, ()
        if round_trip != here:
            differ(n, None, "ACT-5", here, round_trip)
        base = reached.pop(n, None) or adapter.save()
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
                reached[answer.next] = adapter.save()
        result.states += 1
        if stop_at_first and result.differences:
            break
    return result


def explain(divergence: Divergence, oracle: Oracle) -> str:
    """A difference in words: how to get there, what the spec says, what the code does."""
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
    """``covered``: rules whose absence the walk noticed, with the rule it then named."""

    covered: dict[str, str] = field(default_factory=dict)
    uncovered: list[str] = field(default_factory=list)
    by_test: dict[str, str] = field(default_factory=lambda: dict(NO_GRAPH))


Ablated = Callable[[str], Adapter]
"""An implementation without one rule."""


def covered(
    oracle: Oracle,
    ablated: Ablated,
    on_rule: Callable[[str], None] | None = None,
    *,
    wanted: Iterable[str] = RULES,
) -> Coverage:
    """Take each rule away and walk until a difference shows.  Rules that no graph can show
    are listed with the test that shows them."""
    result = Coverage()
    for rule in wanted:
        if rule in NO_GRAPH:
            continue
        if on_rule is not None:
            on_rule(rule)
        found = walk(oracle, ablated(rule), stop_at_first=True).divergences
        if found:
            result.covered[rule] = found[0].rule
        else:
            result.uncovered.append(rule)
    return result
