"""What ``check-adapter`` says of a good adapter, and of one with each of the usual mistakes."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest
from suite_stage import LIMIT, SHORT
from wrong_station import station

from automcm_conformance.adapter.check_adapter import Checked, check
from automcm_maintenance.code_mutation import faults

GOOD = (Path(__file__).parents[1] / "toy_adapter.py").read_text()
MISTAKES = faults.load("toy_adapter")


def found(code: str) -> list[Checked]:
    said: list[str] = []
    limit_s = SHORT if "sleep" in code else LIMIT
    findings = check([sys.executable, "-c", code], limit_s, said.append)
    assert said
    return findings


def test_a_good_adapter() -> None:
    assert [finding.level for finding in found(GOOD)] == ["ok"] * 5


@pytest.mark.sweep(3)
@pytest.mark.parametrize("name", MISTAKES)
def test_the_usual_mistakes(name: str) -> None:
    (text,) = MISTAKES[name].texts().values()
    what = MISTAKES[name].notice["says"]
    findings = [f for f in found(text) if f.level != "ok"]
    assert any(what in f"{f.level}: {f.what}" for f in findings), findings
    assert all(f.level == "warning" for f in findings) == what.startswith("warning")


def test_a_fixed_parameter_is_given_with_others_that_fit() -> None:
    command = station('kit.HELLO["fixed"] = {"backoff_min": 3000}')
    assert all("answered with an error" not in f.what for f in check(command, LIMIT, str))


def test_a_finding_shows_the_line_and_its_answer() -> None:
    findings = found(GOOD.replace('"seq": 1}', '"seq": 0}'))
    [finding] = [f for f in findings if f.level == "error"]
    assert '"request"' in finding.sent
    assert '"seq": 0' in finding.answered


def test_an_adapter_that_cannot_be_started(tmp_path: Path) -> None:
    [finding] = check([str(tmp_path / "none")], 0.5, lambda text: None)
    assert (finding.level, finding.stderr) == ("error", [])
    assert "cannot be started" in finding.what


def test_an_adapter_that_dies_at_once() -> None:
    [finding] = found("import sys\nsys.exit('no such table')")
    assert "exit code 1" in finding.what
    assert finding.stderr == ["no such table"]


def test_an_adapter_that_says_nothing() -> None:
    [finding] = found("import time\ntime.sleep(9)")
    assert finding.what.startswith(f"no answer within {SHORT:g} s")
    assert '"hello"' in finding.sent
