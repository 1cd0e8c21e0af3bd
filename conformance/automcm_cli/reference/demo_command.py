"""The command ``automcm demo`` and its output."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from automcm_cli.reference.station_commands import CloseEarly
from automcm_cli.shared.common import Json, code_3, say, write_json

if TYPE_CHECKING:
    from rich.table import Table

    from automcm_simulation.road.demo_processes import Demo


def demo(
    loss: Annotated[
        float, typer.Option(min=0, max=0.9, help="Share of the datagrams to lose.")
    ] = 0.0,
    kill: Annotated[
        str | None, typer.Option(help="Kill the process of B during the maneuver.", metavar="B")
    ] = None,
    second_prescriber: Annotated[
        bool,
        typer.Option("--second-prescriber", help="Add a fifth station that also prescribes B."),
    ] = False,
    secured: Annotated[
        bool, typer.Option("--secured", help="Sign all messages, with keys made for this run.")
    ] = False,
    close_early: CloseEarly = False,
    out: Annotated[Path, typer.Option(help="Folder for the logs and the page.")] = Path(
        "runs/demo"
    ),
    seed: Annotated[int, typer.Option(help="Seed of the losses and delays.")] = 0,
    listen: Annotated[int, typer.Option(help="See automcm station --help.", hidden=True)] = 1100,
    json_: Json = None,
) -> None:
    """Run a prescriber and three receivers as processes.

    The prescriber instructs B to slow down, B accepts, A and C are not selected, and the session
    ends with a Fin.  With --kill B, the prescriber falls back because of CAM loss.  With
    --second-prescriber, B refuses the instruction of another station because it is busy.  Every
    station's log is checked against the oracle, and a page of the run is written.  The exit code is
    1 if the outcome differs from this description.
    """
    import asyncio

    from automcm.links.link import LinkError
    from automcm_simulation.road.demo_processes import Demo
    from automcm_spec.support.extras import MissingExtra

    if kill not in (None, "B"):
        raise typer.BadParameter(f"--kill accepts only B, the target, not {kill!r}")
    if kill and second_prescriber:
        raise typer.BadParameter("--kill and --second-prescriber cannot be combined")
    shown = Demo(
        out,
        loss=loss,
        kill=kill == "B",
        second_prescriber=second_prescriber,
        secured=secured,
        close_early=close_early,
        seed=seed,
        listen_ms=listen,
    )
    with code_3("demo", LinkError, MissingExtra, OSError), _live(shown):
        asyncio.run(shown.run())
        shown.write_page()
    if write_json(json_, shown.as_dict()):
        _summary(shown)
    raise typer.Exit(1 if shown.problems else 0)


@contextmanager
def _live(shown: Demo) -> Iterator[None]:
    """A table that shows the events as they occur, on a terminal; no output to a pipe."""
    from rich.live import Live

    from automcm_cli.shared.terminal import Terminal

    console = Terminal(stderr=True)
    if not console.is_terminal:
        yield
        return
    with Live(table(shown), console=console, refresh_per_second=10, transient=True) as live:
        shown.changed = lambda demo: live.update(table(demo))
        yield


def table(shown: Demo) -> Table:
    """Each vehicle's phase, its sent and received messages without CAMs, its last indication."""
    from rich.table import Table

    made = Table("vehicle", "station", "role", "phase", "session", "sent", "received", "indication")
    for v in shown.vehicles:
        phase = "killed" if v.killed else v.phase
        session = "/".join(map(str, v.session)) if v.session else ""
        last = v.indications[-1] if v.indications else ""
        sent = " ".join(f"{name} {n}" for name, n in v.sent.items())
        received = str(sum(v.received.values()))
        made.add_row(v.name, str(v.station_id), v.role, phase, session, sent, received, last)
    return made


def _summary(shown: Demo) -> None:
    for v in shown.vehicles:
        way = " > ".join(step.replace(" ", " (") + ")" for step in v.way)
        say(f"{v.name} (station {v.station_id}): {way}{' > killed' if v.killed else ''}")
        say(f"  indications: {', '.join(v.indications) or 'none'}")
        sent = ", ".join(f"{n} {name}" for name, n in sorted(v.sent.items()))
        say(f"  sent: {sent or 'nothing'}, and CAMs")
    for verdict in shown.verdicts:
        say(f"{verdict.file}: {verdict.verdict}, {verdict.events} events")
    say(f"datagrams: {shown.delivered} delivered, {shown.lost} lost; {shown.seconds:.1f} s")
    for problem in shown.problems:
        say(problem, err=True)
    if not shown.problems:
        say("ended as described")
    if shown.page is not None:
        say(f"open in a browser: {shown.page}")
