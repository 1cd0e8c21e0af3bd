"""Arrival times of a receiver: the clock, the driver, and SUMO."""

from __future__ import annotations

from typing import Any

import pytest

from automcm.applications.lane_change import LaneChange
from automcm.applications.vehicle import LateBraking
from automcm_evaluation.arrival import arrival, arrival_tables, sumo
from automcm_simulation.road.drive import FourVehicles

Json = Any
USUAL: Json = arrival.Settings().model_dump(mode="json")
PLACES: Json = {name: USUAL[name] for name in arrival.PLACES}
MODEL: Json = {name: USUAL[name] for name in arrival.MODEL}


def values(part: str, **more: Json) -> Json:
    return {"part": part, "speed_kmh": 50, "places": PLACES, "model": MODEL} | more


@pytest.mark.parametrize("coordinated", [True, False])
def test_the_clock_runs_from_the_signal_to_the_target(coordinated: bool) -> None:
    """With nobody in the way the receiver drives on: way divided by speed."""
    driven = arrival.drive(values("trials"), (5000.0, 50.0), MODEL, coordinated=coordinated)
    assert driven["arrival_s"] == pytest.approx((260 - 50) / (50 / 3.6), abs=0.002)
    assert driven["hardest"] == 0 and driven["slowest"] == pytest.approx(50 / 3.6, abs=1e-3)
    later = arrival.drive(values("trials"), (5000.0, 20.0), MODEL, coordinated=coordinated)
    assert later["arrival_s"] == pytest.approx((260 - 20) / (50 / 3.6), abs=0.002)


def test_the_driver_is_the_same_with_and_without(monkeypatch: pytest.MonkeyPatch) -> None:
    """Also with coordination the receiver stops late if the gap is not open."""
    made: list[Json] = []
    on = FourVehicles.on
    monkeypatch.setattr(
        FourVehicles, "on", lambda *args, **more: made.append(on(*args, **more)) or made[-1]
    )
    for coordinated in (True, False):
        arrival.drive(values("trials"), (6.0, 50.0), MODEL, coordinated=coordinated, seed=3)
    (_, with_), (_, without) = ([d.vehicle for d in drive.drivers] for drive in made)
    assert (with_.late, with_.driving) == (without.late, without.driving)
    assert with_.late == LateBraking(**{n: MODEL[n] for n in MODEL if n != "acceleration"})


def test_the_ways_of_the_two_readings_by_hand() -> None:
    """5 s are 15 % of 33.3 s, or 15 % of 33.3 s more than that."""
    found = arrival_tables.ways(30, 0.0)
    assert found["reduction"][0] == pytest.approx((100 / 3 - 5) / 3.6 * 30, abs=1e-3)
    assert found["ratio"][0] == pytest.approx(100 / 3 / 3.6 * 30, abs=1e-3)
    shorter = arrival_tables.ways(30, 2.4)
    for reading, (way, low, high) in found.items():
        assert low < way < high and way - shorter[reading][0] == pytest.approx(20)


# -- SUMO


def test_in_sumo_it_is_prescribed_when_it_is_with_us_and_the_lane_is_changed_then() -> None:
    drive = FourVehicles(vehicles=2, until_s=12).run()
    assert isinstance(drive.drivers[0], LaneChange)
    told = {what.split()[0]: t / 1000 for t, what in drive.drivers[0].story}
    assert told["prescribes"] - told["signals"] == pytest.approx(sumo.DECIDED_S, abs=0.1)
    trial = sumo.Trial(how="prescribed", speed=30 / 3.6, beside_m=5, signal_s=told["signals"])
    slower, moves_s = trial.slower()
    assert slower is not None and moves_s == pytest.approx(told["moves"], abs=0.2)
    assert min(slower.speeds()) == pytest.approx(10 / 3.6)
