"""``automcm bench``: all its commands."""

from __future__ import annotations

from typing import Annotated, Literal

import typer

from automcm_cli.shared.common import Json, code_3, example, progress, usage, write_json
from automcm_maintenance.benches import conform_bench, station_bench, trace_bench

app = typer.Typer()
app.command(epilog=example("bench station --seconds 20"))(station_bench.station)
app.command(epilog=example("bench kernels --seconds 60"))(station_bench.kernels)
app.command(epilog=example("bench security --seconds 20"))(station_bench.security)
app.command(epilog=example("bench window --sessions 200"))(station_bench.window)
app.command(epilog=example("bench radio --seconds 20"))(station_bench.radio)
app.command(epilog=example("bench conform --must"))(conform_bench.conform)
app.command(epilog=example("bench traces --logs 200"))(trace_bench.traces)


@app.command(epilog=example("bench traffic"))
def traffic(
    scenario: Annotated[str, typer.Option(help="As of simulate traffic.")] = "lane-change",
    vehicles: Annotated[int, typer.Option(help="Number of vehicles.", min=1)] = 100,
    density: Annotated[float, typer.Option(help="Vehicles per km of road.", min=1)] = 40,
    radio: Annotated[
        Literal["even", "table", "ns3"], typer.Option(help="As of simulate traffic.")
    ] = "table",
    seconds: Annotated[float, typer.Option(help="Simulated time in seconds.", min=1)] = 10,
    json_: Json = None,
) -> None:
    """Simulated seconds a second, with and without stations.

    SUMO alone is the baseline.  All run on one core in this process, one after the other; the time
    is that of the processor.  Needs automcm[sumo].
    """
    from automcm_simulation.traffic.mover import TrafficError
    from automcm_simulation.traffic.traffic_scenario import TrafficSetting
    from automcm_simulation.traffic_scenarios.traffic_run import TrafficRun
    from automcm_simulation.traffic_scenarios.traffic_speed import measured

    with usage(ValueError):
        setting = TrafficSetting(vehicles=vehicles, density=density, duration_s=seconds)
        run = TrafficRun(scenario=scenario, setting=setting, radio=radio)
    with code_3("bench traffic", TrafficError), progress() as notify:
        report = measured(run, notify)
    if write_json(json_, report):
        typer.echo(
            f"SUMO alone        {report['alone']['simulated_per_s']:8.1f} simulated s a second"
        )
        without = report["without"]
        typer.echo(
            f"without stations  {without['simulated_per_s']:8.1f}, "
            f"{without['times_alone']:.1f} times as long"
        )
        for share, found in report["stations"].items():
            typer.echo(
                f"{float(share):5.0%} have one    {found['simulated_per_s']:8.1f}, "
                f"{found['times_alone']:.1f} times as long, {found['received']} receptions"
            )
