"""The suite against stations of other people, in C++ and in Go: they pass in full, and each mutant
of the one in C++ fails in a case whose rule fits.  The logs that the one in C++ writes are allowed.
The one that docs/first-hour.md lets its reader write in C++ passes the cases named there.

    python conformance/tests/foreign.py [--station-only] [--mutant NAME]...

Needs cmake, g++ and nlohmann/json.hpp, and Go; what cannot be run for want of them counts as
skipped.
"""

from __future__ import annotations

import argparse
import json
import os
import shutil
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import first_hour
import foreign_logs

from automcm_maintenance.code_mutation import faults
from automcm_maintenance.code_mutation.cpp_station import (
    SECONDS,
    SOURCE,
    build,
    build_mutant,
    missing,
)
from automcm_maintenance.code_mutation.faults import Fault

Json = Any
GO = SOURCE.with_name("go")
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


def go_missing() -> str:
    """What the station in Go lacks here; empty if nothing."""
    if shutil.which("go") is None:
        return "go"
    with TemporaryDirectory(prefix="automcm-go-") as name:
        done = go(Path(name), "list", ".")
    return "" if done.returncode == 0 else f"a newer go: {done.stderr.strip()}"


def go(cache: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    """Run go in the folder of the station: nothing is downloaded, nothing is left outside of
    ``cache``."""
    offline = {"GOFLAGS": "-mod=mod", "GOPROXY": "off", "GOTOOLCHAIN": "local", "GOWORK": "off"}
    env = os.environ | offline | {"GOCACHE": str(cache), "GOPATH": str(cache / "path")}
    return subprocess.run(
        ["go", *arguments], cwd=GO, env=env, capture_output=True, text=True, timeout=SECONDS
    )


def build_go(folder: Path) -> Path:
    """The station as its README says, after its own tests.  Raises CalledProcessError."""
    station = folder / "station"
    for arguments in (("vet", "."), ("test", "."), ("build", "-o", str(station), ".")):
        done = go(folder / "cache", *arguments)
        if done.returncode:
            raise subprocess.CalledProcessError(
                done.returncode, ["go", *arguments], done.stdout, done.stdout + done.stderr
            )
    return station


@dataclass(frozen=True)
class Station:
    """One of those in ``implementations``."""

    name: str
    missing: Callable[[], str]
    """What its toolchain lacks here; empty if nothing."""
    build: Callable[[Path], Path]
    """Into this folder; the program built.  Raises CalledProcessError."""


STATIONS = (
    Station("the station in C++", missing, build),
    Station("the station in Go", go_missing, build_go),
)


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


@contextmanager
def judged(row: Row) -> Iterator[None]:
    """Records the duration, the outcome unless it is recorded already, and the failures."""
    begun = time.monotonic()
    try:
        yield
        row.verdict = row.verdict or ("FAIL" if row.failed else "PASS")
    except (subprocess.SubprocessError, OSError, ValueError) as error:
        row.failed = f"{error} {getattr(error, 'stderr', '')}"
    row.seconds = time.monotonic() - begun


def lacks(row: Row, what: str) -> bool:
    """Whether something is missing, and noted as such."""
    if what:
        row.failed, row.skipped = f"{what} is missing", True
    return row.skipped


def check_station(station: Station, folder: Path) -> Row:
    """It is built, and passes in full."""
    row = Row(station.name)
    if lacks(row, station.missing()):
        return row
    with judged(row):
        own = folder / station.name.replace(" ", "-")
        code, report = conform(station.build(own), own / "report")
        row.failed = "no report" if report is None else wrong(code, report)
    return row


def check_logs(folder: Path) -> Row:
    """The logs of the station in C++ are allowed, and that of a mutant diverges where it must."""
    row = Row("the logs of the station in C++")
    if lacks(row, missing()):
        return row
    with judged(row):
        row.failed = foreign_logs.check_logs(folder / "logs")
        if not row.failed:
            row.case, row.rule = foreign_logs.check_mutant_log(folder / "logs-mutant")
            row.failed = "" if row.rule else f"no log of {foreign_logs.MUTANT} shows its mistake"
    return row


def check_first_hour(folder: Path) -> Row:
    """The station of docs/first-hour.md in C++ is built without a warning, and passes."""
    row = Row("the station of first-hour.md")
    if lacks(row, missing()):
        return row
    with judged(row):
        own, build_ = folder / "first-hour", str(folder / "first-hour" / "build")
        run = first_hour.cpp_station(own)
        for command in (["-S", str(own), "-B", build_], ["--build", build_]):
            done = subprocess.run(
                ["cmake", *command], check=True, capture_output=True, text=True, timeout=SECONDS
            )
            row.failed = row.failed or ("a warning" if "warning:" in done.stderr else "")
        code, report = conform(run, own / "report", first_hour.CASES)
        if code or report is None or report["counts"]["PASS"] != len(report["cases"]):
            row.failed = f"exit code {code}"
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


def check_mutant(mutant: Fault, folder: Path) -> Row:
    """The suite finds the mistake: first the cases of its rules alone, then all."""
    row = Row(mutant.name)
    with judged(row):
        station = build_mutant(mutant, folder)
        for selectors in (mutant.notice["rules"], ()):
            code, report = conform(station, folder / mutant.name / "report", selectors)
            if report is None:
                row.failed = "no report"
                break
            row.case, row.rule = fitting(report, mutant.notice["rules"])
            row.verdict = "FAIL" if report["counts"]["FAIL"] else "PASS"
            row.failed = "" if row.rule and code == 1 else f"exit code {code}, no fitting FAIL"
            if not row.failed:
                break
    return row


def show(rows: Sequence[Row]) -> None:
    """The table, and the failures."""
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
    mutants = faults.load("cpp").values()
    chosen = [m for m in mutants if options.mutant is None or m.name in options.mutant]
    if options.mutant is not None and len(chosen) != len(set(options.mutant)):
        parser.error(f"--mutant must be one of {', '.join(m.name for m in mutants)}")
    chosen = [] if options.station_only else chosen
    stations = () if options.mutant else STATIONS
    lacking = missing() if chosen else ""
    with TemporaryDirectory(prefix="automcm-foreign-") as name:
        folder = Path(name)
        with ThreadPoolExecutor(TOGETHER) as pool:
            jobs = [pool.submit(check_station, station, folder) for station in stations]
            if stations:
                jobs += [pool.submit(check, folder) for check in (check_logs, check_first_hour)]
            if not lacking:
                jobs += [pool.submit(check_mutant, mutant, folder) for mutant in chosen]
            rows = [job.result() for job in jobs]
        if lacking:
            why = f"{lacking} is missing"
            rows += [Row(mutant.name, failed=why, skipped=True) for mutant in chosen]
    for row in rows:
        if row.skipped:
            print(f"SKIPPED {row.name}: {row.failed}", file=sys.stderr)
    show(rows)
    skipped = sum(row.skipped for row in rows)
    failed = sum(bool(row.failed) for row in rows) - skipped
    more = f", {skipped} skipped" if skipped else ""
    print(f"{len(rows) - failed - skipped} passed, {failed} failed{more}")
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
