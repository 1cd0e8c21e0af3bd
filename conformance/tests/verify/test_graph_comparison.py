"""The walk of the oracle through the reference, and its report of differences."""

from __future__ import annotations

from typing import Any

import pytest

from automcm_maintenance.verify.graph_comparison import covered, explain, walk
from automcm_maintenance.verify.spec_mapping import (
    Reference,
    abstract,
    abstract_input,
    answer,
    concrete,
    without,
)
from automcm_spec.graph import oracle_generation
from automcm_spec.graph.oracle import Oracle, load
from automcm_spec.vocabulary.station import Cam, Receive

PEER = 2


@pytest.fixture(scope="module")
def oracle() -> Oracle:
    return load(oracle_generation.ONE_PEER.path, oracle_generation.spec_hash())


def test_the_map_is_its_own_inverse_on_every_state(oracle: Oracle) -> None:
    assert all(abstract(concrete(state)) == state for state in oracle.states)


@pytest.mark.slow
def test_the_map_is_its_own_inverse_on_every_input_that_changes_something(
    oracle: Oracle, monkeypatch: pytest.MonkeyPatch
) -> None:
    """But for what neither looks at: is a CAM newer if none was heard, does an Advertisement of
    its own concern it."""

    class Back(Reference):
        def apply(self, value: Any) -> Any:
            before = self.station.state
            given, (only,) = self.give(value)
            assert only.input is not None
            looked_at = len(value)
            match value:
                case Cam() if before.heard_ms is None:
                    looked_at = 3
                case Receive(message=m) if (m.type, m.src) != ("Advertisement", PEER):
                    looked_at = 2
            taken = abstract_input(self.station.me, before, only.input)
            assert taken[:looked_at] == value[:looked_at]
            return answer(before, given, only)

    monkeypatch.setattr(oracle, "answers", oracle.changes)
    assert walk(oracle, Back(oracle.constants)).divergences == []


def test_every_state_differs_in_the_reference(oracle: Oracle) -> None:
    assert len({repr(concrete(state)) for state in oracle.states}) == len(oracle.states)


@pytest.mark.parametrize("rule", ["NEG-4", "ADV-8", "END-4"])
def test_a_missing_rule_is_missed_and_named(oracle: Oracle, rule: str) -> None:
    result = walk(oracle, Reference(oracle.constants, without(rule)), stop_at_first=True)
    found = result.divergences[0]
    assert found.rule == (rule if rule != "END-4" else "NEG-6")
    assert f"Station.tla:{found.line}" in explain(found) and found.line > 0


def test_the_path_to_a_difference_is_a_shortest_one(oracle: Oracle) -> None:
    result = walk(oracle, Reference(oracle.constants, without("NEG-3")), stop_at_first=True)
    inputs = result.divergences[0].inputs
    assert [i.kind for i in inputs[:2]] == ["receive", "receive"] and len(inputs) == 3


@pytest.mark.slow
def test_marks_are_compared(oracle: Oracle, monkeypatch: pytest.MonkeyPatch) -> None:
    class Unmarked(Reference):
        def marks(self) -> Any:
            return frozenset()

    monkeypatch.setattr(oracle, "answers", oracle.changes)
    result = walk(oracle, Unmarked(oracle.constants))
    assert {d.rule for d in result.divergences} == {"ACT-5"}


def test_a_rule_that_nothing_misses_is_uncovered(oracle: Oracle) -> None:
    def nothing_is_taken_away(rule: str) -> Reference:
        return Reference(oracle.constants)

    small = load(oracle_generation.ONE_PEER.path)
    small.states = small.states[:1]
    small.answers = lambda n: iter(())  # type: ignore[method-assign,assignment]
    assert "NEG-4" in covered(small, nothing_is_taken_away).uncovered
