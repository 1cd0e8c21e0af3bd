"""The text of explain: times from the start, the finding at the end, the matrix on request."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from merged_runs import Run, later

from automcm_spec.log_format.reader import read
from automcm_spec.vocabulary.application import Abort
from automcm_traces.explain.explain import start_times, text, verdict_of
from automcm_traces.system.properties import SystemReport, judge

CORPUS = Path(__file__).parents[2] / "corpus"
EPOCH = 1_732_300_000_000
BAD = [e["file"] for e in json.loads((CORPUS / "index.json").read_text()) if e["line"]]


@pytest.mark.sweep(12)
@pytest.mark.parametrize("file", BAD)
def test_the_text_of_a_verdict_is_the_same_whatever_the_epoch(file: str, tmp_path: Path) -> None:
    path = CORPUS / file
    verdict = verdict_of(path)
    if verdict.verdict == "unreadable":
        return
    moved = verdict_of(later(path, EPOCH, tmp_path))
    shown = [text(v, start_times([v])).replace(v.file, "LOG") for v in (verdict, moved)]
    assert shown[0] == shown[1] and str(EPOCH)[:7] not in shown[1]
    if verdict.recent:
        assert str(moved.recent[-1][1].t_ms) in text(moved)


def hazard(folder: Path, ahead: int) -> SystemReport:
    """A run with a hazard, all clocks ahead by some ms."""
    run = Run(folder, maneuver_ms=9000)
    run.simulation.command(2, Abort(session=(1, 1)), at=4000)
    run.logs()
    paths = [folder / f"{n}.ndjson" for n in (1, 2, 3)]
    return judge([read(later(path, ahead)) for path in paths])


@pytest.mark.slow
def test_the_report_of_a_run_is_the_same_whatever_the_epoch(tmp_path: Path) -> None:
    one, other = hazard(tmp_path / "1", 0), hazard(tmp_path / "2", EPOCH)
    zero = dict.fromkeys(other.files, EPOCH)
    assert one.text() == other.text(zero).replace(str(tmp_path / "2"), str(tmp_path / "1"))
    assert str(EPOCH)[:7] not in other.text(zero) and str(other.hazards[0].since_ms) in other.text()
    assert other.as_dict()["hazards"][0]["since_ms"] > EPOCH  # type: ignore[index]


def test_the_report_ends_with_its_finding_and_has_the_matrix_on_request(tmp_path: Path) -> None:
    report = hazard(tmp_path, 0)
    lines = report.text().splitlines()
    found = lines.index(f"together, run {report.run}: ALLOWED, shows a hazard (fault)")
    assert lines[found + 1 :] == report.hazards[0].text().splitlines()
    assert not any(line.startswith("messages ") for line in lines)
    matrix = [line for line in report.text(matrix=True).splitlines() if line not in lines]
    assert [line.split()[1].rstrip(":") for line in matrix] == list(report.deliveries)
    for line, counts in zip(matrix, report.deliveries.values(), strict=True):
        assert all(f"{n} {name.replace('_', ' ')}" in line for name, n in counts.items())
