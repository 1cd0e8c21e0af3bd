"""``automcm simulate``: scenarios on the road simulator, as a list of events and as plots."""

from __future__ import annotations

import logging
import os
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from contextlib import ExitStack
from dataclasses import asdict
from multiprocessing import get_context
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from automcm_cli.shared.common import Json, code_3, example, progress, say, write_json
from automcm_spec.support import children, files

if TYPE_CHECKING:
    from automcm_simulation.road.drive import SimulatedDrive
    from automcm_simulation.road.occupancy_sweep import Driven

FEW_DRIVES = 20
"""Too few drives for a process of their own."""

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
        plots = _plots(drive, out)
    report = _report(drive)
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
    by_sigma: Annotated[
        bool,
        typer.Option("--by-sigma", help="Drive each with position errors of 0, 0.5, 1 and 2 m."),
    ] = False,
    workers: Annotated[int, typer.Option(help="Processes; 0: one per core.", min=0)] = 0,
    json_: Json = None,
) -> None:
    """Look for lane changes into an occupied lane (APP-1 to APP-5).

    In each drive some stations do not answer, only send CAMs, have no radio, or do not drive what
    they accepted, messages are lost, the road bends, some vehicles are lorries, and positions have
    errors.  A drive is bad if less than 2 m of room is left, or somebody brakes harder than 4 m/s².
    The exit code is 1 if a drive is bad.
    """
    from automcm_simulation.road.occupancy_sweep import KINDS
    from automcm_simulation.road.sweep_drivers import WITHOUT

    if without and without not in WITHOUT:
        raise typer.BadParameter(f"expected one of {', '.join(WITHOUT)}, got {without!r}")
    sigmas = (0.0, 0.5, 1.0, 2.0) if by_sigma else (None,)
    asked = [(each, without, sigma) for sigma in sigmas for each in range(seed, seed + count)]
    found = _driven(asked, workers)
    bad = [asdict(each) for each in found if each.bad]
    kinds = {
        kind: {
            "drives": len(some),
            "changed": sum(each.changed for each in some),
            "returned": sum(each.returned for each in some),
            "bad": sum(each.bad for each in some),
        }
        for kind in KINDS
        for some in [[each for each in found if each.kind == kind]]
    }
    report = {"seed": seed, "drives": count, "without": without, "kinds": kinds, "bad": bad}
    errors = {
        sigma: {
            "completed": sum(each.changed for each in some),
            "aborted": sum(not each.changed for each in some),
            "bad": sum(each.bad for each in some),
        }
        for sigma in sigmas
        if sigma is not None
        for some in [[each for each in found if each.sigma == sigma]]
    }
    if by_sigma:
        report["sigmas"] = errors
    if write_json(json_, report):
        for sigma, outcomes in errors.items():
            counts = ", ".join(f"{number} {name}" for name, number in outcomes.items())
            say(f"sigma {sigma} m      {counts}")
        for kind, figures in kinds.items():
            counts = ", ".join(f"{number} {name}" for name, number in figures.items())
            say(f"{kind:<16} {counts}")
        for each in bad:
            room = "-" if each["room_m"] is None else f"{each['room_m']} m"
            braking = f"braking {each['braking']} m/s²"
            say(
                f"seed {each['seed']}, {each['kind']}, sigma {each['sigma']} m: "
                f"room {room}, {braking}"
            )
    raise typer.Exit(1 if bad else 0)


def _driven(asked: Sequence[tuple[int, str, float | None]], workers: int) -> list[Driven]:
    """Each drive (seed, mechanism taken away, sigma), in this order."""
    found: list[Driven] = []
    with progress() as notify, ExitStack() as stack:
        workers = min(workers or os.cpu_count() or 1, len(asked) // FEW_DRIVES + 1)
        if workers > 1:
            spawn = get_context("spawn")
            pool = ProcessPoolExecutor(workers, spawn, initializer=children.end_with_parent)
            results = stack.enter_context(pool).map(_drive, asked, chunksize=10)
        else:
            results = map(_drive, asked)
        for one in results:
            found.append(one)
            notify(f"{len(found)} of {len(asked)} drives, {sum(d.bad for d in found)} bad")
    return found


def _drive(asked: tuple[int, str, float | None]) -> Driven:
    from automcm_simulation.road.occupancy_sweep import drive

    # Clocks out of step and messages too long are drawn on purpose: no warnings.
    logging.getLogger("automcm.service").setLevel(logging.ERROR)
    seed, without, sigma = asked
    return drive(seed, without, sigma=sigma)


def _report(drive: SimulatedDrive) -> dict[str, Any]:
    from automcm.applications.lane_change import LaneChange
    from automcm_simulation.road.drive import NAMES

    story = [
        {"t_s": t / 1000, "vehicle": NAMES[driver.vehicle.station_id], "what": what}
        for driver in drive.drivers
        if isinstance(driver, LaneChange)
        for t, what in driver.story
    ]
    ends = {}
    for vehicle in drive.road.vehicles:
        samples = drive.road.of(vehicle.station_id)
        ends[NAMES[vehicle.station_id]] = {
            "lane": vehicle.lane,
            "x_m": round(vehicle.x, 2),
            "slowest_kmh": round(min(s.speed for s in samples) * 3.6, 2),
            "hardest_braking": round(max(0.0, -min(s.acceleration for s in samples)), 2),
        }
    changed = drive.road.vehicles[0]
    return {
        "done": changed.lane == 1 and not changed.changing,
        "story": sorted(story, key=lambda line: line["t_s"]),
        "vehicles": ends,
    }


def _plots(drive: SimulatedDrive, out: Path) -> list[Path]:
    """Both plots as PNG and SVG; none without matplotlib."""
    from automcm_simulation.road import figures
    from automcm_simulation.road.drive import NAMES

    if not figures.available():
        return []
    written = []
    for name, across, up in (
        ("speed-over-position", "position, m", "speed, km/h"),
        ("space-time", "time, s", "position, m"),
    ):
        figure, (plot,) = figures.plots()
        for vehicle in drive.road.vehicles:
            samples = drive.road.of(vehicle.station_id)
            value = {
                "position, m": [s.x for s in samples],
                "speed, km/h": [s.speed * 3.6 for s in samples],
                "time, s": [s.t for s in samples],
            }
            plot.plot(value[across], value[up], label=NAMES[vehicle.station_id])
        plot.set_xlabel(across)
        plot.set_ylabel(up)
        plot.legend()
        written += figures.save(figure, out / name)
    return written
