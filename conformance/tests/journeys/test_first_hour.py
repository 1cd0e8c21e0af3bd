"""docs/first-hour.md: its commands give the output on the page."""

from __future__ import annotations

import json
import re
import subprocess
from pathlib import Path

import pytest
from cli_stage import automcm
from first_hour import CASES, PAGE, blocks, cpp_station, python_station


@pytest.fixture(scope="module")
def mine(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return python_station(tmp_path_factory.mktemp("mine"))


def conform(*arguments: str) -> tuple[int, str]:
    answer = automcm("conform", *arguments)
    return answer.exit_code, answer.output


def shown(first: str) -> str:
    """The output in the page that begins so."""
    return PAGE.split(f"```\n{first}")[1].split("```")[0].strip()


def test_what_is_said_to_it_by_hand(mine: Path, tmp_path: Path) -> None:
    """With the first three parts alone, as in the page."""
    run = python_station(tmp_path / "mine")
    station = "\n".join(blocks("python")[2:5])
    (run.parent / "station.py").write_text(station)
    said = PAGE.split("<<'LINES'\n")[1].split("LINES\n")[0]
    for command in (mine, run):
        done = subprocess.run(
            [command], input=said, capture_output=True, text=True, check=True, timeout=60
        )
        assert done.stdout == blocks("json")[0]


def test_each_line_has_the_right_form(mine: Path) -> None:
    code, output = conform("check-adapter", "--", str(mine))
    assert code == 0 and "error" not in output, output


@pytest.mark.slow
def test_the_cases_of_the_page_pass(mine: Path, tmp_path: Path) -> None:
    assert f"automcm conform run {' '.join(CASES)} -- mine/run" in PAGE
    code, output = conform("run", *CASES, "--out", str(tmp_path), "--", str(mine))
    assert code == 0 and shown("Conforms as") in output, output
    coverage = json.loads((tmp_path / "report.json").read_text())["coverage"]
    driven = re.search(r"goes through ([\d,]+) transitions and\ngives ([\d,]+) inputs", PAGE)
    assert driven is not None
    counts = [f"{coverage[name][0]:,}" for name in ("transitions", "refusals")]
    assert list(driven.groups()) == counts


@pytest.mark.slow
def test_the_mistake_of_the_page_is_found(tmp_path: Path) -> None:
    run = python_station(tmp_path / "mine")
    station = run.parent / "station.py"
    text = station.read_text()
    assert text.count('"busy"') == 1
    station.write_text(text.replace('"busy"', '"unsafe"'))
    out = str(tmp_path / "report")
    code, output = conform("run", "AMCM/RCV/NEG/BI-05", "--out", out, "--", str(run))
    assert code == 1 and shown("FAIL AMCM") in output, output


def test_the_station_in_cpp_is_assembled(tmp_path: Path) -> None:
    """It is compiled and run by foreign.py."""
    run = cpp_station(tmp_path / "mine")
    text = (run.parent / "station.hpp").read_text()
    assert text.startswith("#pragma once") and text.endswith("};\n")
    assert '#include "station.hpp"' in (run.parent / "adapter.cpp").read_text()
