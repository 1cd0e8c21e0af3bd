"""Trajectories and kinematics in Autoware's form: ROS messages as JSON, SI units.

The station uses integers (mm, ms, mrad), ROS messages use floats (m, s, rad).  The conversion is
lossless for integers: ``trajectory(to_trajectory(t)) == t`` for every trajectory that
``to_trajectory`` accepts.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise, takewhile
from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field, ValidationError, field_validator

from automcm.service.application import Kinematics
from automcm_spec.vocabulary.messages import MessageError, Trajectory, fault, refusal, short

MAX_POINTS = 1000
"""Maximum points of a trajectory.  Any such trajectory fits in a message of the protocol."""
LIMIT = 1e9
"""The largest absolute value of a number in any unit, except for times."""

NORMS = (0.5, 2.0)
"""The least and the greatest norm of an orientation, which is normalised."""

Number = Annotated[float, Field(ge=-LIMIT, le=LIMIT, allow_inf_nan=False)]


class Ros(BaseModel):
    """A ROS message.  A missing field gets its default, or is refused if it has none; so is an
    unknown one."""

    model_config = ConfigDict(frozen=True, strict=True, extra="forbid")


class Time(Ros):
    """builtin_interfaces/Time, and Duration."""

    sec: int = Field(default=0, ge=-(2**31), lt=2**31)
    nanosec: int = Field(default=0, ge=0, lt=10**9)

    @property
    def ms(self) -> int:
        """The time in ms, rounded."""
        return self.sec * 1000 + (self.nanosec + 500_000) // 1_000_000


def to_time(ms: int) -> Time:
    """The time as a ROS message.  Raises ValidationError beyond 2^31 s."""
    return Time(sec=ms // 1000, nanosec=ms % 1000 * 1_000_000)


class RosHeader(Ros):
    """std_msgs/Header.  The frame is always ``map``."""

    stamp: Time = Time()
    frame_id: Literal["map"] = "map"


class RosVector(Ros):
    """geometry_msgs/Point, and Vector3."""

    x: Number
    y: Number
    z: Number = 0.0


class Quaternion(Ros):
    """geometry_msgs/Quaternion."""

    x: Number = 0.0
    y: Number = 0.0
    z: Number = 0.0
    w: Number = 1.0

    @property
    def yaw(self) -> float:
        """The heading in rad: 0 along x, counterclockwise; of a quaternion of any norm but 0."""
        x, y, z, w = self.x, self.y, self.z, self.w
        return math.atan2(2 * (w * z + x * y), w * w + x * x - y * y - z * z)


def _heading(yaw: float) -> Quaternion:
    return Quaternion(z=math.sin(yaw / 2), w=math.cos(yaw / 2))


class Pose(Ros):
    """geometry_msgs/Pose."""

    position: RosVector
    orientation: Quaternion = Quaternion()


class TrajectoryPoint(Ros):
    """autoware_planning_msgs/TrajectoryPoint."""

    time_from_start: Time
    pose: Pose
    longitudinal_velocity_mps: Number = 0.0
    lateral_velocity_mps: Number = 0.0
    acceleration_mps2: Number = 0.0
    heading_rate_rps: Number = 0.0
    front_wheel_angle_rad: Number = 0.0
    rear_wheel_angle_rad: Number = 0.0


class AutowareTrajectory(Ros):
    """autoware_planning_msgs/Trajectory.  Without points, there is no trajectory."""

    header: RosHeader = RosHeader()
    points: list[TrajectoryPoint] = Field(default=[], max_length=MAX_POINTS, fail_fast=True)


class _WithCovariance(Ros):
    covariance: list[Number] = Field(default=[], max_length=36, fail_fast=True)


class PoseWithCovariance(_WithCovariance):
    """geometry_msgs/PoseWithCovariance.  The covariance of x and y must be positive semidefinite;
    zeros mean unknown, as in ROS."""

    pose: Pose

    @field_validator("pose")
    @classmethod
    def _turned(cls, pose: Pose) -> Pose:
        of = pose.orientation
        norm = math.hypot(of.x, of.y, of.z, of.w)
        if not NORMS[0] <= norm <= NORMS[1]:
            text = f"must have a norm from {NORMS[0]} to {NORMS[1]}, not {norm:.6g}"
            raise fault("orientation", text)
        return pose

    @field_validator("covariance")
    @classmethod
    def _possible(cls, covariance: list[float]) -> list[float]:
        if len(covariance) not in (0, 36):
            raise fault("", f"must have 36 numbers, not {len(covariance)}")
        xx, xy, yx, yy = _of_xy(covariance)
        tolerance = 1e-6 * max(abs(xx), abs(yy))  # of a filter in floats
        if abs(xy - yx) > tolerance or min(xx, yy, _eigenvalue(-1, xx, xy, yy)) < -tolerance:
            text = f"[[{xx}, {xy}], [{yx}, {yy}]] of x and y is not positive semidefinite"
            raise fault("", text)
        return covariance

    @property
    def sigma_mm(self) -> int | None:
        """The greatest standard deviation of the position along any axis, rounded up; None if
        unknown."""
        xx, xy, _, yy = _of_xy(self.covariance)
        largest = _eigenvalue(1, xx, xy, yy)
        # less what rounding may have added
        return max(1, math.ceil(1000 * math.sqrt(largest) - 1e-6)) if largest > 0 else None


def _of_xy(covariance: Sequence[float]) -> tuple[float, float, float, float]:
    if not covariance:
        return 0.0, 0.0, 0.0, 0.0
    return covariance[0], covariance[1], covariance[6], covariance[7]


def _eigenvalue(sign: int, xx: float, xy: float, yy: float) -> float:
    """The larger (1) or the smaller (-1) eigenvalue of [[xx, xy], [xy, yy]]."""
    return (xx + yy) / 2 + sign * math.hypot((xx - yy) / 2, xy)


class Twist(Ros):
    """geometry_msgs/Twist."""

    linear: RosVector
    angular: RosVector = RosVector(x=0.0, y=0.0)


class TwistWithCovariance(_WithCovariance):
    """geometry_msgs/TwistWithCovariance."""

    twist: Twist


class Odometry(Ros):
    """nav_msgs/Odometry; ``twist.twist.linear.x`` is the forward speed."""

    header: RosHeader = RosHeader()
    child_frame_id: str = Field(default="base_link", max_length=64)
    pose: PoseWithCovariance
    twist: TwistWithCovariance


NO_TRAJECTORY = AutowareTrajectory()


def trajectory(of: AutowareTrajectory, place: str = "trajectory") -> Trajectory:
    """The trajectory in integers.  Velocities and headings are ignored; the points define them.

    Of points at the beginning with one time, only the last counts; a point that repeats the one
    before it, time and place, does not count.  Raises MessageError, which names ``place``, if there
    is no point or the times of the others do not increase.
    """
    if not of.points:
        raise MessageError(short(f"{place}.points", "at least one point is required"))
    points = tuple((p.time_from_start.ms, *_mm(p.pose.position)) for p in of.points)
    run = sum(1 for _ in takewhile(lambda p: p[0] == points[0][0], points))
    first = run - 1 if run < len(points) else 0
    kept = [n for n in range(first, len(points)) if n == first or points[n] != points[n - 1]]
    _check_times(points, kept, place)
    return Trajectory(t0=of.header.stamp.ms, points=tuple(points[n] for n in kept))


def to_trajectory(of: Trajectory, place: str = "trajectory") -> AutowareTrajectory:
    """The trajectory in Autoware's form, with the velocity and heading from each point to the next.

    Raises MessageError, which names ``place``, for more than ``MAX_POINTS`` points, a position or a
    time out of bounds, or times that do not increase.
    """
    if len(of.points) > MAX_POINTS:
        raise MessageError(short(f"{place}.points", f"more than {MAX_POINTS}"))
    _check_times(of.points, range(len(of.points)), place)
    try:
        return AutowareTrajectory(header=RosHeader(stamp=to_time(of.t0)), points=_points(of.points))
    except ValidationError as error:
        raise refusal(error, place) from None


def _mm(at: RosVector) -> tuple[int, int]:
    return round(at.x * 1000), round(at.y * 1000)


def _check_times(points: Sequence[tuple[int, int, int]], kept: Sequence[int], place: str) -> None:
    for before, after in pairwise(kept):
        if points[after][0] <= points[before][0]:
            where = f"{place}.points.{after}.time_from_start"
            raise MessageError(short(where, "must be later than that of the previous point"))


def _points(points: Sequence[tuple[int, int, int]]) -> list[TrajectoryPoint]:
    out = []
    yaw, speed = 0.0, 0.0
    for n, (t, x, y) in enumerate(points):
        if n + 1 < len(points):
            next_t, next_x, next_y = points[n + 1]
            dx, dy = next_x - x, next_y - y
            speed = math.hypot(dx, dy) / (next_t - t)  # mm/ms is m/s
            yaw = math.atan2(dy, dx) if dx or dy else yaw
        out.append(
            TrajectoryPoint(
                time_from_start=to_time(t),
                pose=Pose(position=RosVector(x=x / 1000, y=y / 1000), orientation=_heading(yaw)),
                longitudinal_velocity_mps=speed,
            )
        )
    return out


def kinematics(of: Odometry) -> Kinematics:
    """The kinematics in integers."""
    x_mm, y_mm = _mm(of.pose.pose.position)
    return Kinematics(
        x_mm=x_mm,
        y_mm=y_mm,
        heading_mrad=round(of.pose.pose.orientation.yaw * 1000),
        speed_mm_s=round(of.twist.twist.linear.x * 1000),
        sigma_mm=of.pose.sigma_mm,
    )


def to_odometry(of: Kinematics, now_ms: int) -> Odometry:
    """The kinematics in Autoware's form, which has no extent, and no error of 0.  Raises
    ValidationError for numbers out of bounds."""
    at = Pose(
        position=RosVector(x=of.x_mm / 1000, y=of.y_mm / 1000),
        orientation=_heading(of.heading_mrad / 1000),
    )
    moving = Twist(linear=RosVector(x=of.speed_mm_s / 1000, y=0.0))
    variance = ((of.sigma_mm or 0) / 1000) ** 2
    covariance = [variance if n in (0, 7) else 0.0 for n in range(36)] if variance else []
    return Odometry(
        header=RosHeader(stamp=to_time(now_ms)),
        pose=PoseWithCovariance(pose=at, covariance=covariance),
        twist=TwistWithCovariance(twist=moving),
    )
