"""What a maneuver costs in comfort: the measures."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from automcm_evaluation.comfort import comfort
from automcm_evaluation.comfort.comfort_courses import B, C
from automcm_evaluation.comfort.comfort_measures import FAR_S, DrivenTrack, distance


def track(speeds: list[float], x: float = 0.0, y: float = 0.0) -> DrivenTrack:
    """A vehicle with these speeds, one each 0.1 s."""
    v = np.array(speeds)
    t = np.arange(len(v)) * 0.1
    acceleration = np.diff(v, prepend=v[0]) / 0.1
    return DrivenTrack(t, x + np.cumsum(v) * 0.1, np.full(len(v), y), v, acceleration)


# -- measures


def test_braking_jerk_and_way_lost() -> None:
    even = track([10.0] * 30)
    slowing = track([10.0] * 10 + [9.8, 9.6, 9.4, 9.2, 9.0] + [9.0] * 5 + [10.0] * 10)
    assert even.braking == 0 and even.jerk == 0
    assert slowing.braking == pytest.approx(2.0)
    assert slowing.jerk == pytest.approx(20.0)  # from 0 to 10 m/s² within 0.5 s
    assert slowing.lost(even) == pytest.approx(0.1 * (0.2 + 0.4 + 0.6 + 0.8 + 1.0 * 6))
    assert slowing.slowed(even) == pytest.approx(0.8)  # those slower by more than 0.5 m/s
    assert slowing.first_slower(even) == 1.2 and even.first_slower(even) is None


def test_distance_is_to_who_is_next_ahead_and_in_the_way() -> None:
    me = track([10.0] * 10)
    found = {1: me, 2: track([5.0] * 10, x=24.5), 3: track([0.0] * 10, x=15.0, y=3.5)}
    gap, collision_s = distance(1, found)
    assert gap == pytest.approx(24.5 - 4.5 - 5.0 * 0.1 * 10, abs=0.01)
    assert collision_s == pytest.approx(gap / 5.0)
    assert distance(2, found) == (np.inf, FAR_S)
    faster = found | {2: track([11.0] * 10, x=24.5)}
    assert distance(1, faster)[1] == FAR_S


# -- courses


def test_slowing_is_needless_unless_a_lane_change_takes_it() -> None:
    even = track([10.0] * 30)
    slow = track([10.0] * 10 + [8.0] * 10 + [10.0] * 10)
    alone = {1: even, 2: track([10.0] * 30, x=60), 3: even, 4: even}
    needed = {B: (1.5, 0.4), C: (0.0, 0.0)}
    stayed = comfort.cost(alone | {3: slow}, alone, needed)
    assert (stayed["moved"], stayed["B needless_m"]) == (0, pytest.approx(2.0))
    assert stayed["B needless_s"] == pytest.approx(1.0) and stayed["C needless_m"] == 0
    over = replace(even, y=np.linspace(0, 3.5, 30))
    moved = comfort.cost(alone | {1: over, 3: slow}, alone, needed)
    assert (moved["moved"], moved["B needless_m"]) == (1, pytest.approx(0.5))
    assert moved["B needless_s"] == pytest.approx(0.6)
    counts = moved["drives"], moved["hard"], moved["touched"]
    assert counts == (1, 1, 1)  # 20 m/s², and nobody is a length away
    assert moved["B lost_m"] == pytest.approx(2.0) and moved["ttc_s"] == FAR_S
