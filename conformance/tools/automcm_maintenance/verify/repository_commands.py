"""``automcm verify`` and ``automcm generate``.  Each imports only the modules that it needs."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from automcm_cli.shared import completion
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
        typer.Option(
            help="quick, full (larger models, all graphs) or deep (up to half an hour).",
            autocompletion=completion.profiles,
        ),
    ] = "quick",
    models: Annotated[
        bool,
        typer.Option(help="Check the models.  Otherwise only the reference (one to two minutes)."),
    ] = True,
    rule: Annotated[
        str | None,
        typer.Option(
            help="With --no-models, for work on one rule: use only a small graph (two rounds, one "
            "peer), disable only this rule, and skip the generated files. Takes seconds.",
            autocompletion=completion.rules,
        ),
    ] = None,
    fresh: Annotated[
        bool,
        typer.Option(
            "--fresh", help="Ignore kept results: run all models and all stages but the proof."
        ),
    ] = False,
    json_: Json = None,
) -> None:
    """Check the models, and the reference against the oracle."""
    from automcm_maintenance.verify import verify as verify_
    from automcm_maintenance.verify import verify_screen
    from automcm_spec.model_checking.models import PROFILES
    from automcm_spec.vocabulary.rules import RULES

    if profile not in PROFILES:
        raise typer.BadParameter(unknown(profile, PROFILES, "profile"))

    if rule is not None and (models or profile != "quick"):
        raise typer.BadParameter("--rule requires --no-models and the profile quick")
    if rule is not None and rule not in RULES:
        raise typer.BadParameter(f"there is no rule {rule!r}; the rules are {', '.join(RULES)}")

    with progress() as notify:
        report = verify_.run(profile, notify, models_too=models, rule=rule, fresh=fresh)
    if write_json(json_, report.as_dict()):
        verify_screen.show(report, console_of())
    raise typer.Exit(report.exit_code)


@app.command(epilog=example("generate docs/messages.md"))
def generate(
    paths: Annotated[
        list[Path] | None,
        typer.Argument(help="Only these files, or those below these folders."),
    ] = None,
) -> None:
    """Renew the generated files.

    These are the oracles, the counterexamples, the corpus, the schemas, and generated pages and
    tables.  TLC is not run where nothing has changed that its result depends on.
    """
    from automcm_maintenance.documents import generated_files
    from automcm_maintenance.induction.prove_commands import FAULTS
    from automcm_spec.model_checking.models import ModelError
    from automcm_spec.model_checking.toolchain import ToolError

    only = [path.resolve() for path in paths or ()]
    faults = *FAULTS, ToolError, ModelError, ValueError
    with code_3("generate", *faults), progress(piped=True) as notify:
        changed = generated_files.write(notify, only)
    for path in changed:
        typer.echo(f"renewed {path.relative_to(ROOT)}")
    if not changed:
        typer.echo("all generated files were up to date")
