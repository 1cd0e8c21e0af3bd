"""Trajectories and kinematics in Autoware's form, and back."""

from __future__ import annotations

import json
import math
from itertools import accumulate
from typing import Any

import pytest
from automcm_stage import prescription
from bridge_stage import here
from hypothesis import given
from hypothesis import strategies as st

from automcm.bridge import autoware
from automcm.bridge import rosbridge as ros
from automcm.service.application import Kinematics
from automcm_spec.vocabulary.messages import LIMIT, MAX_BYTES, MessageError, Trajectory, encode

# -- conversion

COORDINATE = st.integers(-(10**12), 10**12)
TRAJECTORY = st.builds(
    lambda t0, start, steps, places: Trajectory(
        t0=t0,
        points=tuple(
            (t, *place) for t, place in zip(accumulate(steps, initial=start), places, strict=False)
        ),
    ),
    st.integers(-(2**31) * 1000, 2**31 * 1000 - 1),
    st.integers(-(10**6), 10**6),
    st.lists(st.integers(1, 10**6), max_size=20),
    st.lists(st.tuples(COORDINATE, COORDINATE), min_size=1, max_size=20),
)


@given(TRAJECTORY)
def test_trajectories_come_back_as_they_were(trajectory: Trajectory) -> None:
    try:
        form = autoware.to_trajectory(trajectory)
    except MessageError as error:  # a speed beyond 10^9 m/s
        assert "longitudinal_velocity_mps" in str(error)
        return
    again = autoware.AutowareTrajectory.model_validate(json.loads(form.model_dump_json()))
    assert autoware.trajectory(again) == trajectory


@given(
    st.integers(-3141, 3141), COORDINATE, COORDINATE, COORDINATE, st.none() | st.integers(1, 10**7)
)
def test_kinematics_come_back_as_they_were(
    heading: int, x: int, y: int, speed: int, sigma: int | None
) -> None:
    at = Kinematics(x_mm=x, y_mm=y, heading_mrad=heading, speed_mm_s=speed, sigma_mm=sigma)
    form = autoware.to_odometry(at, 5).model_dump_json()
    assert autoware.kinematics(autoware.Odometry.model_validate(json.loads(form))) == at


def odometry(xx: float, xy: float, yx: float, yy: float) -> dict[str, Any]:
    covariance = [0.0] * 36
    covariance[0], covariance[1], covariance[6], covariance[7] = xx, xy, yx, yy
    message = here(0.0, 0.0)
    message["pose"]["covariance"] = covariance
    return message


@pytest.mark.parametrize(
    ("orientation", "heading"),
    [
        ((0.0, 0.0, 0.0, 1.0), 0),
        ((0.0, 0.0, 1.0, 1.0), 1571),
        ((0.0, 0.0, -0.4, 0.4), -1571),
        ((0.0, 0.0, 1.9, 0.0), 3142),
        ((0.0, 0.0, 0.0, 0.0), None),
        ((0.0, 0.0, 0.38, 0.0), None),
        ((0.0, 0.0, 2.0, 0.1), None),
    ],
)
def test_an_orientation_is_normalised_or_refused(orientation: Any, heading: int | None) -> None:
    message = here(0.0, 0.0, **dict(zip("xyzw", orientation, strict=True)))
    if heading is not None:
        assert autoware.kinematics(ros.read(ros.OdometryIn, message)).heading_mrad == heading
        return
    with pytest.raises(MessageError, match=r"^msg\.pose\.pose\.orientation: must have a norm"):
        ros.read(ros.OdometryIn, message)


@pytest.mark.parametrize("missing", ["pose", "pose.pose.position.y", "twist", "twist.twist.linear"])
def test_a_missing_position_or_speed_is_not_zero(missing: str) -> None:
    message = inner = here(0.0, 0.0)
    *outer, last = missing.split(".")
    for name in outer:
        inner = inner[name]
    del inner[last]
    with pytest.raises(MessageError, match=f"^msg.{missing}: Field required"):
        ros.read(ros.OdometryIn, message)


@pytest.mark.parametrize(
    ("block", "sigma"),
    [
        ((0.0, 0.0, 0.0, 0.0), None),
        ((0.25, 0.0, 0.0, 0.04), 500),
        ((0.04, 0.0, 0.0, 0.25), 500),
        ((1.0, 1.0, 1.0, 1.0), 1415),  # a line along the diagonal: the root of 2 m, rounded up
        ((2.5, -1.5, -1.5, 2.5), 2000),
        ((1.0, 1.0 + 1e-8, 1.0, 1.0), 1415),
        ((1e-12, 0.0, 0.0, 0.0), 1),
    ],
)
def test_sigma_is_the_long_axis_of_the_ellipse(
    block: tuple[float, float, float, float], sigma: int | None
) -> None:
    read = ros.read(ros.OdometryIn, odometry(*block))
    assert autoware.kinematics(read).sigma_mm == sigma


@pytest.mark.parametrize(
    ("block", "problem"),
    [
        ((-1.0, 0.0, 0.0, 1.0), "not positive semidefinite"),
        ((1.0, 0.0, 0.0, -1.0), "not positive semidefinite"),
        ((1.0, 2.0, 2.0, 1.0), "not positive semidefinite"),
        ((1.0, 0.5, -0.5, 1.0), "not positive semidefinite"),
        ((0.0, 1.0, 1.0, 0.0), "not positive semidefinite"),
        ((math.nan, 0.0, 0.0, 1.0), "finite"),
        ((math.inf, 0.0, 0.0, 1.0), "finite"),
    ],
)
def test_an_impossible_covariance_is_refused(
    block: tuple[float, float, float, float], problem: str
) -> None:
    with pytest.raises(MessageError, match=rf"^msg\.pose\.covariance.*{problem}"):
        ros.read(ros.OdometryIn, odometry(*block))
    short = here(0.0, 0.0)
    short["pose"]["covariance"] = [1.0] * 7
    with pytest.raises(MessageError, match=r"^msg\.pose\.covariance: must have 36 numbers, not 7"):
        ros.read(ros.OdometryIn, short)


def test_velocity_and_heading_are_those_to_the_next_point() -> None:
    points = ((0, 3000, 7000), (500, 3000, 9000), (1000, 3000, 9000), (2000, 2000, 9000))
    way = Trajectory(t0=0, points=points)
    form = autoware.to_trajectory(way)
    speeds = [point.longitudinal_velocity_mps for point in form.points]
    assert speeds == [4.0, 0.0, 1.0, 1.0]
    yaws = [point.pose.orientation.yaw for point in form.points]
    assert yaws == pytest.approx([math.pi / 2, math.pi / 2, math.pi, math.pi])


@pytest.mark.parametrize(
    ("way", "problem"),
    [
        (Trajectory(t0=0, points=((0, 10**13, 0),)), "there.points.0|there.x"),
        (Trajectory(t0=2**31 * 1000, points=((0, 0, 0),)), "sec"),
        (Trajectory(t0=0, points=((5, 0, 0), (5, 0, 0))), "there.points.1.time_from_start"),
    ],
)
def test_what_autoware_cannot_hold(way: Trajectory, problem: str) -> None:
    with pytest.raises(MessageError, match=problem):
        autoware.to_trajectory(way, "there")


def test_a_largest_trajectory_fits_a_message() -> None:
    far = -(10**12)
    points = tuple((-(2**31) * 1000 + n, far, far) for n in range(autoware.MAX_POINTS))
    way, id_ = Trajectory(t0=-(2**31) * 1000, points=points), 2**32 - 1
    most: dict[str, Any] = dict.fromkeys(("seq", "hold_ms", "lease_ms"), LIMIT)
    largest = prescription(LIMIT, (id_, LIMIT), dst=id_, prescribed=way, **most)
    assert len(encode(largest)) + ros.MAX_DETAILS + 6 * 256 < MAX_BYTES
