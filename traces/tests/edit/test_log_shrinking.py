"""Failing logs are shrunk to nearly the shortest, and what is wrong in them stays the same."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from automcm_maintenance.corpus.corpus_bad import EditedLog as Edited
from automcm_spec.log_format.reader import read
from automcm_traces.edit.log_shrinking import Shrunk, masked, shrink
from automcm_traces.edit.log_slice import LogSlice
from automcm_traces.explain.explain import verdict_of, verdicts_of
from automcm_traces.explain.lint import report
from automcm_traces.system.properties import judge

Json = Any
CORPUS = Path(__file__).parents[2] / "corpus"


def written(found: Shrunk, folder: Path) -> list[Path]:
    folder.mkdir(exist_ok=True)
    paths = [folder / Path(log.file).name for log in found.logs]
    for path, log in zip(paths, found.logs, strict=True):
        path.write_bytes(log.text())
    return paths


INDEX = json.loads((CORPUS / "index.json").read_text())
BAD = [e for e in INDEX if e["file"].startswith("bad/") and e["verdict"] == "diverges"]
"""Every second one is deep."""


@pytest.mark.sweep(1)
@pytest.mark.parametrize(
    "entry",
    [pytest.param(e, marks=[pytest.mark.deep] * (n % 2)) for n, e in enumerate(BAD)],
    ids=[Path(e["file"]).stem for e in BAD],
)
def test_every_bad_log_keeps_its_fault(entry: dict[str, Json], tmp_path: Path) -> None:
    paths = [CORPUS / entry["file"]]
    paths += [CORPUS / entry["beside"]] if "beside" in entry else []
    before = verdicts_of(paths)[0]
    found = shrink(paths)
    small = written(found, tmp_path)
    after = verdicts_of(small)
    assert (after[0].verdict, after[0].finding.rule) == ("diverges", before.finding.rule)
    assert after[0].finding.at.line == found.line_now
    assert after[0].finding.observed.split()[:2] == before.finding.observed.split()[:2]
    assert [v.verdict for v in after[1:]] == ["allowed"] * (len(after) - 1)
    assert masked(after[0].finding.state) == masked(before.finding.state)
    for path, given in zip(small, paths, strict=False):
        assert report(path).errors <= report(given).errors
    original = explain_steps(paths)
    for log in found.logs:
        for step in log.steps():
            lines = {item.line for item in step}
            assert any(lines <= one for one in original[log.file]), "made of two steps"


def explain_steps(paths: list[Path]) -> dict[str, list[set[int]]]:
    logs = [LogSlice.read(path) for path in paths]
    return {log.file: [{item.line for item in step} for step in log.steps()] for log in logs}


def test_what_is_wrong_only_beside_another_log_keeps_one(tmp_path: Path) -> None:
    """A message received under an id that its own station never sent: explain compares two logs."""
    log = Edited((CORPUS / "pair/2002.ndjson").read_bytes())
    log.at(log.find("receive"))["tx"] = "2002:99999"
    path = tmp_path / "2002.ndjson"
    path.write_bytes(log.text())
    found = shrink([path, CORPUS / "pair/1001.ndjson"], tries=60)
    assert found.finding.kind == "forged" and len(found.logs) == 2
    (small := tmp_path / "small").mkdir()
    after = verdicts_of(written(found, small))
    assert [v.finding.kind for v in after] == ["forged", "nothing"]


def test_a_log_that_is_wrong_by_itself_needs_no_other() -> None:
    found = shrink([CORPUS / "pair/1001.ndjson", CORPUS / "bad/hold_not_armed.ndjson"])
    assert [Path(log.file).name for log in found.logs] == ["hold_not_armed.ndjson"]
    assert "pair/1001.ndjson: is not needed" in "\n".join(found.text())


def test_logs_that_violate_a_property_only_together_are_shrunk_together(tmp_path: Path) -> None:
    """S-4: each log is allowed, both act, and not on the same proposal."""
    paths = sorted((CORPUS / "counterexamples/memory_dropped").iterdir())
    assert {v.verdict for v in verdicts_of(paths)} == {"allowed"}
    found = shrink(paths, tries=60)
    assert found.finding.property == "S-4"
    assert len(found.logs) == 2
    assert sum(len(log.items) for log in found.logs) < sum(found.before.values())
    small = written(found, tmp_path)
    assert {v.verdict for v in verdicts_of(small)} == {"allowed"}
    judged = {j.property: j.outcome for j in judge([read(path) for path in small]).properties}
    assert judged["S-4"] == "violated"


def test_what_is_left_is_moved_together() -> None:
    """A round that is left out leaves no gap: not in time, not in seq, not in proposals."""
    (log,) = shrink([CORPUS / "bad/another_trajectory.ndjson"]).logs
    proposals = {i.record["message"]["proposal"] for i in log.items if "proposal" in str(i.record)
                 and "message" in i.record}  # fmt: skip
    assert proposals == {1}
    times = [item.event.t_ms for item in log.items]
    assert times == sorted(times)
    assert times[-1] - times[0] < 100


@pytest.mark.slow
def test_a_log_of_other_promises_keeps_them(tmp_path: Path) -> None:
    """Without timers promised, what is unseen is supposed; the header stays as it is."""
    log = Edited((CORPUS / "bad/another_trajectory.ndjson").read_bytes())
    log.at(1)["complete"] = ["command", "receive", "send"]
    path = tmp_path / "some.ndjson"
    path.write_bytes(log.text())
    before = verdict_of(path)
    assert before.verdict == "diverges"
    found = shrink([path], tries=200)
    small = written(found, tmp_path / "small")[0]
    assert json.loads(small.read_bytes().splitlines()[0]) == log.at(1)
    assert verdict_of(small).verdict == "diverges"
    assert verdict_of(small).finding.rule == before.finding.rule


@pytest.mark.slow
def test_an_end_stays_and_what_is_without_stays_without(tmp_path: Path) -> None:
    text = (CORPUS / "bad/lease_longer.ndjson").read_bytes()
    path = tmp_path / "no_end.ndjson"
    path.write_bytes(b"".join(text.splitlines(keepends=True)[:-1]))
    (log,) = shrink([path]).logs
    assert b'"end"' not in log.text() and len(log.items) <= 15
    (log,) = shrink([CORPUS / "bad/lease_longer.ndjson"]).logs
    assert json.loads(log.text().splitlines()[-1])["seq"] == len(log.items)


def test_the_number_of_tries_ends_the_search_and_is_told() -> None:
    found = shrink([CORPUS / "bad/not_told_of_the_end.ndjson"], tries=3)
    assert (found.tries, found.ended) == (3, True)
    assert "--tries" in found.text()[-1]


def test_steps_in_a_row_go_together() -> None:
    """NEG-4: of two sessions only the one in which the station is bound is needed."""
    (log,) = shrink([CORPUS / "bad/busy_silent.ndjson"]).logs
    assert len(log.items) <= 22
