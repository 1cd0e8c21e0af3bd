"""The adapter: the rules without one."""

from __future__ import annotations

from typing import Any

from automcm_stage import ME, cancel

from automcm.core.outcome import Me, Received
from automcm.core.rules import RULES, decide
from automcm.core.state import State
from automcm_maintenance.verify.spec_mapping import without

IN_SESSION_1 = State(phase="INTENDING", role="receiver", session=(9, 1))
LIMITS = Me(ME, 2, 2, 9, 2, 100, 1)


def decided(message: Any, rule: str = "END-4") -> str:
    return decide(LIMITS, IN_SESSION_1, Received(message), without(rule))[0]


def test_without_end_4_any_session_of_the_same_prescriber_is_the_own_one() -> None:
    same, newer, other = cancel(src=9), cancel(src=9, session=(9, 2)), cancel(src=8, session=(8, 2))
    assert [decided(m) for m in (same, newer, other)] == ["END-2", "END-2", "END-3"]
    assert [decided(m, "NEG-4") for m in (same, newer, other)] == ["END-2", "END-3", "END-3"]


def test_without_takes_the_rows_of_one_rule_from_a_copy() -> None:
    before = {name: tuple(rows) for name, rows in RULES.items()}
    kept = without("NEG-4")
    gone = [row for name in RULES for row in RULES[name] if row not in kept[name]]
    assert [row.rule for row in gone] == ["NEG-4"]
    assert before == RULES
