"""Arrival times of a receiver: the clock, the two ways to drive, and the claims."""

from __future__ import annotations

import sys
from typing import Any

import pytest

from automcm.applications.lane_change import LaneChange
from automcm.applications.vehicle import LateBraking
from automcm_evaluation.arrival import arrival, arrival_tables, sumo
from automcm_evaluation.framework.experiment import ExperimentError
from automcm_simulation.road.drive import FourVehicles

Json = Any
USUAL: Json = arrival.ArrivalSetting().model_dump(mode="json")
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


def test_a_trial_is_driven_both_ways_from_the_same_start_and_again_the_same() -> None:
    cell = values("trials", block=0, trials=2)
    first = arrival.run(cell, 7)
    arrival.run(values("one", draws=1, name="notice", tried=[1.0]), 9)
    assert arrival.run(cell, 7) == first
    assert first["signal_m"] != arrival.run(cell, 8)["signal_m"]
    for which in ("with", "without"):
        driven = [
            arrival.drive(cell, draw, MODEL, coordinated=which == "with")["arrival_s"]
            for draw in zip(first["beside_m"], first["signal_m"], strict=True)
        ]
        assert driven == pytest.approx(first[which]["arrival_s"], abs=0.02)


def test_without_coordination_it_stops_and_with_it_hardly_brakes_at_the_lane_change() -> None:
    with_, without = (
        arrival.drive(values("trials"), (6.0, 50.0), MODEL, coordinated=coordinated)
        for coordinated in (True, False)
    )
    assert (with_["completed"], without["completed"]) == (1, 0)
    alone = arrival.drive(values("trials"), (5000.0, 50.0), MODEL, coordinated=True)
    assert alone["completed"] == 0
    assert without["stood_s"] >= MODEL["restart_s"] and without["slowest"] == 0
    assert with_["stood_s"] == 0 and with_["slowest"] > 50 / 3.6 - 20 / 3.6 - 0.5
    assert without["after"] >= 3 and with_["after"] < 0.5 < with_["hardest"]


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


def test_with_the_calibrated_baseline_the_paper_s_gains_come_out() -> None:
    settings = arrival.ArrivalSetting(draws=2, notices=(0.5,), sumo=False)
    assert settings.restart_gap == FourVehicles().late.restart_gap
    cells = [cell for cell in arrival.cells(settings) if cell.get("name") == "notice"]
    assert len(cells) == 2
    for cell in cells:
        gain, _ = arrival_tables.PAPER[cell["speed_kmh"]]
        assert arrival.run(cell, 1)["gain_s"] == [pytest.approx(gain, abs=0.5)]


@pytest.mark.parametrize(
    ("name", "less", "more"),
    [
        ("restart_gap", 30.0, 80.0),
        ("restart_s", 1.0, 5.0),
        ("brake", 8.0, 2.0),
        ("acceleration", 2.5, 1.0),
    ],
)
def test_each_parameter_of_the_baseline_matters(name: str, less: float, more: float) -> None:
    speed_kmh = 30 if name == "restart_gap" else 50
    cell = values("one", speed_kmh=speed_kmh, draws=1, name=name, tried=[less, more])
    least, most = arrival.run(cell, 1)["gain_s"]
    assert most > least + 1


def test_a_grid_is_of_the_gains_its_parameters_give_each() -> None:
    cell = values("grid", draws=1, brake=2.0, restart_gaps=[45.0, 80.0], restarts_s=[0.0, 5.0])
    (_, long_wait), (wide_gap, _) = arrival.run(cell, 1)["gain_s"]
    for changes, gain in (({"restart_s": 5.0}, long_wait), ({"restart_gap": 80.0}, wide_gap)):
        changed = MODEL | {"brake": 2.0, "restart_s": 0.0} | changes
        one = values("one", draws=1, name="notice", tried=[0.5]) | {"model": changed}
        assert arrival.run(one, 2)["gain_s"] == [gain]


def test_starts_spread_evenly_stay_within_their_ranges() -> None:
    starts = arrival.spread(PLACES, 40)
    beside, signal = ([start[n] for start in starts] for n in (0, 1))
    assert min(beside) >= 5 and max(beside) <= 7.5 and min(signal) >= 45 and max(signal) <= 55
    assert sum(beside) / 40 == pytest.approx(6.25) and sum(signal) / 40 == pytest.approx(50, abs=1)
    assert arrival.drawn(PLACES, 0, 1) == (5, 55)


def test_who_never_arrives_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(arrival, "TOO_LATE", 1)
    with pytest.raises(ExperimentError, match="does not arrive: 50 km/h"):
        arrival.drive(values("trials"), (6.0, 50.0), MODEL, coordinated=False)


def test_the_ways_of_the_two_readings_by_hand() -> None:
    """5 s are 15 % of 33.3 s, or 15 % of 33.3 s more than that."""
    found = arrival_tables.ways(30, 0.0)
    assert found["reduction"][0] == pytest.approx((100 / 3 - 5) / 3.6 * 30, abs=1e-3)
    assert found["ratio"][0] == pytest.approx(100 / 3 / 3.6 * 30, abs=1e-3)
    shorter = arrival_tables.ways(30, 2.4)
    for reading, (way, low, high) in found.items():
        assert low < way < high and way - shorter[reading][0] == pytest.approx(20)


# -- SUMO


def test_without_sumo_the_extra_is_named_before_anything_else_is_run(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setitem(sys.modules, "libsumo", None)
    cells = arrival.cells(arrival.ArrivalSetting(trials=2))
    assert [cell["part"] for cell in cells].index("trials") == 6
    with pytest.raises(ExperimentError, match=r"automcm\[sumo\]"):
        arrival.run(cells[0], 1)
    assert not any(c["part"] == "sumo" for c in arrival.cells(arrival.ArrivalSetting(sumo=False)))


def test_in_sumo_it_is_prescribed_when_it_is_with_us_and_the_lane_is_changed_then() -> None:
    drive = FourVehicles(vehicles=2, until_s=12).run()
    assert isinstance(drive.drivers[0], LaneChange)
    told = {what.split()[0]: t / 1000 for t, what in drive.drivers[0].story}
    assert told["prescribes"] - told["signals"] == pytest.approx(sumo.DECIDED_S, abs=0.1)
    trial = sumo.Trial(how="prescribed", speed=30 / 3.6, beside_m=5, signal_s=told["signals"])
    slower, moves_s = trial.slower()
    assert slower is not None and moves_s == pytest.approx(told["moves"], abs=0.2)
    assert min(slower.speeds()) == pytest.approx(10 / 3.6)


@pytest.mark.parametrize(
    ("name", "value"), [("brakes", []), ("brakes", [0]), ("restart_gap", 101), ("trials", 1)]
)
def test_a_setting_out_of_range_is_named(name: str, value: Json) -> None:
    with pytest.raises(ExperimentError, match=name):
        arrival.EXPERIMENT.set("quick", {name: value})
