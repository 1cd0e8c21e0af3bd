"""Trajectories of the driving software: converted (KIN-1) and thinned (KIN-2) as they arrive."""

from __future__ import annotations

import numpy as np

from automcm.bridge.autoware import AutowareTrajectory, trajectory
from automcm.kernels import trajectory as kernel
from automcm.kernels.convert import V_EPS, closest_points, convert
from automcm.kernels.thin import excess, thin
from automcm.service.application import Kinematics
from automcm_spec.vocabulary.messages import MessageError, Trajectory, short


def own_trajectory(
    of: AutowareTrajectory, place: str, at: Kinematics | None, at_ms: int
) -> Trajectory:
    """The vehicle's own trajectory.  If all times are 0, they are computed from the speeds (KIN-1).

    ``at``: the vehicle's last kinematics, published at ``at_ms``, or None; the computed times begin
    there.  Raises MessageError, which names the field below ``place``.
    """
    if len(of.points) < 2 or any(p.time_from_start.ms for p in of.points):
        return timed_trajectory(of, place)
    if at is None:
        why = "every time_from_start is 0; without times, kinematics must be published first"
        raise MessageError(short(f"{place}.points", why))
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
    given = trajectory(of, place)
    full = kernel.from_message(given)
    return given if excess(full) is None else _thinned(full, place)


def _check_speeds(speed: kernel.Floats, first: int, place: str) -> None:
    """Raise MessageError if KIN-1 cannot compute times from point ``first`` on."""
    if len(backward := np.flatnonzero(speed < 0)):
        where = f"{place}.points.{backward[0]}.longitudinal_velocity_mps"
        raise MessageError(short(where, "must not be negative if every time_from_start is 0"))
    moves = speed >= V_EPS
    if not moves.any():
        why = f"every time_from_start is 0, and no longitudinal_velocity_mps is at least {V_EPS}"
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
