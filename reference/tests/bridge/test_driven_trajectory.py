"""Trajectories of the driving software: KIN-1 for those without times, KIN-2 for long ones."""

from __future__ import annotations

import math
from itertools import accumulate
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from automcm.bridge import autoware, driven_trajectory
from automcm.bridge.driven_trajectory import own_trajectory, timed_trajectory
from automcm.encoding.codec import FRAME_BYTES
from automcm.kernels.convert import V_EPS
from automcm.kernels.trajectory import TrajectoryError, from_message
from automcm.service.application import Kinematics
from automcm_spec.vocabulary.messages import Intention, MessageError, Trajectory, encode

PLACE = "msg.trajectory"
NOW = 12_345


def path(*points: tuple[float, float, float], times: bool = False) -> autoware.AutowareTrajectory:
    """Autoware's trajectory by x, y and speed; its times are 0, or whole seconds."""
    return autoware.AutowareTrajectory.model_validate(
        {
            "points": [
                {
                    "time_from_start": {"sec": n if times else 0, "nanosec": 0},
                    "pose": {"position": {"x": float(x), "y": float(y), "z": 0.0}},
                    "longitudinal_velocity_mps": float(v),
                }
                for n, (x, y, v) in enumerate(points)
            ]
        }
    )


def timed(*points: tuple[float, float, float], at: tuple[int, ...]) -> autoware.AutowareTrajectory:
    """That of ``path`` with these times in seconds, stamped with 7 s."""
    of = [
        point.model_copy(update={"time_from_start": autoware.Time(sec=s)})
        for point, s in zip(path(*points).points, at, strict=True)
    ]
    return autoware.AutowareTrajectory(
        header=autoware.RosHeader(stamp=autoware.Time(sec=7)), points=of
    )


def own(*points: tuple[float, float, float], at: tuple[float, float] = (0, 0)) -> Trajectory:
    here = Kinematics(round(at[0] * 1000), round(at[1] * 1000), 0, 0)
    way, planned_ms = own_trajectory(path(*points), PLACE, here, NOW)
    assert planned_ms == NOW
    return way


def bytes_of(way: Trajectory) -> int:
    car = 2**32 - 1
    return len(encode(Intention(src=car, dst=car, session=(car, car), seq=car, planned=way)))


STEP = st.tuples(st.integers(1, 20), st.integers(-5, 5), st.integers(1, 40))


@given(st.lists(STEP, min_size=1, max_size=15))
def test_kin_1_times_are_the_sums_of_length_by_speed(steps: list[tuple[int, int, int]]) -> None:
    """By the formula of docs/protocol.md, not by the kernel."""
    xs = [0, *accumulate(dx for dx, _, _ in steps)]
    ys = [0, *accumulate(dy for _, dy, _ in steps)]
    speeds = [v for *_, v in steps] + [1]
    way = own(*zip(xs, ys, speeds, strict=True))
    taken = (math.hypot(dx, dy) / v for dx, dy, v in steps)
    times = [0.0, *accumulate(taken)]
    assert way.t0 == NOW and [(x, y) for _, x, y in way.points] == [
        (x * 1000, y * 1000) for x, y in zip(xs, ys, strict=True)
    ]
    assert all(abs(t - 1000 * due) <= 1.001 for (t, *_), due in zip(way.points, times, strict=True))


def test_it_begins_where_and_when_the_vehicle_last_was() -> None:
    """Autoware's path begins some metres behind the vehicle."""
    way = own((-5, 0, 10), (5, 0, 20), (25, 0, 20), at=(1, 0.4))
    assert way == Trajectory(t0=NOW, points=((0, 1000, 0), (400, 5000, 0), (1400, 25000, 0)))


def test_zero_speeds_at_the_end_are_a_stop() -> None:
    way = own((0, 0, 10), (10, 0, 10), (20, 0, 0), (30, 0, 0))
    assert way.points == ((0, 0, 0), (1000, 10000, 0), (2000, 20000, 0), (3000, 20000, 0))
    assert from_message(way).stopped


def test_a_stop_behind_the_vehicle_is_over() -> None:
    assert own((0, 0, 0), (1, 0, 10), (21, 0, 10), at=(2, 0)).points[-1] == (1900, 21000, 0)


@pytest.mark.parametrize(
    ("points", "problem"),
    [
        (((0, 0, 0), (1, 0, 0)), f"{PLACE}.points: .*no longitudinal_velocity_mps is at least"),
        (((0, 0, 5), (9, 0, 0), (9, 1, 5)), f"{PLACE}.points.1.*: a stop .* give time_from_start"),
        (((0, 0, 0.09), (9, 0, 5)), f"{PLACE}.points.0.longitudinal_velocity_mps: a stop"),
        (((0, 0, 5), (9, 0, -1)), f"{PLACE}.points.1.*: must not be negative"),
    ],
)
def test_what_cannot_be_converted(points: Any, problem: str) -> None:
    with pytest.raises(MessageError, match=problem):
        own(*points)
    with pytest.raises(MessageError, match=r"points.1.time_from_start: must be later"):
        timed_trajectory(path(*points), PLACE)


def test_kin_1_the_slowest_speed_with_a_known_duration() -> None:
    assert own((0, 0, V_EPS), (9, 0, 5)).points[-1][1:] == (9000, 0)


def test_without_kinematics_nothing_is_converted() -> None:
    with pytest.raises(
        MessageError, match=r"points.1.time_from_start: .* kinematics must be published first"
    ):
        own_trajectory(path((0, 0, 5), (9, 0, 5)), PLACE, None, NOW)


@pytest.mark.parametrize(
    ("times", "xs", "kept"),
    [
        ((0, 0, 0, 1, 2), (-10, -5, 0, 5, 10), (2, 3, 4)),  # behind the vehicle
        ((0, 1, 2, 2), (0, 5, 10, 10), (0, 1, 2)),  # a stop point given twice
        ((0, 0, 1, 1, 2), (0, 0, 5, 5, 10), (1, 2, 4)),
        ((0, 0), (0, 0), (0,)),
    ],
)
def test_repeated_points_are_left_out(times: Any, xs: Any, kept: Any) -> None:
    way = timed(*((x, 0, 5) for x in xs), at=times)
    expected = Trajectory(t0=7000, points=tuple((1000 * times[n], 1000 * xs[n], 0) for n in kept))
    assert own_trajectory(way, PLACE, None, NOW) == (expected, 7000)
    assert timed_trajectory(way, PLACE) == expected


@pytest.mark.parametrize("times", [(0, 1, 1), (0, 2, 1), (2, 1, 0)])
def test_kin_1_times_that_do_not_increase_are_computed(times: Any) -> None:
    way = timed((0, 0, 5), (5, 0, 5), (15, 0, 5), at=times)
    expected = Trajectory(t0=NOW, points=((0, 0, 0), (1000, 5000, 0), (3000, 15000, 0)))
    assert own_trajectory(way, PLACE, Kinematics(0, 0, 0, 0), NOW) == (expected, NOW)
    with pytest.raises(MessageError, match=r"points.\d.time_from_start: must be later"):
        timed_trajectory(way, PLACE)


def curve(count: int) -> list[tuple[float, float, float]]:
    """A bend of 100 m radius, a point each metre, slowly accelerating."""
    at = [n / 100 for n in range(count)]
    return [(100 * math.sin(a), 100 - 100 * math.cos(a), 8 + a) for a in at]


def test_kin_2_what_fits_no_frame_is_thinned() -> None:
    points = curve(300)
    way = own(*points)
    assert len(way.points) < 300 and bytes_of(way) <= FRAME_BYTES
    assert way.points[0] == (0, 0, 0)
    assert way.points[-1][1:] == (round(points[-1][0] * 1000), round(points[-1][1] * 1000))
    long = timed_trajectory(path(*points, times=True), PLACE)
    assert bytes_of(long) <= FRAME_BYTES and long.points[-1][0] == 299_000
    full = from_message(autoware.trajectory(path(*points, times=True)))
    off = full.xy - from_message(long).at(full.t)
    assert np.hypot(*off.T).max() < 1


def test_kin_2_what_cannot_be_thinned_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    def thin(full: Any) -> Any:
        raise TrajectoryError("budget", "too small")

    monkeypatch.setattr(driven_trajectory, "thin", thin)
    for refused in (
        lambda way: own(*way),
        lambda way: timed_trajectory(path(*way, times=True), PLACE),
    ):
        with pytest.raises(MessageError, match=f"^{PLACE}: budget: too small"):
            refused(curve(300))
