"""The road simulator: its equations and its invariants."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from automcm.applications.vehicle import LANE_WIDTH, STEP_S, Driving, LateBraking, Vehicle, idm
from automcm.kernels.trajectory import Trajectory
from automcm_simulation.road.occupancy_sweep import bends
from automcm_simulation.road.road import Road

D = Driving()


def test_the_idm_keeps_its_speed_on_a_free_road_and_its_gap_behind_another() -> None:
    assert idm(math.inf, 10, 0, 10, D) == 0
    assert idm(math.inf, 0, 0, 10, D) == D.acceleration
    at_ease = (D.standstill + 8 * D.headway_s) / math.sqrt(1 - (8 / 10) ** 4)
    assert idm(at_ease, 8, 8, 10, D) == pytest.approx(0)
    assert idm(at_ease, 8, 7, 10, D) < 0 < idm(at_ease, 8, 9, 10, D)


def drive(road: Road, seconds: float) -> Road:
    for _ in range(round(seconds / STEP_S)):
        road.step()
    return road


@settings(max_examples=30, deadline=None)
@given(
    st.lists(st.floats(6, 60), min_size=1, max_size=4),
    st.lists(st.floats(0, 15), min_size=5, max_size=5),
)
def test_followers_never_collide_nor_go_backwards(gaps: list[float], speeds: list[float]) -> None:
    """With room to brake at first."""
    x, vehicles = 0.0, []
    for n, speed in enumerate(speeds[: len(gaps) + 1]):
        vehicles.append(Vehicle(n + 1, -x, 0, speed, 15))
        if n < len(gaps):
            x += gaps[n] + max(0.0, speeds[n + 1] ** 2 - speed**2) / (2 * D.comfortable) + 4.5
    road = drive(Road(vehicles), 30)
    for v in vehicles:
        samples = road.of(v.station_id)
        assert all(b.x >= a.x for a, b in pairwise(samples))
        assert all(s.speed >= 0 for s in samples)
    for t in range(len(road.of(1))):
        places = [road.of(v.station_id)[t].x for v in vehicles]
        assert all(front - behind > 4.5 for front, behind in pairwise(places))


def test_a_prescribed_speed_is_followed_smoothly_and_costs_the_way_it_should() -> None:
    """Fig. 4: the step is smoothed at both ends, and the way lost is that of the step."""
    slow = Trajectory(np.array([2, 6, 30.0]), np.array([[0, 0], [16, 0], [256, 0]]))
    vehicle = Vehicle(1, 0, 0, 10, 10, driving=Driving(comfortable=8, acceleration=8))
    vehicle.follow(slow)
    road = drive(Road([vehicle]), 25)
    speeds = [s.speed for s in road.of(1)]
    assert min(speeds) == pytest.approx(4, abs=0.15)
    assert max(abs(b - a) for a, b in pairwise(speeds)) < 6 * STEP_S * 1.05
    assert 10 * 25 - vehicle.x == pytest.approx(4 * 6, abs=0.7)


def test_a_vehicle_never_jumps_sideways() -> None:
    vehicle = Vehicle(1, 0, 0, 10, 10)
    road = Road([vehicle])
    for n in range(100):
        if n in (3, 10, 60):
            vehicle.change_lane(1 - vehicle.target_lane, road.t)
        road.step()
    most = LANE_WIDTH / D.lane_change_s * STEP_S
    assert all(abs(b.y - a.y) < most * 1.01 for a, b in pairwise(road.of(1)))


def test_a_lane_change_takes_its_time_and_is_in_the_way_on_both_lanes() -> None:
    vehicle, behind = Vehicle(1, 0, 0, 10, 10), Vehicle(2, -15, 1, 10, 10)
    road = Road([vehicle, behind])
    assert road.ahead(behind) is None
    vehicle.change_lane(1, road.t)
    assert road.ahead(behind) is vehicle and vehicle.lanes == {0, 1}
    drive(road, 2.0)
    assert vehicle.y == pytest.approx(LANE_WIDTH / 2) and vehicle.lane == 1 and vehicle.changing
    drive(road, 2.0)
    assert vehicle.y == LANE_WIDTH and not vehicle.changing and vehicle.lanes == {1}
    xy, speed = vehicle.path()
    assert (xy[:, 1] == LANE_WIDTH).all() and len(xy) == len(speed)


def test_without_coordination_it_is_noticed_late_with_a_hard_stop_and_a_restart() -> None:
    """Section VI-B, and that each part of the model matters."""

    def arrival(late: LateBraking | None) -> tuple[float, float, float]:
        front = Vehicle(1, 3, 0, 8.33, 8.33)
        behind = Vehicle(2, 0, 1, 8.33, 8.33, late=late)
        road = Road([front, behind])
        front.change_lane(1, road.t)
        drive(road, 40)
        samples = road.of(2)
        first = next(s.t for s in samples if s.acceleration <= -2.9)
        return first, min(s.speed for s in samples), behind.x

    first, slowest, x = arrival(LateBraking())
    assert first == pytest.approx(D.lane_change_s * 0.5 / LANE_WIDTH, abs=0.2) and slowest == 0
    assert arrival(LateBraking(notice=2.0))[0] > first
    assert (
        arrival(LateBraking(restart_s=5.0))[2] < x and arrival(LateBraking(restart_gap=60))[2] < x
    )
    assert arrival(LateBraking(brake=6.0))[1] == 0


def test_a_station_is_on_the_road_once() -> None:
    with pytest.raises(ValueError, match="station_id"):
        Road([Vehicle(1, 0, 0, 1, 1), Vehicle(1, 9, 0, 1, 1)])


def test_on_a_bend_a_vehicle_drives_its_speed_and_keeps_its_lane() -> None:
    vehicle = Vehicle(1, 20, 1, 10, 10, line=bends(100.0, True, 300))
    road, places = Road([vehicle]), []
    for _ in range(50):
        places.append((vehicle.x, vehicle.y))
        road.step()
    steps = np.hypot(*np.diff(places, axis=0).T)
    assert steps.sum() == pytest.approx(49 * 10 * STEP_S, rel=1e-3)
    assert vehicle.line.project(places).d == pytest.approx(LANE_WIDTH)
    assert vehicle.heading == pytest.approx((20 + 5 * 10 / 0.965) / 100, abs=0.03)
    with pytest.raises(ValueError, match="line: must be the same"):
        Road([vehicle, Vehicle(2, 0, 0, 10, 10)])
