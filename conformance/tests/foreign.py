"""The suite against a station that somebody else wrote: it passes in full, and each of its
mutants fails in a case that names a rule of the mutant.

    python conformance/tests/foreign.py [--station-only] [--mutant NAME]...

Needs cmake, g++ and nlohmann/json.hpp; what cannot be run for want of them counts as skipped.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import time
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from automcm_cli.cpp import SECONDS, Mutant, build, build_mutant, missing, mutants

Json = Any
AUTOMCM = Path(sys.executable).parent / "automcm"
TOGETHER = 2
"""Compilers and runs at once."""


@dataclass
class Row:
    """A line of the table; ``failed`` says why, and is empty if all is well."""

    name: str
    verdict: str = ""
    case: str = ""
    rule: str = ""
    seconds: float = 0.0
    failed: str = ""
    skipped: bool = False


def conform(station: Path, folder: Path, selectors: Sequence[str] = ()) -> tuple[int, Json]:
    """The exit code of a run, and its report (None if there is none)."""
    command = [str(AUTOMCM), "conform", "run", *selectors, "--out", str(folder)]
    done = subprocess.run(
        [*command, "--", str(station)], capture_output=True, text=True, timeout=SECONDS
    )
    file = folder / "report.json"
    report = json.loads(file.read_text()) if file.exists() else None
    if report is None:
        print(done.stderr, file=sys.stderr)
    return done.returncode, report


def check_station(folder: Path) -> Row:
    """It is built, and passes in full."""
    row, begun = Row("the station itself"), time.monotonic()
    try:
        code, report = conform(build(folder / "build"), folder / "station")
        row.failed = "no report" if report is None else wrong(code, report)
        row.verdict = "FAIL" if row.failed else "PASS"
    except (subprocess.SubprocessError, OSError) as error:
        row.failed = f"{error} {getattr(error, 'stderr', '')}"
    row.seconds = time.monotonic() - begun
    return row


def wrong(code: int, report: Json) -> str:
    """What of a report is not as it must be; empty if it is."""
    if code != 0:
        return f"exit code {code}"
    for case in report["cases"]:
        if case["verdict"] != "PASS" and (case["level"] == "MUST" or not case["expected"]):
            return f"{case['id']}: {case['verdict']} {case['reason']}"
    if report["problems"]:
        return "; ".join(report["problems"])
    for name, (reached, total) in report["coverage"].items():
        if reached < total or total == 0:
            return f"{name}: {reached} of {total}"
    return ""


def fitting(report: Json, rules: Sequence[str]) -> tuple[str, str]:
    """The first FAIL that names one of the rules: its case and the rule; else empty."""
    for case in report["cases"]:
        if case["verdict"] == "FAIL":
            for failure in case["failures"]:
                if failure["rule"] in rules:
                    return case["id"], failure["rule"]
    return "", ""


def check_mutant(mutant: Mutant, folder: Path) -> Row:
    """The suite finds the mistake: first the cases of its rules alone, then all."""
    row, begun = Row(mutant.name), time.monotonic()
    try:
        station = build_mutant(mutant, folder)
        for selectors in (mutant.rules, ()):
            code, report = conform(station, folder / mutant.name / "report", selectors)
            if report is None:
                row.failed = "no report"
                break
            row.case, row.rule = fitting(report, mutant.rules)
            row.verdict = "FAIL" if report["counts"]["FAIL"] else "PASS"
            row.failed = "" if row.rule and code == 1 else f"exit code {code}, no fitting FAIL"
            if not row.failed:
                break
    except (subprocess.SubprocessError, OSError) as error:
        row.failed = f"{error} {getattr(error, 'stderr', '')}"
    row.seconds = time.monotonic() - begun
    return row


def show(rows: Sequence[Row]) -> None:
    """The table, and what failed."""
    titles = Row("mutant", "verdict", "case", "rule")
    names = ("name", "verdict", "case", "rule")
    widths = [max(len(getattr(row, name)) for row in [titles, *rows]) for name in names]
    for row in [titles, *rows]:
        cells = (row.name, row.verdict, row.case, row.rule)
        text = "  ".join(cell.ljust(width) for cell, width in zip(cells, widths, strict=False))
        print(f"{text}  {'seconds' if row is titles else f'{row.seconds:7.1f}'}")
    for row in rows:
        if row.failed:
            print(f"{row.name}: {'SKIPPED, ' if row.skipped else ''}{row.failed}")


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.split("\n\n")[0])
    parser.add_argument("--station-only", action="store_true", help="no mutants")
    parser.add_argument("--mutant", action="append", metavar="NAME", help="this mutant alone")
    options = parser.parse_args()
    chosen = [m for m in mutants() if options.mutant is None or m.name in options.mutant]
    if options.mutant is not None and len(chosen) != len(set(options.mutant)):
        parser.error(f"--mutant: one of {', '.join(m.name for m in mutants())}")
    chosen = [] if options.station_only else chosen
    lacking = missing()
    with TemporaryDirectory(prefix="automcm-foreign-") as name:
        folder = Path(name)
        if lacking:
            print(f"SKIPPED: {lacking} is not installed", file=sys.stderr)
            names = [
                *(["the station itself"] if not options.mutant else []),
                *(m.name for m in chosen),
            ]
            rows = [Row(n, failed=f"{lacking} is missing", skipped=True) for n in names]
        else:
            with ThreadPoolExecutor(TOGETHER) as pool:
                jobs = [] if options.mutant else [pool.submit(check_station, folder)]
                jobs += [pool.submit(check_mutant, mutant, folder) for mutant in chosen]
                rows = [job.result() for job in jobs]
    show(rows)
    skipped = sum(row.skipped for row in rows)
    failed = sum(bool(row.failed) for row in rows) - skipped
    more = f", {skipped} skipped" if skipped else ""
    print(f"{len(rows) - failed - skipped} passed, {failed} failed{more}")
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
