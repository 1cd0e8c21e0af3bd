"""``automcm simulate``: scenarios on the road simulator, and in the traffic of SUMO."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, Literal

import typer

from automcm_cli.shared import completion
from automcm_cli.shared.common import (
    Json,
    code_3,
    example,
    progress,
    say,
    unknown,
    usage,
    write_json,
)
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
            say(
                f"seed {each['seed']}, {each['kind']}, sigma {each['sigma']} m: room {room}, "
                f"braking {each['braking']} m/s²"
            )
    raise typer.Exit(1 if counted["bad"] else 0)


@app.command("traffic", epilog=example("simulate traffic --scenario lane-change --vehicles 20"))
def traffic(
    scenario: Annotated[
        str,
        typer.Option(
            help="Which scenario; an unknown name lists them.", autocompletion=completion.scenarios
        ),
    ] = "lane-change",
    vehicles: Annotated[int, typer.Option(help="Number of vehicles.", min=1)] = 20,
    density: Annotated[
        float,
        typer.Option(
            help="Vehicles per km of road, over all lanes; merge: of the main lane.",
            min=1,
            max=1000,
        ),
    ] = 40,
    penetration: Annotated[
        float, typer.Option(help="Share of vehicles with a station.", min=0, max=1)
    ] = 1,
    radio: Annotated[
        Literal["even", "table", "ns3"],
        typer.Option(
            help="even: loses --loss everywhere; ns3: 802.11p by ns-3; table: fitted to it."
        ),
    ] = "even",
    loss: Annotated[
        float, typer.Option(help="Share of messages to lose (--radio even).", min=0, max=1)
    ] = 0,
    codec: Annotated[Literal["json", "uper"], typer.Option(help="Encoding of messages.")] = "json",
    seed: Annotated[int, typer.Option(help="Seed of everything that is drawn.", min=0)] = 0,
    duration_s: Annotated[
        float, typer.Option(help="Simulated time in seconds.", min=1, max=3600)
    ] = 40,
    out: Annotated[
        Path, typer.Option(help="Folder for the logs, the positions, the record and the page.")
    ] = Path("runs/traffic"),
    gui: Annotated[bool, typer.Option("--gui", help="Watch it in sumo-gui.")] = False,
    json_: Json = None,
) -> None:
    """Simulate stations in the traffic of SUMO.

    SUMO moves everybody, and each equipped vehicle has a station.  The vehicles agree on maneuvers
    by radio and drive them by their own control.  A vehicle without a station is SUMO's own driver.
    The command writes each station's log, the record of safety, comfort, radio and sessions, and a
    page of one session with the traffic from above.  The exit code is 1 if equipped vehicles
    collided, a maneuver caused a collision, an equipped vehicle hit a pedestrian, or a hazard was
    unexcused (S-5) or exceeded its bound (T-2).  Needs automcm[sumo]; --radio ns3 also
    automcm[radio].
    """
    from automcm.encoding.codec import CodecError
    from automcm_simulation.traffic.mover import TrafficError
    from automcm_simulation.traffic.seen_from_above import Frames
    from automcm_simulation.traffic.traffic_scenario import TrafficSetting
    from automcm_simulation.traffic_scenarios import session_page
    from automcm_simulation.traffic_scenarios.catalogue import SCENARIOS
    from automcm_simulation.traffic_scenarios.traffic_run import TrafficRun, wrong

    if scenario not in SCENARIOS:
        raise typer.BadParameter(unknown(scenario, list(SCENARIOS), "scenario"))
    with usage(ValueError):
        run = TrafficRun(
            scenario=scenario,
            setting=TrafficSetting(
                seed=seed,
                vehicles=vehicles,
                density=density,
                penetration=penetration,
                duration_s=duration_s,
            ),
            radio=radio,
            loss=loss,
            codec=codec,
        )
    frames = Frames()

    def show(now_ms: int) -> None:
        notify(f"{now_ms / 1000:.1f} of {duration_s:g} simulated seconds")

    with code_3("simulate traffic", TrafficError, CodecError, OSError):
        with files.new_folder(out, named=True), progress() as notify:
            found = run.drive(logs=out, frames=frames, gui=gui, progress=show)
        record = run.record(found)
        files.write(out / "traffic.json", frames.as_json())
        page = session_page.write(found, out)
    write_json(out / "record.json", record)
    if write_json(json_, record | {"page": str(page) if page else None}):
        _say_traffic(record, out, page)
    raise typer.Exit(1 if wrong(record) else 0)


def _say_traffic(record: dict[str, Any], out: Path, page: Path | None) -> None:
    from automcm_simulation.road.hazard_measures import number_wrong
    from automcm_spec.vocabulary.parameters import DEFAULTS, longest_delay

    collisions, sessions, radio = record["collisions"], record["sessions"], record["radio"]
    say(
        f"collisions  {collisions['between_equipped']} between equipped vehicles, "
        f"{collisions['by_maneuver']} by a maneuver, {collisions['with_pedestrian']} with a "
        f"pedestrian, {collisions['all']} in all"
    )
    if record["hazards"] is not None:
        lengths = [ms for each in record["hazards"]["lengths"].values() for ms in each]
        say(
            f"hazards     {len(lengths)}, longest {max(lengths, default=0)} ms, "
            f"{number_wrong(record['hazards'])} unexcused (S-5) or beyond "
            f"B = {record['hazards']['bound_ms']} ms (T-2)"
        )
    say(
        f"sessions    {sessions['requested']} requested, {sessions['agreed']} agreed, "
        f"{sessions['completed']} completed"
    )
    say(
        f"radio       {radio['sent_bytes']} bytes; 95 % of CAMs at most "
        f"{radio['cam_age_ms']['p95']} ms old, longest delay {radio['longest_delay_ms']} ms"
    )
    if record["hazards"] and radio["longest_delay_ms"] >= longest_delay(DEFAULTS):
        say(f"            T-2 and TLC assume less than {longest_delay(DEFAULTS)} ms")
    for what, number in record["outcome"].items():
        say(f"  {number:4}  {what}")
    say(f"written     {out / 'record.json'}, the logs" + (f", {page}" if page else ""))
