"""``automcm bench``: the benches of a subject as a table of ratios, each with its bar."""

from __future__ import annotations

import os
import subprocess
import sys
from dataclasses import asdict
from pathlib import Path
from typing import Annotated, Any
from xml.etree import ElementTree

import typer
from pydantic.dataclasses import dataclass

from automcm_cli.shared.common import Json, code_3, console_of, example, say, table_of, write_json
from automcm_spec.support import children, scratch

app = typer.Typer()
FOLDER = Path(__file__).parent
OPTIONS = [
    *("-qs", "-c", os.devnull, "-o", "python_functions=bench_*"),
    *("-p", "automcm_maintenance.benches.plugin", "-p", "no:cacheprovider", "-p", "no:xdist"),
    *("--benchmark-enable", "--benchmark-min-rounds=3", "--benchmark-disable-gc"),
    "--benchmark-timer=time.process_time",
]
SUBJECTS = {
    "station": "the core, codecs and sessions of the reference",
    "kernels": "the trajectory kernels",
    "window": "an advertising window that closes early (ADV-9)",
    "radio": "the simulated radio channel",
    "traces": "reading and judging logs",
    "conform": "the kit's check of an adapter, in Python and C++",
    "traffic": "traffic with stations in SUMO; needs automcm[sumo]",
}


@dataclass(frozen=True)
class BenchRow:
    """One figure.  ``beside``: its baseline; ``at_most``: the bar, above which the ratio falls
    short."""

    name: str
    value: float
    unit: str
    beside: str | None = None
    at_most: float | None = None


@dataclass(frozen=True)
class BenchRun:
    """All figures of a run, and why a bench was left out, by name."""

    rows: list[BenchRow]
    skipped: dict[str, str]

    def ratio(self, row: BenchRow) -> float | None:
        """The ratio to the baseline, if there is another row of that name and it was measured."""
        values = {each.name: each.value for each in self.rows if each is not row}
        _, bracket, parameters = row.name.partition("[")
        for baseline in (f"{row.beside}{bracket}{parameters}", row.beside):
            if baseline in values:
                return row.value / values[baseline]
        return None


class BenchFailure(Exception):
    """A bench that does not run; the text is the last error that pytest shows."""


def measured(subject: str, seconds: float) -> BenchRun:
    """Run the benches of a subject, each for about this long.  Raises BenchFailure."""
    with scratch.folder("bench") as folder:
        report = folder / "report.xml"
        words = [sys.executable, "-m", "pytest", str(FOLDER / f"{subject}_bench.py"), *OPTIONS]
        words += [f"--junitxml={report}", f"--benchmark-max-time={seconds}"]
        words = children.ending_with_parent(words)
        env = {name: value for name, value in os.environ.items() if name != "PYTEST_XDIST_WORKER"}
        done = subprocess.run(words, capture_output=True, text=True, env=env)
        if done.returncode:
            lines = [line for line in (done.stdout + done.stderr).splitlines() if line.strip()]
            lines = [line for line in lines if line.startswith("E  ")] or lines
            raise BenchFailure(f"{subject}: {lines[-1].removeprefix('E').strip()}")
        run = BenchRun([], {})
        for case in ElementTree.parse(report).iter("testcase"):
            name = case.attrib["name"].removeprefix("bench_")
            if (skipped := case.find("skipped")) is not None:
                run.skipped[name] = skipped.attrib["message"]
                continue
            found: dict[str, Any] = {each.attrib["name"]: each.attrib["value"] for each in case[0]}
            run.rows.append(BenchRow(name, **found))
        return run


def _command(subject: str, about: str) -> None:
    def command(
        seconds: Annotated[
            float, typer.Option(help="Duration of each bench in seconds.", min=0.01)
        ] = 1.0,
        json_: Json = None,
    ) -> None:
        with code_3("bench", BenchFailure, OSError):
            run = measured(subject, seconds)
        rows = [_entry(run, row) for row in run.rows]
        short = [row["name"] for row in rows if row["ok"] is False]
        if write_json(json_, {"rows": rows, "skipped": run.skipped, "falls_short": short}):
            _show(rows, run.skipped)
        for name in short:
            say(f"{name} falls short of its bar", err=True)
        raise typer.Exit(1 if short else 0)

    command.__doc__ = (
        f"Measure {about}.\n\nEach figure has a baseline of the same run. The exit code is 1 if a "
        "ratio to it is above its bar. Times are CPU times, the least of all rounds."
    )
    app.command(subject, epilog=example(f"bench {subject} --seconds 1"))(command)


def _entry(run: BenchRun, row: BenchRow) -> dict[str, Any]:
    found = run.ratio(row)
    ok = None if found is None or row.at_most is None else found <= row.at_most
    return asdict(row) | {"ratio": found, "ok": ok}


def _show(rows: list[dict[str, Any]], skipped: dict[str, str]) -> None:
    from rich.text import Text

    table = table_of("", "figure", "unit", "beside", "ratio", "at most", "")
    for row in rows:
        cells = [row["name"], f"{row['value']:,.2f}", row["unit"]]
        if row["ratio"] is not None:
            end = "" if row["ok"] else "falls short"
            cells += [row["beside"], f"{row['ratio']:.3g}", f"{row['at_most']:g}", end]
        table.add_row(*map(Text, cells))
    console = console_of(110)
    console.print(table)
    for name, reason in skipped.items():
        console.print(Text(f"not measured: {name} ({reason})"))


for _subject, _about in SUBJECTS.items():
    _command(_subject, _about)
