"""KIN-1 and the Trajectory type."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from shapely import LineString, Point
from test_trajectory_cases import BAD, numbers, paths, places, raises, starts, trajectories

from automcm.kernels import convert
from automcm.kernels.trajectory import Floats, Trajectory, from_message, to_message
from automcm_spec.vocabulary import messages

V_EPS = 0.1


@st.composite
def roads(draw: st.DrawFn) -> tuple[Floats, Floats, tuple[float, float]]:
    """A path, speeds of which some are 0, and a position on it, at a vertex or beside it."""
    xy = draw(paths())
    one = numbers(0.2, 40) | st.sampled_from([0.0, 0.05, 0.1])
    speed = np.array(draw(st.lists(one, min_size=len(xy), max_size=len(xy))))
    here = draw(st.sampled_from([tuple(each) for each in xy]) | places)
    return xy, speed, (float(here[0]), float(here[1]))


@given(roads(), starts)
def test_time_begins_and_increases(road: tuple[Floats, Floats, tuple[float, float]], t0: float):
    xy, speed, here = road
    made = convert.convert(xy, speed, here, t0, v_eps=V_EPS)
    assert made.t[0] == t0
    assert (np.diff(made.t) > 0).all()


@given(roads())
def test_begins_at_the_closest_point(road: tuple[Floats, Floats, tuple[float, float]]) -> None:
    """shapely's distance; its projection puts the place."""
    xy, speed, here = road
    made = convert.convert(xy, speed, here, 0.0)
    line = LineString(xy) if len(xy) > 1 else Point(xy[0])
    off = np.hypot(*(made.xy[0] - here))
    assert off == pytest.approx(line.distance(Point(here)), abs=1e-8)
    if len(xy) > 1 and line.length > 0:
        assert LineString(xy).distance(Point(made.xy[0])) < 1e-8


@given(roads(), starts)
def test_interpolation_gives_the_speeds_back(
    road: tuple[Floats, Floats, tuple[float, float]], t0: float
) -> None:
    """Of each segment, with the speed of its first point; and the path's points are all there.

    A plain reading of KIN-1, without numpy: walk from the foot, a segment at a time.
    """
    xy, speed, here = road
    made = convert.convert(xy, speed, here, t0, v_eps=V_EPS)
    k = int(convert.closest_points(xy, np.array([here])).segment[0])
    time, place, n = t0, made.xy[0], 0
    while True:
        if speed[k] < V_EPS:
            assert made.stopped
            break
        if k == len(xy) - 1:
            assert not made.stopped
            break
        length = float(np.hypot(*(xy[k + 1] - place)))
        time, place, k = time + length / speed[k], xy[k + 1], k + 1
        if length == 0:
            continue
        n += 1
        rounding = 4 * (n + 1) * np.spacing(max(abs(t0), time, 1.0))
        assert made.t[n] == pytest.approx(time, rel=0, abs=rounding)
        assert made.xy[n] == pytest.approx(place)
        middle = (made.t[n - 1] + made.t[n]) / 2
        quarter = (made.t[n] - made.t[n - 1]) / 4
        if quarter > 1e-3:
            two = made.at([middle - quarter, middle + quarter])
            measured = np.hypot(*(two[1] - two[0])) / (2 * quarter)
            assert measured == pytest.approx(speed[k - 1], rel=2e-3)
    assert len(made) == n + 1


LINE = [(0.0, 0.0), (10.0, 0.0), (20.0, 0.0)]


@pytest.mark.parametrize(
    ("xy", "speed", "here", "t", "x", "stopped"),
    [
        (LINE, (0, 5, 5), (0, 0), [0], [0], True),  # stands at the start
        (LINE, (0, 5, 5), (4, 1), [0], [4], True),
        (LINE, (5, 0, 5), (0, 0), [0, 2], [0, 10], True),  # in the middle
        (LINE, (5, 2, 0), (0, 0), [0, 2, 7], [0, 10, 20], True),  # at the end
        (LINE, (5, 2, 1), (0, 0), [0, 2, 7], [0, 10, 20], False),
        (LINE, (0, 2, 1), (10, 0), [0, 5], [10, 20], False),  # at a vertex: its speed
        (LINE, (0, 2, 1), (10 - 1e-12, 0), [0, 5], [10, 20], False),
        (LINE, (5, 2, 1), (25, 3), [0], [20], False),  # past the end
        (LINE, (5, 2, 0), (25, 3), [0], [20], True),
        (LINE[:1], (3,), (9, 9), [0], [0], False),  # one point
        (LINE[:1], (0,), (9, 9), [0], [0], True),
        (LINE[:1] * 3, (5, 5, 5), (1, 0), [0], [0], False),  # repeated points
        ([LINE[0], LINE[0], LINE[1]], (5, 2, 2), (0, 0), [0, 5], [0, 10], False),
        ([LINE[0], LINE[1], LINE[1], LINE[2]], (5, 5, 0, 5), (0, 0), [0, 2], [0, 10], True),
        ([LINE[0], LINE[1], LINE[0]], (5, 2, 2), (4, 0), [0, 1.2, 6.2], [4, 10, 0], False),  # tie
    ],
)
def test_edges(xy, speed, here, t, x, stopped) -> None:  # type: ignore[no-untyped-def]
    made = convert.convert(xy, speed, here, 0.0)
    assert made.t == pytest.approx(t)
    assert made.xy[:, 0] == pytest.approx(x)
    assert made.stopped is stopped


def test_refused() -> None:
    c = convert.convert
    for bad in BAD:
        raises("xy[1, 0]", lambda bad=bad: c([(0, 0), (bad, 1)], (1, 1), (0, 0), 0))
        raises("speed[1]", lambda bad=bad: c(LINE, (1, bad, 1), (0, 0), 0))
        raises("position[0]", lambda bad=bad: c(LINE, (1, 1, 1), (bad, 0), 0))
        raises("t0", lambda bad=bad: c(LINE, (1, 1, 1), (0, 0), bad))
        raises("v_eps", lambda bad=bad: c(LINE, (1, 1, 1), (0, 0), 0, v_eps=bad))
    raises("v_eps", lambda: c(LINE, (1, 1, 1), (0, 0), 0, v_eps=0))
    raises("v_eps", lambda: c(LINE, (1, 1, 1), (0, 0), 0, v_eps=-1))
    raises("speed[2]: -1", lambda: c(LINE, (1, 1, -1), (0, 0), 0))
    raises("speed: must have shape (3,), not (2,)", lambda: c(LINE, (1, 1), (0, 0), 0))
    raises("speed: must be 1-dim", lambda: c(LINE, 1, (0, 0), 0))
    raises(
        "xy: must have shape (n, 2) with n of at least 1, not (1, 3)",
        lambda: c([(1, 2, 3)], (1,), (0, 0), 0),
    )
    raises("xy: must be 2-dim", lambda: c([1, 2], (1,), (0, 0), 0))
    raises(
        "xy: must have shape (n, 2) with n of at least 1, not (0, 2)",
        lambda: c(np.empty((0, 2)), (), (0, 0), 0),
    )
    raises("xy: must be an array", lambda: c([(1, 2), (3,)], (1, 1), (0, 0), 0))
    raises("xy[0, 1]: beyond", lambda: c([(0, 1e200)], (1,), (0, 0), 0))
    raises("position: must have shape (2,)", lambda: c(LINE, (1, 1, 1), (0, 0, 0), 0))
    raises("t0: must be 0-dim", lambda: c(LINE, (1, 1, 1), (0, 0), [0]))
    raises("t[1]", lambda: c(LINE, (1e-300, 1, 1), (0, 0), 0, v_eps=1e-308))


# -- the type


@given(trajectories(t0=1.8e9))
def test_message_and_back(of: Trajectory) -> None:
    back = from_message(to_message(of))
    n = len(of)
    assert back.t[:n] == pytest.approx(of.t, abs=6e-4)
    assert back.xy[:n] == pytest.approx(of.xy, abs=6e-4)
    assert len(back) - n in (0, 1)
    if of.stopped:
        assert back.stopped
        assert np.hypot(*(back.xy[-1] - of.xy[-1])) < 1e-3
    else:
        assert len(back) == n
    assert to_message(back) == to_message(of)


def test_messages_that_are_none() -> None:
    raises("t[1]", lambda: from_message(messages.Trajectory(t0=0, points=((0, 0, 0), (0, 1, 1)))))
    raises("t[1]: less", lambda: to_message(Trajectory(np.array([0, 3e-4]), np.zeros((2, 2)))))
    far = Trajectory(np.array([-8e12, 8e12]), np.zeros((2, 2)))
    raises("t: ", lambda: to_message(far))


def test_type_refuses() -> None:
    two = np.zeros((2, 2))
    raises("t[1]: 0.0 s is not after", lambda: Trajectory(np.zeros(2), two))
    raises("t[2]", lambda: Trajectory(np.array([0, 2.0, 1]), np.zeros((3, 2))))
    raises("t: must have at least", lambda: Trajectory(np.zeros(0), np.zeros((0, 2))))
    raises("xy: must have shape (3, 2), not (2, 2)", lambda: Trajectory(np.arange(3.0), two))
    for bad in BAD:
        raises("t[0]: not a finite", lambda bad=bad: Trajectory(np.array([bad, 1]), two))
    good = Trajectory(np.arange(2.0), two)
    raises("times[1]: 1.5", lambda: good.at([1, 1.5]))
    raises("times[0]", lambda: good.since(-1))
    assert Trajectory(good.t, two, True).at([9.0]) == pytest.approx(two[:1])
    with pytest.raises(ValueError):
        good.xy[0, 0] = 1


@given(trajectories(least=2), numbers(0, 1))
@example(Trajectory(np.array([0.0, 1]), np.array([(0.0, 0), (4, 0)])), 0.25)
def test_since(of: Trajectory, share: float) -> None:
    time = float(of.t[0] + share * (of.t[-1] - of.t[0]))
    left = of.since(time)
    assert left.t[0] == time
    later = np.linspace(time, of.t[-1], 7)
    assert left.at(later) == pytest.approx(of.at(later), abs=1e-6)
