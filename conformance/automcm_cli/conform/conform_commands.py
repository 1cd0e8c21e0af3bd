"""All commands of ``automcm conform``."""

from __future__ import annotations

from automcm_cli.conform import conform, conform_explore, conform_live
from automcm_cli.shared.adapter_options import WithCommand
from automcm_cli.shared.common import example

app = conform.app
app.command(cls=WithCommand, epilog=example("conform explore 60 --seed 7 -- ./my_adapter"))(
    conform_explore.explore
)
app.command(
    cls=WithCommand,
    epilog=example(
        "conform live 7 -- automcm adapter",
        "Start the station first, in another terminal: automcm station --id 7 --first.  ",
    ),
)(conform_live.live)
