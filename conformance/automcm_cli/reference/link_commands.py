"""``automcm link relay``: a simulated radio between stations."""

from __future__ import annotations

from typing import Annotated

import typer

from automcm_cli.reference.station_commands import For, Lines, carry_out
from automcm_cli.shared.common import example, two_numbers
from automcm_cli.shared.station_options import Remote

app = typer.Typer()


@app.command(epilog=example("link relay --port 47200 --loss 0.2 --delay 5:40"))
def relay(
    port: Annotated[
        int, typer.Option(help="Port to listen on (0 = any free port).", min=0, max=65_535)
    ] = 47_200,
    host: Annotated[str, typer.Option(help="Address to listen on.")] = "127.0.0.1",
    loss: Annotated[float, typer.Option(min=0, max=1, help="Share of copies to lose.")] = 0.0,
    duplicate: Annotated[
        float, typer.Option(min=0, max=1, help="Share of copies to duplicate.")
    ] = 0.0,
    reorder: Annotated[
        float, typer.Option(min=0, max=1, help="Share of copies to hold back.")
    ] = 0.0,
    delay: Annotated[str, typer.Option(help="Delay of a copy, MIN:MAX in ms.")] = "0:0",
    seed: Annotated[int, typer.Option(help="Seed of losses, duplicates and delays.")] = 0,
    allow_remote: Remote = False,
    for_ms: For = None,
) -> None:
    """Forward each datagram to all other stations.

    Datagrams can be lost, duplicated, delayed and reordered.  The relay runs until SIGTERM.
    """
    from automcm.links.simulated_radio import Channel
    from automcm.service.station_process import stopping
    from automcm_simulation.radio.relay import Relay

    least, most = two_numbers(delay, ":", "MIN:MAX in ms, such as 2:40", "--delay")
    if least > most:
        raise typer.BadParameter(f"MIN exceeds MAX in {delay}", param_hint="--delay")
    channel = Channel(loss=loss, duplicate=duplicate, reorder=reorder, delay_ms=(least, most))

    async def run(lines: Lines) -> None:
        over = stopping(for_ms)
        relay = Relay(host, port, channel=channel, seed=seed, allow_remote=allow_remote)
        lines.report({"event": "start", "host": relay.address[0], "port": relay.address[1]})
        try:
            await over
        finally:
            relay.close()
            lines.report(
                {"event": "end", "delivered": relay.radio.delivered, "lost": relay.radio.lost}
            )

    carry_out("link relay", run)
