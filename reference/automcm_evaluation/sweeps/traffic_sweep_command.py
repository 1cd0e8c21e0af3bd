"""``automcm simulate traffic-sweep``: many seeds of the scenarios in traffic."""

from __future__ import annotations

import logging
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any

import typer

from automcm_cli.shared.common import (
    Json,
    code_3,
    console_of,
    example,
    progress,
    say,
    table_of,
    unknown,
    write_json,
)
from automcm_spec.support import files

app = typer.Typer()


@app.command("traffic-sweep", epilog=example("simulate traffic-sweep --seeds 10"))
def traffic_sweep(
    scenario: Annotated[
        list[str] | None, typer.Option(help="Only this scenario.  Repeatable.")
    ] = None,
    seeds: Annotated[int, typer.Option(help="Number of runs of each scenario.", min=1)] = 20,
    seed: Annotated[int, typer.Option(help="Seed of the first run; then the next.", min=0)] = 0,
    twice_every: Annotated[
        int,
        typer.Option(
            help="Run the seeds that are multiples of this twice and compare the bytes (0: none).",
            min=0,
        ),
    ] = 10,
    workers: Annotated[int, typer.Option(help="Processes; 0: one per core.", min=0)] = 0,
    out: Annotated[Path, typer.Option(help="Folder for the results.")] = Path("runs/traffic-sweep"),
    again: Annotated[bool, typer.Option("--again", help="Repeat finished runs.")] = False,
    page: Annotated[
        Path | None, typer.Option(help="File for the results as Markdown.", hidden=True)
    ] = None,
    json_: Json = None,
) -> None:
    """Look for collisions, hazards and diverging logs in traffic.

    Each run of 30 simulated seconds draws its vehicles, density, penetration and radio from its
    seed.  The command writes a file for each run to the folder cells at once, and continues
    there after an interruption, also with more seeds.  The exit code is 1 if equipped vehicles
    collided, a maneuver caused a collision, an equipped vehicle hit a pedestrian, a hazard was
    unexcused (S-5) or exceeded its bound (T-2), a log diverges (trace explain), a repeated seed
    wrote other bytes, or an exception ended a run.  Needs automcm[sumo,map].
    """
    from automcm_evaluation.framework.experiment import ExperimentError
    from automcm_evaluation.sweeps import sweep, traffic_sweep
    from automcm_simulation.traffic.mover import TrafficError
    from automcm_simulation.traffic.sumo_mover import sumo_home
    from automcm_simulation.traffic_scenarios.catalogue import SCENARIOS

    for name in scenario or ():
        if name not in SCENARIOS:
            raise typer.BadParameter(unknown(name, list(SCENARIOS), "scenario"))
    names = [name for name in SCENARIOS if not scenario or name in scenario]
    with code_3("simulate traffic-sweep", TrafficError, ExperimentError, OSError):
        sumo_home()
        code = sweep.code()
        with progress() as notify:
            cells = sweep.finish(
                traffic_sweep.wanted(names, seed, seeds, twice_every),
                _checked,
                {"sweep": "traffic", "code": code},
                out,
                workers=workers,
                again=again,
                notify=lambda done, of: notify(f"{done} of {of} runs"),
            )
    summary = traffic_sweep.summary(cells)
    bad = [cell.values | cell.result for cell in cells if cell.result["wrong"]]
    report = {
        "seed": seed,
        "seeds": seeds,
        "twice_every": twice_every,
        "only": [name for name in names if scenario],
        "code": code,
        "scenarios": summary,
        "bad": bad,
    }
    files.write(page or out / "sweep.md", traffic_sweep.page(report), named=True)
    if write_json(json_, report):
        _say_sweep(summary, bad)
    raise typer.Exit(1 if bad else 0)


def _checked(values: dict[str, Any]) -> dict[str, Any]:
    """Run and judge one seed, in any process."""
    from automcm_evaluation.sweeps.traffic_sweep import check

    # Messages are lost on purpose: no warnings.
    logging.getLogger("automcm.service").setLevel(logging.ERROR)
    return check(values, not_allowed)


def not_allowed(logs: Sequence[Path]) -> list[str]:
    """A line for each log that ``trace explain`` does not allow."""
    from automcm_traces.explain.explain import verdicts_of

    return [
        f"{Path(one.file).name}:{one.finding.at.line}: {one.verdict}"
        for one in verdicts_of(logs)
        if one.verdict != "allowed"
    ]


def _say_sweep(summary: dict[str, Any], bad: Sequence[dict[str, Any]]) -> None:
    from automcm_evaluation.sweeps.traffic_sweep import COLUMNS

    table = table_of(
        "scenario", "runs", "twice", "requested", "agreed", "completed", "hazards", "longest, ms",
        "collisions: equipped", "by maneuver", "pedestrian", "all", "bad runs",
    )  # fmt: skip
    for name, row in summary.items():
        table.add_row(name, *(str(row[each]) for each in COLUMNS))
    console_of(130).print(table)
    for run in bad:
        say(f"{run['scenario']}, seed {run['seed']}: {'; '.join(run['wrong'])}")
        say(f"  {run['command']}")
