"""Several stations, whatever happens: the properties, the oracle, and bugs that must be found."""

from __future__ import annotations

import re

import pytest
import stateful
from seeded_bugs import BUGS, hunt
from stateful import Coordination, profile, run
from stateful_oracle import PROPERTIES, Coverage

BUSY = re.compile(r"^  (?:never|false) OnForeignPrescription:\d+ Bound\(st\)$", re.MULTILINE)
"""A condition of Station.tla (NEG-4) that was never true, in a report."""


@pytest.mark.slow
def test_s_1_to_s_7_t_1_to_t_3_and_the_oracle() -> None:
    """Some thousand steps, a million in ``make test-deep``.  All rules and phases must be met; if a
    change of the machine changes what a seed draws, others may be needed for that."""
    total = Coverage()
    for seed in (4, 5, 6):
        total.add(run(Coordination, profile(60, 50, steered=seed == 6), seed))
    print(total.report())
    assert total.rules_and_phases_missing() == []
    assert not BUSY.search(total.report())
    assert 'm.type = "Ack"' not in total.report()  # the last arm of a CASE, which is never false


def test_what_is_not_met_is_reported() -> None:
    coverage = run(Coordination, profile(2, 5), 1)
    missing = coverage.rules_and_phases_missing()
    assert "rule NEG-4" in missing
    assert "phase receiver ACTUATING" in missing
    assert "property T-2: nothing to look at" in missing
    assert BUSY.search(coverage.report())


@pytest.mark.sweep(2)
@pytest.mark.parametrize("name", sorted(BUGS))
def test_a_seeded_bug_is_found(name: str) -> None:
    """``python reference/tests/seeded_bugs.py`` tells what to write into seeded.toml if a change of
    the machine changes what a seed draws."""
    bug = BUGS[name]
    what, calls = hunt(bug, bug.notice["seed"])
    print(stateful.told(calls))
    assert what == bug.notice["what"]


def test_each_property_finds_a_bug() -> None:
    assert {bug.notice["what"] for bug in BUGS.values()} >= set(PROPERTIES)
