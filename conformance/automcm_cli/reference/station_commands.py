"""``automcm station``, ``adapter``, ``drive`` and ``link relay``: processes that serve others."""

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

from automcm.links.link import LinkError
from automcm_cli.shared.common import code_3, example, two_numbers, usage
from automcm_cli.shared.station_options import EVERYONE, Broadcast, Host, Remote, Settings, adjusted
from automcm_spec.support.bad_input import printable

if TYPE_CHECKING:
    from automcm.bridge.websocket_bridge import WebSocketBridge
    from automcm.encoding.codec import Codec
    from automcm.service.line_output import LineOutput
    from automcm.service.station_keys import StationKeys
    from automcm_spec.vocabulary.parameters import Parameters

app = typer.Typer()
"""The group ``link``; the other commands are at the top level."""
Target = Annotated[
    int, typer.Option(help="station_id of the station to prescribe (0 = the first that answers).")
]
TokenFile = Annotated[
    Path | None,
    typer.Option(
        help="File with the bridge's token.  Without it: the environment variable "
        "AUTOMCM_BRIDGE_TOKEN."
    ),
]
For = Annotated[int | None, typer.Option("--for", help="Stop after this many ms.")]
CloseEarly = Annotated[
    bool,
    typer.Option(
        "--close-early",
        help="The prescriber closes its advertising window when every known neighbour has answered "
        "(ADV-9).",
    ),
]

FINISH_S = 0.2
"""How long to wait at the end for a slow reader."""


class Lines:
    """Non-blocking reports on standard output and warnings on standard error.

    A report that cannot be written at once is lost and counted.  Standard error shows the first
    loss and the final count.
    """

    def __init__(self, name: str) -> None:
        self._name = name
        self._began = time.monotonic()
        self._terminal = sys.stdout.isatty()
        self._err = _line_output(sys.stderr)
        self._out = _line_output(
            sys.stdout,
            lambda why: self.complain(f"standard output: {why}; current reports are lost"),
        )

    def report(self, event: dict[str, Any]) -> None:
        """One line on standard output: JSON; on a terminal words, without single messages."""
        if event.get("name") == "refused":
            event = event | {"reason": _refusal(event)}
        text = json.dumps(event, separators=(",", ":"))
        if self._terminal:
            if not (text := _words(event)):
                return
            text = printable(f"{time.monotonic() - self._began:7.2f} s  {text}")
        self._out.write(text.encode() + b"\n")

    def complain(self, text: str) -> None:
        """One line on standard error."""
        self._err.write(f"{self._name}: {printable(text)}\n".encode())

    def finish(self) -> None:
        """Write the pending lines for up to FINISH_S."""
        self._out.finish(FINISH_S)
        if self._out.lost and not self._out.closed_by_reader:
            self.complain(f"standard output: {self._out.lost} reports were lost")
        self._err.finish(FINISH_S)


_TOLD = {
    "choose": "the application chooses",
    "propose": "the application proposes again:",
    "verify": "the application verifies the proposal",
    "accepted": "agreement: the other station has accepted",
    "finished": "finished as agreed",
    "fallback": "the session fails:",
}


def _refusal(event: dict[str, Any]) -> str:
    """Why a command was refused."""
    from automcm_spec.vocabulary.rules import RULES

    left_s = -(-event["quarantine_ms"] // 1000)
    return f"quarantine, {left_s} s left" if left_s else RULES[event["rule"]]


def _words(event: dict[str, Any]) -> str:
    """A report in words; empty for single messages."""
    match event:
        case {"event": "phase", "phase": "STANDALONE", "rule": rule}:
            return f"out of the session ({rule})"
        case {"event": "phase", "phase": phase, "role": role, "session": [src, n], "rule": rule}:
            to = f" to station {event['target']}" if phase == "PRESCRIBING" else ""
            return f"{phase.lower()}{to}, as {role} of session {src}/{n} ({rule})"
        case {"name": "refused", "rule": rule, "reason": reason}:
            return f"a command was refused by {rule}: {reason}"
        case {"event": "told", "name": name, "reason": reason}:
            return f"{_TOLD.get(name, name)} {reason}".strip()
        case {"event": "drive", "text": text}:
            return str(text)
        case {"event": "sent" | "received"}:
            return ""
    return f"{event['event'].replace('_', ' ')} of station {event.get('station', '')}"


def _line_output(stream: TextIO, trouble: Callable[[str], None] = lambda why: None) -> LineOutput:
    """An output on the descriptor itself, so that no data remains in Python's buffer at the end.

    automcm_cli.exit_codes has opened a descriptor that was closed.
    """
    from automcm.service.line_output import LineOutput

    stream.flush()
    return LineOutput(stream.fileno(), trouble=trouble)


def carry_out(name: str, what: Callable[[Lines], Coroutine[Any, Any, None]]) -> None:
    """Run the coroutine; an error gives a one-line message and exit code 3."""
    import asyncio
    import logging

    from automcm.service.station_process import NumberError

    lines = Lines(name)
    handler = logging.Handler()
    handler.emit = lambda record: lines.complain(record.getMessage())  # type: ignore[method-assign]
    logging.getLogger().addHandler(handler)  # logging's own handler would block
    try:
        asyncio.run(what(lines))
    except (LinkError, NumberError, OSError) as error:
        lines.complain(str(error))
        raise typer.Exit(3) from None
    finally:
        logging.getLogger().removeHandler(handler)
        lines.finish()


def station(
    station_id: Annotated[
        int, typer.Option("--id", min=1, max=2**32 - 1, help="The station's station_id.")
    ],
    via: Annotated[
        str | None, typer.Option(help="HOST:PORT of a relay to use instead of broadcast.")
    ] = None,
    broadcast: Broadcast = EVERYONE,
    host: Host = "127.0.0.1",
    allow_remote: Remote = False,
    codec: Annotated[str, typer.Option(help="Encoding of messages: json or uper.")] = "json",
    set_: Settings = None,
    keys: Annotated[
        Path | None,
        typer.Option(
            help="Folder of automcm keys issue.  Sign messages, and take only signed ones."
        ),
    ] = None,
    log: Annotated[
        Path | None,
        typer.Option(
            help="File for the log (automcm.trace/1).  If it exists, the log goes to name.2, and "
            "so on."
        ),
    ] = None,
    log_to: Annotated[
        str | None,
        typer.Option(
            help="Send the log as datagrams to HOST:PORT, where automcm trace watch listens."
        ),
    ] = None,
    number_file: Annotated[
        Path | None,
        typer.Option(
            help="File that stores the session number.  If it exists, the station starts as after "
            "a restart (END-8)."
        ),
    ] = None,
    first: Annotated[
        bool,
        typer.Option(
            "--first",
            help="Without --number-file: start as a station that has never run (END-8).",
        ),
    ] = False,
    bridge: Annotated[
        int | None,
        typer.Option(
            help="WebSocket port for driving software (usually 9090; 0 = any free port).",
            min=0,
            max=65_535,
        ),
    ] = None,
    token_file: TokenFile = None,
    request_after: Annotated[
        int | None, typer.Option(help="Request a lane change after this many ms.")
    ] = None,
    close_early: CloseEarly = False,
    target: Target = 0,
    concerned: Annotated[bool, typer.Option(help="Join the maneuvers of other stations.")] = True,
    refuse_first: Annotated[
        int, typer.Option(help="Number of proposals to refuse before accepting.")
    ] = 0,
    maneuver: Annotated[int, typer.Option(help="Duration of the maneuver, in ms.")] = 3000,
    listen: Annotated[
        int,
        typer.Option(
            help="Before the start, listen this many ms for another station with the same id."
        ),
    ] = 1100,
    for_ms: For = None,
    name: Annotated[str, typer.Option(help="Name of the station in its log.")] = "",
    place: Annotated[
        str, typer.Option(help="Where it drives from, in m along and across the road.")
    ] = "0,0",
    zero: Annotated[
        float | None,
        typer.Option(
            help="Time of the host's monotonic clock, in s, that counts as 0 ms.  "
            "Default: UNIX time."
        ),
    ] = None,
) -> None:
    """Run one station on UDP until SIGTERM.

    The station reports messages and phases as lines of JSON.  On SIGTERM, SIGINT or SIGHUP it
    cancels its session (END-1), waits at most 1 s for the Ack, and ends; a second signal ends it at
    once.  A full disk, or a slow or absent reader, does not stop it: reports and log records that
    cannot be written are counted.  The exit code is 3 if log records were lost.

    With --bridge, its application is at the other end of a WebSocket: driving software that speaks
    rosbridge JSON, or automcm drive.  Without --bridge, it drives straight on and accepts
    proposals.  Beyond loopback the bridge needs a token.

    With --keys it reads its certificate and the lists of revoked ones again each second.

    The station starts as after a restart unless --first is given or the --number-file does not
    exist yet: it takes its session number from the clock, and for some seconds it joins no session.
    """
    from automcm.encoding.codec import CodecError, CodecMissing
    from automcm.encoding.codec import codec as by_name
    from automcm.links.udp_link import UdpLink, address
    from automcm.service.application import all_answered
    from automcm.service.datagram_log import DatagramLog
    from automcm.service.station_process import NumberFile, StationProcess
    from automcm_simulation.road.straight_lane import LANE_CHANGE, Straight

    if zero is not None and not 0 <= zero <= time.monotonic():
        raise typer.BadParameter(
            f"--zero must be between 0 and the present time of the monotonic clock, not {zero}"
        )
    with usage(LinkError, CodecError), code_3("station", CodecMissing):
        to, relay = address(broadcast), address(via) if via else None
        watcher = address(log_to.removeprefix("udp:")) if log_to else None
        coded = by_name(codec)
    straight = Straight(
        place_mm=_place(place),
        target=target,
        refuse_first=refuse_first,
        maneuver_ms=maneuver,
        concerned_by_all=concerned,
    )
    if bridge is None and token_file is not None:
        raise typer.BadParameter("--token-file needs --bridge")
    served = None if bridge is None else _bridge(bridge, host, allow_remote, token_file)
    parameters = adjusted(set_)
    signing = _keys(keys, station_id, coded, parameters) if keys else None

    with code_3("station", LinkError):
        sent = DatagramLog(watcher, allow_remote=allow_remote) if watcher else None

    async def run(lines: Lines) -> None:
        process = StationProcess(
            station_id=station_id,
            name=name,
            application=served or straight,
            serving=served or nullcontext(),
            link=partial(UdpLink, host=host, broadcast=to, via=relay, allow_remote=allow_remote),
            codec=coded,
            parameters=parameters,
            keys=signing,
            report=lines.report,
            complain=lines.complain,
            log=log,
            log_to=sent,
            number_file=NumberFile(number_file) if number_file else None,
            commands=[] if request_after is None else [(request_after, LANE_CHANGE)],
            listen_ms=listen,
            number=0 if first else int(time.time()),
            restarted=not first,
            for_ms=for_ms,
            close_window=all_answered if close_early else None,
            zero=zero,
        )
        await process.run()

    carry_out("station", run)


def _place(text: str) -> tuple[int, int]:
    """Two numbers of metres, in mm."""
    try:
        along, across = (round(1000 * float(number)) for number in text.split(","))
    except (ValueError, OverflowError):
        raise typer.BadParameter(
            f"expected two numbers in m, such as 40,3.5, not {text!r}", param_hint="--place"
        ) from None
    return along, across


def _keys(folder: Path, station_id: int, codec: Codec, parameters: Parameters) -> StationKeys:
    from automcm_spec.support.extras import MissingExtra
    from automcm_spec.vocabulary.parameters import ParameterError

    with usage(ParameterError), code_3("station", LinkError, MissingExtra):
        from automcm.service.station_keys import StationKeys

        return StationKeys(folder, station_id, codec, parameters)


def _bridge(port: int, host: str, allow_remote: bool, token_file: Path | None) -> WebSocketBridge:
    from automcm.bridge.access import read_token

    with code_3("station", LinkError):
        from automcm.bridge.websocket_bridge import WebSocketBridge

        token = read_token(token_file)
        return WebSocketBridge(host, port, allow_remote=allow_remote, token=token)


def drive(
    uri: Annotated[str, typer.Option(help="Address of the bridge.")] = "ws://127.0.0.1:9090",
    request_after: Annotated[
        int | None, typer.Option(help="Request a lane change this many ms after connecting.")
    ] = None,
    target: Target = 0,
    token_file: TokenFile = None,
    attempts: Annotated[
        int, typer.Option(help="Maximum attempts for the first connection.", min=1)
    ] = 5,
    for_ms: For = None,
) -> None:
    """Play the driving software at a bridge.

    The vehicle drives straight on and accepts proposals.
    """
    import asyncio

    from automcm.service.station_process import stopping
    from automcm_simulation.road.straight_lane import LANE_CHANGE, Straight

    with code_3("drive", LinkError):
        from automcm.bridge.access import read_token
        from automcm_simulation.road.remote_application import RemoteApplication

        token = read_token(token_file)

    async def run(lines: Lines) -> None:
        over = stopping(for_ms)
        remote = RemoteApplication(
            Straight(
                target=target,
                concerned_by_all=request_after is None,
                from_now=True,
                report=lambda text: lines.report({"event": "drive", "text": text}),
            ),
            uri,
            expect=[LANE_CHANGE],
            attempts=attempts,
            token=token,
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


def adapter() -> None:
    """Run the reference as an adapter.

    It uses standard input and output.  The protocol is in docs/adapter.md.
    """
    from automcm.adapters.adapter_lines import main

    main()


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
