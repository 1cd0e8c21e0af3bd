"""``automcm trace lint``, ``show`` and ``coverage`` from the command line."""

from __future__ import annotations

import json
import os
from pathlib import Path

import pytest
from cli_stage import automcm
from merged_runs import simulated

from automcm_spec.vocabulary.station import CONDITIONS

COMMANDS = ("lint", "show", "coverage")


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    first, *_ = simulated(tmp_path_factory.mktemp("logs"), 1001, 2002, loss=0.1, until=5_000)
    return first.parent


@pytest.mark.parametrize("command", COMMANDS)
def test_each_names_what_it_cannot_read(
    command: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What a wrong file is named for is in test_reader."""
    (tmp_path / "image").write_bytes(b"\x89PNG\r\n\x1a\n\x00")
    for name, problem in (
        ("image", "this is a PNG image"),
        (".", "contains no log"),
        ("none", "no such file"),
    ):
        answer = automcm("trace", command, tmp_path / name)
        assert answer.exit_code == 3 and problem in answer.output
        assert str(tmp_path) in answer.output
    assert automcm("trace", command).exit_code == 2
    monkeypatch.setattr(os, "access", lambda path, mode: path == tmp_path)
    (tmp_path / "sub").mkdir()
    assert "sub: cannot be read" in automcm("trace", command, tmp_path).output


def test_lint_tells_all_and_as_json(folder: Path, tmp_path: Path) -> None:
    lines = (folder / "1001.ndjson").read_bytes().splitlines(keepends=True)
    bad = tmp_path / "bad.ndjson"
    bad.write_bytes(b"".join([*lines[:5], b"rubbish\n", *lines[6:9], *lines[8:]]))
    answer = automcm("trace", "lint", bad, folder)
    assert answer.exit_code == 1
    assert (
        f"{bad}:6: not JSON" in answer.output and f"{bad}:10: seq: 8 is repeated" in answer.output
    )
    assert "2002.ndjson: clean" in answer.output
    answer = automcm("trace", "lint", "--json", "-", "--most", "1", bad)
    value = json.loads(answer.output)
    [file] = value["files"]
    assert (value["exit"], file["verdict"], len(file["findings"])) == (1, "findings", 1)
    assert file["errors"] >= 3


def test_show_filters_and_counts_cams(folder: Path) -> None:
    arguments = ["trace", "show", str(folder), "--session", "1001/1", "--no-timers"]
    answer = automcm(*arguments)
    lines = answer.output.splitlines()
    assert lines[0].split() == ["ms", "line", "1001", "2002"]
    assert "CAMs not shown" in lines[-1] and max(len(line) for line in lines) <= 80
    assert "Intention ->1001" in answer.output and "arm " not in answer.output
    assert answer.output == automcm(*arguments).output
    answer = automcm("trace", "show", folder, "--type", "Intention")
    assert {line.split()[2] for line in answer.output.splitlines()[1:]} <= {
        "Intention",
        "<-",
        "x1001",
        "=",
    }
    answer = automcm("trace", "show", folder, "--type", "CAM")
    assert "CAM ->all" in answer.output and "not shown" not in answer.output


JSON = [(c, "--json") for c in (*COMMANDS, "explain", "diff", "export", "html", "itf", "watch")]


@pytest.mark.parametrize(("command", "option"), [*JSON, ("coverage", "--out"), ("html", "--out")])
def test_no_log_is_overwritten(command: str, option: str, folder: Path, tmp_path: Path) -> None:
    text = (folder / "1001.ndjson").read_bytes()
    log = tmp_path / "1001.ndjson"
    log.write_bytes(text)
    answer = automcm("trace", command, log, *[log] * (command == "diff"), option, log)
    assert answer.exit_code == 2 and "is an input and would be overwritten" in answer.output
    assert log.read_bytes() == text


def test_show_gives_the_last_rows_and_json(folder: Path) -> None:
    answer = automcm("trace", "show", folder, "--last", "3", "--json", "-")
    rows = json.loads(answer.output)["rows"]
    assert len(rows) == 3 and rows[-1]["text"].startswith("-- end")
    answer = automcm("trace", "show", folder, "--station", "2002", "--from-line", "9")
    assert answer.output.splitlines()[0].split() == ["ms", "line", "2002"]
    assert int(answer.output.splitlines()[1].split()[1]) >= 9


@pytest.mark.parametrize("session", ["1001", "a/b", "1/2/3", "/", "-1/2", "\u0661/1"])
def test_what_is_no_session_is_a_usage_error(session: str, folder: Path) -> None:
    answer = automcm("trace", "show", folder, f"--session={session}")
    assert answer.exit_code == 2


def test_show_warns_of_a_station_without_a_log(folder: Path) -> None:
    answer = automcm("trace", "show", folder, "--station", "7")
    assert "no log of station 7" in answer.output


def test_show_gives_what_it_can_of_a_damaged_log(folder: Path, tmp_path: Path) -> None:
    lines = (folder / "1001.ndjson").read_bytes().splitlines(keepends=True)
    bad = tmp_path / "1001.ndjson"
    bad.write_bytes(b"".join([*lines[:30], b"rubbish\n"]))
    answer = automcm("trace", "show", bad, "--cams")
    assert answer.exit_code == 3
    assert answer.output.splitlines()[-1].split()[:3] == ["31", "--", "UNREADABLE:"]


def test_coverage_as_json(folder: Path, tmp_path: Path) -> None:
    target = tmp_path / "coverage.json"
    answer = automcm("trace", "coverage", folder, "--json", target)
    value = json.loads(target.read_text())
    assert answer.exit_code == 0 and value["logs"] == 2
    assert value["rules"]["NEG-2"] == 1 and value["rules"]["NEG-4"] == 0
    assert {row["operator"] for row in value["conditions"]} > {"OnCam", "OnFin"}
    assert "rules" in answer.output


def test_coverage_on_the_text_of_the_specification(folder: Path) -> None:
    answer = automcm("trace", "coverage", folder, "--annotate")
    assert answer.exit_code == 0 and "logs, " not in answer.output
    line = next(c.line for c in CONDITIONS if c[0] == "OnRequest" and c.text == "Bound(st)")
    assert f'false  {line}   IF Bound(st) THEN Refuse(st, "ADV-1")' in answer.output.splitlines()


def test_no_color_means_none(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    arguments = ["trace", "show", str(folder), "--last", "3"]
    monkeypatch.setenv("FORCE_COLOR", "1")
    monkeypatch.setenv("TERM", "xterm")
    monkeypatch.delenv("NO_COLOR", raising=False)
    assert "\x1b" in automcm(*arguments, color=True).output
    monkeypatch.setenv("NO_COLOR", "1")
    assert "\x1b" not in automcm(*arguments, color=True).output


def test_coverage_writes_a_page(folder: Path, tmp_path: Path) -> None:
    out = tmp_path / "new" / "coverage.html"
    shown = automcm("trace", "coverage", folder, "--out", out)
    assert shown.output == automcm("trace", "coverage", folder).output
    assert "<h1>Coverage of Station.tla</h1>" in out.read_text()
    assert automcm("trace", "coverage", folder, "--out", folder).exit_code == 3
