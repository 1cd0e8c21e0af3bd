"""KIN-2: reduces a trajectory to the points that fit in one frame (V-C)."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from automcm.encoding.codec import FRAME_BYTES, JSON
from automcm.kernels.trajectory import Floats, Trajectory, TrajectoryError, to_message, whole
from automcm_spec.vocabulary import messages

EVERY = 5
"""The paper: thinned to a fifth."""
CHANGE = 0.01
"""A speed changes if it differs by more than this share of the greater one."""

Indices = NDArray[np.intp]


def intention_bytes(trajectory: Trajectory) -> int:
    """The bytes of an Intention with this trajectory in JSON and the longest ids.

    Raises TrajectoryError if a message cannot carry it (``to_message``).
    """
    car, number = 2**32 - 1, 2**32 - 1
    intention = messages.Intention(
        src=car, dst=car, session=(car, number), seq=number, planned=to_message(trajectory)
    )
    try:
        return len(JSON.encode(intention))
    except messages.MessageError as error:
        raise TrajectoryError(f"trajectory: {error}") from None


def changes(trajectory: Trajectory) -> Indices:
    """The points at which the speed changes by more than CHANGE, indices in order."""
    v = trajectory.speeds()
    return np.flatnonzero(np.abs(np.diff(v)) > CHANGE * np.maximum(v[1:], v[:-1])) + 1


def thin(
    trajectory: Trajectory,
    budget: int = FRAME_BYTES,
    size: Callable[[Trajectory], int] = intention_bytes,
    every: int = EVERY,
) -> Trajectory:
    """Every 5th point, the first, the last and each change of speed, of at most ``budget`` bytes
    (KIN-2).

    A sample that rounds to the same millisecond as the one kept before it is left out (the one
    before the last, if the last does): no message can carry both.  If ``size(thinned) > budget``,
    or ``size`` raises TrajectoryError, the step grows by one until only the first, the last and the
    changes of speed are left; then the changes go too, always the one without which the places move
    least (the earliest on a tie).  ``size`` is asked each time, so any codec will do.

    Open in the paper: which points, before or after the conversion (here: after it), and what to
    do if a fifth does not fit.  ``deviation`` gives the resulting error.

    Raises TrajectoryError for a negative budget, ``every`` below 1, or if not even the first and
    the last point fit.
    """
    whole("budget", budget, 0)
    every = whole("every", every, 1)
    trajectory = pick(trajectory, _one_per_ms(trajectory.t))
    last = len(trajectory) - 1
    fixed = np.union1d(changes(trajectory), [0, last])
    before = -1
    for step in range(every, last):
        kept = np.union1d(fixed, np.arange(0, last, step))
        if len(kept) != before:
            before = len(kept)
            thinned = pick(trajectory, kept)
            if _excess(thinned, budget, size) is None:
                return thinned
    kept = fixed
    while True:
        thinned = pick(trajectory, kept)
        problem = _excess(thinned, budget, size)
        if problem is None:
            return thinned
        if len(kept) <= 2:
            raise TrajectoryError(
                f"budget: too small for the required points ({len(kept)}): {problem}"
            )
        kept = np.delete(kept, 1 + int(np.argmin(_effects(thinned))))


def pick(trajectory: Trajectory, kept: Indices) -> Trajectory:
    """Only these samples."""
    return Trajectory(trajectory.t[kept], trajectory.xy[kept], trajectory.stopped)


def deviation(full: Trajectory, thinned: Trajectory) -> float:
    """The greatest distance, m, between the two at the same time, where ``thinned`` has some of the
    samples of ``full``.

    Both move evenly between the samples of ``full``, so the greatest distance is at one of them;
    a closest approach to any third trajectory changes by no more than this.
    """
    off = full.xy - thinned.at(full.t)
    return float(np.hypot(off[:, 0], off[:, 1]).max())


def _one_per_ms(t: Floats) -> Indices:
    """The first sample of each millisecond, but the last sample of the last millisecond."""
    first = np.unique(np.rint(t * 1000), return_index=True)[1]
    return np.union1d(first[:-1], [0, len(t) - 1])


def _excess(thinned: Trajectory, budget: int, size: Callable[[Trajectory], int]) -> str | None:
    try:
        bytes_ = size(thinned)
    except TrajectoryError as error:
        return str(error)
    return f"{bytes_} bytes, the budget is {budget}" if bytes_ > budget else None


def _effects(trajectory: Trajectory) -> Floats:
    """The distance, m, of each inner sample from the linear motion between its neighbours."""
    t, xy = trajectory.t, trajectory.xy
    share = ((t[1:-1] - t[:-2]) / (t[2:] - t[:-2]))[:, None]
    off = xy[1:-1] - (xy[:-2] + share * (xy[2:] - xy[:-2]))
    return np.hypot(off[:, 0], off[:, 1])
