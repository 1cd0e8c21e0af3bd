"""The tables, the claims and the page of the safety experiment."""

from __future__ import annotations

from copy import deepcopy
from itertools import product
from typing import Any

import pytest

from automcm_evaluation.framework.experiment import Cell
from automcm_evaluation.safety import safety, safety_page, safety_road, safety_tables
from automcm_evaluation.safety.ablations import ABLATIONS, BY_NAME, WHOLE
from automcm_evaluation.sweeps.report import assemble

Json = Any
B = 1540
"""ms: the bound of the parameters as they are (T-2)."""


def made_up() -> Json:
    """A report of a few cells of each part; everything as it should be."""
    faults = {"part": "faults", "fault": "target restarts", "loss": 0.4, "drives": 10}
    result: Json = dict.fromkeys(safety_tables.COUNTS, 0)
    result |= {"bound_ms": B, "lengths": {"restart": [1500]}, "wrong": []}
    result |= {"agreed": 9, "completed": 8, "maneuvers": 9, "with_hazard": 1}
    cells = [Cell(faults | {"delay_ms": 40}, result)]
    for name in BY_NAME:
        values = {"part": "mechanisms", "ablation": name, "drives": 10, "delay_ms": 40}
        more = {"beyond": 2} if name == "plain CAMs count" else {}
        cells.append(Cell(values, deepcopy(result) | more))
    for name in safety.CLASS_ABLATIONS:
        for fault in safety.CLASSES:
            values = {"part": "classes", "ablation": name, "fault": fault, "drives": 7}
            formula, ms = safety.class_bound(values | {"delay_ms": 40}, BY_NAME[name])
            more = {"class_bound": formula, "class_bound_ms": ms, "lengths": {"x": [ms]}}
            cells.append(Cell(values | {"delay_ms": 40}, deepcopy(result) | more))
    for name, begins in product(safety_road.PROTOCOLS, safety_road.WINDOWS_MS):
        values = {"part": "road", "ablation": name, "speed_kmh": 30, "drives": 2, "delay_ms": 40}
        values["begins"] = begins
        room = -1.25 if name == safety_road.UNCOORDINATED else 12.75
        found = {"bound_ms": B, "room_m": [room, None], "gap_m": [3.5, None], "ttc_s": [None] * 2}
        found |= {"braking": [5.0, 2.0], "lengths": {}, "with_hazard": 0, "begun": 1, "wrong": []}
        found |= {"unasked": 0}
        cells.append(Cell(values, found))
    about = {"experiment": "safety", "profile": "quick", "seed": 1, "version": "0", "code": "0"}
    settings = safety.Safety(speeds_kmh=(30,)).model_dump(mode="json")
    return assemble(safety.EXPERIMENT, about | {"settings": settings}, cells)


def verdicts(report: Json) -> list[str]:
    return [claim.verdict for claim in safety_page.claims(report)]


def test_all_claims_hold_of_what_is_as_it_should_be() -> None:
    report = made_up()
    assert set(verdicts(report)) == {"beyond the paper"}
    assert "broken" not in report["summary"]


def worse(report: Json, n: int) -> None:
    """Make the figures of the n-th claim such that it does not hold."""
    s = report["summary"]
    match n:
        case 0:
            s["all"]["beyond"] = 1
        case 1:
            s["all"]["longest_ms"] = 1400
        case 2:
            s["all"]["unexcused"] = 1
        case 3:
            s["classes"][0]["longest_ms"] = 141
        case 4 | 5:
            fault = ("cut forth", "target restarts")[n - 4]
            for row in s["classes"]:
                if row["fault"] == fault and row["ablation"] != WHOLE.name:
                    row["longest_ms"] = 30
        case 6:
            for row in s["mechanisms"]:
                row["beyond"] = row["unexcused"] = 0
        case 7 | 8:  # one tight lane change in one of the windows is enough
            name = (WHOLE.name, safety_road.LOOKS)[n - 7]
            rows = [row for row in s["road"] if row["ablation"] == name]
            rows[n - 7]["near"] = 1


@pytest.mark.parametrize("n", range(9))
def test_a_claim_that_the_figures_are_against_is_not_reproduced(n: int) -> None:
    report = made_up()
    worse(report, n)
    assert [v == "not reproduced" for v in verdicts(report)] == [k == n for k in range(9)]


@pytest.mark.parametrize("begins", safety_road.WINDOWS_MS)
def test_where_nobody_moved_over_nothing_is_shown(begins: str) -> None:
    report = made_up()
    for row in report["summary"]["road"]:
        row["moved"] *= row["begins"] != begins
    assert verdicts(report)[7:] == ["not reproduced"] * 2


def test_what_is_worse_without_a_mechanism() -> None:
    whole = {"drives": 100, "with_hazard": 20, "agreed": 90, "completed": 80, "in_vain": 2}
    whole |= {"unexcused": 0, "beyond": 0, "stuck": 0}
    assert safety_tables.shows(dict(whole), whole) == []
    for changes, text in (
        ({"unexcused": 1}, "S-5"),
        ({"beyond": 1}, "T-2"),
        ({"stuck": 1}, "L-1"),
        ({"with_hazard": 50}, "more hazards"),
        ({"agreed": 60}, "fewer agreements"),
        ({"in_vain": 30}, "takes for failed"),
    ):
        (found,) = safety_tables.shows(whole | changes, whole)
        assert text in found
    assert safety_tables.shows(whole | {"with_hazard": 25, "agreed": 85}, whole) == []


def test_a_fault_class_beyond_its_bound_and_a_run_without_end_are_broken() -> None:
    report = made_up()
    cells = [Cell(cell["values"], cell["result"]) for cell in report["cells"]]
    for cell in cells:
        if cell.values["part"] == "classes" and cell.values["fault"] == "target aborts":
            cell.result["lengths"] = {"abort": [41]}
    cells[0].result["stuck"] = 2
    broken = safety_tables.summary(cells)["broken"]
    assert [text[:10] for text in broken] == ["T-1: 2 run", "T-2: targe"]
    assert "41 ms, D = 40 ms" in broken[1]


def test_the_page_has_the_figures_of_the_report() -> None:
    report = made_up()
    text = safety_page.page(report)
    assert "B = D + L = 40 + 1500 ms = 1540 ms" in text
    assert "| target restarts | 10 | 9 | 1 (1.8 to 40.4 %) | 0 | 0 | 1500 | 1500 |" in text
    assert "1540 of D + L = 1540 ms" in text and "10000 of E = 10000 ms" in text
    for begins in ("negotiation", "maneuver"):
        assert f"| no coordination | 30 | {begins} | 2 | 1 | 1 | 0 | 0 | -1.25 |" in text
    for ablation in ABLATIONS:
        assert f"| {ablation.name}: {ablation.text} | {ablation.rule} |" in text
    report["summary"]["mechanisms"][1]["longest_ms"] = 6543
    assert "| 6543 |" in safety_page.page(report)
