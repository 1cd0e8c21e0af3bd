"""The adapter: a rule is taken away for a while only."""

from __future__ import annotations

import pytest

from automcm import outcome
from automcm.adapter import without
from automcm.rules import RULES
from automcm.state import State

IN_SESSION_1 = State(phase="INTENDING", role="receiver", session=(9, 1))


def test_end_4_guard_is_loose_within_without_and_restored_afterwards() -> None:
    strict = outcome.in_session
    assert not strict(IN_SESSION_1, (9, 2))
    with without("END-4"):
        assert outcome.in_session(IN_SESSION_1, (9, 2))
        assert not outcome.in_session(IN_SESSION_1, (8, 2))
    assert outcome.in_session is strict
    assert not outcome.in_session(IN_SESSION_1, (9, 2))


def test_end_4_guard_is_restored_after_an_error() -> None:
    strict = outcome.in_session
    with pytest.raises(RuntimeError), without("END-4"):
        raise RuntimeError
    assert outcome.in_session is strict


def test_without_takes_the_rows_of_one_rule_from_a_copy() -> None:
    before = {name: tuple(rows) for name, rows in RULES.items()}
    strict = outcome.in_session
    with without("NEG-4") as kept:
        assert outcome.in_session is strict
        gone = [row for name in RULES for row in RULES[name] if row not in kept[name]]
        assert [row.rule for row in gone] == ["NEG-4"]
    assert before == RULES
