"""``automcm verify`` and ``automcm generate``.  Imports lazily: each command only what it needs."""

from __future__ import annotations

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
from automcm_maintenance.documents.repository import ROOT

app = typer.Typer()


@app.command(epilog=example("verify --profile full --json report.json"))
def verify(
    profile: Annotated[
        str,
        typer.Option(help="quick; full (larger models, all graphs); deep (up to half an hour)."),
    ] = "quick",
    models: Annotated[
        bool, typer.Option(help="Check the models; without, the reference alone (a minute or two).")
    ] = True,
    rule: Annotated[
        str | None,
        typer.Option(
            help="With --no-models: only a small graph (two rounds, one peer), and only this rule "
            "taken away; no generated files. For the short loop while a rule is written: seconds."
        ),
    ] = None,
    fresh: Annotated[
        bool, typer.Option("--fresh", help="Run the models whose results are kept as well.")
    ] = False,
    json_: Json = None,
) -> None:
    """Model-check, write the oracle, compare the reference with it."""
    from automcm_maintenance.verify import verify as verify_
    from automcm_maintenance.verify import verify_screen
    from automcm_spec.model_checking.models import PROFILES
    from automcm_spec.vocabulary.rules import RULES

    if profile not in PROFILES:
        raise typer.BadParameter(unknown(profile, PROFILES, "profile"))

    if rule is not None and (models or profile != "quick"):
        raise typer.BadParameter("--rule needs --no-models, and goes with no other profile")
    if rule is not None and rule not in RULES:
        raise typer.BadParameter(f"there is no rule {rule!r}; there are: {', '.join(RULES)}")

    with progress() as say:
        report = verify_.run(profile, say, models_too=models, rule=rule, fresh=fresh)
    if write_json(json_, report.as_dict()):
        verify_screen.show(report, console_of())
    raise typer.Exit(report.exit_code)


@app.command(epilog=example("generate"))
def generate(
    two_peers: Annotated[bool, typer.Option(help="Also the two-peer graph (minutes).")] = True,
) -> None:
    """Renew the generated files.  Oracles, counterexamples, corpus, schema, rule table."""
    from automcm_maintenance.documents import generated_files
    from automcm_spec.model_checking.models import ModelError
    from automcm_spec.model_checking.tlc import TlcError
    from automcm_spec.model_checking.toolchain import ToolError

    faults = TlcError, ToolError, ModelError, OSError, ValueError
    with code_3("generate", *faults), progress() as say:
        changed = generated_files.write(say, two_peers)
    for path in changed:
        typer.echo(f"renewed {path.relative_to(ROOT)}")
    if not changed:
        typer.echo("everything was up to date")
