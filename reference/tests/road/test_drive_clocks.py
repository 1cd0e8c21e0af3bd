"""Drives of vehicles whose clocks differ (APP-6)."""

from __future__ import annotations

import pytest

from automcm.applications.lane_change import LaneChange
from automcm.applications.vehicle import Vehicle
from automcm_simulation.road.drive import SimulatedDrive

SPEED = 30 / 3.6


def driven(offsets_ms: dict[int, int], gap_m: float = 3.0) -> SimulatedDrive:
    """Vehicle 1 wants into the lane of 3, beside it, and of 2, ahead."""
    places = {1: (0.0, 0), 3: (-gap_m, 1), 2: (22.0 - gap_m, 1)}
    drivers = [LaneChange(Vehicle(n, x, lane, SPEED, SPEED)) for n, (x, lane) in places.items()]
    drive = SimulatedDrive(drivers, offsets_ms=offsets_ms)
    drive.simulation.clock.at(1000, lambda: drivers[0].signal(1))
    drive.run(25)
    return drive


def positions(drive: SimulatedDrive) -> list[tuple[float, float, float]]:
    return [(round(s.t, 6), round(s.x, 3), round(s.y, 3)) for s in drive.road.samples]


def test_a_drive_does_not_depend_on_the_time_of_day() -> None:
    assert positions(driven(dict.fromkeys((1, 2, 3), 100_000))) == positions(driven({}))


@pytest.mark.parametrize("offset_ms", [0, 80])
def test_app_6_with_clocks_in_step_it_changes_lanes(offset_ms: int) -> None:
    drive = driven({3: offset_ms})
    assert drive.drivers[0].vehicle.lane == 1
    assert min(s.acceleration for s in drive.road.samples) > -4


@pytest.mark.parametrize("offset_ms", [500, 10_000])
@pytest.mark.parametrize("who", [1, 3])
def test_app_6_nobody_moves_over_beside_a_vehicle_that_is_out_of_step(
    offset_ms: int, who: int
) -> None:
    drive = driven({who: offset_ms})
    assert drive.drivers[0].vehicle.lane == 0
    assert min(s.acceleration for s in drive.road.samples) > -1
