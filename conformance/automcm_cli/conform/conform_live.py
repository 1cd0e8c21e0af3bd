"""``automcm conform live``: tests of a station that runs by its own clock, over UDP."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import ExitStack, closing, contextmanager
from typing import TYPE_CHECKING, Annotated

import typer

from automcm_cli.shared.adapter_options import COMMAND, Limit, WithCommand
from automcm_cli.shared.common import (
    Json,
    code_3,
    console_of,
    example,
    progress,
    say,
    usage,
    write_json,
)
from automcm_cli.shared.station_options import EVERYONE, Broadcast, Host, Remote, Settings, chosen
from automcm_conformance.adapter.process import LIMIT_S
from automcm_spec.vocabulary.parameters import DEFAULTS, longest_delay

if TYPE_CHECKING:
    from rich.console import Console

    from automcm_conformance.live.live import UdpAir
    from automcm_conformance.live.live_cases import LiveCase, LiveResult

FIRST_CAM_MS = 5_000
"""How long to listen for the station, in ms; a CAM comes at least every second."""


app = typer.Typer()


@app.command(
    cls=WithCommand,
    epilog=example(
        "conform live 7 -- automcm adapter",
        "Start the station first, in another terminal: automcm station --id 7 --first.  ",
    ),
)
def live(
    ctx: typer.Context,
    station: Annotated[
        int, typer.Argument(min=1, max=2**32 - 1, help="The station_id of the live station.")
    ],
    selectors: Annotated[
        list[str] | None,
        typer.Argument(metavar="[CASE]...", help="The name of a case, or a rule id."),
    ] = None,
    broadcast: Broadcast = EVERYONE,
    host: Host = "127.0.0.1",
    allow_remote: Remote = False,
    jitter: Annotated[
        int, typer.Option(help="Tolerated deviation of a message from its time, in ms.", min=1)
    ] = 50,
    set_: Settings = None,
    scenario: Annotated[
        str, typer.Option(help="A scenario that the station's application joins.")
    ] = "lane_change",
    limit: Limit = LIMIT_S,
    json_: Json = None,
) -> None:
    """Test a live receiver in real time over UDP.

    The kit plays the other stations.  No other station may be present, and the tested station must
    join each session and accept each proposal.  With the adapter of the same implementation after
    --, a case with a message at the wrong time is repeated in virtual time: FAIL if it fails there
    as well, else INCONC.
    """
    from automcm_conformance.adapter.adapter import Adapter
    from automcm_conformance.adapter.process import AdapterError
    from automcm_conformance.adapter.protocol import ProtocolError
    from automcm_conformance.live.live_cases import LiveRun
    from automcm_spec.graph.oracle import OracleError, load
    from automcm_spec.graph.oracle_generation import ONE_PEER, spec_hash

    cases = _cases(selectors or [])
    known = chosen(set_).known
    parameters = {name: known[name] for name in DEFAULTS}
    if jitter > longest_delay(known):
        raise typer.BadParameter(
            f"--jitter must be at most {longest_delay(known)} ms (half of t_resend), not {jitter}: "
            "the copies of a message could not be distinguished"
        )
    command: list[str] = ctx.meta.get(COMMAND, [])
    with (
        code_3("live", AdapterError, ProtocolError, OracleError, OSError),
        ExitStack() as stack,
        _air(host, broadcast, allow_remote) as air,
        progress() as notify,
    ):
        oracle = load(ONE_PEER.path, spec_hash())
        session = LiveRun(oracle, air, station, parameters, jitter, int(time.time()), scenario)
        if command:
            session.adapter = Adapter(command, limit)
            stack.callback(session.adapter.stop)
        notify(f"listening for station {station}")
        if not session.heard(FIRST_CAM_MS):
            say(
                f"live: no CAM of station {station} on {broadcast} within {FIRST_CAM_MS} ms",
                err=True,
            )
            raise typer.Exit(3)
        for case in cases:
            notify(case.name)
            session.judge(case)
    if write_json(json_, session.as_dict()):
        _show(session.results, console_of())
    raise typer.Exit(session.exit_code)


@contextmanager
def _air(host: str, broadcast: str, allow_remote: bool) -> Iterator[UdpAir]:
    """The same sockets as those of the reference's stations.  A bad address is a usage error."""
    from automcm.links.link import LinkError
    from automcm.links.udp_link import address, bind, local_only
    from automcm_conformance.live.live import UdpAir

    with usage(LinkError):
        everyone = address(broadcast)
        local_only(everyone[0], allow_remote)
        with (
            closing(bind(host, 0, allow_remote=allow_remote)) as own,
            closing(bind(*everyone, shared=True, allow_remote=allow_remote)) as shared,
        ):
            yield UdpAir(own, shared, everyone)


def _cases(selectors: list[str]) -> list[LiveCase]:
    from automcm_conformance.live.live_cases import CASES

    for selector in selectors:
        if all(selector != case.name and selector not in case.rules for case in CASES):
            names = ", ".join(case.name for case in CASES)
            raise typer.BadParameter(f"there is no case {selector!r}; the cases are {names}")
    wanted = set(selectors)
    return [c for c in CASES if not wanted or c.name in wanted or wanted & {*c.rules}]


def _show(judged: list[LiveResult], console: Console) -> None:
    for case in judged:
        console.print(f"{case.verdict:<6}  {case.case:<16} {case.reason}", markup=False)
    for case in [case for case in judged if case.reason][:3]:
        console.print()
        console.print(f"{case.verdict} {case.case}: {case.then}", markup=False)
        for line in case.lines:
            text = f"{line.now:>8}  {line.who:<8} {line.text}"
            console.print(text, markup=False, highlight=False)
