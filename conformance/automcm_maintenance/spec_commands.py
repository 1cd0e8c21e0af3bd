"""``automcm spec pages``, ``mutate`` and ``bench``: how far the models can be trusted.

Imports lazily: each command only what it needs.
"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from automcm_cli.shared.common import (
    Json,
    code_3,
    console_of,
    example,
    progress,
    usage,
    write_json,
)

app = typer.Typer()


@app.command("pages", epilog=example("spec pages --out runs/counterexamples"))
def spec_pages(
    out: Annotated[Path, typer.Option(help="The folder of the pages.")] = Path(
        "docs/counterexamples"
    ),
) -> None:
    """Each counterexample of docs/models.md as a page.  It is like those of automcm trace html."""
    from automcm_maintenance.documents import counterexample_pages
    from automcm_spec.model_checking import models
    from automcm_spec.model_checking.tlc import TlcError
    from automcm_traces.export.itf import ItfError

    with code_3("pages", ItfError, models.ModelError, OSError, TlcError), progress() as say:
        written = counterexample_pages.committed(models.load(), out, say)
    typer.echo(f"{len(written)} pages in {out}")


@app.command("mutate", epilog=example("spec mutate --only OnAck"))
def spec_mutate(
    profile: Annotated[
        str, typer.Option(help="quick: till a mutant is killed; deep: by which properties.")
    ] = "quick",
    module: Annotated[
        list[str] | None, typer.Option(help="A module to mutate, instead of the usual ones.")
    ] = None,
    model: Annotated[
        list[str] | None, typer.Option(help="A model to use, instead of all that fit.")
    ] = None,
    only: Annotated[
        str | None, typer.Option(help="Mutants with this in their id; * and ?.")
    ] = None,
    limit: Annotated[
        int, typer.Option(min=0, help="A fixed sample of this size; 0: all there are.")
    ] = 260,
    list_: Annotated[bool, typer.Option("--list", help="Name the mutants, run nothing.")] = False,
    jobs: Annotated[int, typer.Option(min=1, help="Mutants at a time.")] = 2,
    search: Annotated[
        float, typer.Option(min=0, help="Seconds: longer models are not run for a better kill.")
    ] = 2,
    longest: Annotated[
        float, typer.Option(min=0, help="Seconds: longer models are not run at all.")
    ] = 6,
    write: Annotated[bool, typer.Option(help="Write docs/mutation.md.")] = False,
    json_: Json = None,
) -> None:
    """Change the specification in small ways; the models must notice.  May take an hour.

    What is done is kept under runs/, so an interrupted run goes on where it was.  A mutant that
    survives must be in spec/models/survivors.toml with the reason.
    """
    from automcm_maintenance.spec_mutation import mutate_commands

    with code_3("mutate", *mutate_commands.FAULTS), usage(mutate_commands.Usage):
        asked = mutate_commands.Asked(
            profile, module, model, only, limit, jobs, search, longest, write
        )
        mutants = mutate_commands.select(asked)
        if list_:
            if write_json(json_, mutate_commands.as_rows(mutants)):
                typer.echo(mutate_commands.listed(mutants))
            return
        with progress() as say:
            report = mutate_commands.run(asked, mutants, say)
        if write:
            mutate_commands.write(report)
    if write_json(json_, mutate_commands.as_dict(report)):
        mutate_commands.show(report, console_of(110))
    raise typer.Exit(report.exit_code)


@app.command("bench", epilog=example("spec bench --seconds 120"))
def spec_bench(
    seconds: Annotated[int, typer.Option(min=1, help="For each naive encoding.")] = 60,
    json_: Json = None,
) -> None:
    """Our encoding of the radio against two naive ones.  States and seconds; at least 20 times?

    A naive one that does not finish in time gives a lower bound.  Too low a bound is code 4.
    """
    from automcm_maintenance.benches import encoding_bench
    from automcm_maintenance.benches import encoding_bench_table as bench_
    from automcm_spec.model_checking.tlc import TlcError

    with code_3("bench", TlcError, encoding_bench.BenchError, OSError), progress() as say:
        report = encoding_bench.run(seconds, say)
    if write_json(json_, report.as_dict()):
        bench_.show(report, console_of())
    raise typer.Exit(report.exit_code)
