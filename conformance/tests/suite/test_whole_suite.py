"""The whole suite: the first entry of the report for each seeded bug, no false alarm, and the
memory that docs/conformance.md says."""

from __future__ import annotations

import os
import re
import subprocess
from pathlib import Path

import pytest
from broken_stations import CAUSES, broken
from cli_stage import AUTOMCM
from test_causes import LINES
from test_no_false_alarm import ALL, VARIANTS
from wrong_station import station

from automcm_conformance.exchange.results import Report
from automcm_conformance.report import report

PAGE = (Path(__file__).resolve().parents[3] / "docs" / "conformance.md").read_text()
pytestmark = [pytest.mark.slow, pytest.mark.deep]


def whole(command: list[str], folder: Path) -> Report:
    """A run of all cases against a station."""
    run = [*AUTOMCM, "conform", "run", "--out", str(folder), "--", *command]
    process = subprocess.Popen(run, stdout=subprocess.DEVNULL)
    taken_mb = os.wait4(process.pid, 0)[2].ru_maxrss / 1024
    assert taken_mb < 1.1 * int(re.findall(r"(\d+) MB with the reference", PAGE)[0])
    return report.load(folder / "report.json")


@pytest.mark.parametrize("bug", CAUSES)
def test_the_first_entry_is_the_bug(bug: str, tmp_path: Path) -> None:
    rule, operator, says = CAUSES[bug].values()
    found = whole(broken(bug), tmp_path)
    case, shown = found.causes[0][0]
    assert (case.verdict, shown.rule, shown.operator) == ("FAIL", rule, operator)
    assert len(shown.exchange) <= LINES, [line.text for line in shown.exchange]
    assert says in "\n".join(report.about(shown))
    assert not found.problems and found.exit_code == 1


@pytest.mark.parametrize("how", VARIANTS)
def test_no_false_alarm(how: str, tmp_path: Path) -> None:
    found = whole(station(ALL.format(variant=VARIANTS[how])), tmp_path)
    wrong = [(case.id, case.reason) for case in found.cases if case.verdict not in ("PASS", "SKIP")]
    assert not wrong and not found.problems
