"""Commands in a folder of somebody else: its links, and the characters in its files."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest
from cli_stage import REFERENCE, automcm

CORPUS = Path(__file__).resolve().parents[2] / "traces" / "corpus"
BAD = "ack_missing.ndjson"


@pytest.fixture
def foreign(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The working directory, with a log that diverges."""
    shutil.copy(CORPUS / "bad" / BAD, tmp_path)
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.mark.parametrize(
    ("words", "written"),
    [
        (f"trace explain {BAD}", "runs/explain/ack_missing-7.ndjson"),
        (f"trace shrink {BAD}", f"runs/shrink/{BAD}"),
        (f"trace export {BAD}", "runs/export/ack_missing.mmd"),
        (f"trace itf {BAD}", "ack_missing.itf.json"),
        (f"trace html {BAD}", "runs/trace.html"),
        (f"trace replay {BAD} -- {' '.join(REFERENCE)}", "runs/replay/ack_missing-replayed.ndjson"),
        ("simulate lane-change --vehicles 4 --seconds 1", "runs/simulate"),
        ("experiment loss --workers 1", "runs/evaluation/loss/cells.ndjson"),
        ("demo", "runs/demo"),
    ],
)
def test_no_output_that_the_user_did_not_name_follows_a_link(
    words: str, written: str, foreign: Path
) -> None:
    for part in [Path(written), *Path(written).parents][:-1]:
        shutil.rmtree("runs", ignore_errors=True)
        part.parent.mkdir(parents=True, exist_ok=True)
        part.symlink_to(foreign / "target")
        done = automcm(*words.split())
        assert done.exit_code in (1, 3) and "a symbolic link" in done.output, done.output
        assert str(part) in done.output and not (foreign / "target").exists()
        part.unlink()
