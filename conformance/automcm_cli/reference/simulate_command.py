"""``automcm simulate``: scenarios on the road simulator, as a list of events and as plots."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from automcm_cli.shared.common import Json, code_3, example, progress, say, write_json
from automcm_spec.support import files

app = typer.Typer()


@app.command("lane-change", epilog=example("simulate lane-change --vehicles 4 --speed 30"))
def lane_change(
    vehicles: Annotated[int, typer.Option(help="Number of vehicles.", min=2, max=4)] = 4,
    speed: Annotated[
        float, typer.Option(help="Speed of all vehicles, in km/h.", min=5, max=130)
    ] = 30,
    loss: Annotated[float, typer.Option(help="Share of messages to lose.", min=0, max=1)] = 0,
    uncoordinated: Annotated[
        bool,
        typer.Option("--uncoordinated", help="Send no messages: brake late, stop, restart."),
    ] = False,
    seconds: Annotated[float, typer.Option(help="Simulated time in seconds.", min=1, max=600)] = 40,
    seed: Annotated[int, typer.Option(help="Seed of the radio.")] = 0,
    out: Annotated[Path, typer.Option(help="Folder for plots and logs.")] = Path("runs/simulate"),
    json_: Json = None,
) -> None:
    """Simulate a lane change among four vehicles (figure 6).

    The prescriber changes lanes beside the receivers A, B and C.  The command prints the events,
    and writes each station's log and the plots speed-over-position and space-time (they need
    automcm[plot]).  The exit code is 1 if the lane change was not completed.
    """
    from automcm.links.simulated_radio import Channel
    from automcm_simulation.road import drive_report
    from automcm_simulation.road.drive import FourVehicles

    setting = FourVehicles(
        vehicles=vehicles,
        speed_kmh=speed,
        coordinated=not uncoordinated,
        until_s=seconds,
        seed=seed,
    )
    with code_3("simulate", OSError):
        files.folder(out, named=True)
        for old in out.glob("[1-4].ndjson"):
            old.unlink()
        drive = setting.run(channel=Channel(loss=loss), logs=out)
        plots = drive_report.plots(drive, out)
    report = drive_report.report(drive)
    if write_json(json_, report | {"plots": [str(path) for path in plots]}):
        for line in report["story"]:
            say(f"{line['t_s']:6.2f} s  {line['vehicle']:<10}  {line['what']}")
        for name, end in report["vehicles"].items():
            say(
                f"{name:<10}  lane {end['lane']}, {end['x_m']:.0f} m, slowest "
                f"{end['slowest_kmh']:.1f} km/h, hardest braking {end['hardest_braking']:.1f} m/s²"
            )
        for path in plots:
            say(f"written {path}")
        if not plots:
            say("no plots were written: install automcm[plot]", err=True)
        if not report["done"]:
            say(f"the lane change was not completed within {seconds:g} s", err=True)
    raise typer.Exit(0 if report["done"] else 1)


@app.command("drives", epilog=example("simulate drives --drives 20"))
def drives(
    count: Annotated[int, typer.Option("--drives", help="Number of drives.", min=1)] = 100,
    seed: Annotated[int, typer.Option(help="Seed of the first drive; then the next.", min=0)] = 0,
    without: Annotated[
        str, typer.Option(help="Mechanism to take away: CAMs, perception, lengths, sigma, ...")
    ] = "",
    workers: Annotated[int, typer.Option(help="Processes; 0: one per core.", min=0)] = 0,
    json_: Json = None,
) -> None:
    """Look for lane changes into an occupied lane (APP-1 to APP-5).

    In each drive some stations do not answer, only send CAMs, have no radio, or do not drive what
    they accepted, messages are lost, the road bends, some vehicles are lorries, and positions have
    errors.  A drive is bad if less than 2 m of room is left, or somebody brakes harder than 4 m/s².
    The exit code is 1 if a drive is bad.
    """
    from automcm_simulation.road import sweep_report
    from automcm_simulation.road.sweep_drivers import WITHOUT

    if without and without not in WITHOUT:
        raise typer.BadParameter(f"expected one of {', '.join(WITHOUT)}, got {without!r}")
    with progress() as notify:
        found = sweep_report.driven(range(seed, seed + count), without, workers, notify)
    counted = sweep_report.counted(found)
    report = {"seed": seed, "drives": count, "without": without, **counted}
    if write_json(json_, report):
        for kind, figures in counted["kinds"].items():
            counts = ", ".join(f"{number} {name}" for name, number in figures.items())
            say(f"{kind:<16} {counts}")
        for each in counted["bad"]:
            room = "-" if each["room_m"] is None else f"{each['room_m']} m"
            braking = f"braking {each['braking']} m/s²"
            say(
                f"seed {each['seed']}, {each['kind']}, sigma {each['sigma']} m: "
                f"room {room}, {braking}"
            )
    raise typer.Exit(1 if counted["bad"] else 0)
