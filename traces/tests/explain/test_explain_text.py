"""The text of explain: times from the start, the finding at the end, the matrix on request."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from merged_runs import Run, later

from automcm_spec.log_format.reader import read
from automcm_spec.vocabulary.application import Abort
from automcm_traces.explain.explain import start_times, text, verdict_of, verdicts_of
from automcm_traces.system.properties import SystemReport, judge

CORPUS = Path(__file__).parents[2] / "corpus"
EPOCH = 1_732_300_000_000
BAD = [e["file"] for e in json.loads((CORPUS / "index.json").read_text()) if e["line"]]


FIRST = {
    "ack_missing": [
        "LOG:7: DIVERGES at receive Intention from 2002: effects are missing",
        "  expected: send Ack to 2002 session=1001/1 (of Intention seq=1)",
        "  by ADV-5: which Intentions are recorded, acked, or answered that the session is closed "
        "(OnIntention, Station.tla:258)",
        "  nearest allowed: ADV-5 without send Ack (OnIntention) blocked by guard "
        "p \\in st.withdrawn, which must hold: p = 2002, st.withdrawn = {}  Station.tla:261",
    ],
    "window_too_long": [
        "LOG:4: DIVERGES at arm advertise for 700 ms",
        "  expected: arm advertise for 600 ms",
    ],
    "window_closed_early": [
        "LOG:28: DIVERGES at expire advertise: 1 ms too early",
        "  expected: expire advertise 1 ms later",
    ],
    "lost_records": ["LOG: CANNOT TELL: the log lost 5 records"],
    "no_events": ["LOG: CANNOT TELL: the log contains no events"],
    "seq_twice": ["LOG:10: UNREADABLE: seq: 8 after 8, expected 9 [seq]"],
    "forged_content": [
        "LOG:23: DIVERGES at receive Prescription from 1001, tx 1001:10: forged, "
        f"{CORPUS}/pair/1001.ndjson has another message under this tx",
        "  expected: hold_ms: 2000 was sent, not 1",
    ],
}
"""What the text of a verdict begins with."""


@pytest.mark.parametrize("name", FIRST)
def test_the_first_lines_say_what_is_wrong(name: str) -> None:
    paths = [CORPUS / "pair/1001.ndjson"] * name.startswith("forged")
    verdict = verdicts_of([*paths, CORPUS / f"bad/{name}.ndjson"])[-1]
    shown = text(verdict).replace(verdict.file, "LOG").splitlines()
    assert shown[: len(FIRST[name])] == FIRST[name]
    assert verdict.finding.at.file == verdict.file


def test_a_cut_log_is_allowed_as_far_as_it_goes_and_says_so() -> None:
    verdict = verdict_of(CORPUS / "bad/cut.ndjson")
    warnings = [line for line in text(verdict).splitlines() if line.startswith("  warning: ")]
    assert verdict.verdict == "allowed" and len(warnings) == len(verdict.warnings) == 2
    assert verdict.as_dict()["warnings"] == list(verdict.warnings)


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
