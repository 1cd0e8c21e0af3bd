"""A merge from a ramp looks at who is there (APP-1 to APP-5), and stops before the ramp's end."""

from __future__ import annotations

from typing import Any

import pytest
from road_stage import driven, said, stands

from automcm.applications.lane_change import WAIT_MS
from automcm.applications.occupancy import Seen
from automcm.applications.planning import planned
from automcm.applications.ramp_merge import Merge, Ramp
from automcm.applications.vehicle import LANE_WIDTH, Vehicle
from automcm.service.application import heard_by
from automcm_simulation.road.drive import SimulatedDrive
from automcm_simulation.road.occupancy_sweep import CamOnly, DoesNotSlow, sight


class Silent(CamOnly, Merge):
    """It sends CAMs and answers nothing."""


class Fast(DoesNotSlow, Merge):
    """It accepts, and does not slow down."""


def car(station_id: int, x: float, speed: float, lane: int = 1) -> Vehicle:
    return Vehicle(station_id, x, lane, speed, speed)


RAMP = Ramp(joins_m=120)


def ramp_car(ramp: Ramp = RAMP) -> Merge:
    return Merge(car(1, 0, 10, 0), ramp)


def waits(x: float) -> Merge:
    """Answers, and is not in the way."""
    return Merge(car(4, x, 10), RAMP)


def words_after(driver: Merge, first: str) -> list[str]:
    words = said(driver)
    return words[words.index(first) :]


@pytest.mark.parametrize("seen", [False, True])
def test_app_2_it_does_not_merge_beside_a_vehicle_that_did_not_answer(seen: bool) -> None:
    on_ramp, beside = ramp_car(), car(3, -2, 10)
    others: list[Any] = [] if seen else [Silent(beside, RAMP)]
    more = {"others": [beside]} if seen else {}
    on_ramp.occupied = sight(on_ramp.vehicle, [beside]) if seen else on_ramp.occupied
    drive_ = driven(on_ramp.signal, on_ramp, waits(-60), *others, until=60, **more)
    who = "a vehicle that is only seen" if seen else "3"
    assert said(on_ramp)[1:] == [f"gives up: {who} is in the way"]
    assert [t for _, station, t in drive_.sent if station == 1][-1] == "Cancel"
    stands(drive_, on_ramp)


def test_app_4_it_does_not_merge_before_a_target_that_does_not_slow() -> None:
    on_ramp, target = ramp_car(), Fast(car(3, -2, 10), RAMP)
    drive_ = driven(on_ramp.signal, on_ramp, target, until=60)
    assert said(on_ramp)[-2:] == ["is accepted, and waits for the gap", "gives up: 3 is in the way"]
    assert said(target)[-1] == "drives alone: abort"
    gave_up, begins = on_ramp.story[-1][0], 12_000
    assert begins + WAIT_MS <= gave_up <= begins + WAIT_MS + 200
    stands(drive_, on_ramp)


@pytest.mark.parametrize(("after_ms", "lane"), [(500, 0), (2900, 0), (3200, 1)])
def test_app_5_it_returns_to_the_ramp_and_stops_or_completes(after_ms: int, lane: int) -> None:
    on_ramp, target = ramp_car(), Merge(car(3, -2, 10), RAMP)
    drive_ = SimulatedDrive([on_ramp, target])
    vehicle, clock, seen = on_ramp.vehicle, drive_.simulation.clock, list[Seen]()
    on_ramp.occupied = lambda region, t0, t1: seen

    def begun() -> None:
        appears = lambda: seen.append(Seen(x=vehicle.x - 1, y=LANE_WIDTH, vx=10))  # noqa: E731
        later = clock.now() + after_ms
        clock.at(*((later, appears) if vehicle.changing else (clock.now() + 100, begun)))

    clock.at(100, on_ramp.signal)
    clock.at(100, begun)
    drive_.run(60)
    if lane == 0:
        assert words_after(on_ramp, "moves over")[1:] == [
            "returns: a vehicle that is only seen is in the way"
        ]
        stands(drive_, on_ramp)
    else:
        assert said(on_ramp)[-1] == "has changed lanes" and vehicle.lane == lane


def test_a_ramp_that_is_too_short_to_return_to_is_not_left() -> None:
    on_ramp = ramp_car(Ramp(joins_m=120, length_m=40))
    drive_ = driven(on_ramp.signal, on_ramp, waits(-90), until=60)
    assert said(on_ramp)[-1] == "gives up: the ramp ends"
    stands(drive_, on_ramp)


def test_app_2_who_comes_earlier_but_is_not_clear_is_asked() -> None:
    on_ramp, slower = ramp_car(), Merge(car(2, 30, 9), RAMP)
    drive_ = driven(on_ramp.signal, on_ramp, slower, until=4)
    assert "Prescription" in [t for _, station, t in drive_.sent if station == 1]


def test_app_2_who_comes_later_but_is_not_clear_is_not_asked_to_come_earlier() -> None:
    on_ramp, faster = ramp_car(), Merge(car(2, -90, 14), RAMP)
    drive_ = driven(on_ramp.signal, on_ramp, faster, until=4)
    assert "Prescription" not in [t for _, station, t in drive_.sent if station == 1]
    assert said(on_ramp)[-1] == "gives up: 2 is in the way"


def test_app_3_an_answer_does_not_count_after_proceed() -> None:
    on_ramp = ramp_car()
    drive_ = driven(on_ramp.signal, on_ramp, waits(-90), until=10)
    known = on_ramp._known(heard_by(on_ramp.service), None)
    assert [track.answered for track in known or ()] == [False]
    assert said(on_ramp)[-1] == "nobody is in the way" and on_ramp.vehicle.lane == 0
    drive_.run(25)
    assert on_ramp.vehicle.lane == 1


def test_a_vehicle_that_has_merged_may_be_asked_to_slow_down() -> None:
    """Its own ramp no longer matters."""
    on_ramp = ramp_car()
    drive_ = driven(on_ramp.signal, on_ramp, waits(-90), until=25)
    asked = planned(on_ramp.vehicle, 25_000)
    on_ramp.vehicle.follow(asked)
    drive_.run(40)
    assert on_ramp.vehicle._profile is asked
    assert on_ramp.vehicle.x > RAMP.joins_m + RAMP.length_m


def test_it_does_not_merge_before_the_ramp_joins_even_if_it_is_late() -> None:
    on_ramp = ramp_car()
    drive_ = SimulatedDrive([on_ramp, waits(-90)])
    drive_.simulation.clock.at(100, on_ramp.signal)
    drive_.simulation.clock.at(4000, lambda: setattr(on_ramp.vehicle, "desired", 9))
    drive_.run(25)
    assert said(on_ramp)[-1] == "has changed lanes"
    assert next(s.x for s in drive_.road.of(1) if s.y > 0) > RAMP.joins_m


def test_it_does_not_brake_for_the_end_of_the_ramp_while_it_moves_over() -> None:
    on_ramp = ramp_car(Ramp(joins_m=120, length_m=66))
    drive_ = driven(on_ramp.signal, on_ramp, waits(-90), until=25)
    assert on_ramp.vehicle.lane == 1
    assert min(sample.speed for sample in drive_.road.of(1)) == pytest.approx(10)
