"""phases.TABLE is what python-statemachine declares, no more and no less."""

from __future__ import annotations

from typing import get_args

import pytest
from statemachine.exceptions import TransitionNotAllowed

from automcm.phases import MACHINES, TABLE, Phase, Role, after

EVERY = [
    (role, state.id, event.id)
    for role, machine in MACHINES.items()
    for state in machine.states
    for event in machine().events
]


@pytest.mark.parametrize(("role", "phase", "event"), EVERY)
def test_table_agrees_with_the_state_machine(role: Role, phase: Phase, event: str) -> None:
    machine = MACHINES[role](start_value=phase)
    if (role, phase, event) in TABLE:
        machine.send(event)
        assert [state.id for state in machine.configuration] == [after(role, phase, event)]
        return
    with pytest.raises(TransitionNotAllowed):
        machine.send(event)
    assert [state.id for state in machine.configuration] == [phase]
    with pytest.raises(KeyError):
        after(role, phase, event)


def test_table_has_no_other_entries() -> None:
    assert set(TABLE) <= set(EVERY)
    assert len(EVERY) == len(set(EVERY)) == 6 * 7 + 5 * 6


def test_every_phase_is_declared_and_no_other() -> None:
    declared = {state.id for machine in MACHINES.values() for state in machine.states}
    assert declared == set(get_args(Phase))
    assert set(TABLE.values()) <= declared
    assert set(MACHINES) == set(get_args(Role)) - {"none"}


@pytest.mark.parametrize("role", list(MACHINES))
def test_l_1_every_bound_phase_can_be_left_at_once(role: Role) -> None:
    bound = {state.id for state in MACHINES[role].states} - {"STANDALONE"}
    assert {phase for r, phase, e in TABLE if r == role and e == "leave"} == bound
    assert all(TABLE[role, phase, "leave"] == "STANDALONE" for phase in bound)


@pytest.mark.parametrize("role", list(MACHINES))
def test_every_phase_can_be_reached(role: Role) -> None:
    reached, seen = {"STANDALONE"}, set[str]()
    while reached != seen:
        seen = reached
        reached = seen | {to for (r, phase, _), to in TABLE.items() if r == role and phase in seen}
    assert reached == {state.id for state in MACHINES[role].states}
