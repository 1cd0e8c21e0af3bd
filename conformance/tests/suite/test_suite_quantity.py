"""The cases ``quantity …``, and what only many or large values show: each fault is found."""

from __future__ import annotations

import pytest
from suite_stage import Suite, graph, of
from suite_stage import conform as conform
from wrong_station import station

from automcm_conformance.suite import purposes
from automcm_maintenance.code_mutation import faults
from automcm_spec.graph.growing_graph import GrowingGraph
from automcm_spec.graph.oracle_generation import TIGHT
from automcm_spec.vocabulary.parameters import LIMITS
from automcm_spec.vocabulary.station import Expire

FAULTS = faults.load("quantities")
TEXTS = "AMCM/PRE/ADV/BV-05"
QUICK = ("8 participants", "3 rounds", "__proto__ lost")
"""The faults that are tried in the quick set."""


@pytest.mark.sweep(1)
@pytest.mark.parametrize(
    ("name", "case"),
    [
        pytest.param(name, case, marks=[pytest.mark.slow] * (name not in QUICK))
        for name, fault in FAULTS.items()
        for case in fault.notice["cases"]
    ],
)
def test_each_fault_of_quantity_is_found(conform: Suite, name: str, case: str) -> None:
    found = conform(FAULTS[name].command("quantities", "automcm.adapters.adapter_lines"), case)
    assert of(found, case).verdict == "FAIL", of(found, case).reason


def test_a_growing_graph_answers_as_the_stored_one() -> None:
    stored = graph(TIGHT.path)
    grown = GrowingGraph(stored.spec_hash)
    grown.limited({name: stored.constants[constant] for name, constant in LIMITS.items()})
    refused = 0
    for n, state in enumerate(stored.states[::40]):
        there = stored.state_index[state]
        assert grown.marks[grown.state_index[state]] == stored.marks[there]
        for value in stored.inputs:
            here = grown.answer(grown.state_index[state], grown.input_index[value])
            answer = stored.answer(there, stored.input_index[value])
            if answer is None:
                refused += 1
                assert here is None or not isinstance(value, Expire) or value.timer[0] == "forget"
                continue
            assert here is not None, (n, value)
            assert (here.effect, here.changes) == (answer.effect, answer.changes)
            assert grown.states[here.next] == stored.states[answer.next]
    assert refused


def test_a_station_may_refuse_a_scenario_that_it_does_not_know(conform: Suite) -> None:
    code = """
def answer(c):
    if c.get('command', {}).get('scenario', 'lane_change') != 'lane_change':
        return right(c | {'command': {'name': 'complete', 'session': [4711, 99]}})
    return right(c)
"""
    assert of(conform(station(code), TEXTS), TEXTS).verdict == "PASS"


@pytest.mark.slow
def test_a_word_selects_the_cases_of_its_name(conform: Suite) -> None:
    found = conform(station(), "quantity")
    wanted = {p.id for p in purposes.load() if p.case.startswith("quantity ")}
    assert TEXTS in wanted and {case.id for case in found.cases} == wanted
    assert {case.verdict for case in found.cases} == {"PASS"}
