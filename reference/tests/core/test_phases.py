"""phases.TABLE is what python-statemachine declares, and a rule takes only a declared transition.

That all of it is taken shows in the stateful tests (``Coverage.missing``).
"""

from __future__ import annotations

import pytest
from automcm_stage import Stage
from statemachine.exceptions import TransitionNotAllowed

from automcm.core import phases, rules
from automcm.core.phases import MACHINES, TABLE, Phase, Role, after

Key = tuple[Role, Phase, str, str]


def taken(role: Role) -> dict[Key, Phase]:
    """What the machine of a role does in every phase, at every event, by every rule."""
    found: dict[Key, Phase] = {}
    machine_class = MACHINES[role]
    for phase in machine_class.states:
        machine = machine_class(start_value=phase.id)
        for event in machine_class.events:
            for rule in sorted({row.rule for rows in rules.RULES.values() for row in rows}):
                try:
                    machine.send(event.id, rule=rule)
                except TransitionNotAllowed:
                    continue
                (reached,) = machine.configuration
                found[role, phase.id, event.id, rule] = reached.id
                machine = machine_class(start_value=phase.id)
    return found


@pytest.mark.parametrize("role", list(MACHINES))
def test_table_and_machine_agree_on_everything(role: Role) -> None:
    assert taken(role) == {key: target for key, target in TABLE.items() if key[0] == role}


def test_what_is_not_declared_raises() -> None:
    with pytest.raises(KeyError):
        after("receiver", "STANDALONE", "open")


def test_a_step_by_a_rule_that_is_not_declared_raises(monkeypatch: pytest.MonkeyPatch) -> None:
    stage = Stage().walk("prescriber", "ADVERTISING")
    monkeypatch.delitem(phases.WAYS, ("prescriber", "ADVERTISING", "STANDALONE", "END-1"))
    with pytest.raises(KeyError, match="END-1 may not lead a prescriber"):
        stage.do(stage.now, "abort", stage.own)
