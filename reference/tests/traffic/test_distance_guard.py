"""An equipped vehicle does not touch a vehicle that is in its way as it stands on the road."""

from __future__ import annotations

import pytest

from automcm.applications.vehicle import STEP_S
from automcm_simulation.traffic.distance_guard import LEFT_M, limits
from automcm_simulation.traffic.mover import AUTOMATED, Body, RoadUser

SIGHT_M = 100.0
CAR, LORRY = (4.5, 1.8), (16.0, 2.5)


def user(number: int, size: tuple[float, float] = CAR, kind: str = "vehicle") -> RoadUser:
    length, width = size
    return RoadUser(
        number=number,
        route=("road",),
        lane=0,
        at_m=0.0,
        speed=0.0,
        desired=30.0,
        equipped=True,
        length=length,
        width=width,
        kind=kind,  # type: ignore[arg-type]
    )


def body(x: float, y: float = 0.0, heading: float = 0.0, speed: float = 0.0) -> Body:
    return Body(x, y, heading, speed, 0.0)


def limit(other: Body, size: tuple[float, float] = CAR, kind: str = "vehicle") -> float | None:
    """That of a car at 10 m/s behind another road user."""
    users = {1: user(1), 2: user(2, size, kind)}
    return limits({1}, {1: body(0.0, speed=10.0), 2: other}, users, SIGHT_M).get(1)


def test_a_rear_that_is_in_the_way_counts() -> None:
    """SUMO takes the lorry for one whose sides are along the lane."""
    aside = 2.5 / 2 + 1.8 / 2 + 0.3
    assert limit(body(14.0, aside), LORRY) is None
    assert limit(body(14.0, aside, heading=0.1), LORRY) is not None


def test_only_those_asked_for_are_limited() -> None:
    users = {1: user(1), 2: user(2)}
    bodies = {1: body(0.0, speed=10.0), 2: body(9.0)}
    assert (
        limits(set(), bodies, users, SIGHT_M) == {}
        and limits({1}, {1: bodies[1]}, users, SIGHT_M) == {}
    )


def test_a_limit_asks_for_no_harder_braking_than_the_hardest() -> None:
    """Whoever comes into the way too late is hit, but the limit can be kept."""
    assert limit(body(5.0)) == 10.0 - AUTOMATED.hardest * STEP_S


def test_who_is_beyond_the_sensors_does_not_count() -> None:
    users, bodies = {1: user(1), 2: user(2)}, {1: body(0.0, speed=10.0), 2: body(9.0)}
    assert limits({1}, bodies, users, 9.1) != {}
    assert limits({1}, bodies, users, 8.9) == {}


@pytest.mark.parametrize("speed", [3.0, 10.0, 25.0])
def test_who_keeps_the_limit_stops_before(speed: float) -> None:
    """At no more than the hardest braking, from wherever the limit begins."""
    users, x = {1: user(1), 2: user(2, LORRY)}, 0.0
    rear = speed**2 / 2 / AUTOMATED.hardest + 1.0
    lorry = body(CAR[0] / 2 + rear + LORRY[0] / 2)
    while speed > 0.0:
        found = limits({1}, {1: body(x, speed=speed), 2: lorry}, users, SIGHT_M)
        after = min(found.get(1, speed), speed)
        assert after >= speed - AUTOMATED.hardest * STEP_S - 1e-9
        speed = after if after > 0.05 else 0.0
        x += speed * STEP_S
    assert 0.0 < LEFT_M - 0.05 < rear - x < 2.0
