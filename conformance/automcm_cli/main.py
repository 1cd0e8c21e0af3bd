"""The one console script, ``automcm``.  Imports lazily: each command only what it needs."""

from __future__ import annotations

import signal
import sys
from typing import Annotated

import typer

from automcm_cli import demo_command, exit_codes, station
from automcm_cli.common import (
    CODES,
    ROOT,
    Json,
    code_3,
    console_of,
    example,
    needs_repository,
    progress,
    write_json,
)
from automcm_cli.groups import Groups

app = typer.Typer(
    name="automcm",
    cls=Groups,
    help="Maneuver coordination: a checked specification, and what is held against it.",
    epilog=CODES,
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,  # plain help: to import rich and draw with it takes 0.15 s
)
app.command(epilog=example("conform run -- automcm adapter"))(station.adapter)
app.command(epilog=example("demo --loss 0.3"))(demo_command.demo)
app.command(epilog=example("drive --uri ws://127.0.0.1:9090"))(station.drive)
app.command(epilog=example("station --id 7 --request-after 500"))(station.station)


def _version(wanted: bool) -> None:
    from importlib.metadata import version

    if wanted:
        typer.echo(f"automcm {version('automcm')}")
        raise typer.Exit


@app.callback()
def _options(
    version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Say which, exit.")
    ] = False,
) -> None:
    """What goes before any command."""


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
    json_: Json = None,
) -> None:
    """Model-check, write the oracle, compare the reference with it."""
    needs_repository("verify")
    from automcm_cli import screen, spec
    from automcm_cli import verify as verify_
    from automcm_spec.models import PROFILES
    from automcm_spec.rules import RULES

    if profile not in PROFILES:
        raise typer.BadParameter(spec.unknown(profile, PROFILES, "profile"))

    if rule is not None and (models or profile != "quick"):
        raise typer.BadParameter("--rule needs --no-models, and goes with no other profile")
    if rule is not None and rule not in RULES:
        raise typer.BadParameter(f"there is no rule {rule!r}; there are: {', '.join(RULES)}")

    with progress() as say:
        report = verify_.run(profile, say, models_too=models, rule=rule)
    if write_json(json_, report.as_dict()):
        screen.show(report, console_of())
    raise typer.Exit(report.exit_code)


@app.command(epilog=example("generate"))
def generate(
    two_peers: Annotated[bool, typer.Option(help="Also the two-peer graph (minutes).")] = True,
) -> None:
    """Renew the generated files.  Oracles, counterexamples, corpus, schema, rule table."""
    needs_repository("generate")
    from automcm_cli import generated
    from automcm_spec.models import ModelError
    from automcm_spec.tlc import TlcError
    from automcm_spec.toolchain import ToolError

    faults = TlcError, ToolError, ModelError, OSError, ValueError
    with code_3("generate", *faults), progress() as say:
        changed = generated.write(say, two_peers)
    for path in changed:
        typer.echo(f"renewed {path.relative_to(ROOT)}")
    if not changed:
        typer.echo("everything was up to date")


def main() -> None:
    """Entry point.  SIGTERM ends like Ctrl-C, so that no child is left behind."""

    def stop(*_: object) -> None:
        raise KeyboardInterrupt

    signal.signal(signal.SIGTERM, stop)
    sys.exit(exit_codes.run(app))
