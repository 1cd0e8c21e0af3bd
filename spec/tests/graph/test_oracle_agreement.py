"""The comparison of the compiled station with a graph sees what differs."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest

from automcm_spec.graph import oracle, oracle_agreement, oracle_generation
from automcm_spec.vocabulary import json_forms
from automcm_spec.vocabulary.json_forms import canonical
from automcm_spec.vocabulary.station import Input, OpenStation, Outcome, State


@pytest.fixture(scope="module")
def tight() -> oracle.Oracle:
    return oracle.load(oracle_generation.TIGHT.path, oracle_generation.spec_hash())


def stepping(change: Callable[[Outcome], Outcome]) -> type[OpenStation]:
    class Wrong(OpenStation):
        def step(self, me: int, st: State, i: Input) -> Outcome:
            return change(super().step(me, st, i))

    return Wrong


def of(tight: oracle.Oracle, made: type[OpenStation]) -> oracle_agreement.Agreement:
    station = json_forms.open_station(tight.constants)
    station.__class__ = made
    return oracle_agreement.compare(tight, station)


@pytest.mark.parametrize(
    "graph",
    [
        oracle_generation.TIGHT,
        pytest.param(oracle_generation.ONE_PEER, marks=pytest.mark.slow),
        pytest.param(oracle_generation.TWO_PEERS, marks=pytest.mark.deep),
    ],
    ids=lambda g: g.name,
)
def test_the_compiled_station_is_that_of_the_graph(graph: oracle_generation.Graph) -> None:
    known = oracle.load(graph.path, oracle_generation.spec_hash())
    found = oracle_agreement.compare(known, json_forms.open_station(known.constants))
    assert [str(difference) for difference in found.found] == []
    assert found.differences == 0 and found.states == len(known.states)
    assert found.inputs == known.transitions + known.refusals


@pytest.mark.sweep(1)
@pytest.mark.parametrize(
    "change",
    [
        lambda o: o._replace(st=o.st._replace(proposal=o.st.proposal + 1)),
        lambda o: o._replace(st=o.st._replace(heard=int(o.st.heard))),
        lambda o: o._replace(out=frozenset()),
        lambda o: o._replace(out=frozenset(m._replace(accepted=int(m.accepted)) for m in o.out)),
        lambda o: o._replace(told=("other",)),
        lambda o: o._replace(rule="MSG-1"),
        lambda o: o._replace(arm=frozenset()),
        lambda o: o._replace(stop=frozenset()),
    ],
)
def test_each_part_of_an_outcome_counts(
    tight: oracle.Oracle, change: Callable[[Outcome], Outcome]
) -> None:
    found = of(tight, stepping(change))
    assert found.differences and len(found.found) <= oracle_agreement.LIMIT
    first = found.found[0]
    assert first.input is not None and canonical(first.expected) != canonical(first.actual)
    assert "\n  TLC      " in str(first) and "\n  compiled " in str(first)


def test_an_exception_is_a_difference(tight: oracle.Oracle) -> None:
    class Broken(OpenStation):
        def step(self, me: int, st: State, i: Input) -> Outcome:
            raise LookupError("nothing")

    assert "LookupError: nothing" in str(of(tight, Broken).found[0])


@pytest.mark.slow
def test_marks_invariant_alphabet_and_offered_count(tight: oracle.Oracle) -> None:
    class Unmarked(OpenStation):
        def marks(self, st: State) -> frozenset[tuple[int, int]]:
            return frozenset()

    class Unbounded(OpenStation):
        def station_type_inv(self, me: int, st: State) -> bool:
            return False

    class Deaf(OpenStation):
        def from_peer(self, p: int) -> frozenset[Any]:
            return frozenset()

    class Free(OpenStation):
        def offered(self, x: State, i: Input) -> bool:
            return True

    assert of(tight, Unmarked).found[0].input is None
    assert of(tight, Unbounded).differences == len(tight.states)
    assert of(tight, Deaf).found[0].state is None
    assert of(tight, Free).found[0].expected == {"offered": False}
