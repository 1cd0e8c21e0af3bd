"""``automcm bench``: what is measured beside what."""

from __future__ import annotations

import typer

from automcm_cli import conform_bench, station_bench, trace_bench

app = typer.Typer()
app.command(epilog=station_bench.STATION)(station_bench.station)
app.command(epilog=station_bench.KERNELS)(station_bench.kernels)
app.command(epilog=conform_bench.EPILOG)(conform_bench.conform)
app.command(epilog=trace_bench.EPILOG)(trace_bench.traces)
