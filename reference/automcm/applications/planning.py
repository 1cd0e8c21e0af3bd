"""The trajectories of a vehicle on the road: planned, received, and judged."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from automcm.applications.prediction import Neighbour
from automcm.applications.vehicle import Vehicle
from automcm.kernels.convert import convert
from automcm.kernels.thin import thin
from automcm.kernels.trajectory import Floats, Trajectory, TrajectoryError, from_message, to_message
from automcm.kernels.verify import Limits, Reason, verify
from automcm_spec.vocabulary import messages

MOST_POINTS = 500
"""Maximum points of a received trajectory; thinning more would exceed the time to decide."""
OF_IT = (Reason.EXPIRED, Reason.PATH)
"""Reasons that are checked on the trajectory as it was received."""
LIMITS = Limits(acceleration=3.0, deceleration=3.0, v_max=130 / 3.6)
"""Limits that allow a step of Table I's 20 km/h, down and up again."""


def planned(vehicle: Vehicle, now_ms: int) -> Trajectory:
    """The vehicle's trajectory without coordination: its path as positions over time (KIN-1)."""
    xy, speed = vehicle.path()
    return convert(xy, speed, xy[0], now_ms / 1000)


def intention(vehicle: Vehicle, now_ms: int) -> messages.Trajectory:
    """The planned trajectory for a message, thinned (KIN-2)."""
    return to_message(thin(planned(vehicle, now_ms)))


def read(what: str, trajectory: messages.Trajectory) -> Trajectory:
    """A received trajectory.

    Raises TrajectoryError, which names ``what``, if it is invalid or has more than MOST_POINTS.
    """
    if len(trajectory.points) > MOST_POINTS:
        raise TrajectoryError(what, f"more than {MOST_POINTS} points")
    try:
        return from_message(trajectory)
    except TrajectoryError as error:
        raise TrajectoryError(what, str(error)) from None


def along(path: Trajectory, prescribed: Trajectory, now: float) -> Trajectory:
    """The speeds of ``prescribed`` from ``now`` (s) on, along ``path`` from its first place."""
    ways, whole = prescribed.arc(), path.arc()
    kept = ways <= whole[-1]
    xy = np.stack([np.interp(ways[kept], whole, path.xy[:, axis]) for axis in (0, 1)], axis=1)
    t = prescribed.t[kept] - prescribed.t[0] + now
    return Trajectory(t, xy, prescribed.stopped and bool(kept.all()))


Around = Callable[[Trajectory], tuple[Neighbour | None, Neighbour | None]]
"""The vehicles ahead and behind, given the trajectory that the vehicle would drive (KIN-6)."""


def nobody(prescribed: Trajectory) -> tuple[None, None]:
    """Neither is known."""
    return None, None


def judged(
    prescribed: Trajectory,
    intended: Trajectory,
    vehicle: Vehicle,
    now_ms: int,
    limits: Limits,
    around: Around = nobody,
) -> tuple[Trajectory, tuple[Reason, ...]]:
    """The received trajectory on the vehicle's own path from its present position, and the reasons
    not to drive it (NEG-2, KIN-6).

    Path and age are checked on the received trajectory, against the intended path.  The least gaps
    are those of ``around``, not of ``limits``.
    """
    now = now_ms / 1000
    alone = planned(vehicle, now_ms)
    anchored = along(alone, prescribed, now)
    received = verify(prescribed, intended, now, limits)
    leader, follower = around(anchored)
    limits = replace(
        limits,
        leader_gap=leader.apart if leader else 0.0,
        follower_gap=follower.apart if follower else 0.0,
    )
    own = verify(
        anchored,
        alone,
        now,
        limits,
        leader.trajectory if leader else None,
        follower.trajectory if follower else None,
    )
    return anchored, tuple(
        reason for reason in Reason if reason in (received if reason in OF_IT else own)
    )


def gained_at(planned: Trajectory, prescribed: Trajectory, gain: float) -> float:
    """The time in s at which ``prescribed`` has fallen ``gain`` m behind ``planned``."""
    times = prescribed.t[prescribed.t <= planned.t[-1]]
    behind = np.interp(times, planned.t, planned.arc()) - np.interp(
        times, prescribed.t, prescribed.arc()
    )
    return float(times[int(np.argmax(behind >= gain - 1e-3))])


def direction(trajectory: Trajectory) -> Floats:
    """The direction of travel at the beginning, shape (2,); (1, 0) for a standing vehicle."""
    if len(trajectory) < 2:
        return np.array([1.0, 0.0])
    step = trajectory.xy[1] - trajectory.xy[0]
    length = float(np.hypot(*step))
    ahead: Floats = step / length if length else np.array([1.0, 0.0])
    return ahead
