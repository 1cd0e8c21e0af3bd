"""phases.TABLE is what python-statemachine declares, no more and no less, guards included."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from types import ModuleType
from typing import get_args

import pytest
from automcm_stage import Stage
from statemachine.exceptions import TransitionNotAllowed

from automcm.core import phases, rules
from automcm.core.phases import MACHINES, NEXT, RULES, TABLE, WAYS, Phase, Role, after, require

Key = tuple[Role, Phase, str, str]

ROWS = {row.rule for rows in rules.RULES.values() for row in rows}
"""The rules that decide anything; most take no transition."""


def taken(machines: ModuleType, role: Role) -> dict[Key, Phase]:
    """What the machine of a role does in every phase, at every event, by every rule."""
    found: dict[Key, Phase] = {}
    machine_class = machines.MACHINES[role]
    for phase in machine_class.states:
        machine = machine_class(start_value=phase.id)
        for event in machine_class.events:
            for rule in sorted(ROWS):
                try:
                    machine.send(event.id, rule=rule)
                except TransitionNotAllowed:
                    assert [state.id for state in machine.configuration] == [phase.id]
                    continue
                (reached,) = machine.configuration
                found[role, phase.id, event.id, rule] = reached.id
                machine = machine_class(start_value=phase.id)
    return found


def of(role: Role, table: Mapping[Key, Phase] = TABLE) -> dict[Key, Phase]:
    return {key: target for key, target in table.items() if key[0] == role}


@pytest.mark.parametrize("role", list(MACHINES))
def test_table_and_machine_agree_on_everything(role: Role) -> None:
    assert taken(phases, role) == of(role)


def test_everything_is_enumerated() -> None:
    assert {len(MACHINES[role].states) * len(MACHINES[role].events) for role in MACHINES} == {
        6 * 8,
        5 * 7,
    }
    assert set(RULES) == {rule for _, _, _, rule in TABLE} <= ROWS
    assert len(set(RULES)) == len(RULES) < len(ROWS)


def test_an_event_leads_to_one_phase_whatever_the_rule() -> None:
    assert all(NEXT[role, phase, event] == to for (role, phase, event, _), to in TABLE.items())
    assert all(after(*key) == to for key, to in NEXT.items())


def test_what_is_required_is_what_is_in_the_table() -> None:
    assert len(WAYS) == len(TABLE), "two events take the same way: require cannot tell them apart"
    for role, machine in MACHINES.items():
        names = [state.id for state in machine.states]
        for before, to, rule in ((b, t, r) for b in names for t in names for r in ROWS):
            event = WAYS.get((role, before, to, rule))
            if event is not None:
                require(role, before, to, rule)
                assert TABLE[role, before, event, rule] == to
                continue
            with pytest.raises(KeyError, match=f"{rule} may not lead a {role} from {before}"):
                require(role, before, to, rule)


def test_what_is_not_declared_raises() -> None:
    with pytest.raises(KeyError):
        after("receiver", "STANDALONE", "open")


def test_every_phase_is_declared_and_no_other() -> None:
    declared = {state.id for machine in MACHINES.values() for state in machine.states}
    assert declared == set(get_args(Phase))
    assert set(TABLE.values()) <= declared
    assert set(MACHINES) == set(get_args(Role)) - {"none"}


# -- each of these can fail


def changed(old: str, new: str) -> ModuleType:
    """phases.py with an edit, as a module of its own."""
    path = Path(str(phases.__file__))
    text = path.read_text()
    assert text.count(old) == 1, "the edit no longer applies"
    module = ModuleType("changed_phases")
    exec(compile(text.replace(old, new), str(path), "exec"), module.__dict__)
    return module


def test_a_missing_guard_is_noticed() -> None:
    machines = changed('STANDALONE.to(ADVERTISING, cond="ADV_1")', "STANDALONE.to(ADVERTISING)")
    assert taken(machines, "prescriber") != of("prescriber", machines.TABLE)


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ('(INTENDING, cond="ADV_3")', '(INTENDING, cond="ADV_11")'),
        ('"ADV-1", "ADV-3", "ADV-6", "ADV-7"', '"ADV-1", "ADV-3", "ADV-6"'),
        ('cond="PRE_1 or END_1"', 'cond="PRE_1 and END_1"'),
    ],
    ids=["unknown rule", "rule gone", "another form"],
)
def test_a_guard_that_does_not_name_rules_is_no_declaration(old: str, new: str) -> None:
    with pytest.raises(KeyError):
        changed(old, new)


@pytest.mark.parametrize("key", [next(iter(TABLE)), list(TABLE)[-1]])
def test_an_entry_too_few_is_noticed(key: Key) -> None:
    rest = {other: to for other, to in TABLE.items() if other != key}
    assert taken(phases, key[0]) != of(key[0], rest)


@pytest.mark.parametrize(
    ("old", "new", "rule"),
    [
        ('(ADVERTISING, cond="ADV_1")', '(ADVERTISING, cond="ADV_3")', "ADV-1"),
        ('cond="PRE_1 or END_1"', 'cond="PRE_1 or END_2"', "END-1"),
        ("        ADVERTISING, CHOOSING, PRESC", "        CHOOSING, PRESC", "END-8"),
    ],
)
def test_a_step_by_a_rule_that_is_not_declared_raises(
    old: str, new: str, rule: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    def walk() -> None:
        stage = Stage().walk("prescriber", "ADVERTISING")
        if rule == "END-8":
            stage.station.restart(stage.now)
        else:
            stage.do(stage.now, "abort", stage.own)
        assert stage.at == ("none", "STANDALONE")

    walk()
    monkeypatch.setattr(rules, "require", changed(old, new).require)
    with pytest.raises(KeyError, match=f"{rule} may not lead a prescriber"):
        walk()
