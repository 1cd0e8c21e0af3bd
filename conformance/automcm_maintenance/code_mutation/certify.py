"""``automcm conform certify``: does the suite find what is wrong?"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from automcm_cli.shared.adapter_options import purposes_of
from automcm_cli.shared.common import Json, code_3, progress, write_json

if TYPE_CHECKING:
    from automcm_maintenance.code_mutation.source_mutants import Generated, Mutant

STATIONS = ("reference", "cpp", "all")
EPILOG = (
    "Example: automcm conform certify --class timer --out runs/certificate.  Exit codes: 0 every "
    "mutant is killed, or equivalent; 1 some survive; 2 usage; 3 the certificate itself broke, or "
    "was interrupted."
)
app = typer.Typer()


@app.command(epilog=EPILOG)
def certify(
    seed: Annotated[int, typer.Option(help="Chooses the mutants; the seed of the suite.")] = 1,
    mutant: Annotated[list[str] | None, typer.Option(help="This mutant; may be repeated.")] = None,
    class_: Annotated[
        list[str] | None, typer.Option("--class", help="Mutants of this class; may be repeated.")
    ] = None,
    mutants: Annotated[
        int | None, typer.Option(help="Mutants of the reference that are chosen; 0: all.", min=0)
    ] = None,
    cases: Annotated[
        int, typer.Option(help="Failed cases that end the run of a mutant; 0: none do.", min=0)
    ] = 3,
    suite: Annotated[
        list[str] | None, typer.Option(help="Part of the suite (as of run); may be repeated.")
    ] = None,
    station: Annotated[str, typer.Option(help="reference, cpp or all.")] = "reference",
    out: Annotated[Path, typer.Option(help="Folder in which what is decided is kept.")] = Path(
        "runs/certificate"
    ),
    jobs: Annotated[int, typer.Option(help="Mutants at a time.", min=1)] = 2,
    list_: Annotated[bool, typer.Option("--list", help="Name the mutants, run nothing.")] = False,
    page: Annotated[bool, typer.Option(help="Write docs/certificate.md as well.")] = False,
    json_: Json = None,
) -> None:
    """A certificate of the kit.  The suite is held against stations that are wrong on purpose."""
    from automcm_maintenance.code_mutation import certificate, certificate_page, cpp_station
    from automcm_maintenance.code_mutation.certificate import Asked
    from automcm_maintenance.code_mutation.equivalence import WalkError
    from automcm_spec.graph.oracle import OracleError
    from automcm_spec.graph.oracle_generation import spec_hash

    if station not in STATIONS:
        raise typer.BadParameter(f"--station: one of {', '.join(STATIONS)}")
    if page and (mutant or class_ or suite):
        raise typer.BadParameter("--page needs a whole certificate: no --mutant, --class, --suite")
    purposes_of(suite or [])
    asked = Asked(out, seed, cases, tuple(suite or ()), jobs)
    with code_3("certify", OracleError, WalkError, OSError, SyntaxError, ValueError):
        made, chosen = _chosen(station, mutant, class_, mutants, seed)
        if list_:
            for each in chosen:
                typer.echo(f"{each.id}  {each.file}:{each.line}  {each.rule}")
                typer.echo(f"    {each.old}  =>  {each.new}")
            raise typer.Exit(0)
        count, notes = len(chosen), []
        rows: list[certificate.Row] = []
        problems: list[str] = []
        with progress() as say:
            if chosen:
                rows, problems = certificate.run(chosen, asked, say)
            if station != "reference" and not problems:
                if lacking := cpp_station.missing():
                    notes.append(f"the C++ station and its mutants: {lacking} is not installed")
                else:
                    others, problems = certificate.run_cpp(asked, say)
                    rows, count = rows + others, count + len(others)
    found = certificate.Certificate(asked, spec_hash(), made, count, rows, notes, problems)
    write_json(json_, found.as_dict())
    if page:
        certificate_page.write(found)
    if str(json_) != "-":
        typer.echo(certificate_page.summary(found))
    raise typer.Exit(found.exit_code)


def _chosen(
    station: str,
    ids: list[str] | None,
    classes: list[str] | None,
    count: int | None,
    seed: int,
) -> tuple[Generated, list[Mutant]]:
    """The mutants of the reference there are, and those to be judged."""
    from automcm_maintenance.code_mutation import source_mutants
    from automcm_maintenance.code_mutation.source_edits import CLASSES

    if unknown := set(classes or ()) - set(CLASSES):
        raise typer.BadParameter(f"--class: no {', '.join(sorted(unknown))}: {', '.join(CLASSES)}")
    made = source_mutants.generate()
    if station == "cpp":
        return made, []
    if ids:
        chosen = [each for each in made.mutants if each.id in ids]
        if missing := set(ids) - {each.id for each in chosen}:
            raise typer.BadParameter(f"--mutant: there is no {', '.join(sorted(missing))}")
        return made, chosen
    share = source_mutants.SHARE if count is None else count
    chosen = source_mutants.sample(made.mutants, share, seed)
    return made, [each for each in chosen if not classes or each.class_ in classes]
