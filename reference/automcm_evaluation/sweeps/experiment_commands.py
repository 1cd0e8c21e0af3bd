"""``automcm experiment``: the paper's evaluation as seeded commands."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any

import typer

from automcm_cli.shared.common import Json, code_3, example, progress, say, usage, write_json
from automcm_spec.support import files

app = typer.Typer()

Profile = Annotated[
    str,
    typer.Option(
        help="quick (2 minutes for all) or standard (over an hour); traffic also has coarse."
    ),
]
Seed = Annotated[int, typer.Option(help="Seed.  Equal seeds give equal files.", min=0)]
Out = Annotated[
    Path, typer.Option(help="Folder for the results; each experiment gets a subfolder.")
]
Changes = Annotated[
    list[str] | None,
    typer.Option("--set", help="NAME=JSON: change the value of a setting.  Repeatable."),
]
Workers = Annotated[int, typer.Option(help="Number of processes (0 = one for each core).", min=0)]
OUT = Path("runs/evaluation")


@app.command(epilog=example("experiment render runs/evaluation"))
def render(
    folder: Annotated[Path, typer.Argument(help="Folder whose subfolders contain results.json.")],
) -> None:
    """Write figures and pages from existing results."""
    from automcm_evaluation.framework.experiment import ExperimentError
    from automcm_evaluation.sweeps import report

    found = report.results(folder)
    with code_3("experiment", ExperimentError, OSError):
        if not found:
            raise ExperimentError(f"{folder}: no subfolder contains {report.RESULTS}")
        for path in found:
            for written in report.write(report.load(path), path.parent):
                say(f"written {written}")


def _command(name: str, about: str) -> None:
    def command(
        profile: Profile = "quick",
        seed: Seed = 1,
        out: Out = OUT,
        changes: Changes = None,
        workers: Workers = 0,
        json_: Json = None,
    ) -> None:
        from automcm_evaluation.framework.experiment import ExperimentError
        from automcm_evaluation.sweeps import report, sweep
        from automcm_evaluation.sweeps.catalogue import NAMES, experiment

        with usage(ExperimentError):
            made = [experiment(each) for each in (NAMES if name == "all" else [name])]
            wanted = [(one, one.set(profile, _changes(changes or []))) for one in made]
            for one, settings in wanted:
                one.cells(settings)  # check all settings before the first run
        reports = []
        with code_3("experiment", ExperimentError, OSError), progress() as notify:
            for one, settings in wanted:
                begun = time.monotonic()
                about = sweep.header(one, profile, seed, settings)
                folder = out / one.name
                counted = _counted(one.name, notify)
                cells = sweep.sweep(one, about, folder, workers=workers, notify=counted)
                made_of_them = report.assemble(one, about, cells)
                written = report.write(made_of_them, folder)
                reports.append(made_of_them)
                if str(json_) != "-":
                    _show(made_of_them, time.monotonic() - begun, written)
            if name == "all":
                whole = out.with_suffix(".md")
                files.write(whole, report.evaluation(out))
                if str(json_) != "-":
                    say(f"written {whole}")
        write_json(json_, reports)
        broken = [text for one in reports for text in one["summary"].get("broken", [])]
        for text in broken:
            say(f"BROKEN: {text}", err=True)
        raise typer.Exit(1 if broken else 0)

    command.__doc__ = (
        f"{about}\n\nWrites results.json (.xz above 1 MB), a page and figures "
        "(automcm[plot]) into a subfolder. An interrupted run continues where it stopped. "
        "Exit code 1: a proved property did not hold."
    )
    app.command(name, epilog=example(f"experiment {name} --profile quick --seed 1"))(command)


ABOUT = {
    "bandwidth": "Bytes sent, event-driven and always-on (figure 7).",
    "arrival": "Arrival time with and without coordination (figure 8).",
    "comfort": "Cost of coordination and fallbacks for vehicles (figure 6).",
    "loss": "Success rate under loss (figure 9, equation 2).",
    "safety": "Frequency and duration of hazards, and their bound (T-2).",
    "radio": "Success over a radio channel fitted to ns-3, and its fit.",
    "traffic": "Traffic in SUMO with and without stations, and crowds.",
    "traffic-sweep": "Collisions, hazards and logs of many short runs in SUMO.",
    "all": "All but traffic-sweep, and one page of all claims.",
}


def _changes(changes: list[str]) -> dict[str, Any]:
    from pydantic_core import from_json

    from automcm_evaluation.framework.experiment import ExperimentError

    found = {}
    for text in changes:
        name, given, value = text.partition("=")
        try:
            if not given:
                raise ValueError("no =")
            found[name] = from_json(value)
        except ValueError:
            raise ExperimentError(f"--set: expected NAME=JSON, not {text!r}") from None
    return found


def _counted(name: str, notify: Callable[[str], None]) -> Callable[[int, int], None]:
    return lambda done, of: notify(f"{name}: {done} of {of} cells")


def _show(report: dict[str, Any], took: float, written: list[Path]) -> None:
    say(f"{report['experiment']}: {len(report['cells'])} cells, {took:.0f} s")
    for claim in report["claims"]:
        say(f"  {claim['verdict']}: {claim['claim']}")
        say(f"    paper: {claim['paper']}; here: {claim['here']}")
    say(f"  written to {written[0].parent}: {', '.join(path.name for path in written)}")


for _name, _about in ABOUT.items():
    _command(_name, _about)
