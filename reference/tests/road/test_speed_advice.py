"""Speed advice on the unchanged service."""

from __future__ import annotations

import pytest
from road_stage import answers_of, driven, rows

from automcm.applications.vehicle import Vehicle
from automcm.service.application import Proposal
from automcm_simulation.road.speed_advice import SpeedAdvice
from automcm_spec.vocabulary import messages


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
