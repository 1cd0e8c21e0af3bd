"""``automcm station``, ``automcm adapter`` and ``automcm drive``: the reference at work."""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Callable, Coroutine
from contextlib import nullcontext
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, TextIO

import typer

from automcm_cli.shared.common import code_3, usage
from automcm_cli.shared.network_options import EVERYONE, Broadcast, Host, Remote
from automcm_cli.shared.parameter_options import chosen

if TYPE_CHECKING:
    from automcm.bridge.websocket_bridge import WebSocketBridge
    from automcm.service.line_output import LineOutput

Target = Annotated[int, typer.Option(help="Whom to prescribe; 0: who answers first.")]
For = Annotated[int | None, typer.Option("--for", help="End after so many ms.")]

FINISH_S = 0.2
"""How long the end waits for somebody who reads slowly."""


class Lines:
    """Reports on standard output and complaints on standard error, neither of which is waited for.

    What nobody reads, or has no room, is lost and counted; standard error says so once and at the
    end.
    """

    def __init__(self, name: str) -> None:
        self._name = name
        self._err = _line_output(sys.stderr)
        self._out = _line_output(sys.stdout, lambda why: self._trouble(why))

    def report(self, event: dict[str, Any]) -> None:
        """One line of JSON on standard output."""
        self._out.write(json.dumps(event, separators=(",", ":")).encode() + b"\n")

    def complain(self, text: str) -> None:
        """One line on standard error."""
        self._err.write(f"{self._name}: {text}\n".encode(errors="backslashreplace"))

    def finish(self) -> None:
        """Write what can still be written, within a moment."""
        self._out.finish(FINISH_S)
        if self._out.lost and not self._out.closed_by_reader:
            self.complain(f"standard output: {self._out.lost} reports are lost")
        self._err.finish(FINISH_S)

    def _trouble(self, why: str) -> None:
        self.complain(f"standard output: {why}; the reports of now are lost")


def _line_output(stream: TextIO, trouble: Callable[[str], None] = lambda why: None) -> LineOutput:
    """On the descriptor itself, so that nothing waits in Python's buffer at the end.

    A descriptor that was closed is occupied by then (automcm_cli.exit_codes).
    """
    from automcm.service.line_output import LineOutput

    stream.flush()
    return LineOutput(stream.fileno(), trouble=trouble)


def carry_out(name: str, what: Callable[[Lines], Coroutine[Any, Any, None]]) -> None:
    """Run it; what goes wrong is one line and exit code 3."""
    import asyncio
    import logging

    from automcm.links.link import LinkError
    from automcm.service.station_process import NumberError

    lines = Lines(name)
    handler = logging.Handler()
    handler.emit = lambda record: lines.complain(record.getMessage())  # type: ignore[method-assign]
    logging.getLogger().addHandler(handler)  # its own would wait for whoever reads standard error
    try:
        asyncio.run(what(lines))
    except (LinkError, NumberError, OSError) as error:
        lines.complain(str(error))
        raise typer.Exit(3) from None
    finally:
        logging.getLogger().removeHandler(handler)
        lines.finish()


def station(
    station_id: Annotated[int, typer.Option("--id", min=1, max=2**32 - 1, help="Its station_id.")],
    via: Annotated[str | None, typer.Option(help="A relay's HOST:PORT; else broadcast.")] = None,
    broadcast: Broadcast = EVERYONE,
    host: Host = "127.0.0.1",
    allow_remote: Remote = False,
    codec: Annotated[str, typer.Option(help="json or uper.")] = "json",
    set_: Annotated[
        list[str] | None, typer.Option("--set", help="A parameter, such as t_timeout=1000.")
    ] = None,
    log: Annotated[
        Path | None,
        typer.Option(help="Write a log here (automcm.trace/1).  If the file exists: name.2, ..."),
    ] = None,
    number_file: Annotated[
        Path | None,
        typer.Option(help="Keeps the session number.  If it is there, this is a restart (END-8)."),
    ] = None,
    first: Annotated[
        bool, typer.Option("--first", help="Without --number-file: it never ran before (END-8).")
    ] = False,
    bridge: Annotated[
        int | None,
        typer.Option(
            help="Serve driving software on this WebSocket port (9090 is usual; 0: any).",
            min=0,
            max=65_535,
        ),
    ] = None,
    request_after: Annotated[
        int | None, typer.Option(help="Ask for a lane change after so many ms.")
    ] = None,
    target: Target = 0,
    concerned: Annotated[bool, typer.Option(help="Join the maneuvers of others.")] = True,
    refuse_first: Annotated[int, typer.Option(help="How many proposals to refuse.")] = 0,
    maneuver: Annotated[int, typer.Option(help="How long the maneuver takes, ms.")] = 3000,
    listen: Annotated[
        int, typer.Option(help="First listen so many ms for a station of the same id.")
    ] = 1100,
    for_ms: For = None,
    zero: Annotated[
        float, typer.Option(help="What counts as 0 ms on the host's monotonic clock, in s.")
    ] = 0.0,
) -> None:
    """Run one station on UDP until SIGTERM.  Messages and phases are reported as lines of JSON.

    At SIGTERM, SIGINT or SIGHUP it cancels its session (END-1), waits at most 1 s for the Ack, and
    ends; a second signal ends it at once.  Neither a full disk nor a reader that is slow or gone
    stops it: reports and log records that cannot be written are counted.  The exit code is 3 if
    the log lost records.

    With --bridge its application is at the other end of a WebSocket: driving software that speaks
    rosbridge JSON, or automcm drive.  Without, it drives straight on and agrees to what it is
    asked.  Unless a --number-file or --first says that it never ran before, it starts as after a
    restart: its session number comes from the clock, and for some seconds it joins no session.
    """
    from automcm.encoding.codec import CodecError, CodecMissing
    from automcm.encoding.codec import codec as by_name
    from automcm.links.link import LinkError
    from automcm.links.udp_link import UdpLink, address
    from automcm.scenarios.straight_lane import LANE_CHANGE, Straight
    from automcm.service.station_process import NumberFile, StationProcess

    if not 0 <= zero <= time.monotonic():
        raise typer.BadParameter(f"--zero: {zero} is not a time that has been")
    with usage(LinkError, CodecError), code_3("station", CodecMissing):
        to, relay = address(broadcast), address(via) if via else None
        coded = by_name(codec)
    straight = Straight(
        target=target,
        refuse_first=refuse_first,
        maneuver_ms=maneuver,
        concerned_by_all=concerned,
    )
    served = None if bridge is None else _bridge(bridge, host, allow_remote)
    parameters = chosen(set_ or [])

    async def run(lines: Lines) -> None:
        process = StationProcess(
            station_id=station_id,
            application=served or straight,
            serving=served or nullcontext(),
            link=partial(UdpLink, host=host, broadcast=to, via=relay, allow_remote=allow_remote),
            codec=coded,
            parameters=parameters,
            report=lines.report,
            complain=lines.complain,
            log=log,
            number_file=NumberFile(number_file) if number_file else None,
            commands=[] if request_after is None else [(request_after, LANE_CHANGE)],
            listen_ms=listen,
            number=0 if first else int(time.time()),
            restarted=not first,
            for_ms=for_ms,
            zero=zero,
        )
        await process.run()

    carry_out("station", run)


def _bridge(port: int, host: str, allow_remote: bool) -> WebSocketBridge:
    from automcm.links.link import LinkError

    with code_3("station", LinkError):
        from automcm.bridge.websocket_bridge import WebSocketBridge

        return WebSocketBridge(host, port, allow_remote=allow_remote)


def drive(
    uri: Annotated[str, typer.Option(help="Where the bridge is.")] = "ws://127.0.0.1:9090",
    request_after: Annotated[
        int | None, typer.Option(help="Ask for a lane change so many ms after connecting.")
    ] = None,
    target: Target = 0,
    attempts: Annotated[int, typer.Option(help="To connect the first time.", min=1)] = 5,
    for_ms: For = None,
) -> None:
    """The driving software's end of a bridge.  Drives straight on, agrees to what it is asked."""
    import asyncio

    from automcm.links.link import LinkError
    from automcm.scenarios.straight_lane import LANE_CHANGE, Straight
    from automcm.service.station_process import stopping

    with code_3("drive", LinkError):
        from automcm.bridge.remote_application import RemoteApplication

    async def run(lines: Lines) -> None:
        over = stopping(for_ms)
        remote = RemoteApplication(
            Straight(target=target, concerned_by_all=request_after is None),
            uri,
            expect=[LANE_CHANGE],
            attempts=attempts,
        )
        running = asyncio.create_task(remote.run())
        connected = asyncio.create_task(remote.connected.wait())
        everything: set[asyncio.Future[Any]] = {over, running, connected}
        await asyncio.wait(everything, return_when=asyncio.FIRST_COMPLETED)
        if connected.done():
            lines.report({"event": "connected", "uri": uri})
            if request_after is not None:
                await asyncio.wait({over, running}, timeout=request_after / 1000)
                remote.command(LANE_CHANGE)
            await asyncio.wait({over, running}, return_when=asyncio.FIRST_COMPLETED)
        connected.cancel()
        if running.done():
            running.result()
        running.cancel()

    carry_out("drive", run)


def adapter(
    websocket: Annotated[
        str | None,
        typer.Option(
            metavar="HOST:PORT", help="Serve it there over WebSocket, a station per connection."
        ),
    ] = None,
    allow_remote: Remote = False,
) -> None:
    """The reference as an adapter, on standard input and output.  See docs/adapter.md."""
    from automcm.adapters.adapter_lines import main

    if websocket is not None:
        carry_out("adapter", lambda lines: _served(lines, websocket, allow_remote))
        return
    main()


async def _served(lines: Lines, where: str, allow_remote: bool) -> None:
    """Serve until SIGTERM; where it listens is told in a line of JSON."""
    from automcm.adapters.adapter_server import serve
    from automcm.service.station_process import stopping

    over = stopping()
    async with await serve(where, allow_remote=allow_remote) as server:
        host, port = server.sockets[0].getsockname()
        lines.report({"event": "start", "uri": f"ws://{host}:{port}"})
        await over
