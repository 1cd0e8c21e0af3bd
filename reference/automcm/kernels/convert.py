"""KIN-1: a path with speeds as positions over time (V-C, Eq. 1)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from automcm.kernels.trajectory import (
    NANOMETRE,
    Floats,
    Trajectory,
    TrajectoryError,
    array,
    number,
    pair,
    path,
)

V_EPS = 0.1
"""A vehicle stands below this speed, m/s (the paper divides by any speed)."""


@dataclass(frozen=True, slots=True)
class ClosestPoints:
    """The closest points of a polyline to m points.

    ``segment`` (m,): the foot lies on segment k, from point k to k + 1, and not at its end; so
    n - 1 stands for the last point.  ``place`` (m, 2), m.  ``distance`` (m,), m.
    """

    segment: NDArray[np.intp]
    place: Floats
    distance: Floats


def closest_points(
    xy: Floats, points: Floats, among: NDArray[np.intp] | None = None
) -> ClosestPoints:
    """Closest point of the polyline ``xy`` (n, 2) to each of ``points`` (m, 2); not checked.

    Of two that are equally close (within a nanometre) the earlier one; a foot within a nanometre
    of a vertex is the vertex.  ``among``: only these segments, in order, at least one.
    """
    if len(xy) == 1:
        away = points - xy
        first = np.zeros(len(points), np.intp)
        return ClosestPoints(first, xy[first], np.hypot(away[:, 0], away[:, 1]))
    if among is None:
        a, step = xy[:-1], np.diff(xy, axis=0)
    else:
        a = xy[among]
        step = xy[among + 1] - a
    length = np.hypot(step[:, 0], step[:, 1])
    away = points[:, None] - a
    dot = away[..., 0] * step[:, 0] + away[..., 1] * step[:, 1]
    share = np.clip(dot / np.where(length > 0, length**2, 1), 0, 1)
    share[share * length <= NANOMETRE] = 0
    share[(1 - share) * length <= NANOMETRE] = 1
    share[:, length == 0] = 0
    off_x = away[..., 0] - share * step[:, 0]
    off_y = away[..., 1] - share * step[:, 1]
    distance = np.hypot(off_x, off_y)
    k = (distance <= distance.min(axis=1)[:, None] + NANOMETRE).argmax(axis=1)
    of = np.arange(len(points))
    chosen = share[of, k]
    place = a[k] + chosen[:, None] * step[k]
    segment = k if among is None else among[k]
    at_end = chosen == 1
    place[at_end] = xy[segment[at_end] + 1]
    return ClosestPoints(segment + at_end, place, distance[of, k])


def convert(
    xy: ArrayLike, speed: ArrayLike, position: ArrayLike, t0: float, *, v_eps: float = V_EPS
) -> Trajectory:
    """t_n = t_0 + Σ_{k=1..n} |x_k - x_(k-1)| / v_(k-1)  (KIN-1; Eq. 1).

    ``xy``: path, (n, 2), m.  ``speed``: m/s at its points, (n,), not negative.  ``position``: of
    the vehicle, (2,), m.  ``t0``: now, s.  x_0 is the closest point of the path, the earlier one
    on a tie, and v_0 the speed of the path's point before it (or at it).  Points that repeat the
    one before them are left out, as are those whose time is not after the one before in double
    precision.

    Open in the paper: its sum starts at k = 0 and does not depend on k (read as above); x_0 is a
    point of the path, which may lie behind the vehicle (here: the projection); v = 0 divides by
    zero (here: at the first point whose speed is below ``v_eps`` the trajectory ends, ``stopped``).

    Raises TrajectoryError for bad shapes and numbers, a negative speed, ``v_eps`` of 0 or less.
    """
    points = path("xy", xy)
    v = array("speed", speed, 1)
    here = pair("position", position)
    begin = number("t0", t0)
    slow = number("v_eps", v_eps, 0, above=True)
    if len(v) != len(points):
        raise TrajectoryError("speed", f"must have shape ({len(points)},), not {v.shape}")
    if (v < 0).any():
        n = int(np.flatnonzero(v < 0)[0])
        raise TrajectoryError("speed", f"{v[n]} is negative", n)

    closest = closest_points(points, here[None])
    k = int(closest.segment[0])
    x, v = np.concatenate([closest.place, points[k + 1 :]]), v[k:]
    standing = np.flatnonzero(v < slow)
    stopped = len(standing) > 0
    if stopped:
        x, v = x[: standing[0] + 1], v[: standing[0] + 1]
    steps = np.diff(x, axis=0)
    with np.errstate(over="ignore"):
        times = np.cumsum(np.hypot(steps[:, 0], steps[:, 1]) / v[:-1])
        t = begin + np.concatenate([[0.0], times])
    later = np.ones(len(t), bool)
    later[1:] = ~(np.diff(t) <= 0)
    return Trajectory(t[later], x[later], stopped)
