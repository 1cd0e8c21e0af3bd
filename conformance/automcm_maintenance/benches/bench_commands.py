"""``automcm bench``: all its commands."""

from __future__ import annotations

import typer

from automcm_cli.shared.common import example
from automcm_maintenance.benches import conform_bench, station_bench, trace_bench

app = typer.Typer()
app.command(epilog=example("bench station --seconds 20"))(station_bench.station)
app.command(epilog=example("bench kernels --seconds 60"))(station_bench.kernels)
app.command(epilog=example("bench security --seconds 20"))(station_bench.security)
app.command(epilog=example("bench window --sessions 200"))(station_bench.window)
app.command(epilog=example("bench conform --must"))(conform_bench.conform)
app.command(epilog=example("bench traces --logs 200 --no-tlc"))(trace_bench.traces)
