"""What commands share that send UDP."""

from __future__ import annotations

from typing import Annotated

import typer

Remote = Annotated[
    bool, typer.Option("--allow-remote", help="Also addresses that other hosts can reach.")
]
Broadcast = Annotated[str, typer.Option(help="Where all stations listen.")]
Host = Annotated[str, typer.Option(help="The address to send from.")]
EVERYONE = "127.255.255.255:47100"
