"""``automcm spec pages``, ``mutate`` and ``prove``: for the quality of the models.

Each command imports only the modules that it needs.
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
    unknown,
    write_json,
)

app = typer.Typer()


@app.command("pages", epilog=example("spec pages --out runs/counterexamples"))
def spec_pages(
    out: Annotated[Path, typer.Option(help="Folder for the pages.")] = Path("docs/counterexamples"),
) -> None:
    """Write an HTML page for each counterexample of docs/models.md.

    The pages have the form of automcm trace html.
    """
    from automcm_maintenance.documents import counterexample_pages
    from automcm_spec.model_checking import models
    from automcm_spec.model_checking.tlc import TlcError
    from automcm_traces.export.itf import ItfError

    with code_3("pages", ItfError, models.ModelError, OSError, TlcError), progress() as notify:
        written = counterexample_pages.committed(models.load(), out, notify)
    typer.echo(f"{len(written)} pages in {out}")


@app.command("mutate", epilog=example("spec mutate --only OnAck"))
def spec_mutate(
    profile: Annotated[
        str,
        typer.Option(help="quick: stop at the first kill of a mutant; deep: find all properties."),
    ] = "quick",
    only: Annotated[
        str | None,
        typer.Option(help="Only mutants whose id contains this text or matches * and ?."),
    ] = None,
    limit: Annotated[
        int, typer.Option(min=0, help="Use a fixed sample of this size (0 = all mutants).")
    ] = 260,
    list_: Annotated[
        bool, typer.Option("--list", help="List the mutants without running them.")
    ] = False,
    jobs: Annotated[int, typer.Option(min=1, help="Number of mutants to run in parallel.")] = 2,
    write: Annotated[bool, typer.Option(help="Write the results, for the site.")] = False,
    json_: Json = None,
) -> None:
    """Run the models on mutants of the specification.

    A mutant is killed when a property is violated in a model that must hold.  Other differences
    are reported apart.  With --write, each result is written at once and holds until the
    specification, the models or the mutants change, so that a run continues where it stopped.
    A mutant that no property kills must be in spec/mutation/no-property.toml with the reason.  A
    quick run may take hours, a deep one a night.
    """
    from automcm_maintenance.spec_mutation import mutate_commands

    if profile not in mutate_commands.PROFILES:
        raise typer.BadParameter(unknown(profile, mutate_commands.PROFILES, "profile"))
    if write and only:
        raise typer.BadParameter("--write cannot be with --only")
    with code_3("mutate", *mutate_commands.FAULTS):
        mutants = mutate_commands.select(only, limit)
        if list_:
            typer.echo(mutate_commands.listed(mutants))
            return
        with progress() as notify:
            report = mutate_commands.run(profile, mutants, jobs, notify, write)
    if write_json(json_, mutate_commands.as_dict(report)):
        mutate_commands.show(report, console_of(110))
    raise typer.Exit(report.exit_code)


@app.command("prove", epilog=example("spec prove --step accept"))
def spec_prove(
    step: Annotated[
        str, typer.Option(help="Only steps with this text in their name, such as 'lease'.")
    ] = "",
    without: Annotated[
        list[str] | None,
        typer.Option(help="Leave this conjunct out of the invariant.  Repeatable."),
    ] = None,
    json_: Json = None,
) -> None:
    """Prove S-1 to S-8 by an inductive invariant.

    The invariant is that of Inductive.tla.  z3 proves it from the syntax tree, for any number of
    stations, sessions, rounds and messages.  A full run takes a minute or more.  The exit code is 1
    if an obligation is refuted, and 4 if z3 cannot decide one.
    """
    from automcm_maintenance.induction import prove_commands

    with code_3("prove", *prove_commands.FAULTS), progress() as notify:
        report = prove_commands.run(without or [], step, notify)
    if write_json(json_, report.as_dict()):
        prove_commands.show(report, console_of())
    raise typer.Exit(report.exit_code)
