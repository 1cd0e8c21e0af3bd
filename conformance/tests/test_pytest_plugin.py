"""``pytest --automcm-adapter``: the tests, and the outcome for each verdict."""

from __future__ import annotations

import json
import shlex
import subprocess
import sys
from pathlib import Path
from xml.etree import ElementTree

import pytest
from cli_stage import REFERENCE

import automcm_conformance.report.pytest_cases  # noqa: F401  else pytester would import it in each run

pytest_plugins = "pytester"
GOOD = shlex.join(REFERENCE)
CASE = "AMCM/STA/END/BI-19"
OTHER = "AMCM/RCV/ADV/TI-03"
SKIPPED = "AMCM/STA/ACT/TI-02"
"""A case that needs the feature cam."""
STATION = """
import json, sys
from automcm.adapters.adapter_lines import Kit
kit = Kit()
for line in sys.stdin:
    command = json.loads(line)
    if command["cmd"] == "stop":
        break
    command.get("message", {}).pop("unknown", None)
    answer = kit.answer(command)
    if "features" in answer:
        answer["features"] = ["prescriber", "receiver", "restart", "durations"]
    print(json.dumps(answer), flush=True)
"""
"""It overlooks an unknown field in a message (END-5), and does not claim CAMs."""


@pytest.fixture
def bad(pytester: pytest.Pytester) -> str:
    """The command of a station that is wrong."""
    return shlex.join([sys.executable, str(pytester.makepyfile(station=STATION))])


def options(adapter: str, *more: str) -> list[str]:
    return ["--automcm-adapter", adapter, "--automcm-out", "out", *more]


def selected(*ids: str) -> list[str]:
    return [text for each in ids for text in ("--automcm-select", each)]


def test_without_an_adapter_there_is_nothing(pytester: pytest.Pytester) -> None:
    pytester.makepyfile("def test_mine(): pass")
    done = pytester.runpytest("-v")
    done.assert_outcomes(passed=1)
    done.stdout.no_fnmatch_line("*conformance*")
    assert pytester.runpytest("automcm::AMCM").ret == pytest.ExitCode.USAGE_ERROR


@pytest.mark.slow
def test_in_every_run_nothing_of_the_kit_is_imported() -> None:
    code = (
        "import sys, pytest; pytest.main(['--markers']); print(sorted(name for name in sys.modules"
        " if name.startswith('automcm_')))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    found = done.stdout.splitlines()[-1]
    assert "automcm_conformance.report.pytest_plugin" in found, (
        "it is not installed: make .venv/ready"
    )
    assert found.count("automcm_") == 3, found  # with its two packages


def test_cases_are_listed_without_the_adapter(pytester: pytest.Pytester) -> None:
    done = pytester.runpytest(*options("no-such-adapter"), "--collect-only", "-q")
    listed = [line for line in done.outlines if line.startswith("automcm::AMCM/")]
    assert done.ret == 0 and len(listed) > 200
    assert f"automcm::{CASE}" in listed
    assert not (pytester.path / "out").exists()


@pytest.mark.parametrize(
    ("arguments", "wanted"),
    [
        (("-k", "AMCM/RCV/NEG"), "AMCM/RCV/NEG/"),
        (("-m", "NEG-5 and not END-3"), "AMCM/"),
        (("-k", "NEG-5 and STA"), "AMCM/STA/NEG/BI-01"),
        (("-m", "SHOULD and CMD-1"), "AMCM/"),
        (("automcm::AMCM/RCV/NEG",), "AMCM/RCV/NEG/"),
        ((f"automcm::{CASE}",), CASE),
        (("automcm::NEG-5",), "AMCM/"),
        (selected("NEG-5", CASE), "AMCM/"),
        (("test_mine.py", "-k", CASE), CASE),
    ],
)
def test_cases_are_chosen(
    pytester: pytest.Pytester, arguments: tuple[str, ...], wanted: str
) -> None:
    pytester.makepyfile(test_mine="def test_mine(): pass")
    done = pytester.runpytest(
        *options("none"), "--strict-markers", "--collect-only", "-q", *arguments
    )
    listed = [line for line in done.outlines if line.startswith("automcm::")]
    assert 0 < len(listed) < 60 and all(line.startswith(f"automcm::{wanted}") for line in listed)


@pytest.mark.slow
def test_an_adapter_in_the_settings(pytester: pytest.Pytester) -> None:
    pytester.makeini(f"[pytest]\nautomcm_adapter = {GOOD}\nautomcm_select = {CASE}")
    pytester.makepyfile(test_mine="def test_mine(): pass")
    arguments = ("--automcm-out", "out")
    pytester.runpytest(*arguments).assert_outcomes(passed=2)
    pytester.runpytest(*arguments, "test_mine.py").assert_outcomes(passed=1)
    pytester.runpytest(*arguments, "automcm::").assert_outcomes(passed=1)


def test_verdicts(pytester: pytest.Pytester, bad: str) -> None:
    done = pytester.runpytest(
        *options(bad, *selected(CASE, OTHER, SKIPPED)), "--junitxml", "junit.xml", "-ra"
    )
    done.assert_outcomes(passed=1, failed=1, skipped=1)
    done.stdout.fnmatch_lines(
        [
            f"*_ {CASE} _*",
            "given *",
            "END-5: a message that breaks the protocol *",
            "Expected one of",
            "Received",
            "Exchange",
            "Replay: automcm conform replay out/replay/AMCM-STA-END-BI-19-1.json -- *",
            "*Does not conform: 1 MUST case fails; 1 MUST case skipped; only a part of the *",
            "Report: out/report.html",
            f"FAILED automcm::{CASE} - Failed: *",
        ],
        consecutive=False,
    )
    told = json.loads((pytester.path / "out" / "report.json").read_text())
    assert set(told["selectors"]) == {CASE, OTHER, SKIPPED} and told["started"]
    assert (pytester.path / "out" / told["cases"][0]["log"]).exists()
    (test,) = [
        test
        for test in ElementTree.parse(pytester.path / "junit.xml").iter("testcase")
        if test.get("name") == CASE
    ]
    found = {p.get("name"): p.get("value") for p in test.iter("property")}
    assert found == {"rules": "END-5", "level": "MUST"} and test.find("failure") is not None


def test_known_deviations(pytester: pytest.Pytester, bad: str) -> None:
    (pytester.path / "known.toml").write_text(
        f'"{CASE}" = {{verdict = "FAIL", because = "ticket 12"}}\n'
        f'"{OTHER}" = {{verdict = "FAIL", because = "ticket 13"}}\n'
    )
    done = pytester.runpytest(
        *options(bad, *selected(CASE, OTHER), "--automcm-expect", "known.toml"), "-rx"
    )
    done.assert_outcomes(xfailed=1, failed=1)
    done.stdout.fnmatch_lines(["*was expected to fail*", "because: ticket 13", "*ticket 12*"])


def test_an_adapter_that_breaks(pytester: pytest.Pytester) -> None:
    code = pytester.makepyfile(station=STATION.replace('"message", {})', '"message")'))
    done = pytester.runpytest(*options(shlex.join([sys.executable, str(code)]), *selected(CASE)))
    done.assert_outcomes(failed=1)
    done.stdout.fnmatch_lines(["*AttributeError*"])


def test_no_adapter_is_one_failure(pytester: pytest.Pytester) -> None:
    pytester.makepyfile("def test_mine(): pass")
    done = pytester.runpytest(*options("no-such-adapter"), "-k", "BI or mine")
    outcomes = done.parseoutcomes()
    assert (outcomes["failed"], outcomes["passed"]) == (1, 1) and outcomes["skipped"] > 50
    done.stdout.fnmatch_lines(["the suite could not be run: no-such-adapter cannot be started*"])


@pytest.mark.slow
def test_no_adapter_is_one_failure_of_all_workers(pytester: pytest.Pytester) -> None:
    arguments = (*options("no-such-adapter"), *selected("AMCM/RCV/NEG/BI"), "-n", "2")
    outcomes = pytester.runpytest_subprocess(*arguments).parseoutcomes()
    assert outcomes["failed"] == 1 and outcomes["skipped"] == 5


@pytest.mark.slow
def test_workers_share_one_run(pytester: pytest.Pytester, bad: str) -> None:
    station = pytester.path / "station.py"
    station.write_text(f"open('started', 'a').write('x')\n{station.read_text()}")
    pytester.makepyfile("def test_mine(): pass")
    arguments = options(bad, *selected(CASE, OTHER, SKIPPED), "-n", "2")
    done = pytester.runpytest_subprocess(*arguments)
    done.assert_outcomes(passed=2, failed=1, skipped=1)
    done.stdout.fnmatch_lines(["*Does not conform: 1 MUST case fails*", "Report: out/report.html"])
    # The station is started for the run, and once more to confirm the failure.
    assert (pytester.path / "started").read_text() == "xx"


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (selected("NEG-44"), "NEG-4"),
        (["automcm::AMCM/RVC"], "AMCM/RCV"),
        (["--automcm-limit", "x"], "float"),
        (["--automcm-limit", "nan"], "--automcm-limit must be at least 0.01"),
        (["--automcm-seed", "-1"], "--automcm-seed must be at least 0"),
        (["--automcm-expect", "none.toml"], "none.toml"),
        (["--automcm-adapter", "'"], "quotation"),
    ],
    ids=str,
)
def test_usage_errors(pytester: pytest.Pytester, arguments: list[str], says: str) -> None:
    done = pytester.runpytest(*options("none", *arguments))
    assert done.ret == pytest.ExitCode.USAGE_ERROR
    assert says in str(done.stderr) + str(done.stdout)


def test_the_entry_point_is_declared() -> None:
    text = (Path(__file__).resolve().parents[2] / "pyproject.toml").read_text()
    assert 'automcm = "automcm_conformance.report.pytest_plugin"' in text
