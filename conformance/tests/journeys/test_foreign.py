"""make test-foreign: the mutants of the C++ station, and the criterion for a pass."""

from __future__ import annotations

import foreign

from automcm_maintenance.code_mutation import faults
from automcm_spec.vocabulary.rules import RULES


def test_the_mutants_are_well_formed() -> None:
    found, combined = (faults.load(name).values() for name in ("cpp", "cpp_combined"))
    assert (len(found), len(combined)) == (32, 10)
    for mutant in [*found, *combined]:
        assert mutant.story.endswith(".") and set(mutant.notice["rules"]) <= set(RULES)
    assert all(len(mutant.edits) == len(mutant.notice["rules"]) == 2 for mutant in combined)


def test_what_foreign_takes_for_a_pass() -> None:
    case = {"id": "x", "verdict": "PASS", "level": "MUST", "expected": True, "reason": ""}
    good = {"cases": [case], "problems": [], "coverage": {"transitions": [3, 3]}}
    assert foreign.wrong(0, good) == ""
    assert foreign.wrong(1, good) == "exit code 1"
    assert foreign.wrong(0, good | {"cases": [case | {"verdict": "SKIP"}]}) == "x: SKIP "
    assert foreign.wrong(0, good | {"problems": ["cut short"]}) == "cut short"
    assert "2 of 3" in foreign.wrong(0, good | {"coverage": {"transitions": [2, 3]}})
    assert "0 of 0" in foreign.wrong(0, good | {"coverage": {"transitions": [0, 0]}})
    failed = {"id": "y", "verdict": "FAIL", "failures": [{"rule": "NEG-1"}, {"rule": "END-3"}]}
    assert foreign.fitting({"cases": [case, failed]}, ("END-3",)) == ("y", "END-3")
    assert foreign.fitting({"cases": [case, failed]}, ("END-4",)) == ("", "")
