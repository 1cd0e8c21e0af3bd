"""The commands: exit codes, JSON, help, bad input."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from cli_stage import automcm, good_report, shown

from automcm_cli.spec import model_output
from automcm_maintenance.documents import generated_files
from automcm_maintenance.exact_vectors import vector_texts
from automcm_maintenance.verify import verify as verify_
from automcm_maintenance.verify.graph_comparison import Divergence
from automcm_spec.graph import oracle_generation
from automcm_spec.graph.oracle_agreement import OracleDifference
from automcm_spec.model_checking import kept_results, models, tlc
from automcm_spec.model_checking.tlc import ErrorKind, Progress, TlcError, TlcResult
from automcm_spec.vocabulary.station import Restart

ROOT = generated_files.ROOT
NOT_COVERED = "No property covers what you changed"


@pytest.mark.parametrize(
    ("arguments", "near"),
    [
        (["verify", "--profile", "fulll"], "full"),
        (["spec", "check", "retargett"], "retarget"),
        (["spec", "list", "--property", "S-55"], "S-5"),
        (["spec", "list", "--property", "NoHazard"], "NoHazardInv"),
        (["spec", "list", "--profile", "depp"], "deep"),
        (["spec", "simulate", "two_by_thre"], "two_by_three"),
    ],
)
def test_an_unknown_name_gets_the_nearest_ones(arguments: list[str], near: str) -> None:
    answer = automcm(*arguments)
    said = answer.output.replace("\n", " ").replace(repr(arguments[-1]), "")
    assert answer.exit_code == 2 and near in said


def test_check_needs_something_to_check() -> None:
    assert automcm("spec", "check").exit_code == 2
    nothing = ["spec", "list", "--profile", "quick", "--property"]
    assert automcm(*nothing, "L-1").exit_code == 0


def test_check_shows_and_writes_a_counterexample(tmp_path: Path) -> None:
    answer = automcm("spec", "check", "bare_ack", "--traces", tmp_path)
    assert answer.exit_code == 0, answer.output
    assert "S-6 is violated" in answer.output and "as expected" in answer.output
    assert "[ADV-1: OnRequest, Station.tla:" in answer.output
    assert "OnAck, Station.tla:" in answer.output and NOT_COVERED not in answer.output
    assert 'phase "STANDALONE" → "ADVERTISING"' in answer.output
    written = json.loads((tmp_path / "bare_ack.itf.json").read_text())
    assert written["#meta"]["description"].startswith("bare_ack breaks S-6. ")
    assert [s["#meta"]["index"] for s in written["states"]] == list(range(len(written["states"])))


@pytest.mark.sweep(1)
@pytest.mark.parametrize(
    ("kind", "partial", "code"),
    [("timeout", 7, 4), ("memory", 7, 4), ("disk", 7, 4), ("timeout", 0, 3)],
)
def test_a_run_that_does_not_end_is_incomplete(
    monkeypatch: pytest.MonkeyPatch, kind: ErrorKind, partial: int, code: int
) -> None:
    def broken(*_: object, **__: object) -> TlcResult:
        error = TlcError(kind, "TLC did not come to the end")
        error.partial = Progress(3, 2 * partial, partial, 1) if partial else None
        raise error

    monkeypatch.setattr(tlc, "run", broken)
    answer = automcm("spec", "check", "unreduced", "--json", "-")
    assert answer.exit_code == code, answer.output
    (found_,) = json.loads(answer.output)
    assert found_["outcome"] == ("incomplete" if partial else "error")
    assert found_["states_looked_at"] == (partial or None)


def test_without_its_models_verify_says_so() -> None:
    report = good_report()
    WRONG["no models"](report)
    report.models_too = False
    assert report.ok and report.exit_code == 0 and not report.as_dict()["models_too"]
    assert shown(report).startswith("Models      not checked\n")
    WRONG["nothing compared"](report)
    assert not report.ok


def uncovered(report: verify_.VerifyReport) -> None:
    assert report.coverage is not None
    report.coverage.uncovered.append("NEG-5")


def violates(report: verify_.VerifyReport) -> None:
    result = TlcResult("violates", "NoHazardInv", 10, 20, 3, 0.1)
    verdict = models.ModelVerdict(models.load()[0], "violates", "S-5", result, "violates S-5")
    report.verdicts.append(verdict)


def compiled_differs(report: verify_.VerifyReport) -> None:
    report.compiled["one-peer"].differences = 1
    report.compiled["one-peer"].found.append(OracleDifference([], Restart("restart"), 1, 2))


DIVERGENCE = Divergence([Restart("restart")], "END-8", 9, {"told": 1}, {"told": 2})
WRONG: dict[str, Callable[[verify_.VerifyReport], None]] = {
    "divergence": lambda r: r.compared["one-peer"].divergences.append(DIVERGENCE),
    "behaviour": lambda r: r.behaviour_differences.append("step 3 [red]"),
    "uncovered": uncovered,
    "drift": lambda r: r.drift.append("spec/oracle: stale"),
    "model": violates,
    "nothing compared": lambda r: r.compared.clear(),
    "no models": lambda r: r.verdicts.clear(),
    "compiled": compiled_differs,
    "not compiled": lambda r: r.compiled.clear(),
}


@pytest.mark.parametrize("what", WRONG)
def test_each_thing_that_is_wrong_makes_verify_fail(what: str) -> None:
    report = good_report()
    WRONG[what](report)
    assert not report.ok and report.exit_code == 1
    assert "NOT as expected" in shown(report)


def test_a_tool_that_fails_is_3_and_the_report_is_kept(monkeypatch: pytest.MonkeyPatch) -> None:
    def broken(*_: object, **__: object) -> None:
        raise TlcError("java", "no Java")

    monkeypatch.setattr(kept_results, "check_all", broken)
    monkeypatch.setattr(verify_, "_oracle", broken)
    report = verify_.run()
    assert report.exit_code == 3 and "no Java" in report.as_dict()["errors"][0]
    answer = automcm("generate")
    assert answer.exit_code == 3 and "no Java" in answer.output


def test_what_is_stale_or_cannot_be_generated_is_a_line_of_drift(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def raises(*_: object) -> Any:
        raise KeyError("PRE-6")

    texts = {generated_files.DIAGRAMS: raises, ROOT / "docs" / "nowhere.md": lambda: "text"}
    monkeypatch.setattr(generated_files, "_texts", lambda one_peer: texts)
    monkeypatch.setattr(generated_files, "_corpus", raises)
    monkeypatch.setattr(vector_texts, "texts", raises)
    monkeypatch.setattr(oracle_generation, "spec_hash", lambda: "another")
    graph, diagrams, nowhere, vectors, corpus, remainder = generated_files.drift(
        "quick", b"another oracle", lambda text: None
    )
    stale = "not what would be generated now; run .venv/bin/automcm generate"
    assert nowhere == f"docs/nowhere.md: {stale} docs/nowhere.md"
    assert stale in graph and stale in remainder
    for line in (diagrams, vectors, corpus):
        assert line.endswith(": cannot be generated now: KeyError: 'PRE-6'")


def test_spec_list_names_every_model() -> None:
    answer = automcm("spec", "list")
    assert answer.exit_code == 0
    assert all(model.cfg in answer.output for model in models.load())
    listed = json.loads(automcm("spec", "list", "--json", "-").output)
    assert {"cfg", "expect", "why"} <= set(listed[0])


@pytest.mark.slow
def test_spec_check_says_when_no_model_tells_a_change(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(oracle_generation, "recorded_hash", lambda: "another")
    answer = automcm("spec", "check", "bare_ack")
    assert answer.exit_code == 0 and "as recorded before your change" in answer.output
    assert "as expected" not in answer.output
    assert f"{NOT_COVERED}: the specification differs from the one recorded" in answer.output
    answer = automcm("spec", "check", "bare_ack", "--json", "-")
    assert json.loads(answer.stdout) and NOT_COVERED in answer.stderr


def test_a_model_that_tells_a_change_covers_it(monkeypatch: pytest.MonkeyPatch) -> None:
    model = models.load()[0]
    result = TlcResult("holds", None, 10, 20, 3, 0.1)
    same = models.ModelVerdict(model, "holds", None, result, None)
    other = models.ModelVerdict(model, "holds", None, result, "states is 20, 19 expected")
    assert model_output.not_covered([same, other]) == "" == model_output.not_covered([])
    assert model_output.not_covered([same, same]).startswith(NOT_COVERED)
    assert "NOT as expected" in model_output.shown(other, True)


def test_without_a_recorded_graph_nothing_is_said_of_a_change(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr(oracle_generation.Graph, "path", tmp_path / "none.json.xz")
    assert oracle_generation.recorded_hash() is None and not model_output.specification_changed()


def test_spec_check_that_cannot_run_is_3(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("AUTOMCM_TLA2TOOLS", "/nowhere.jar")
    answer = automcm("spec", "check", "one_by_two")
    assert answer.exit_code == 3 and "/nowhere.jar" in answer.output
