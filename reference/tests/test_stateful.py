"""Several stations, whatever happens: the properties, the oracle, and bugs that must be found."""

from __future__ import annotations

import pytest
import stateful
from seeded_bugs import BUGS, Bug, hunt
from stateful import Coordination, profile, repeated, run
from stateful_oracle import PROPERTIES, Coverage

BATCHES = 3
MOST_BATCHES = 12


def test_s_1_to_s_7_t_1_to_t_3_and_the_oracle() -> None:
    """The CI profile.  All rules and phases must be met; for a while it goes on until they are."""
    total = Coverage()
    for seed in range(1, MOST_BATCHES + 1):
        total.add(run(Coordination, profile(100, 50, steered=seed == 3), seed))
        if seed >= BATCHES and not total.rules_and_phases_missing():
            break
    print(total.report())
    assert total.rules_and_phases_missing() == []
    assert not total.cannot_tell


def test_what_is_not_met_is_reported() -> None:
    missing = run(Coordination, profile(2, 5), 1).rules_and_phases_missing()
    assert "rule NEG-4" in missing
    assert "phase receiver ACTUATING" in missing
    assert "property T-2: nothing to look at" in missing


def test_same_seed_same_run() -> None:
    first, second = (run(Coordination, profile(10, 40), 5) for _ in range(2))
    assert first == second


MORE = 3
"""Steps by which no seed need come closer, whatever it draws."""


@pytest.mark.no_cover
@pytest.mark.parametrize("name", BUGS)
def test_a_seeded_bug_is_found_and_shortened(name: str) -> None:
    """A change of the machine changes what a seed draws, and so do the constants in whatever
    modules are loaded (hypothesis draws from them), so the next seeds count as well.
    ``python reference/tests/seeded_bugs.py`` tells what to write into the table."""
    bug: Bug = BUGS[name]
    found: dict[int, list[stateful.Call]] = {}
    for seed in range(bug.seed, bug.seed + 12):
        what, calls = hunt(bug, seed)
        if what == bug.what:
            found.setdefault(len(calls) - 1, calls)
        if found and min(found) <= bug.steps + MORE:
            break
    calls = found[min(found)]
    print(stateful.told(calls))
    assert len(calls) - 1 <= bug.steps + MORE
    assert repeated(Coordination, calls) == ""  # without the bug nothing breaks


def test_each_property_finds_a_bug() -> None:
    assert {bug.what for bug in BUGS.values()} >= set(PROPERTIES)
