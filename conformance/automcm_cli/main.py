"""The console script ``automcm``.  Each command imports only the modules that it needs."""

from __future__ import annotations

import gc
import signal
import sys
from typing import Annotated

import typer

from automcm_cli import exit_codes
from automcm_cli.groups import Groups
from automcm_cli.reference import demo_command, station_commands
from automcm_cli.shared.common import CODES, example, say

app = typer.Typer(
    name="automcm",
    cls=Groups,
    help="Maneuver coordination: a model-checked specification, a reference and test tools.",
    epilog=CODES,
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,  # plain help: importing rich and rendering with it takes 0.15 s
)
app.command(epilog=example("conform run -- automcm adapter"))(station_commands.adapter)
app.command(epilog=example("demo --loss 0.3"))(demo_command.demo)
app.command(epilog=example("drive --uri ws://127.0.0.1:9090"))(station_commands.drive)
app.command(
    epilog=example(
        "station --id 7 --first",
        "In a second terminal: automcm station --id 8 --first --request-after 500.",
    )
)(station_commands.station)


def _version(wanted: bool) -> None:
    if wanted:
        from importlib.metadata import version

        say(f"automcm {version('automcm')}")
        raise typer.Exit


@app.callback()
def _options(
    version: Annotated[
        bool,
        typer.Option(
            "--version", callback=_version, is_eager=True, help="Print the version and exit."
        ),
    ] = False,
) -> None:
    """Options that precede any command."""


def main() -> None:
    """Entry point.  SIGTERM has the effect of Ctrl-C, so that no child process remains."""
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    code = exit_codes.run(app)
    gc.freeze()  # else Python's last collection visits every value that is left
    sys.exit(code)
