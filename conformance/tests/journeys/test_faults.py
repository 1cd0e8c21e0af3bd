"""The fault matrix: one cell, the failures that it detects, and its page."""

from __future__ import annotations

import asyncio
from pathlib import Path

import pytest
from fault_cell import Cell
from fault_reasons import WHY
from faults import PHASES, matrix, page
from faulty_station import FAULTS

PAGE = Path(__file__).parents[3] / "docs" / "faults.md"


def test_every_fault_is_explained() -> None:
    assert list(WHY) == list(FAULTS)


def test_the_page_has_every_cell_and_none_that_is_unexplained() -> None:
    lines = [line for line in PAGE.read_text().splitlines() if line.startswith("| ")]
    rows = [[cell.strip() for cell in line.strip("|").split("|")] for line in lines]
    shown = [fault for row in rows if len(row) == 4 for fault in row[0].split("; ")]
    assert sorted(shown[1:]) == sorted(FAULTS)
    wide = [row for row in rows if len(row) > 4][1:]
    assert all(len(row) == 1 + len(PHASES) and all(row) for row in wide)
    assert {fault for row in wide for fault in row[0].split("; ")} < set(FAULTS)
    assert f"{len(FAULTS) * len(PHASES)} cells" in PAGE.read_text()
    assert "unexpected: 0." in PAGE.read_text() and "(!)" not in PAGE.read_text()


def test_end_1_a_cell_in_which_the_acting_prescriber_is_told_to_stop(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    place = [p for p in PHASES if p[:2] == ("prescriber", "ACTUATING")]
    monkeypatch.setattr("faults.PHASES", place)
    (cell,) = asyncio.run(matrix(["SIGTERM"], 1, tmp_path))
    assert (cell.outcome, cell.problems, cell.code) == ("Cancel(abort)", [], 0)
    assert "Cancel(abort)" in page([cell])


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
