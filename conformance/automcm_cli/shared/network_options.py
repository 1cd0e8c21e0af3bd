"""Options shared by the commands that send UDP."""

from __future__ import annotations

from typing import Annotated

import typer

Remote = Annotated[
    bool, typer.Option("--allow-remote", help="Allow addresses that other hosts can reach.")
]
Broadcast = Annotated[str, typer.Option(help="HOST:PORT on which all stations listen.")]
Host = Annotated[str, typer.Option(help="Local address to send from.")]
EVERYONE = "127.255.255.255:47100"
