"""The report on a terminal and in a pipe."""

from __future__ import annotations

import io
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from report_stage import case, failure, run
from report_stage import hostile as hostile
from rich.console import Console

from automcm_conformance.exchange.results import BROKE, CUT_SHORT, INTERRUPTED, Report
from automcm_conformance.report import terminal_report


def printed(render: Any, **options: Any) -> str:
    """What ``render`` prints into a pipe."""
    console = Console(file=io.StringIO(), **{"width": 100} | options)
    render(console)
    out = console.file
    assert isinstance(out, io.StringIO)
    return out.getvalue()


def test_the_summary_in_a_pipe(tmp_path: Path) -> None:
    cases = [case(f"AMCM/PRE/ACT/BI-{n:02}", "FAIL", reason=f"why {n}") for n in range(20)]
    out = printed(lambda console: terminal_report.summary(run(case(), *cases), console, tmp_path))
    lines = out.splitlines()
    assert "\x1b" not in out
    assert len(lines) < 40 and max(len(line) for line in lines[:-1]) <= 100
    assert lines[1] == "Does not conform: 20 MUST cases fail"
    assert "Unexpected: 20 of 21 cases" in lines and "and 10 more" in lines
    assert any(line.split() == ["ACT", "actuating", ".", "20", ".", ".", "."] for line in lines)
    assert lines[-1] == f"Report: {tmp_path / 'report.html'}"


@pytest.mark.parametrize("options", [{}, {"force_terminal": True, "width": 80}])
def test_a_long_reason_hides_no_verdict(options: Any) -> None:
    bad = [case(f"AMCM/PRE/ACT/BI-{n:02}", "FAIL", reason="why " * 100) for n in range(5)]
    out = printed(
        lambda console: terminal_report.summary(run(*bad), console), no_color=True, **options
    )
    table = [line for line in out.splitlines() if "AMCM/PRE" in line]
    assert len(table) == 5
    for line, each in zip(table, bad, strict=True):
        assert line.startswith(f"FAIL  {each.id}  why why") and line.endswith("…"), line


@pytest.mark.parametrize("reason", ["", "left out of 9: 1 needs cam"])
def test_what_was_expected_stands_before_the_reason(reason: str) -> None:
    gone = case(wanted="FAIL", because="ticket 12", reason=reason)
    out = printed(lambda console: terminal_report.summary(run(gone), console))
    wanted = f"PASS  {gone.id}  FAIL was expected{'; ' if reason else ''}{reason}"
    assert wanted in [line.rstrip() for line in out.splitlines()]


def test_a_good_summary_is_short() -> None:
    out = printed(lambda console: terminal_report.summary(run(case()), console))
    assert out.endswith("Every verdict is as expected.\n")


def test_a_failure_in_a_pipe() -> None:
    bad = case(verdict="FAIL", failures=[failure()])
    out = printed(lambda console: terminal_report.failure(bad, bad.failures[0], console))
    lines = out.splitlines()
    assert "Station.tla, line 321: OnForeignPrescription" in lines
    assert lines[-1] == "automcm conform replay text"
    kit, station = (next(line for line in lines if word in line) for word in ("said", "answered"))
    assert kit.index("said") < station.index("answered")
    assert "allowed text" in out and "came text" in out


def test_the_end_of_a_long_exchange_is_printed() -> None:
    bad = case(verdict="FAIL", failures=[failure()])
    (shown,) = bad.failures
    shown.exchange = [replace(shown.exchange[0], text=f"line {n};") for n in range(60)]
    out = printed(lambda console: terminal_report.summary(run(bad), console))
    assert "line 59;" in out and "line 43;" not in out and "44 lines more" in out
    out = printed(lambda console: terminal_report.failure(bad, shown, console))
    assert "line 0;" in out


def test_why_cases_were_not_reached() -> None:
    cases = [case("AMCM/PRE/ACT/BI-01", "FAIL", failures=[failure()])]
    report = run(*cases, case("AMCM/PRE/ACT/BI-02", "INCONC"))
    for notes, why in (
        ([], "because of the wrong answers"),
        ([f"{CUT_SHORT} after 1 failed case"], "because the run ended"),
        ([INTERRUPTED], "because the run ended"),
        ([f"{BROKE}: KeyError: 1"], "because the run ended"),
    ):
        report.notes = notes
        out = printed(lambda console: terminal_report.summary(report, console))
        assert f"1 case was not reached ({why})" in out


@pytest.mark.parametrize("options", [{}, {"force_terminal": True, "width": 100}])
def test_nothing_of_the_station_is_obeyed(hostile: Report, options: Any) -> None:
    bad = hostile.cases[1]
    outs = [
        printed(lambda console: terminal_report.summary(hostile, console, Path("out")), **options),
        printed(lambda console: terminal_report.failure(bad, bad.failures[0], console), **options),
    ]
    for out in outs:
        own = out.replace("\x1b[", "") if options else out
        assert all(char.isprintable() or char == "\n" for char in own)
        assert "\x1b[2J" not in out and len(out) < 40_000
        assert not any(line.startswith("Conforms") for line in out.splitlines())
    if "[bold red]" in hostile.implementation.name:
        assert all("[bold red]not markup[/] [/nothing] :smile:" in out for out in outs)
