"""What the tests of the kernels share: random paths, trajectories and movements (no tests here)."""

from __future__ import annotations

from typing import Any

import numpy as np
from hypothesis import strategies as st

from automcm.kernels.trajectory import Floats, Trajectory

BAD = (float("nan"), float("inf"), -float("inf"))


def numbers(least: float, most: float) -> st.SearchStrategy[float]:
    """Without numbers such as 1e-300, which are not realistic distances."""
    return st.floats(least, most, allow_nan=False).map(lambda x: round(x, 6))


places = st.tuples(numbers(-50, 50), numbers(-50, 50))
steps = st.tuples(numbers(-8, 8), numbers(-8, 8))
starts = st.sampled_from([0.0, -3.0, 1_800_000_000.0])


@st.composite
def paths(draw: st.DrawFn, least: int = 1, most: int = 12) -> Floats:
    """Random steps; now and then a point is repeated."""
    n = draw(st.integers(least, most))
    way = [np.array(draw(places))]
    for _ in range(n - 1):
        way.append(way[-1] + np.array(draw(st.one_of(steps, st.just((0.0, 0.0))))))
    return np.array(way)


@st.composite
def trajectories(draw: st.DrawFn, least: int = 1, most: int = 12, t0: float = 0.0) -> Trajectory:
    """Any: it may stand, go back, and stop."""
    xy = draw(paths(least, most))
    spans = draw(st.lists(numbers(0.05, 2), min_size=len(xy) - 1, max_size=len(xy) - 1))
    begin = t0 + draw(numbers(0, 3))
    return Trajectory(begin + np.cumsum([0.0, *spans]), xy, draw(st.booleans()))


@st.composite
def plans(draw: st.DrawFn) -> Trajectory:
    """A car's: 60 to 240 m on a road that bends a little, at 3 to 15 m/s that vary."""
    n = draw(st.integers(12, 40))
    turns = draw(st.lists(numbers(-0.15, 0.15), min_size=n, max_size=n))
    heading = draw(numbers(-3, 3)) + np.cumsum(turns)
    step = draw(numbers(5, 6))
    xy = np.cumsum(step * np.stack([np.cos(heading), np.sin(heading)], axis=1), axis=0)
    base = draw(numbers(4, 14))
    v = np.array([max(0.5, base + d) for d in draw(st.lists(numbers(-1, 1), min_size=n))[:n]])
    t = draw(starts) + np.concatenate([[0.0], np.cumsum(step / v[:-1])])
    return Trajectory(t, xy)


def moved(
    of: Trajectory,
    angle: float = 0.0,
    by: tuple[float, float] = (0.0, 0.0),
    later: float = 0.0,
    space: float = 1.0,
    time: float = 1.0,
) -> Trajectory:
    """Turned, shifted and scaled."""
    return Trajectory(time * of.t + later, turned(space * of.xy, angle) + by, of.stopped)


def turned(xy: Floats, angle: float) -> Floats:
    c, s = np.cos(angle), np.sin(angle)
    made: Floats = xy @ np.array([[c, s], [-s, c]])
    return made


def sampled(of: Trajectory, times: Floats) -> Floats:
    """Places at times, interpolated without the code under test."""
    return np.stack([np.interp(times, of.t, of.xy[:, axis]) for axis in (0, 1)], axis=1)


def raises(what: str, call: Any) -> None:
    """It raises TrajectoryError whose text begins with ``what``."""
    import pytest

    from automcm.kernels.trajectory import TrajectoryError

    with pytest.raises(TrajectoryError) as caught:
        call()
    assert str(caught.value).startswith(what), str(caught.value)
