"""``automcm conform``: tests of any station against the specification."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import ExitStack, closing, contextmanager
from dataclasses import asdict
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from automcm.links.link import LinkError
from automcm_cli.shared import completion
from automcm_cli.shared.adapter_options import (
    COMMAND,
    Limit,
    WithCommand,
    command_of,
    fresh_folder,
    purposes_of,
)
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
from automcm_cli.shared.station_options import EVERYONE, Broadcast, Host, Remote, Settings, adjusted
from automcm_conformance.adapter.new_adapter import LANGUAGES
from automcm_conformance.adapter.process import LIMIT_S, AdapterError
from automcm_spec.support import files
from automcm_spec.support.bad_input import BadInput
from automcm_spec.vocabulary.parameters import DEFAULTS, longest_delay

if TYPE_CHECKING:
    from rich.console import Console

    from automcm_conformance.exchange.results import Exploration
    from automcm_conformance.live.live import UdpAir
    from automcm_conformance.live.live_cases import LiveCase, LiveResult
    from automcm_conformance.suite.purposes import Purpose

app = typer.Typer()
FIRST_CAM_MS = 5_000
"""How long to listen for the station, in ms; a CAM comes at least every second."""
Selectors = Annotated[
    list[str] | None,
    typer.Argument(
        metavar="[SELECTOR]...",
        help="A case id or its prefix, a rule id, or a level.",
        autocompletion=completion.selectors,
    ),
]
Out = Annotated[Path | None, typer.Option(help="Folder for the report.  Default: runs/<time>.")]


@app.command(cls=WithCommand, epilog=example("conform run AMCM/RCV -- python3 my_adapter.py"))
def run(
    ctx: typer.Context,
    selectors: Selectors = None,
    expect: Annotated[
        Path | None, typer.Option(help="File that lists known deviations (docs/conformance.md).")
    ] = None,
    out: Out = None,
    limit: Limit = LIMIT_S,
    seed: Annotated[int, typer.Option(help="Seed of the station's random numbers.", min=0)] = 1,
    stop_after: Annotated[
        int, typer.Option(help="End after this many failed cases (0 = never).", min=0)
    ] = 0,
    quick: Annotated[
        bool, typer.Option(help="Run only the part that finds most faults (docs/conformance.md).")
    ] = False,
    failed: Annotated[
        bool,
        typer.Option(
            "--failed",
            help="Run only the cases that failed when this command was run last, according to the "
            "reports in runs/, or that in the folder --out.",
        ),
    ] = False,
    json_: Json = None,
) -> None:
    """Run the test suite, or a part of it, against a station.

    On Ctrl-C it reports what was found until then.
    """
    from automcm_conformance.adapter.protocol import ProtocolError
    from automcm_conformance.report import report as report_
    from automcm_conformance.report import terminal_report
    from automcm_conformance.suite import verdicts
    from automcm_conformance.suite.suite_run import conform
    from automcm_spec.graph.oracle import OracleError

    command, chosen = command_of(ctx), purposes_of(selectors or [])
    if failed:
        reports = [out] if out else Path("runs").glob("*")
        with code_3("conform", ValueError, OSError):
            last = report_.failed_last(
                (path for each in reports if (path := each / "report.json").exists()), command
            )
        if last is None:
            raise typer.BadParameter("--failed: there is no report of this command yet")
        chosen = [purpose for purpose in chosen if purpose.id in last]
        if not chosen:
            say("no case failed last time")
            raise typer.Exit
    folder = out or fresh_folder()
    started, clock = datetime.now(UTC), time.monotonic()
    with code_3("conform", AdapterError, ProtocolError, OracleError, BadInput, OSError):
        known = {} if expect is None else verdicts.expectations(expect, purposes_of([]))
        with files.new_folder(folder, named=True), progress() as notify:
            report = conform(
                command,
                chosen,
                folder,
                limit_s=limit,
                seed=seed,
                notify=notify,
                selectors=[*(selectors or []), *["--quick"] * quick, *["--failed"] * failed],
                expected=known,
                stop_after=stop_after,
                quick=quick,
            )
            notify("pages")
            report_.write_pages(report, folder)
    report.started = started.isoformat(timespec="seconds")
    report.seconds = round(time.monotonic() - clock, 1)
    report_.write(report, folder)
    if write_json(json_, report.as_dict()):
        terminal_report.summary(report, console_of(), folder)
    raise typer.Exit(report.exit_code)


@app.command(cls=WithCommand, epilog=example("conform explore 60 --seed 7 -- ./my_adapter"))
def explore(
    ctx: typer.Context,
    seconds: Annotated[float, typer.Argument(help="Duration in seconds of real time.", min=0.0)],
    seed: Annotated[int, typer.Option(help="Seed of the walks and of the station.", min=0)] = 1,
    walks: Annotated[
        int | None, typer.Option(help="Stop after this many walks instead of after SECONDS.", min=1)
    ] = None,
    enough: Annotated[
        int, typer.Option(help="Stop after this many different failures.", min=1)
    ] = 3,
    out: Out = None,
    limit: Limit = LIMIT_S,
    json_: Json = None,
) -> None:
    """Test a station by random walks through the graphs.

    The walks prefer transitions that no walk has taken.  The peers answer, and the radio repeats,
    delays and loses messages.  Each failure is shortened on the station itself and is written to a
    file for conform replay.
    """
    from automcm_conformance.adapter.protocol import ProtocolError
    from automcm_conformance.explore.explore import explore as explore_
    from automcm_spec.graph.oracle import OracleError

    command = command_of(ctx)
    folder = out or fresh_folder()
    started, clock = datetime.now(UTC), time.monotonic()

    def more(number: int) -> bool:
        return number < walks if walks is not None else time.monotonic() - clock < seconds

    with code_3("explore", AdapterError, ProtocolError, OracleError, OSError):
        with files.new_folder(folder, named=True), progress() as notify:
            found = explore_(
                command, folder, limit_s=limit, seed=seed, enough=enough, notify=notify, more=more
            )
        found.started = started.isoformat(timespec="seconds")
        found.seconds = round(time.monotonic() - clock, 1)
        write_json(folder / "exploration.json", found.as_dict())
    if write_json(json_, found.as_dict()):
        _show(found, folder, console_of())
    raise typer.Exit(found.exit_code)


def _show(found: Exploration, folder: Path, console: Console) -> None:
    from automcm_conformance.report import terminal_report

    who = found.implementation
    console.print(f"{who.name} {who.version}", markup=False)
    console.print(f"{found.walks:,} walks, {found.lines:,} lines, seed {found.seed}")
    for name, counts in found.coverage.items():
        shares = (f"{kind} {reached:,} of {total:,}" for kind, (reached, total) in counts.items())
        console.print(f"{name:<10} {', '.join(shares)}", highlight=False)
    for problem in found.problems:
        console.print(f"Problem: {problem}", markup=False)
    for case in found.cases:
        console.print()
        terminal_report.failure(case, case.failures[0], console)
    if not found.cases and found.walks:
        console.print("Every answer conforms to the specification.")
    elif found.again:
        console.print(f"{found.again:,} more walks failed in one of these ways.")
    console.print(f"Report: {folder / 'exploration.json'}", markup=False, soft_wrap=True)


@app.command("list", epilog=example("conform list NEG-4 --json -"))
def list_(
    selectors: Selectors = None,
    explain: Annotated[
        str | None,
        typer.Option(help="Describe the case with this id.", autocompletion=completion.selectors),
    ] = None,
    json_: Json = None,
) -> None:
    """List the test cases."""
    from rich.table import Table

    chosen = purposes_of([explain] if explain else selectors or [])
    if not write_json(json_, [_described(purpose) for purpose in chosen]):
        return
    console = console_of()
    if explain:
        for purpose in chosen:
            for name, text in _described(purpose).items():
                shown = ", ".join(text) if isinstance(text, list) else text
                console.print(f"{name:>6}  {shown}", markup=False, highlight=False)
            console.print()
        return
    table = Table(box=None)
    for column in ("id", "level", "rules", "when"):
        table.add_column(column, no_wrap=column != "when")
    for purpose in chosen:
        table.add_row(purpose.id, purpose.level, ", ".join(purpose.rules), purpose.when)
    console.print(table)


def _described(purpose: Purpose) -> dict[str, Any]:
    names = ("id", "level", "rules", "given", "when", "then", "bug", "cost")
    return {name: getattr(purpose, name) for name in names} | {"rules": list(purpose.rules)}


@app.command(
    cls=WithCommand, epilog=example("conform replay runs/x/replay/y-1.json -- ./my_adapter")
)
def replay(
    ctx: typer.Context,
    file: Annotated[
        Path, typer.Argument(help="Replay file written by conform run or conform explore.")
    ],
    limit: Limit = LIMIT_S,
    json_: Json = None,
) -> None:
    """Send the lines of a recorded failure to a station again."""
    from automcm_conformance.adapter.protocol import ProtocolError
    from automcm_conformance.exchange.records import replay_failure
    from automcm_conformance.exchange.transcript import exchange
    from automcm_conformance.report.report import visible

    command = command_of(ctx)
    with code_3("replay", AdapterError, ProtocolError, BadInput, OSError):
        found = replay_failure(file, command, limit)
    if write_json(json_, found.as_dict()):
        console = console_of()
        for line in exchange(found.sent, complete=True):
            text = f"{line.now:>8}  {line.who:<8} {line.text}"
            console.print(text, markup=False, highlight=False)
        wrong = ": ".join(filter(None, (found.rule, found.what)))
        reason = wrong if found.what else "every answer is as expected"
        console.print(f"{found.verdict} {found.case}  {reason}", markup=False)
        for text in found.stderr:
            console.print(f"  stderr  {visible(text)}", markup=False, highlight=False)
    raise typer.Exit(found.exit_code)


@app.command(
    "check-adapter", cls=WithCommand, epilog=example("conform check-adapter -- ./my_adapter")
)
def check_adapter(ctx: typer.Context, limit: Limit = LIMIT_S, json_: Json = None) -> None:
    """Check an adapter against the adapter protocol.

    Checks each line against the schema, and finds common mistakes.
    """
    from automcm_conformance.adapter.check_adapter import check
    from automcm_conformance.report.report import visible

    command = command_of(ctx)
    with progress() as notify:
        findings = check(command, limit, notify)
    if write_json(json_, [asdict(checked) for checked in findings]):
        for checked in findings:
            say(f"{checked.level:>7}  {visible(checked.what)}")
            for name in ("sent", "answered"):
                if text := getattr(checked, name):
                    say(f"{name:>16}  {visible(text, limit=300)}")
            for line in checked.stderr:
                say(f"{'stderr':>16}  {visible(line, limit=300)}")
    raise typer.Exit(1 if any(checked.level == "error" for checked in findings) else 0)


@app.command(epilog=example("conform new --language cpp my_adapter"))
def new(
    folder: Annotated[
        Path, typer.Argument(help="Folder for the adapter; it must be new or empty.")
    ],
    language: Annotated[
        Literal[tuple(LANGUAGES)],  # type: ignore[valid-type]
        typer.Option(help="Language of the adapter."),
    ] = "python",
) -> None:
    """Write the skeleton of an adapter, ready to run."""
    from automcm_conformance.adapter.new_adapter import create, next_commands

    with code_3("new", OSError), usage(FileExistsError):
        written = create(language, folder)
    for path in written:
        say(path)
    say()
    say("Next:")
    for command in next_commands(language, folder):
        say(f"    {command}")


@app.command("report", epilog=example("conform report a.json b.json --out both.html"))
def report_side_by_side(
    reports: Annotated[list[Path], typer.Argument(help="The report.json file of each run.")],
    out: Annotated[Path, typer.Option(help="File for the HTML page.")] = Path("report.html"),
) -> None:
    """Write one HTML page that compares several runs."""
    from automcm_conformance.report import report as report_

    with code_3("report", ValueError, OSError):
        files.write(out, report_.html([report_.load(path) for path in reports]))
    say(out)


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
    from automcm_conformance.adapter.protocol import ProtocolError
    from automcm_conformance.live.live_cases import LiveRun
    from automcm_spec.graph.oracle import OracleError, load
    from automcm_spec.graph.oracle_generation import ONE_PEER, spec_hash

    cases = _cases(selectors or [])
    known = adjusted(set_).known
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
            text = f"live: no CAM of station {station} on {broadcast} within {FIRST_CAM_MS} ms"
            say(text, err=True)
            raise typer.Exit(3)
        for case in cases:
            notify(case.name)
            session.judge(case)
    if write_json(json_, session.as_dict()):
        _show_live(session.results, console_of())
    raise typer.Exit(session.exit_code)


@contextmanager
def _air(host: str, broadcast: str, allow_remote: bool) -> Iterator[UdpAir]:
    """The same sockets as those of the reference's stations.  A bad address is a usage error."""
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


def _show_live(judged: list[LiveResult], console: Console) -> None:
    for case in judged:
        console.print(f"{case.verdict:<6}  {case.case:<16} {case.reason}", markup=False)
    for case in [case for case in judged if case.reason][:3]:
        console.print()
        console.print(f"{case.verdict} {case.case}: {case.then}", markup=False)
        for line in case.lines:
            text = f"{line.now:>8}  {line.who:<8} {line.text}"
            console.print(text, markup=False, highlight=False)
