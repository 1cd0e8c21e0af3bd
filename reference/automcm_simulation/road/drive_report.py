"""The report and the plots of ``automcm simulate lane-change``."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from automcm.applications.lane_change import LaneChange
from automcm_simulation.road import figures
from automcm_simulation.road.drive import NAMES, SimulatedDrive


def report(drive: SimulatedDrive) -> dict[str, Any]:
    """What happened to each vehicle, and how each ended, for JSON."""
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


def plots(drive: SimulatedDrive, out: Path) -> list[Path]:
    """Both plots as PNG and SVG; none without matplotlib."""
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
