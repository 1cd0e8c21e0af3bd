"""Streams of cars on a lane, and the count of what drivers did: for all scenarios here."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

from automcm_simulation.traffic.mover import AUTOMATED, RoadUser
from automcm_simulation.traffic.traffic import Traffic
from automcm_simulation.traffic.traffic_scenario import TrafficSetting

CAR_M = 4.2, 5.0
SPREAD = 0.6, 1.4
"""Of the gaps at the start, as shares of their mean."""


def equipped(setting: TrafficSetting, number: int) -> bool:
    """Whether this vehicle is among the share with stations."""
    return setting.random(f"equipped/{number}").random() < setting.penetration


def stream(
    setting: TrafficSetting,
    numbers: Sequence[int],
    route: tuple[str, ...],
    lane: int,
    *,
    first_m: float,
    gap_m: float,
    desired: tuple[float, float],
    stations: bool = True,
) -> list[RoadUser]:
    """Cars behind each other, the first at ``first_m``, as dense as the edge from 0 m allows.

    ``stations``: whether some are equipped, by the penetration.  Raises ValueError if there is no
    room.
    """
    draw, users, at = setting.random(f"stream/{route[0]}/{lane}"), [], first_m
    longest = (first_m - CAR_M[1]) / (SPREAD[1] * max(len(numbers), 1))
    gap = min(max(gap_m, CAR_M[1] + 2 * AUTOMATED.standstill), longest)
    if SPREAD[0] * gap < CAR_M[1]:
        raise ValueError(
            f"vehicles: the {first_m:.0f} m of {route[0]} have no room for {len(numbers)}"
        )
    for number in numbers:
        wishes, length = draw.uniform(*desired), draw.uniform(*CAR_M)
        least = SPREAD[0] * gap - CAR_M[1] - AUTOMATED.standstill
        allowed = max(0.0, least / (1.2 * AUTOMATED.headway_s))
        users.append(
            RoadUser(
                number=number,
                route=route,
                lane=lane,
                at_m=at,
                speed=min(wishes, desired[0], allowed),
                desired=wishes,
                equipped=stations and equipped(setting, number),
                length=length,
            )
        )
        at -= gap * draw.uniform(*SPREAD)
    return users


def counted(traffic: Traffic, words: Sequence[str]) -> dict[str, int]:
    """How many lines of the drivers' stories begin with each of these words."""
    found: Counter[str] = Counter()
    for driver in traffic.drivers.values():
        story: list[tuple[int, str]] = getattr(driver, "story", [])
        found.update(word for _, what in story for word in words if what.startswith(word))
    return {word: found[word] for word in words}
