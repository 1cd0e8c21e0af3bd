"""Behaviours of the closed models, replayed into reference stations."""

from __future__ import annotations

from typing import Any

import pytest

from automcm_maintenance.verify.behaviour_replay import replay, seen_by
from automcm_maintenance.verify.spec_mapping import Reference, without
from automcm_spec.model_checking import tlc_simulation
from automcm_spec.model_checking.tlc_simulation import Behaviour
from automcm_spec.vocabulary.renumbering import input_of
from automcm_spec.vocabulary.station import Cam


@pytest.fixture(scope="module")
def behaviours() -> list[Behaviour]:
    return tlc_simulation.behaviours(12, 40, 7, lively=True)


def fresh() -> Reference:
    return Reference(tlc_simulation.CONSTANTS)


@pytest.mark.slow
def test_a_missing_rule_shows(behaviours: list[Behaviour]) -> None:
    rows = without("ADV-3")
    answers = [replay(b, lambda: Reference(tlc_simulation.CONSTANTS, rows)) for b in behaviours]
    found = [answer for answer in answers if answer]
    assert found and "spec" in found[0] and "code" in found[0]


@pytest.mark.slow
def test_an_implementation_that_raises_shows(behaviours: list[Behaviour]) -> None:
    class Broken(Reference):
        def apply(self, value: Any) -> Any:
            raise RuntimeError("no")

    answer = replay(behaviours[0], lambda: Broken(tlc_simulation.CONSTANTS))
    assert answer is not None and "RuntimeError: no" in answer


def test_a_station_sees_itself_as_1() -> None:
    """The other inputs, and states: test_every_transition_of_the_closed_models_is_in_a_log."""
    cam, seen = (Cam("cam", n, frozenset({(4 - n, 1)}), True) for n in (1, 3))
    assert input_of(cam, seen_by(3)) == seen and input_of(seen, seen_by(3)) == cam
