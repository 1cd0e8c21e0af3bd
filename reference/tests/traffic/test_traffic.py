"""Stations in traffic, without SUMO: the loop, the radio's links, perception and measures."""

from __future__ import annotations

import json
import math
import sys
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from traffic_stage import traffic

from automcm.applications.lane_change import LaneChange
from automcm.applications.vehicle import STRAIGHT
from automcm.encoding.codec import JSON
from automcm.kernels.trajectory import Trajectory
from automcm.service.service import McService
from automcm_simulation.traffic.even_radio import EvenRadio
from automcm_simulation.traffic.mover import Body, RoadUser, TrafficError
from automcm_simulation.traffic.shared_codec import SharedCodec
from automcm_simulation.traffic.traffic_measures import overlaps, time_to_collision
from automcm_simulation.traffic.traffic_scenario import TrafficSetting
from automcm_simulation.traffic.traffic_service import TrafficService
from automcm_simulation.traffic.traffic_vehicle import Sight
from automcm_simulation.traffic_scenarios import traffic_run
from automcm_simulation.traffic_scenarios.intersection_traffic import Intersection
from automcm_simulation.traffic_scenarios.ramp_traffic import Ramps
from automcm_simulation.traffic_scenarios.traffic_run import TrafficRun
from automcm_spec.support import extras
from automcm_spec.vocabulary.messages import Cam, MessageError

CAR = RoadUser(number=1, route=("road",), lane=0, at_m=0.0, speed=20.0, desired=25.0, equipped=True)


@pytest.mark.parametrize(("longest_ms", "bound"), [(40, 1540), (45, 1545), (70, 1549)])
def test_t_2_s_bound_has_the_longest_delay_of_the_radio(longest_ms: int, bound: int) -> None:
    made, _ = traffic(vehicles=2, duration_s=1)
    made.run()
    made.stations.links.longest_ms = longest_ms
    assert made.record()["hazards"]["bound_ms"] == bound


def test_a_log_leaves_out_cams_that_cannot_count(tmp_path: Path) -> None:
    made, _ = traffic(seed=3, vehicles=6, duration_s=15, logs=tmp_path)
    made.run()
    records = [json.loads(line) for line in (tmp_path / "1.ndjson").read_text().splitlines()]
    cams = [r for r in records if r.get("ev") == "receive" and r["message"]["type"] == "CAM"]
    heard = made.stations.services[1].statistics.received["CAM"]
    assert all(record["phase"] == "ACTUATING" for record in cams) and len(cams) < heard / 2
    assert heard > 500


def test_cams_taken_in_short_change_nothing_else(monkeypatch: pytest.MonkeyPatch) -> None:
    found = []
    for _ in range(2):
        made, _ = traffic(seed=3, vehicles=6, loss=0.2, duration_s=12)
        made.run()
        stories = {n: driver.story for n, driver in made.drivers.items()}  # type: ignore[attr-defined]
        services = made.stations.services.items()
        statistics = {n: s.statistics.as_dict() | {"latest_ms": 0} for n, s in services}
        heard = {n: dict(s.neighbours) for n, s in services}
        found.append((made.record(), stories, statistics, heard))
        monkeypatch.setattr(TrafficService, "receive", McService.receive)
    assert found[0] == found[1] and found[0][0]["sessions"]["agreed"] > 0


def test_who_leaves_the_road_is_off_the_air() -> None:
    made, mover = traffic(vehicles=3, duration_s=3)
    made.clock.at(1000, lambda: mover.gone.add(2))
    made.run()
    before = made.stations.services[1].neighbours[2].received_ms
    assert 900 < before < 1200 and made.stations.down == {2}


@pytest.mark.parametrize("scenario", [Ramps("merge", unit=False), Intersection()])
def test_who_has_passed_and_left_the_road_has_merged_or_turned(scenario: Any) -> None:
    mover = SimpleNamespace(bodies=dict, line=lambda route: STRAIGHT)
    for vehicles in (1, 8):  # of one, nobody turns or comes from the ramp
        users = scenario.users(TrafficSetting(vehicles=vehicles))
        of = SimpleNamespace(users={u.number: u for u in users}, mover=mover, drivers={})
        words = list(scenario.outcome(of).values())
        assert words[0] == words[1] == 2 * (vehicles > 1)


def test_the_way_is_not_asked_for_if_nobody_turns() -> None:
    def line(route: tuple[str, ...]) -> None:
        raise RuntimeError("SUMO has ended, and this route was never asked for")

    mover = SimpleNamespace(bodies=dict, line=line)
    found = Intersection().outcome(SimpleNamespace(users={}, mover=mover, drivers={}))  # type: ignore[arg-type]
    assert found["turn left"] == found["have turned"] == 0


def test_adv_9_a_cam_closes_the_window_as_in_any_service() -> None:
    made, _ = traffic(seed=3, vehicles=3, duration_s=2)
    asked: list[int] = []
    for service in made.stations.services.values():
        service._close_window = lambda answered, heard: bool(asked.append(len(heard)))
    made.clock.at(500, lambda: made.drivers[1].signal(1))  # type: ignore[attr-defined]
    made.run()
    cams = made.stations.services[1].statistics.received["CAM"]
    assert len(asked) > cams / 2 > 10


def test_a_road_side_unit_is_a_station_that_stands() -> None:
    made, _ = traffic(vehicles=2, duration_s=2)
    unit = LaneChange(replace(made.vehicles[1], station_id=99))
    made.add_road_side(99, 100.0, 5.0, unit)
    made.run()
    assert 99 in made.stations.services[1].neighbours


def test_a_control_drives_the_prescribed_speeds_within_its_limits() -> None:
    made, _ = traffic(vehicles=1, duration_s=1)
    vehicle = made.vehicles[1]
    vehicle.speed = 20.0
    times, xy = np.array([1.0, 2.0, 3.0]), np.array([(0.0, 0.0), (19.0, 0.0), (29.0, 0.0)])
    vehicle.follow(Trajectory(times, xy))
    found = [vehicle.set_speed(now_s) for now_s in (0.9, 1.0, 2.0, 3.0)]
    assert found[1:3] == pytest.approx([20.0 - 0.1, 20.0 - 0.2]) and found[0] is found[3] is None
    vehicle.speed = 5.0
    assert vehicle.set_speed(1.0) == pytest.approx(5.0 + 0.15)


# -- perception


def test_sight_ends_at_its_range_and_leaves_out_itself() -> None:
    users = {n: replace(CAR, number=n, length=4.0 + n) for n in (1, 2, 3)}
    sight = Sight(users, 100.0)
    sight.look(
        {
            1: Body(0, 0, 0, 20, 0),
            2: Body(99, 3.5, math.pi / 2, 10, 0),
            3: Body(101, 0, 0, 20, 0),
        }
    )
    (seen,) = sight.of(1)(np.zeros((3, 2)), 0, 0)
    assert (seen.x, seen.y, seen.length, seen.sigma) == (99, 3.5, 6.0, 0.0)
    assert abs(seen.vx) < 1e-9 and seen.vy == pytest.approx(10)
    assert sight.seen(9) == []


# -- measures


SIZE = np.array([(4.5, 1.8), (4.5, 1.8)])


@pytest.mark.parametrize(
    ("pose", "touch"),
    [
        ((4.4, 0.0, 0.0), True),
        ((4.6, 0.0, 0.0), False),
        ((0.0, 1.7, 0.0), True),
        ((0.0, 1.9, 0.0), False),
        ((3.1, 3.1, math.pi / 4), True),
        ((3.4, 3.4, math.pi / 4), False),
        ((3.1, 0.0, math.pi / 2), True),
        ((3.2, 0.0, math.pi / 2), False),
    ],
)
def test_rectangles_that_overlap(pose: tuple[float, float, float], touch: bool) -> None:
    poses = np.array([(0.0, 0.0, 0.0), pose])
    assert bool(overlaps(poses, SIZE)) is touch
    assert bool(overlaps(poses[::-1], SIZE)) is touch


def bodies(*rows: tuple[float, float, float, float]) -> Any:
    return np.array([Body(x, y, heading, speed, 0.0) for x, y, heading, speed in rows])


def test_time_to_collision_is_that_of_the_next_ahead_in_the_way() -> None:
    table = bodies((0, 0, 0, 20), (24.5, 0, 0, 10), (14.5, 3.5, 0, 1), (54.5, 0, 0, 0))
    size = np.array([(4.5, 1.8)] * 4)
    found = time_to_collision(table, size)
    assert found[0] == pytest.approx(2.0) and found[1] == pytest.approx(2.55)
    assert math.isinf(found[2]) and math.isinf(found[3])
    oncoming = time_to_collision(bodies((0, 0, 0, 20), (24.5, 0, math.pi, 10)), SIZE)
    assert np.isinf(oncoming).all(), "whoever comes towards it is not followed"


def test_a_collision_counts_once_and_names_its_cause() -> None:
    made, mover = traffic(vehicles=2, duration_s=2)
    users = list(made.users.values())
    first = mover._vehicles[users[0].number]
    made.measures._maneuver_ms.clear()

    def crash() -> None:
        other = mover._vehicles[users[1].number]
        other.s, other.d, other.lane, other.target_lane = first.s, first.d, 0, 0

    made.clock.at(950, crash)
    made.run()
    (one,) = made.record()["collisions"]["list"]
    assert one["users"] == [1, 2] and one["equipped"] == 2 and not one["maneuver"]
    assert made.record()["collisions"]["between_equipped"] == 1


@pytest.mark.parametrize(("brakes", "counted"), [(3.9, 0), (4.1, 1)])
def test_hard_braking_counts_once_over_half_a_second(brakes: float, counted: int) -> None:
    made, mover = traffic(vehicles=1, penetration=0, duration_s=4)
    vehicle = mover._vehicles[1]
    vehicle.desired = vehicle.speed = 22.0
    made.run()
    measures, now = made.measures, 4000
    for step in range(30):
        speed = 22.0 - brakes * max(0, step - 10) * 0.1
        measures.step(now + 100 * step, {1: Body(0, 0, 0, speed, -brakes)}, made)
    assert measures.hard_brakings["others"] == counted


# -- settings, frames, codec


def test_bad_settings_are_named() -> None:
    for wrong, name in (
        ({"vehicles": 0}, "vehicles"),
        ({"density": 0}, "density"),
        ({"penetration": 1.1}, "penetration"),
        ({"duration_s": 0}, "duration_s"),
    ):
        with pytest.raises(ValueError, match=f"^{name} must be"):
            TrafficSetting(**wrong)  # type: ignore[arg-type]
    with pytest.raises(ValueError, match="scenario must be one of"):
        TrafficRun(scenario="fly")
    with pytest.raises(ValueError, match="loss must be"):
        TrafficRun(scenario="lane-change", loss=2)
    with pytest.raises(ValueError, match="loss is a setting of the radio 'even'"):
        TrafficRun(scenario="lane-change", radio="table", loss=0.1)


def test_a_shared_codec_decodes_once_and_refuses_each_time() -> None:
    codec = SharedCodec(JSON)
    cam = Cam(src=1, generation_ms=1, x_mm=0, y_mm=0, heading_mrad=0, speed_mm_s=0, marks=())
    data = codec.encode(cam)
    assert codec.decode(data) == cam and codec.decode(data) is codec.decode(data)
    for _ in range(2):
        with pytest.raises(MessageError):
            codec.decode(b"{}")


def test_without_sumo_the_message_names_the_extra(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "sumo", None)
    with pytest.raises(TrafficError, match=r"pip install 'automcm\[sumo\]'"):
        TrafficRun(scenario="lane-change").drive()


def test_without_ns3_the_message_names_the_extra(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(extras, "find_spec", lambda name: None)
    with pytest.raises(TrafficError, match=r"pip install 'automcm\[radio\]'"):
        TrafficRun(scenario="lane-change", radio="ns3").drive()


def test_a_run_ends_ns3_also_after_an_error(monkeypatch: pytest.MonkeyPatch) -> None:
    """ns-3 has one simulator in a process."""
    seeds, closed = [], []

    class Ns3(EvenRadio):
        def __init__(self, seed: int) -> None:
            super().__init__(0.0, seed)
            seeds.append(seed)

        def close(self) -> None:
            closed.append(True)

    monkeypatch.setattr(traffic_run, "Ns3Radio", Ns3)
    monkeypatch.setitem(sys.modules, "sumo", None)
    with pytest.raises(TrafficError, match="SUMO is missing"):
        TrafficRun(scenario="lane-change", radio="ns3", setting=TrafficSetting(seed=6)).drive()
    assert (seeds, closed) == ([6], [True])
