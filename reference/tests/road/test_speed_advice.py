"""Speed advice on the unchanged service."""

from __future__ import annotations

import pytest
from road_stage import answers_of, driven, rows

from automcm.applications.occupancy import FORCED, LEAST_M
from automcm.applications.vehicle import LANE_WIDTH, Driving, Vehicle
from automcm.service.application import Proposal
from automcm_simulation.road.speed_advice import SpeedAdvice
from automcm_spec.vocabulary import messages


def test_a_driver_says_where_it_is_and_notes_what_was_refused() -> None:
    driver = SpeedAdvice(Vehicle(2, 7, 1, 9, 9))
    at = driver.kinematics(0)
    assert (at.x_mm, at.y_mm, at.speed_mm_s) == (7000, round(1000 * LANE_WIDTH), 9000)
    assert (at.length_mm, at.width_mm) == (4500, 1800)
    driver.refused("request", "END-7")
    assert driver.ended == ["request END-7"]


def test_speed_advice_reaches_the_fastest_and_is_taken_back() -> None:
    works = SpeedAdvice(Vehicle(1, 300, 0, 0, 0.1), advice_mm_s=6000)
    slow, fast = SpeedAdvice(Vehicle(2, 0, 0, 8, 8)), SpeedAdvice(Vehicle(3, 0, 1, 14, 14))
    drive = driven(works.signal, works, slow, fast, until=7)
    assert fast.vehicle.speed == pytest.approx(6, abs=0.6)
    drive.run(30)
    assert (slow.ended, fast.ended) == (["not_selected"], ["finished"])
    assert fast.vehicle.speed > 13 and min(s.speed for s in drive.road.of(2)) > 7


def test_speed_advice_too_slow_is_answered_by_a_milder_one() -> None:
    works = SpeedAdvice(Vehicle(1, 300, 0, 0, 0.1), advice_mm_s=1000)
    other = SpeedAdvice(Vehicle(2, 0, 0, 10, 10))
    driven(works.signal, works, other, until=6)
    assert other.vehicle.speed == pytest.approx(5.5, abs=0.2)


@pytest.mark.parametrize(
    "prescribed",
    [
        rows((0, 0, 0), (1000, 10**12, 0)),
        rows((0, 0, 0), (1000, 9001, 0)),
        rows((0, 0, 0), (999, 6000, 0)),
        rows((1000, 6000, 0), (0, 0, 0)),
        rows((0, 6000, 0)),
    ],
)
def test_speed_advice_nonsense_or_faster_is_refused(prescribed: messages.Trajectory) -> None:
    driver = SpeedAdvice(Vehicle(2, 0, 0, 9, 9))
    answers = answers_of(driver)
    driver.verify(Proposal((1, 1), 1, prescribed, 0, 1000))
    driver.verify(Proposal((1, 1), 1, rows((0, 0, 0), (1000, 6000, 0)), 0, 1000))
    assert answers == ["refuse", "accept"]


def test_speed_advice_is_taken_back_by_a_fallback_too() -> None:
    works = SpeedAdvice(Vehicle(1, 300, 0, 0, 0.1), advice_mm_s=6000, advice_ms=40_000)
    other = SpeedAdvice(Vehicle(2, 0, 0, 10, 10))
    drive = driven(works.signal, works, other, until=7)
    assert other.vehicle.speed == pytest.approx(6, abs=0.3)
    drive.simulation.radio.partition([1], [2])
    drive.run(20)
    assert other.vehicle.speed > 9 and other.ended == ["cam_loss"]


@pytest.mark.parametrize(("speed", "advice"), [(10, 5.5), (14, 6), (30, 10), (36, 3)])
def test_speed_advice_makes_nobody_brake_hard(speed: float, advice: float) -> None:
    """Nor the vehicle behind, which keeps the headway of one second."""
    works = SpeedAdvice(Vehicle(1, 900, 0, 0, 0.1), advice_mm_s=round(1000 * advice))
    fast, d = SpeedAdvice(Vehicle(2, 0, 1, speed, speed)), Driving()
    behind = Vehicle(3, -4.5 - d.standstill - d.headway_s * speed, 1, speed, speed)
    drive = driven(works.signal, works, fast, others=[behind])
    assert -min(s.acceleration for s in drive.road.of(2)) <= d.comfortable
    assert -min(s.acceleration for s in drive.road.of(3)) <= FORCED
    assert min(a.x - b.x for a, b in zip(*map(drive.road.of, (2, 3)), strict=True)) > 4.5 + LEAST_M
