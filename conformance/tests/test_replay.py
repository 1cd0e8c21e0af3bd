"""Behaviours of the closed models, replayed into reference stations."""

from __future__ import annotations

from typing import Any

import pytest

from automcm.adapter import Reference, without
from automcm_conformance.replay import input_seen, replay, state_seen
from automcm_spec import simulate

Behaviour = list[tuple[int, Any, Any]]


@pytest.fixture(scope="module")
def behaviours() -> list[Behaviour]:
    return simulate.behaviours(12, 40, 7, lively=True)


def fresh() -> Reference:
    return Reference(simulate.CONSTANTS)


def test_behaviours_of_four_stations_agree(behaviours: list[Behaviour]) -> None:
    assert len(behaviours) == 12 and all(len(b) > 10 for b in behaviours)
    assert len({who for b in behaviours for who, _, _ in b}) == 4
    assert [replay(b, fresh) for b in behaviours] == [None] * 12


def test_the_same_seed_gives_the_same_behaviours(behaviours: list[Behaviour]) -> None:
    assert simulate.behaviours(12, 40, 7, lively=True) == behaviours


def test_a_missing_rule_shows(behaviours: list[Behaviour]) -> None:
    rows = without("ADV-3")
    answers = [replay(b, lambda: Reference(simulate.CONSTANTS, rows)) for b in behaviours]
    found = [answer for answer in answers if answer]
    assert found and "spec" in found[0] and "code" in found[0]


def test_an_implementation_that_raises_shows(behaviours: list[Behaviour]) -> None:
    class Broken(Reference):
        def apply(self, value: Any) -> Any:
            raise RuntimeError("no")

    answer = replay(behaviours[0], lambda: Broken(simulate.CONSTANTS))
    assert answer is not None and "RuntimeError: no" in answer


def test_a_station_sees_itself_as_1() -> None:
    entry = ["Cancel", 1, [1, 2], 1, False]
    seen = ["Cancel", 3, [3, 2], 1, False]
    assert input_seen(["expire", ["giveup", entry]], 3) == ["expire", ["giveup", seen]]
    assert input_seen(["expire", ["forget", 3]], 3) == ["expire", ["forget", 1]]
    assert input_seen(["restart"], 3) == ["restart"]
    command = ["command", "prescribe", [3, 1], 1, 1]
    assert input_seen(command, 3) == ["command", "prescribe", [1, 1], 1, 3]
    state = ["WAITING", "receiver", [1, 2], [], [], 0, 0, False, False, 0]
    state += [[[1, 2]], [entry], False, False]
    assert state_seen(state, 3)[2] == [3, 2] and state_seen(state, 3)[11] == [seen]
