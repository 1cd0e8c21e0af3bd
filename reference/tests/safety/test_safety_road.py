"""Hazards on the road: the room that is left, the time to collision."""

from __future__ import annotations

import pytest

from automcm.applications.vehicle import Vehicle
from automcm_evaluation.safety import safety_road
from automcm_simulation.road.road import Sample


def samples(*vehicles: tuple[int, list[tuple[float, float, float]]]) -> list[Sample]:
    return [
        Sample(0.1 * n, station_id, x, y, v, 0.0)
        for station_id, rows in vehicles
        for n, (x, y, v) in enumerate(rows)
    ]


def test_room_gap_and_time_to_collision() -> None:
    mover = Vehicle(1, 0, 0, 8, 8)
    own = [(0.0, 0.0, 8.0), (10.0, 0.0, 8.0), (20.0, 1.0, 8.0), (30.0, 2.0, 8.0), (40.0, 3.5, 8.0)]
    behind = [(-20.0, 3.5, 9.0), (0.0, 3.5, 9.0), (15.0, 3.5, 9.0), (24.0, 3.5, 9.0)]
    found = safety_road.nearest(samples((1, own), (3, [*behind, (34.0, 3.5, 10.0)])), mover)
    assert found == pytest.approx((5.5, 1.5, 0.75))
    assert safety_road.nearest(samples((1, own[:2]), (3, behind[:2])), mover) == (None, None, None)
    ahead = [(x + 9, 3.5, 12.0) for x, *_ in own]
    assert safety_road.nearest(samples((1, own), (2, ahead)), mover)[1:] == (4.5, None)
