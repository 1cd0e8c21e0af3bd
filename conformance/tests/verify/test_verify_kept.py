"""What ``automcm verify`` takes from earlier runs, or from committed results."""

from __future__ import annotations

import json
import shutil
from pathlib import Path
from typing import Any

import pytest
from cli_stage import good_report, shown

from automcm_maintenance.documents import generated_files
from automcm_maintenance.documents.repository import ROOT
from automcm_maintenance.induction import recorded_proof
from automcm_maintenance.induction.recorded_proof import Proof
from automcm_maintenance.verify import kept_stages
from automcm_maintenance.verify import verify as verify_
from automcm_spec.graph import oracle, oracle_generation
from automcm_spec.model_checking import kept_results


@pytest.fixture(autouse=True)
def kept(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(verify_, "KEPT", tmp_path / "kept")


@pytest.fixture
def stages(monkeypatch: pytest.MonkeyPatch) -> None:
    """A verify whose stages find nothing wrong."""
    good = good_report()

    def compared(report: verify_.VerifyReport, data: bytes, notify: object) -> None:
        report.compared, report.compiled = good.compared, good.compiled
        report.coverage = good.coverage

    monkeypatch.setattr(
        kept_results, "check_all", lambda *_, on_done, **__: on_done(good.verdicts[0])
    )
    monkeypatch.setattr(verify_, "_oracle", lambda report, graph, notify: b"")
    monkeypatch.setattr(verify_, "_compare", compared)
    monkeypatch.setattr(generated_files, "drift", lambda *_: [])
    none = generated_files.Generated(Path(), dict)
    monkeypatch.setattr(generated_files, "counterexamples", lambda _: none)
    monkeypatch.setattr(generated_files, "graph_changed", lambda fresh: False)
    monkeypatch.setattr(recorded_proof, "committed", lambda: Proof(5))
    monkeypatch.setattr(verify_, "_proved", lambda: Proof(5, (), 2.4))
    monkeypatch.setattr(generated_files, "proof", lambda _: none)


def test_a_stage_is_kept_until_a_file_that_it_depends_on_changes(tmp_path: Path) -> None:
    (tmp_path / "a").mkdir()
    (tmp_path / "a" / "one.py").write_text("1")
    made: list[int] = []

    def result(clean: bool = True) -> tuple[list[int], bool]:
        key = kept_stages.key(tmp_path, "a")
        return kept_stages.kept(
            tmp_path / "kept" / "x.stage",
            key,
            lambda: made.append(1) or list(made),  # type: ignore[func-returns-value]
            lambda _: clean,
        )

    assert result(clean=False) == ([1], False) and result() == ([1, 1], False)
    assert result() == ([1, 1], True)
    (tmp_path / "b.py").write_text("another")
    (tmp_path / "a" / "one.pyc").write_text("compiled")
    assert result()[1]
    (tmp_path / "a" / "one.py").write_text("2")
    assert not result()[1] and result()[1]
    kept = tmp_path / "kept" / "x.stage"
    kept.write_bytes(kept.read_bytes()[:-1])
    assert not result()[1] and result()[1]


@pytest.mark.parametrize(
    ("present", "options", "made"),
    [
        (True, {}, False),
        (True, {"fresh": True}, True),
        (True, {"profile": "full"}, True),
        (False, {}, True),
    ],
)
def test_the_committed_graph_counts_while_the_specification_is_its_own(
    present: bool, options: dict[str, Any], made: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    graph, builds = oracle_generation.ONE_PEER, []
    committed = json.loads(oracle.content(graph.path))

    def build(graph: oracle_generation.Graph, **_: Any) -> tuple[Any, None]:
        builds.append(graph)
        return committed, None

    monkeypatch.setattr(oracle_generation, "build", build)
    if not present:
        monkeypatch.setattr(oracle_generation, "spec_hash", lambda: "another")
    report = verify_.VerifyReport(**{"profile": "quick"} | options)
    verify_._oracle(report, graph, lambda text: None)
    assert builds == [graph] * made and report.kept_stages == ["oracle one-peer"] * (not made)


EARLIER = "Proof       5 obligations proved earlier from the same files (spec/proof.json)"
NOW = "Proof       5 of 5 obligations proved, 2 s"


@pytest.mark.usefixtures("stages")
@pytest.mark.parametrize(
    ("profile", "committed", "line"),
    [("quick", Proof(5), EARLIER), ("quick", None, NOW), ("full", Proof(5), NOW)],
)
def test_the_quick_profile_proves_only_if_the_committed_result_is_of_other_files(
    profile: str, committed: Proof | None, line: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(recorded_proof, "committed", lambda: committed)
    report = verify_.run(profile)
    assert report.ok and line in shown(report).splitlines()
    assert ("proof" in report.seconds) == (line == NOW)


@pytest.mark.usefixtures("stages")
def test_a_failed_proof_is_no_success_and_is_not_kept(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(recorded_proof, "committed", lambda: None)
    monkeypatch.setattr(verify_, "_proved", lambda: Proof(5, ("refuted: BeenInv",), 2.0))
    report = verify_.run()
    assert not report.ok and report.exit_code == 1
    assert "Not proved  refuted: BeenInv" in shown(report)
    monkeypatch.setattr(verify_, "_proved", lambda: Proof(5, (), 2.0))
    assert verify_.run().ok


@pytest.mark.parametrize(
    ("module", "same"),
    [("Station", False), ("Cutoff", False), ("Inductive", False), ("Liveness", True)],
)
def test_the_committed_proof_is_of_these_modules(
    module: str, same: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in ("tla", "tools", "proof.json"):
        copied = shutil.copytree if (ROOT / "spec" / name).is_dir() else shutil.copy
        (tmp_path / "spec").mkdir(exist_ok=True)
        copied(ROOT / "spec" / name, tmp_path / "spec" / name)
    monkeypatch.setattr(recorded_proof, "ROOT", tmp_path)
    monkeypatch.setattr(recorded_proof, "TLA", tmp_path / "spec" / "tla")
    monkeypatch.setattr(recorded_proof, "PATH", tmp_path / "spec" / "proof.json")
    assert recorded_proof.committed() is not None, "automcm generate spec/proof.json"
    with (tmp_path / "spec" / "tla" / f"{module}.tla").open("a") as file:
        file.write("\n")
    assert (recorded_proof.committed() is not None) == same
