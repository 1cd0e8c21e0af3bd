"""``automcm experiment``: files and errors."""

from __future__ import annotations

import json
import shutil
from pathlib import Path
from typing import Any

import pytest
from cli_stage import automcm

from automcm_evaluation.sweeps import report
from automcm_maintenance.documents import generated_files
from automcm_simulation.road import figures

Json = Any
SMALL = [
    *("experiment", "bandwidth", "--set", "trials=1", "--set", "maneuvers=1"),
    *("--set", "vehicles=[2]"),
]
EVALUATION = generated_files.EVALUATION.with_suffix("")


@pytest.fixture(scope="module")
def small(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("small")
    done = automcm(*SMALL, "--out", out, "--workers", "1")
    assert done.exit_code == 0, done.output
    return out


@pytest.mark.slow
def test_two_workers_write_the_same_bytes(small: Path, tmp_path: Path) -> None:
    done = automcm(*SMALL, "--out", tmp_path, "--workers", "2", "--json", "-")
    assert done.exit_code == 0, done.output
    assert json.loads(done.stdout)[0]["experiment"] == "bandwidth"
    for path in sorted((small / "bandwidth").rglob("*.*")):
        assert (tmp_path / path.relative_to(small)).read_bytes() == path.read_bytes(), path.name


@pytest.mark.parametrize(
    ("changes", "text"),
    [
        (["--set", "trials=0"], "trials: 0: Input should be greater than or equal to 1"),
        (["--set", "trials"], "--set: expected NAME=JSON, not 'trials'"),
        (["--set", "trials=x"], "--set: expected NAME=JSON, not 'trials=x'"),
        (["--set", "trials=" + "[" * 2000], "--set: expected NAME=JSON"),
        (["--set", "dice=1"], "dice: there is no such setting"),
        (["--profile", "slow"], "no profile 'slow'"),
    ],
)
def test_impossible_parameters_are_named(changes: list[str], text: str, tmp_path: Path) -> None:
    done = automcm(*SMALL, *changes, "--out", tmp_path)
    assert done.exit_code == 2 and text in " ".join(done.stderr.split())
    assert not list(tmp_path.iterdir())


@pytest.mark.slow
def test_something_broken_is_exit_code_1(
    monkeypatch: pytest.MonkeyPatch, small: Path, tmp_path: Path
) -> None:
    assemble = report.assemble

    def broken(*arguments: Any) -> Json:
        made = assemble(*arguments)
        return made | {"summary": made["summary"] | {"broken": ["a hazard of 9 s"]}}

    monkeypatch.setattr(report, "assemble", broken)
    monkeypatch.setattr(figures, "available", lambda: False)
    shutil.copytree(small, tmp_path, dirs_exist_ok=True)
    done = automcm(*SMALL, "--out", tmp_path)
    assert done.exit_code == 1 and "BROKEN: a hazard of 9 s" in done.stderr
