"""Yielding at a place, on the unchanged service."""

from __future__ import annotations

from pathlib import Path

import pytest
from road_stage import answers_of, driven, rows

from automcm.applications.occupancy import Seen
from automcm.applications.vehicle import STRAIGHT, Vehicle
from automcm.service.application import Advertised, Proposal
from automcm_simulation.road.drive import SimulatedDrive
from automcm_simulation.traffic.traffic_scenario import TrafficSetting
from automcm_simulation.traffic_scenarios.intersection_traffic import (
    APART_S,
    LINE,
    PLACE,
    REACH_M,
    LeftTurn,
)
from automcm_simulation.traffic_scenarios.traffic_run import TrafficRun
from automcm_simulation.traffic_scenarios.yielding import PATIENCE_MS, Yielding, arriving
from automcm_spec.vocabulary import messages
from automcm_traces.explain.explain import verdicts_of

X_M = 150.0


class Asks(Yielding):
    """Stands beside the road and asks for the window from ``begins`` to ``ends``, ms."""

    def __init__(self, begins: int, ends: int) -> None:
        beside = Vehicle(1, X_M, 3, 0.0, 0.1)
        super().__init__(beside, "test", (X_M, 0.0))
        self.window = begins, ends

    def _wanted(self, now_ms: int) -> tuple[int, int] | None:
        return self.window if now_ms < self.window[1] else None


def car(number: int, x: float, speed: float = 10.0) -> Yielding:
    return Yielding(Vehicle(number, x, 0, speed, speed), "test", (X_M, 0.0))


def passes_s(drive: SimulatedDrive, number: int) -> float:
    return min(s.t for s in drive.road.of(number) if s.x + 2.25 >= X_M)


def test_the_first_in_the_window_arrives_later_and_the_others_follow(tmp_path: Path) -> None:
    unit, before, first, second = Asks(11_000, 20_000), car(2, 60), car(3, 20), car(4, 0)
    drive = driven(lambda: None, unit, before, first, second, until=35, logs=tmp_path)
    assert passes_s(drive, 2) < 10 and 19.5 <= passes_s(drive, 3) < 24 < 35
    assert "yields" in [what for _, what in first.story]
    assert first.ended == ["finished"] and first.vehicle.speed > 9
    assert min(s.acceleration for s in drive.road.of(3)) > -2.01
    verdicts = verdicts_of(sorted(tmp_path.glob("*.ndjson")))
    assert [verdict.verdict for verdict in verdicts] == ["allowed"] * 4


@pytest.mark.parametrize(
    "prescribed",
    [
        rows((0, -150_000, 0)),
        rows((0, -147_750, 0), (15_000, 0, 1)),
        rows((0, 147_750, 0), (15_000, 0, 0)),
        rows((0, -147_750, 0), (0, 0, 0)),
        arriving(0, 130.0, 15_000),
        arriving(0, 147.75, PATIENCE_MS + 1),
    ],
)
def test_another_form_another_way_or_too_long_is_refused(prescribed: messages.Trajectory) -> None:
    driver = car(2, 0)
    answers = answers_of(driver)
    told = Advertised((1, 1), "test", {"x_mm": round(X_M * 1000), "y_mm": 0}, None)
    assert driver.concerned(told) == arriving(0, 147.75, 14_775)
    driver.verify(Proposal((1, 1), 1, prescribed, 0, 1000))
    driver.verify(Proposal((1, 1), 1, arriving(0, 147.75, PATIENCE_MS), 0, 1000))
    driver.vehicle.s = X_M - 10
    driver.verify(Proposal((1, 1), 1, arriving(0, 7.75, 5000), 0, 1000))
    assert answers == ["refuse", "accept", "refuse"]


def test_who_cannot_stop_before_the_place_or_does_not_pass_it_does_not_answer() -> None:
    for driver in (car(2, X_M - 20), car(3, X_M + 5)):
        answers_of(driver)
        told = Advertised((1, 1), "test", {"x_mm": round(X_M * 1000), "y_mm": 0}, None)
        assert driver.concerned(told) is None
    driver = car(2, 0)
    answers_of(driver)
    wrong: tuple[dict[str, messages.Plain], ...] = (
        {"x_mm": 150_000, "y_mm": 9000},
        {"x_mm": "150000", "y_mm": 0},
        {},
    )
    for details in wrong:
        assert driver.concerned(Advertised((1, 1), "test", details, None)) is None


def test_a_left_turn_waits_for_whoever_comes_and_not_for_who_has_passed() -> None:
    """Two lines, one car on each: the turn is free only if the other cannot be there in time."""
    at = float(LINE.project([PLACE]).s[0])
    found = []
    for s in (at - 150, at - 60, at - 10, at + 2 * REACH_M + 6):
        other = Vehicle(2, s, 0, 12.0, 12.0, line=LINE)
        v = Vehicle(1, PLACE[0] - 30, 0, 5.0, 12.0)
        v.line = type(STRAIGHT)([(0.0, PLACE[1]), (1.0, PLACE[1])])
        seen = [Seen(x=other.x, y=other.y, vx=-12.0, sigma=0.0)]
        driver = LeftTurn(v, True, lambda region, t0, t1, seen=seen: seen)  # type: ignore[misc]
        answers_of(driver)
        found.append(driver._free(8.0))
    assert found == [True, False, False, True]


@pytest.mark.parametrize(("speed", "goes"), [(0.2, False), (0.2, True), (2.0, False), (2.0, True)])
def test_a_left_turn_that_crept_over_its_line_still_waits(speed: float, goes: bool) -> None:
    """The sweep's run 268: it crept 1 m too far, and went although another car was near."""
    v = Vehicle(1, PLACE[0] - (REACH_M - 1.1) - 2.25, 0, speed, 12.0)
    v.line = type(STRAIGHT)([(0.0, PLACE[1]), (1.0, PLACE[1])])
    near = [Seen(x=PLACE[0] + 10, y=PLACE[1], vx=-12.0, sigma=0.0)]
    driver = LeftTurn(v, True, lambda region, t0, t1: near)
    answers_of(driver)
    driver._goes = goes
    held = driver._held(0)
    assert held is None if goes else held == pytest.approx(-1.1)


@pytest.mark.parametrize(("until_ms", "goes"), [(8_000, False), (15_000, True)])
def test_a_target_is_in_the_conflict_before_it_arrives_at_the_place(
    until_ms: int, goes: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It drives evenly: 10 m from the place, it is in the conflict at 55 % of its time."""
    v = Vehicle(1, PLACE[0] - 10.5, 0, 0.0, 12.0)
    v.line = type(STRAIGHT)([(0.0, PLACE[1]), (1.0, PLACE[1])])
    seen = [
        Seen(x=PLACE[0] + x + 2.25, y=PLACE[1], vx=-2.0, sigma=0.0, length=4.5, station_id=2)
        for x in (0.0, 10.0)
    ]
    driver = LeftTurn(v, True, lambda region, t0, t1: seen[-1:])
    answers_of(driver)
    driver.target = 2
    monkeypatch.setattr(driver, "promised_ms", lambda: until_ms)
    assert 0.55 * 8 < driver._through_s(8.25, 0.0) + APART_S < 0.55 * 15
    assert driver._free(8.25) is goes
    seen.pop()
    assert not driver._free(8.25), "it has arrived at the place"
    until = driver._until((0, until_ms), 0, 10.0)
    assert until * (10.0 - REACH_M) / 10.0 == pytest.approx(until_ms, abs=1)


@pytest.mark.parametrize(
    ("name", "setting"),
    [
        ("lane-change", TrafficSetting(vehicles=300, density=20)),
        ("merge", TrafficSetting(vehicles=500)),
        ("crossing", TrafficSetting(vehicles=300)),
    ],
)
def test_more_vehicles_than_the_road_has_room_for_are_refused(
    name: str, setting: TrafficSetting
) -> None:
    with pytest.raises(ValueError, match=r"^vehicles: .* (the road has 12 km|have no room for)"):
        TrafficRun(scenario=name, setting=setting)
