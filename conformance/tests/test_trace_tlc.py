"""``automcm trace explain --engine tlc``: the same answers and exit codes, by TLC."""

import json
from pathlib import Path

import pytest
from cli_stage import automcm

CORPUS = Path(__file__).parents[2] / "traces" / "corpus" / "four-vehicles"


def test_a_log_is_allowed_and_an_edited_one_is_not(tmp_path: Path) -> None:
    good = CORPUS / "1001.ndjson"
    bad = tmp_path / "bad.ndjson"
    bad.write_text(good.read_text().replace('"lease_ms":20000', '"lease_ms":20001', 1))
    run = automcm("trace", "explain", "--engine", "tlc", "--json", "-", good, bad)
    assert run.exit_code == 1
    first, second = json.loads(run.stdout)["logs"]
    assert (first["verdict"], first["events"] > 100) == ("allowed", True)
    assert (second["verdict"], second["file"], second["rule"]) == ("diverges", str(bad), "PRE-2")
    oracle = automcm("trace", "explain", "--json", "-", bad)
    assert json.loads(oracle.stdout)["line"] == second["line"]


def test_without_tlc_there_is_one_clear_error(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("AUTOMCM_TLA2TOOLS", "/nowhere/tla2tools.jar")
    run = automcm("trace", "explain", "--engine", "tlc", CORPUS / "1001.ndjson")
    assert run.exit_code == 3
    assert run.stderr.strip() == (
        "explain: AUTOMCM_TLA2TOOLS names /nowhere/tla2tools.jar, which is not a file"
    )


def test_a_file_that_is_no_log_is_named(tmp_path: Path) -> None:
    (tmp_path / "rubbish").write_bytes(bytes(range(256)))
    run = automcm("trace", "explain", "--engine", "tlc", tmp_path / "rubbish", "nothing")
    assert run.exit_code == 3 and run.stdout.count("UNREADABLE") == 2
