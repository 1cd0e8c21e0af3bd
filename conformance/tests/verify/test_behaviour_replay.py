"""Behaviours of the closed models, replayed into reference stations."""

from __future__ import annotations

from typing import Any

import pytest

from automcm_maintenance.verify.behaviour_replay import replay, seen_by
from automcm_maintenance.verify.spec_mapping import Reference, without
from automcm_spec.model_checking import tlc_simulation
from automcm_spec.model_checking.tlc_simulation import Behaviour
from automcm_spec.vocabulary.renumbering import input_of, state
from automcm_spec.vocabulary.station import (
    Cam,
    Command,
    Entry,
    Expire,
    Message,
    Receive,
    Restart,
    Station,
)


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
    to = seen_by(3)
    message = Message("Fin", 1, 3, (1, 2), 1, 0, False, "none", ("none", 0))
    heard = message._replace(src=3, dst=1, session=(3, 2))
    entry, seen = Entry("Cancel", 1, (1, 2), 1, False), Entry("Cancel", 3, (3, 2), 1, False)
    for value, other in (
        (Expire("expire", ("giveup", entry)), Expire("expire", ("giveup", seen))),
        (Expire("expire", ("forget", 3)), Expire("expire", ("forget", 1))),
        (Restart("restart"), Restart("restart")),
        (
            Command("command", "prescribe", (3, 1), 1, 1),
            Command("command", "prescribe", (1, 1), 1, 3),
        ),
        (Cam("cam", 1, frozenset({(3, 1)}), True), Cam("cam", 3, frozenset({(1, 1)}), True)),
        (Receive("receive", message, True), Receive("receive", heard, True)),
    ):
        assert input_of(value, to) == other and input_of(other, to) == value
    waiting = Station(*tlc_simulation.CONSTANTS.values()).initial._replace(
        session=(1, 2),
        recorded=frozenset({1, 2}),
        withdrawn=frozenset({1}),
        target=1,
        joined=frozenset({(1, 1)}),
        outbox=frozenset({entry}),
    )
    assert state(waiting, to) == waiting._replace(
        session=(3, 2),
        recorded=frozenset({2, 3}),
        withdrawn=frozenset({3}),
        target=3,
        joined=frozenset({(3, 1)}),
        outbox=frozenset({seen}),
    )
