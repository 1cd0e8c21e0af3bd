"""A lane is free if everybody known is clear of it: APP-1 to APP-5."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from road_stage import Records, answers_of, car, driven, said

from automcm.applications import occupancy
from automcm.applications.lane_change import (
    FRESH_MS,
    NO_RETURN_M,
    WAIT_MS,
    LaneChange,
    PaperLaneChange,
    Plan,
)
from automcm.applications.occupancy import FORCED, LEAST_M, Seen, clear, needed_gap
from automcm.applications.planning import planned
from automcm.applications.vehicle import LANE_WIDTH, STRAIGHT, Driving, Vehicle, idm
from automcm.service.application import Advertised, Choice, Heard
from automcm_simulation.road.drive import SimulatedDrive
from automcm_simulation.road.occupancy_sweep import KINDS, bends, drive, sight
from automcm_simulation.road.sweep_drivers import PERCEPTION, Binder, CamOnly, WithoutLengths
from automcm_spec.vocabulary.messages import Trajectory

OWN = Seen(x=0.0, y=-LANE_WIDTH, vx=10.0)
LANE = STRAIGHT.parallel(LANE_WIDTH)


# -- APP-1


def test_app_1_a_choice_names_everybody_heard_whether_they_answered_or_not() -> None:
    prescriber, silent = Records(car(1, 0, 0)), CamOnly(car(3, -3))
    bound, binder = LaneChange(car(2, -60)), Binder(car(9, -300, 7), 2)
    drive_ = SimulatedDrive([prescriber, silent, bound, binder, LaneChange(car(4, -90))])
    drive_.simulation.clock.at(100, binder.ask)
    drive_.simulation.clock.at(4000, lambda: prescriber.signal(1))
    drive_.run(7)
    choice = prescriber.asked
    assert choice.heard is not None and set(choice.planned) == {4}
    assert {h.station_id for h in choice.heard} == {2, 3, 4, 9}
    assert {h.station_id for h in choice.heard if h.bound_elsewhere(choice.session)} == {2, 9}
    at = next(h for h in choice.heard if h.station_id == 3)
    assert at.speed_mm_s == 8330 and at.y_mm == 3500 and 6000 <= at.received_ms <= 6100


def test_app_1_of_two_that_are_seen_there_the_nearer_is_the_station() -> None:
    heard = Heard(3, 1000, 0, 3500, 0, 10_000)
    seen = [Seen(x=x, y=3.5, vx=10.0) for x in (-4.5, 2.0, -4.0)]
    found = occupancy.tracks([heard], seen, [3], (1, 1), 1000, LANE)
    assert [(t.x, t.station_id) for t in found] == [(2.0, 3), (-4.5, 0), (-4.0, 0)]


def test_kin_3_a_lorry_is_in_the_way_where_the_paper_s_threshold_sees_nobody() -> None:
    """2 m of it would be abreast."""
    prescriber, paper = LaneChange(car(1, 0, 0)), PaperLaneChange(car(1, 0, 0))
    mine, theirs = planned(car(1, 0, 1), 0), planned(car(3, -8.5, 1), 0)
    heard = Heard(3, 0, -8500, 3500, 0, 8330, length_mm=16_500, width_mm=2500)
    assert prescriber._too_close(mine, theirs, heard)
    assert not prescriber._too_close(mine, theirs, replace(heard, length_mm=None))
    assert not paper._too_close(mine, theirs, heard)


def test_app_2_it_requests_again_as_often_as_planned() -> None:
    prescriber, silent = LaneChange(car(1, 0, 0), Plan(retries=2, retry_s=3)), CamOnly(car(3, -3))
    driven(lambda: prescriber.signal(1), prescriber, silent, until=30)
    asked = [t for t, what in prescriber.story if what == "signals for lane 1"]
    assert len(asked) == 3 and not prescriber.busy
    assert all(later - before > 3000 for before, later in pairwise(asked))


def test_app_1_without_cams_it_aborts() -> None:
    driver = LaneChange(car(1, 0, 0))
    given = answers_of(driver)
    driver.wanted = 1
    driver.choose(Choice((1, 1), 1, {}))
    assert given == ["abort"] and said(driver)[-1] == "gives up: " + (
        "no CAMs: its surroundings are unknown"
    )


def test_app_1_what_is_seen_where_a_station_is_heard_is_that_station() -> None:
    heard = Heard(3, 900, 0, 3500, 0, 10_000)
    near, far = Seen(x=3.0, y=3.5, vx=9.0), Seen(x=20.0, y=3.5, vx=9.0)
    fused, other = occupancy.tracks([heard], [near, far], [3], (1, 1), 1000, LANE)
    assert (fused.station_id, fused.answered, fused.x, fused.vx) == (3, True, 3.0, 9.0)
    assert (other.x, other.y, other.seen, other.answered) == (20.0, 0.0, True, False)
    (alone,) = occupancy.tracks([heard], [], [], (1, 1), 1000, LANE)
    assert alone.x == pytest.approx(1.0) and not alone.answered


def test_app_1_tracks_are_along_the_lane_and_on_its_own_metres() -> None:
    line = bends(100.0, True, 300).parallel(LANE_WIDTH)
    x, y, heading = line.pose(60.0, -LANE_WIDTH)
    vx, vy = 10 * np.cos(heading), 10 * np.sin(heading)
    (track,) = occupancy.on_line([Seen(x=x, y=y, vx=vx, vy=vy)], line)
    assert (track.x, track.y) == pytest.approx((60.0, -LANE_WIDTH))
    assert (
        track.vx == pytest.approx(10 * (100 - LANE_WIDTH) / 100, rel=1e-3) and abs(track.vy) < 1e-9
    )


# -- APP-3


@pytest.mark.parametrize("rear", [0.0, 5.0, 14.0, 25.0, 36.0])
@pytest.mark.parametrize("faster", [0.0, 2.0, 6.0])
def test_app_3_at_the_needed_gap_the_simulated_driver_brakes_as_hard_as_allowed(
    rear: float, faster: float
) -> None:
    front = max(0.0, rear - faster)
    gap = needed_gap(rear, front)
    braking = -idm(gap, rear, front, max(rear, 0.1), Driving())
    assert gap >= LEAST_M
    assert braking == pytest.approx(FORCED) if gap > LEAST_M else braking <= FORCED
    assert needed_gap(rear, rear + 5) == needed_gap(rear, rear)


def test_app_3_clear_is_from_begin_to_end_with_the_margin() -> None:
    least = needed_gap(10, 10) + OWN.length
    ahead = Seen(x=least + 0.01, y=3.5, vx=10.0, answered=True)
    assert clear(OWN, ahead, 0, 4) and not clear(OWN, replace(ahead, x=least - 0.01), 0, 4)
    assert not clear(OWN, replace(ahead, answered=False), 0, 4)
    assert clear(OWN, replace(ahead, x=least + 5.01, answered=False), 0, 4)
    assert not clear(OWN, replace(ahead, x=least + 5.01, answered=False, age_s=1.0), 0, 4)
    assert not clear(OWN, replace(ahead, x=-least - 1.0), 0, 4), "a CAM is older than it says"
    assert clear(OWN, replace(ahead, x=-least - 1.6), 0, 4)
    assert not clear(OWN, replace(ahead, x=60.0, vx=-10.0), 0, 4), "slow and ahead"
    assert not clear(OWN, replace(ahead, x=-100.0, vx=60.0), 0, 4), "passes meanwhile"


def test_app_2_a_vehicle_is_in_a_lane_that_its_side_touches() -> None:
    assert occupancy.in_lane(OWN, Seen(x=0, y=0, vx=10))
    assert occupancy.in_lane(OWN, Seen(x=0, y=LANE_WIDTH / 2 + 0.8, vx=10))
    assert not occupancy.in_lane(OWN, Seen(x=0, y=LANE_WIDTH / 2 + 1.0, vx=10))
    assert occupancy.in_lane(OWN, Seen(x=0, y=LANE_WIDTH / 2 + 1.0, vx=10, width=2.5))
    assert occupancy.in_lane(OWN, Seen(x=0, y=LANE_WIDTH / 2 + 1.0, vx=10, sigma=0.1))
    assert not occupancy.in_lane(OWN, Seen(x=0, y=LANE_WIDTH, vx=10))
    assert occupancy.in_lane(OWN, Seen(x=0, y=LANE_WIDTH, vx=10, vy=-1.0))


# -- APP-2, APP-4, APP-5 on the road

HARM = [
    ("bound elsewhere", "CAMs", 1, None),
    ("CAM only", "CAMs", 1, None),
    ("seen only", PERCEPTION, 1, None),
    ("answers", "lengths", 146, 0.0),
    ("seen only", "sigma", 1044, 2.0),
    ("CAM only", "curvature", 7, None),
    ("does not slow", "look before", 2, None),
    ("cuts in", "look while", 9, None),
]
"""What B does, the mechanism, the first seed to try, and the error of positions."""


@pytest.mark.sweep(2)
@pytest.mark.parametrize(("kind", "mechanism", "first", "sigma"), HARM)
def test_app_2_app_4_app_5_each_mechanism_is_needed(
    kind: str, mechanism: str, first: int, sigma: float | None
) -> None:
    seeds = range(first, first + 60)
    bad = next(seed for seed in seeds if drive(seed, mechanism, kind, sigma).bad)
    assert not drive(bad, "", kind, sigma).bad


@pytest.mark.slow
def test_app_2_a_small_sweep_has_no_bad_drive() -> None:
    drives = [drive(seed) for seed in range(20)]
    assert {each.kind for each in drives} == set(KINDS)
    assert not [each for each in drives if each.bad] and any(each.changed for each in drives)


def pair(**more: Any) -> tuple[LaneChange, LaneChange, SimulatedDrive]:
    prescriber, target = LaneChange(car(1, 0, 0)), LaneChange(car(3, -3))
    return prescriber, target, SimulatedDrive([prescriber, target], **more)


def moved_over_ms(driver: LaneChange) -> int:
    return next(t for t, what in driver.story if what == "moves over")


def test_app_2_a_vehicle_ahead_of_the_target_that_did_not_answer_ends_the_request() -> None:
    prescriber, target, between = LaneChange(car(1, 0, 0)), LaneChange(car(3, -3)), car(2, 9)
    drive_ = SimulatedDrive([prescriber, target, CamOnly(between)])
    drive_.simulation.clock.at(1000, lambda: prescriber.signal(1))
    drive_.run(8)
    assert said(prescriber)[1:] == ["would come too close to [3]", "gives up: 2 is in the way"]
    assert said(target) == ["drives alone: abort"]


class ClockAhead(LaneChange):
    """Its clock is half a second ahead."""

    def concerned(self, advertised: Advertised) -> Trajectory | None:
        planned = super().concerned(advertised)
        return planned and planned.model_copy(update={"t0": planned.t0 + 500})


@pytest.mark.parametrize(("driver", "x"), [(LaneChange, -10.0), (ClockAhead, -3.0)])
def test_app_3_who_answered_is_asked_if_the_gap_to_its_cam_is_too_small(
    driver: type[LaneChange], x: float
) -> None:
    prescriber = LaneChange(Vehicle(1, 0, 0, 16, 16))
    target = driver(Vehicle(3, x, 1, 16, 16))
    drive_ = driven(lambda: prescriber.signal(1), prescriber, target, until=4)
    assert "would come too close to [3]" in said(prescriber)
    assert [t for _, _, t in drive_.sent if t == "Prescription"]


@pytest.mark.slow
def test_app_2_nobody_follows_a_target_that_has_overtaken() -> None:
    """In this drive the target accepts, does not slow and is ahead when the time has come."""
    assert not drive(6428).bad


def moved_over_by_default_ms() -> int:
    prescriber, _, drive_ = pair()
    drive_.simulation.clock.at(1000, lambda: prescriber.signal(1))
    drive_.run(12)
    return moved_over_ms(prescriber)


def test_app_4_it_does_not_move_over_without_a_fresh_cam_that_names_the_session() -> None:
    due_ms = moved_over_by_default_ms()
    prescriber, _, drive_ = pair()
    clock, radio = drive_.simulation.clock, drive_.simulation.radio
    clock.at(1000, lambda: prescriber.signal(1))
    clock.at(due_ms - FRESH_MS - 150, lambda: radio.cut(3, 1))
    clock.at(due_ms + 650, radio.mend)
    drive_.run(16)
    assert due_ms + 650 < moved_over_ms(prescriber) < due_ms + 1000
    assert said(prescriber)[-1] == "has changed lanes"
    prescriber, _, drive_ = pair()
    drive_.simulation.clock.at(1000, lambda: prescriber.signal(1))
    drive_.simulation.restart(3, due_ms - 250)
    drive_.run(16)
    assert "moves over" not in said(prescriber)
    assert said(prescriber)[-1] == "drives alone: cam_loss"


def test_app_4_a_gap_that_does_not_open_is_given_up_within_the_lease() -> None:
    prescriber, target, drive_ = pair()
    drive_.simulation.clock.at(1000, lambda: prescriber.signal(1))
    target.vehicle.follow = lambda trajectory: None  # type: ignore[method-assign]
    drive_.run(25)
    assert "moves over" not in said(prescriber) and prescriber.wanted is None
    (t, what) = prescriber.story[-1]
    assert what == "gives up: 3 is in the way" and said(target)[-1] == "drives alone: abort"
    accepted = next(t for t, what in prescriber.story if "is accepted" in what)
    assert WAIT_MS < t - accepted < WAIT_MS + 8000


@pytest.mark.parametrize(("after_ms", "lane"), [(500, 0), (2900, 0), (3200, 1)])
def test_app_5_it_returns_before_the_point_of_no_return_and_completes_after_it(
    after_ms: int, lane: int
) -> None:
    prescriber, target, drive_ = pair()
    vehicle, clock = prescriber.vehicle, drive_.simulation.clock
    seen: list[Seen] = []
    prescriber.occupied = lambda region, t0, t1: seen
    moved = []

    def appears() -> None:
        moved.append(vehicle.moved_m)
        seen.append(Seen(x=vehicle.x - 1, y=LANE_WIDTH, vx=vehicle.speed))

    def begun() -> None:
        later = clock.now() + after_ms
        clock.at(*((later, appears) if vehicle.changing else (clock.now() + 100, begun)))

    clock.at(1000, lambda: prescriber.signal(1))
    clock.at(1000, begun)
    drive_.run(25)
    assert (moved[0] < NO_RETURN_M) == (lane == 0)
    assert vehicle.lane == lane and vehicle.y == lane * LANE_WIDTH and not vehicle.changing
    returns = [what for what in said(prescriber) if what.startswith("returns")]
    assert returns == (["returns: a vehicle that is only seen is in the way"] if not lane else [])
    assert said(target)[-1] == ("is done" if lane else "drives alone: abort")


def test_app_5_the_way_back_is_the_way_there() -> None:
    drive_ = driven(lambda: None, changer := LaneChange(car(1, 0, 0)), until=0.1)
    v, road = changer.vehicle, drive_.road
    v.change_lane(1, road.t)
    for _ in range(15):
        road.step()
    there = v.y
    v.turn_back(road.t)
    assert v.changing and v.lanes == {0, 1} and v.y == there
    for _ in range(15):
        assert v.changing
        road.step()
        assert v.y < there
    assert not v.changing and v.lane == 0 and v.y == 0.0


# -- extents, errors and bends

LORRY_M = 16.5


def beside_a_lorry(driver: type[LaneChange], behind: float) -> tuple[LaneChange, SimulatedDrive]:
    prescriber = driver(car(1, 0, 0))
    lorry = Vehicle(3, -behind, 1, 8.33, 8.33, LORRY_M)
    drive_ = SimulatedDrive([prescriber, LaneChange(lorry)])
    prescriber.occupied = sight(prescriber.vehicle, drive_.road.vehicles)
    drive_.simulation.clock.at(100, lambda: prescriber.signal(1))
    drive_.run(20)
    return prescriber, drive_


@pytest.mark.parametrize("behind", [-6.0, 0.0, 2.0])
def test_app_3_it_does_not_begin_beside_a_lorry(behind: float) -> None:
    rooms = []
    for driver in (LaneChange, WithoutLengths):
        prescriber, drive_ = beside_a_lorry(driver, behind)
        begin_s = moved_over_ms(prescriber) / 1000
        v, lorry = ({s.t: s for s in drive_.road.of(n)}[begin_s] for n in (1, 3))
        rooms.append(v.x - lorry.x - (LORRY_M + 4.5) / 2 - needed_gap(lorry.speed, v.speed))
    assert rooms[0] >= 0 > rooms[1]


def test_app_3_stated_errors_widen_the_margin() -> None:
    own, other = replace(OWN, sigma=1.0), replace(OWN, x=30.0, sigma=0.5)
    assert occupancy.margin(own, replace(other, answered=True), 0) == 3 * (1 + 0.25) ** 0.5
    assert occupancy.margin(own, replace(other, seen=True), 0) == 1.5
    assert occupancy.margin(OWN, replace(other, sigma=None), 0) == occupancy.ERROR_M
    aside = Seen(x=0, y=LANE_WIDTH, vx=10, sigma=0.0)
    assert occupancy.in_lane(own, replace(aside, seen=True)), "the lane is in the map"
    assert not occupancy.in_lane(own, aside)


def test_app_1_where_a_place_is_unknown_nothing_is_clear() -> None:
    nowhere = Seen(x=float("nan"), y=float("nan"), vx=10)
    assert occupancy.in_lane(OWN, nowhere) and not clear(OWN, nowhere, 0, 4)
    off = LaneChange(Vehicle(1, 0, -40, 8, 8))
    given = answers_of(off)
    off.wanted = 1
    off.choose(Choice((1, 1), 1, {}, heard=()))
    assert given == ["abort"] and said(off)[-1] == "gives up: its own place on the road is unknown"


@pytest.mark.sweep(2)
@pytest.mark.parametrize("left", [False, True])
@pytest.mark.parametrize("radius", [100.0, 300.0, 1450.0])
def test_app_1_on_a_bend_the_gap_is_along_the_lane(radius: float, left: bool) -> None:
    line = bends(radius, left, 900)
    vehicles = [Vehicle(n, s, n > 1, 12, 12, line=line) for n, s in ((1, 100), (2, 122), (3, 97))]
    drivers = [LaneChange(v) for v in vehicles]
    drive_ = driven(lambda: drivers[0].signal(1), *drivers, until=25)
    assert "is accepted, and waits for the gap" in said(drivers[0])
    assert vehicles[0].lane == 1 and max(-s.acceleration for s in drive_.road.samples) < 3


class Nobody(CamOnly):
    """Sends CAMs; takes no part."""


@pytest.mark.parametrize(
    ("x", "speed", "reason"), [(-3 + 6.4, 8.33, "leader_gap"), (-3 - 6.4, 8.33, "follower_gap")]
)
def test_kin_6_a_receiver_knows_who_is_ahead_and_behind(
    x: float, speed: float, reason: str
) -> None:
    prescriber, receiver = PaperLaneChange(car(1, 0, 0)), LaneChange(car(3, -3))
    other = Nobody(Vehicle(2, x, 1, speed, speed, driving=Driving(hardest=0)))
    receiver.vehicle.driving = Driving(hardest=0)
    drive_ = driven(lambda: prescriber.signal(1), prescriber, receiver, other, until=4)
    assert drive_ and f"refuses: {reason}" in said(receiver)
