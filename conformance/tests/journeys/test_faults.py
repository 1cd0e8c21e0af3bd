"""The fault matrix: one cell, the failures that it detects, and its page."""

from __future__ import annotations

import asyncio
import json
from pathlib import Path

import pytest
from fault_cell import Cell
from fault_reasons import WHY
from faults import PHASES, matrix, results
from faulty_station import FAULTS

from automcm_maintenance.documents import built_pages

FOUND = json.loads(built_pages.FAULTS.read_text(encoding="utf-8"))


def test_the_page_has_every_cell_and_none_that_is_unexplained() -> None:
    assert list(FOUND["faults"]) == list(FAULTS)
    for fault, shown in FOUND["faults"].items():
        assert len(shown["outcomes"]) == len(PHASES) and all(shown["outcomes"])
        assert shown["effect"] == WHY[fault].text
    page = built_pages.faults_page(FOUND)
    assert f"{len(FAULTS) * len(PHASES)} cells" in page
    assert "unexpected: 0." in page and "(!)" not in page


def test_end_1_a_cell_in_which_the_acting_prescriber_is_told_to_stop(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    place = [p for p in PHASES if p[:2] == ("prescriber", "ACTUATING")]
    monkeypatch.setattr("faults.PHASES", place)
    (cell,) = asyncio.run(matrix(["SIGTERM"], 1, tmp_path))
    assert (cell.outcome, cell.problems, cell.code) == ("Cancel(abort)", [], 0)
    assert "| Cancel(abort) |" in built_pages.faults_page(results([cell]))


@pytest.mark.slow
@pytest.mark.parametrize(
    "fault",
    [
        *("standard output: closed", "standard output: no space", "standard output: blocks"),
        *("select fails", "SIGKILL", "SIGSTOP"),
    ],
)
def test_a_fault_while_a_station_acts_does_what_the_page_says(
    fault: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("faults.PHASES", [p for p in PHASES if p[1] == "ACTUATING"])
    cells = asyncio.run(matrix([fault], 2, tmp_path))
    assert [(cell.outcome in WHY[fault].acting, cell.problems) for cell in cells] == [
        (True, []),
        (True, []),
    ]


def acted(left_s: float, cams: list[tuple[float, bool]], end_s: float, folder: Path) -> Cell:
    """A cell whose station left at ``left_s`` and whose peer acted until ``end_s``."""
    session = (1, 1)
    cell = Cell("SIGTERM", "prescriber", "ACTUATING", "prescriber", folder, 0)
    cell.truth = [{"s": 0.0, "marks": [list(session)]}, {"s": left_s, "marks": []}]
    cell.marked = [(at, (session,) if marked else ()) for at, marked in cams]
    cell.way = [(0.0, "ACTUATING", "NEG-2", ""), (end_s, "STANDALONE", "ACT-2", "")]
    cell._peer = type("Peer", (), {"statistics": type("S", (), {"latest_ms": 0})})  # type: ignore[assignment]
    cell._judge_cams()
    return cell


def test_act_5_a_cam_that_names_what_was_left_is_a_problem(tmp_path: Path) -> None:
    assert acted(1.0, [(0.5, True), (1.1, True), (1.5, False)], 1.5, tmp_path).problems == []
    (problem,) = acted(1.0, [(0.5, True), (1.4, True)], 1.5, tmp_path).problems
    assert "named (1, 1)" in problem


def test_t_2_a_peer_that_acts_too_long_is_a_problem(tmp_path: Path) -> None:
    assert acted(1.0, [(0.9, True)], 2.1, tmp_path).problems == []
    (problem,) = acted(1.0, [(0.9, True)], 2.4, tmp_path).problems
    assert "after the station had left" in problem
