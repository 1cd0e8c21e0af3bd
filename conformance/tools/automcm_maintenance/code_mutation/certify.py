"""``automcm conform certify``: measures which defects the suite finds."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from automcm_cli.shared.adapter_options import purposes_of
from automcm_cli.shared.common import Json, code_3, example, progress, write_json

if TYPE_CHECKING:
    from automcm_maintenance.code_mutation.source_mutants import Generated, SourceMutant

STATIONS = ("reference", "cpp", "all")
app = typer.Typer()


@app.command(epilog=example("conform certify --mutants 24 --out runs/certificate"))
def certify(
    seed: Annotated[int, typer.Option(help="Seed of the sample and of the suite.")] = 1,
    mutant: Annotated[list[str] | None, typer.Option(help="Only this mutant.  Repeatable.")] = None,
    mutants: Annotated[
        int | None, typer.Option(help="Sample size for the reference's mutants (0 = all).", min=0)
    ] = None,
    cases: Annotated[
        int, typer.Option(help="Stop a mutant after this many failed cases (0 = never).", min=0)
    ] = 3,
    suite: Annotated[
        list[str] | None,
        typer.Option(
            help="Only this part of the suite; a selector as in conform run.  Repeatable."
        ),
    ] = None,
    quick: Annotated[
        bool, typer.Option("--quick", help="Only the part of the suite of conform run --quick.")
    ] = False,
    station: Annotated[str, typer.Option(help="Mutate reference, cpp or all.")] = "reference",
    out: Annotated[Path, typer.Option(help="Folder for the results.")] = Path("runs/certificate"),
    jobs: Annotated[
        int, typer.Option("--workers", "--jobs", help="Mutants to run in parallel.", min=1)
    ] = 2,
    list_: Annotated[
        bool, typer.Option("--list", help="List the mutants without running them.")
    ] = False,
    page: Annotated[
        bool,
        typer.Option(help="Write conformance/certificate.json, for the site."),
    ] = False,
    json_: Json = None,
) -> None:
    """Measure the suite on mutants of stations.

    The suite must fail each mutant, a station with one deliberate defect.  Results are kept in
    the folder; an interrupted run continues.
    """
    from automcm_maintenance.code_mutation import certificate, certificate_page, cpp_station
    from automcm_maintenance.code_mutation.certificate import CertificateRun
    from automcm_maintenance.code_mutation.equivalence import EquivalenceError
    from automcm_spec.graph.oracle import OracleError
    from automcm_spec.graph.oracle_generation import spec_hash

    if station not in STATIONS:
        raise typer.BadParameter(f"--station must be one of {', '.join(STATIONS)}, not {station!r}")
    if page and (mutant or suite or quick):
        raise typer.BadParameter(
            "--page requires a complete certificate: omit --mutant, --suite and --quick"
        )
    purposes_of(suite or [])
    asked = CertificateRun(out, seed, cases, tuple(suite or ()), jobs, quick)
    with code_3("certify", OracleError, EquivalenceError, OSError, SyntaxError, ValueError):
        made, chosen = _chosen(station, mutant, mutants, seed)
        if list_:
            for each in chosen:
                typer.echo(f"{each.id}  {each.file}:{each.line}  {each.rule}")
                typer.echo(f"    {each.old}  =>  {each.new}")
            raise typer.Exit(0)
        count, notes = len(chosen), []
        rows: list[certificate.MutantRow] = []
        problems: list[str] = []
        with progress() as notify:
            if chosen:
                rows, problems = certificate.run(chosen, asked, notify)
            if station != "reference" and not problems:
                if lacking := cpp_station.missing():
                    notes.append(
                        f"the C++ station and its mutants were not run: {lacking} is not installed"
                    )
                else:
                    others, problems = certificate.run_cpp(asked, notify)
                    rows, count = rows + others, count + len(others)
    found = certificate.KillCertificate(asked, spec_hash(), made, count, rows, notes, problems)
    write_json(json_, found.as_dict())
    if page:
        certificate_page.write(found)
    if str(json_) != "-":
        typer.echo(certificate_page.summary(found))
    raise typer.Exit(found.exit_code)


def _chosen(
    station: str,
    ids: list[str] | None,
    count: int | None,
    seed: int,
) -> tuple[Generated, list[SourceMutant]]:
    """All mutants of the reference, and those selected."""
    from automcm_maintenance.code_mutation import source_mutants

    made = source_mutants.generate()
    if station == "cpp":
        return made, []
    if ids:
        chosen = [each for each in made.mutants if each.id in ids]
        if missing := set(ids) - {each.id for each in chosen}:
            raise typer.BadParameter(
                f"there is no mutant {', '.join(sorted(missing))}; --list shows all"
            )
        return made, chosen
    share = source_mutants.SHARE if count is None else count
    return made, source_mutants.sample(made.mutants, share, seed)
