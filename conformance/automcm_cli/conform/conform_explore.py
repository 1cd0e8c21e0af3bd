"""``automcm conform explore``: random walks outside the paths of the suite."""

from __future__ import annotations

import time
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from automcm_cli.shared.adapter_options import Limit, WithCommand, command_of, fresh_folder
from automcm_cli.shared.common import Json, code_3, console_of, example, progress, write_json
from automcm_conformance.adapter.process import LIMIT_S
from automcm_spec.support import files

if TYPE_CHECKING:
    from rich.console import Console

    from automcm_conformance.exchange.results import Exploration


app = typer.Typer()


@app.command(cls=WithCommand, epilog=example("conform explore 60 --seed 7 -- ./my_adapter"))
def explore(
    ctx: typer.Context,
    seconds: Annotated[float, typer.Argument(help="Duration in seconds of real time.", min=0.0)],
    seed: Annotated[int, typer.Option(help="Seed of the walks and of the station.", min=0)] = 1,
    walks: Annotated[
        int | None, typer.Option(help="Stop after this many walks instead of after SECONDS.", min=1)
    ] = None,
    enough: Annotated[
        int, typer.Option(help="Stop after this many different failures.", min=1)
    ] = 3,
    out: Annotated[
        Path | None, typer.Option(help="Folder for the report.  Default: runs/<time>.")
    ] = None,
    limit: Limit = LIMIT_S,
    json_: Json = None,
) -> None:
    """Test a station by random walks through the graphs.

    The walks prefer transitions that no walk has taken.  The peers answer, and the radio repeats,
    delays and loses messages.  Each failure is shortened on the station itself and is written to a
    file for conform replay.
    """
    from automcm_conformance.adapter.process import AdapterError
    from automcm_conformance.adapter.protocol import ProtocolError
    from automcm_conformance.explore.explore import explore as explore_
    from automcm_spec.graph.oracle import OracleError

    command = command_of(ctx)
    folder = out or fresh_folder()
    started, clock = datetime.now(UTC), time.monotonic()

    def more(number: int) -> bool:
        return number < walks if walks is not None else time.monotonic() - clock < seconds

    with code_3("explore", AdapterError, ProtocolError, OracleError, OSError):
        with files.new_folder(folder, named=True), progress() as notify:
            found = explore_(
                command, folder, limit_s=limit, seed=seed, enough=enough, notify=notify, more=more
            )
        found.started = started.isoformat(timespec="seconds")
        found.seconds = round(time.monotonic() - clock, 1)
        write_json(folder / "exploration.json", found.as_dict())
    if write_json(json_, found.as_dict()):
        _show(found, folder, console_of())
    raise typer.Exit(found.exit_code)


def _show(found: Exploration, folder: Path, console: Console) -> None:
    from automcm_conformance.report import terminal_report

    who = found.implementation
    console.print(f"{who.name} {who.version}", markup=False)
    console.print(f"{found.walks:,} walks, {found.lines:,} lines, seed {found.seed}")
    for name, counts in found.coverage.items():
        shares = (f"{kind} {reached:,} of {total:,}" for kind, (reached, total) in counts.items())
        console.print(f"{name:<10} {', '.join(shares)}", highlight=False)
    for problem in found.problems:
        console.print(f"Problem: {problem}", markup=False)
    for case in found.cases:
        console.print()
        terminal_report.failure(case, case.failures[0], console)
    if not found.cases and found.walks:
        console.print("Every answer conforms to the specification.")
    elif found.again:
        console.print(f"{found.again:,} more walks failed in one of these ways.")
    console.print(f"Report: {folder / 'exploration.json'}", markup=False, soft_wrap=True)
