"""Cases that no graph carries: each can fail."""

from __future__ import annotations

import pytest
from suite_stage import Suite, of
from suite_stage import conform as conform
from wrong_station import station

from automcm_conformance.exchange import records
from automcm_conformance.suite import graph_cases, purposes
from automcm_maintenance.code_mutation import faults

FAULTS = faults.load("special")


def broken(name: str) -> list[str]:
    return FAULTS[name].command("special", "automcm.adapters.adapter_lines")


@pytest.mark.sweep(4)
@pytest.mark.parametrize("how", FAULTS)
def test_each_case_without_a_graph_can_fail(conform: Suite, how: str) -> None:
    name, says = FAULTS[how].notice["case"], FAULTS[how].notice["says"]
    found = conform(broken(how), name)
    (case,) = found.cases
    assert case.verdict == "FAIL" and says in case.reason, (case.verdict, case.reason)
    (failure,) = case.failures
    assert failure.rule == "END-7" or not how.startswith("back-off")
    about, steps = records.read_replay(conform.folder / "report" / failure.replay)
    assert about["case"] == name and steps
    assert found.exit_code == 1


def test_every_timer_is_tried(conform: Suite) -> None:
    """None is left out because the kit does not know how long it lasts."""
    timers = [p.id for p in purposes.load() if (p.case or "").startswith("timer ")]
    assert len(timers) > 10
    found = conform(station(), *timers)
    assert {case.id: case.verdict for case in found.cases} == dict.fromkeys(timers, "PASS")


def test_the_order_of_names_is_free(conform: Suite) -> None:
    code = """
def turned(x):
    if isinstance(x, dict): return {k: turned(x[k]) for k in reversed(x)}
    return [turned(y) for y in x] if isinstance(x, list) else x
def answer(c): return turned(right(c))
"""
    names = ("AMCM/PRE/ADV/BV-02", "AMCM/PRE/PRE/BV-07", "AMCM/STA/ACT/BV-01")
    assert conform(station(code), *names).counts["PASS"] == 3


@pytest.mark.slow
def test_wrong_marks_in_a_tour_are_blamed_on_the_marks(conform: Suite) -> None:
    marks, others = "AMCM/STA/ACT/BV-01", ("AMCM/STA/REL/TI-01", "AMCM/STA/END/BV-01")
    found = conform(broken("cam marks"), *others, marks, states=700)
    case = of(found, marks)
    assert case.verdict == "FAIL" and len(case.failures) > 1, "not only in the case itself"
    assert all("CAM.marks" in failure.what for failure in case.failures)
    assert len(case.failures) <= graph_cases.ENOUGH + 1
    assert {of(found, name).verdict for name in others} <= {"PASS", "INCONC"}
