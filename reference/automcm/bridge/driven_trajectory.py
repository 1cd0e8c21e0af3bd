"""Trajectories of the driving software: converted (KIN-1) and thinned (KIN-2) as they arrive."""

from __future__ import annotations

import numpy as np

from automcm.bridge.autoware import AutowareTrajectory, trajectory
from automcm.kernels import trajectory as kernel
from automcm.kernels.convert import V_EPS, closest_points, convert
from automcm.kernels.thin import excess, thin
from automcm.service.application import Kinematics
from automcm_spec.vocabulary.messages import MessageError, Trajectory, short

UNTIMED = "time_from_start does not increase"


def own_trajectory(
    of: AutowareTrajectory, place: str, at: Kinematics | None, at_ms: int
) -> tuple[Trajectory, int]:
    """The vehicle's own trajectory, and the time from which it was planned, in ms: its stamp.  If
    its times do not increase, they are computed from the speeds (KIN-1), and begin at ``at_ms``.

    ``at``: the vehicle's kinematics at ``at_ms``, or None if unknown.  Raises MessageError, which
    names the field below ``place``.
    """
    try:
        given = trajectory(of, place)
    except MessageError as error:
        if at is None:
            why = "without increasing times, the present kinematics must be published first"
            raise MessageError(short(str(error), why)) from None
        return _by_speeds(of, place, at, at_ms), at_ms
    return _fitted(given, place), given.t0


def _by_speeds(of: AutowareTrajectory, place: str, at: Kinematics, at_ms: int) -> Trajectory:
    here = (at.x_mm / 1000, at.y_mm / 1000)
    xy = np.array([(p.pose.position.x, p.pose.position.y) for p in of.points])
    speed = np.array([p.longitudinal_velocity_mps for p in of.points])
    _check_speeds(speed, int(closest_points(xy, np.array([here])).segment[0]), place)
    try:
        full = convert(xy, speed, here, at_ms / 1000)
        return kernel.to_message(full) if excess(full) is None else _thinned(full, place)
    except kernel.TrajectoryError as error:
        raise MessageError(short(place, str(error))) from None


def timed_trajectory(of: AutowareTrajectory, place: str) -> Trajectory:
    """A trajectory with times, thinned only if it would not fit one frame.

    Raises MessageError as ``autoware.trajectory``, or if it cannot be thinned so far.
    """
    return _fitted(trajectory(of, place), place)


def _fitted(given: Trajectory, place: str) -> Trajectory:
    full = kernel.from_message(given)
    return given if excess(full) is None else _thinned(full, place)


def _check_speeds(speed: kernel.Floats, first: int, place: str) -> None:
    """Raise MessageError if KIN-1 cannot compute times from point ``first`` on."""
    if len(backward := np.flatnonzero(speed < 0)):
        where = f"{place}.points.{backward[0]}.longitudinal_velocity_mps"
        raise MessageError(short(where, f"must not be negative: {UNTIMED}"))
    moves = speed >= V_EPS
    if not moves.any():
        why = f"{UNTIMED}, and no longitudinal_velocity_mps is at least {V_EPS}"
        raise MessageError(short(f"{place}.points", why))
    if len(stops := np.flatnonzero(~moves[first:-1] & moves[first + 1 :])):
        where = f"{place}.points.{first + stops[0]}.longitudinal_velocity_mps"
        why = f"a stop (below {V_EPS}) before the end has no known duration: give time_from_start"
        raise MessageError(short(where, why))


def _thinned(full: kernel.Trajectory, place: str) -> Trajectory:
    try:
        return kernel.to_message(thin(full))
    except kernel.TrajectoryError as error:
        raise MessageError(short(place, str(error))) from None
