"""``automcm conform``: all its commands."""

from __future__ import annotations

from automcm_cli import certify, conform, conform_explore, conform_live
from automcm_cli.common import example

app = conform.app
app.command(cls=conform.WithCommand, epilog=example("conform explore 60 --seed 7 -- ./my_adapter"))(
    conform_explore.explore
)
app.command(
    cls=conform.WithCommand,
    epilog=example(
        "conform live 7 -- automcm adapter",
        "The station is automcm station --id 7 --first in another terminal.  ",
    ),
)(conform_live.live)
app.command(epilog=certify.EPILOG)(certify.certify)
