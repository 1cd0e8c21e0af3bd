"""KIN-2: reduces a trajectory to the points that fit in one frame (V-C)."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from automcm.encoding.codec import FRAME_BYTES, JSON
from automcm.kernels.trajectory import (
    Floats,
    Trajectory,
    TrajectoryError,
    number,
    to_message,
    whole,
)
from automcm_spec.vocabulary import messages

POSITION = 0.1
"""The bound on the change of a position at the same time, m."""
SPEED = 0.1
"""The bound on the change of the speed at the same time, m/s."""

FIRST_GUESS = 32
"""How many points beyond the ends are tried first, then twice as many more."""

Indices = NDArray[np.intp]


class Deviation(NamedTuple):
    """The greatest differences of two trajectories at the same time."""

    position: float
    """m."""
    speed: float
    """m/s."""


def prescription_bytes(trajectory: Trajectory) -> int:
    """The bytes of a Prescription, the longest message with a trajectory, in JSON with long ids.

    Raises TrajectoryError if a message cannot carry it (``to_message``).
    """
    car, number = 2**32 - 1, 2**32 - 1
    prescription = messages.Prescription(
        src=car,
        dst=car,
        session=(car, number),
        seq=number,
        proposal=99,
        prescribed=to_message(trajectory),
        hold_ms=10**6,
        lease_ms=10**6,
    )
    try:
        return len(JSON.encode(prescription))
    except messages.MessageError as error:
        raise TrajectoryError("trajectory", str(error)) from None


def thin(
    trajectory: Trajectory,
    budget: int = FRAME_BYTES,
    size: Callable[[Trajectory], int] = prescription_bytes,
    position: float = POSITION,
    speed: float = SPEED,
) -> Trajectory:
    """Some of its points, of at most ``budget`` bytes, with which at each time the position changes
    by at most ``position`` (m) and the speed by at most ``speed`` (m/s) (KIN-2).

    The first and the last point stay.  A part beyond the bound is split at the sample that it
    misses most (Douglas-Peucker at equal times).  The parts of a level are split together, and in
    the middle after 2·log2(n) levels: O(n log n).  If the budget does not allow the bound, the
    points whose loss costs most stay; ``deviation`` gives the error.  ``size`` must grow with the
    points.

    A sample that rounds to the same millisecond as the one before it is left out (the one before
    the last, if the last does): no message can carry both.

    Raises TrajectoryError for a negative budget, a bound of 0 or less, or if not even the first and
    the last point fit.
    """
    whole("budget", budget, 0)
    number("position", position, 0, above=True)
    number("speed", speed, 0, above=True)
    trajectory = pick(trajectory, _one_per_ms(trajectory.t))
    ranked = _ranked(trajectory, position, speed)
    ends = min(2, len(trajectory))

    def first(count: int) -> Trajectory:
        return pick(trajectory, np.sort(ranked[:count]))

    thinned = first(ends)
    problem = excess(thinned, budget, size)
    if problem is not None:
        raise TrajectoryError("budget", f"too small for the required points ({ends}): {problem}")
    fits, exceeds, more = ends, len(ranked) + 1, FIRST_GUESS
    while exceeds - fits > 1:
        count = min(fits + more, exceeds - 1) if more else (fits + exceeds) // 2
        tried = first(count)
        if excess(tried, budget, size) is None:
            fits, thinned, more = count, tried, 2 * more
        else:
            exceeds, more = count, 0
    return thinned


def pick(trajectory: Trajectory, kept: Indices) -> Trajectory:
    """Only these samples."""
    return Trajectory(trajectory.t[kept], trajectory.xy[kept], trajectory.stopped)


def deviation(full: Trajectory, thinned: Trajectory) -> Deviation:
    """How far the two differ at the same time, where ``thinned`` has some of the samples of
    ``full``, with the first and the last.

    Both move evenly between the samples of ``full``, so the greatest distance is at one of them;
    a closest approach to any third trajectory changes by no more than this.
    """
    off = full.xy - thinned.at(full.t)
    part = np.searchsorted(thinned.t, full.t[:-1], side="right") - 1
    faster = np.abs(full.speeds() - thinned.speeds()[part])
    return Deviation(float(np.hypot(off[:, 0], off[:, 1]).max()), float(faster.max(initial=0)))


def _one_per_ms(t: Floats) -> Indices:
    """The first sample of each millisecond, but the last sample of the last millisecond."""
    first = np.unique(np.rint(t * 1000), return_index=True)[1]
    return np.union1d(first[:-1], [0, len(t) - 1])


def excess(
    trajectory: Trajectory,
    budget: int = FRAME_BYTES,
    size: Callable[[Trajectory], int] = prescription_bytes,
) -> str | None:
    """Why a message cannot carry it in ``budget`` bytes; None if it can."""
    try:
        bytes_ = size(trajectory)
    except TrajectoryError as error:
        return str(error)
    return f"{bytes_} bytes, the budget is {budget}" if bytes_ > budget else None


def _ranked(trajectory: Trajectory, position: float, speed: float) -> Indices:
    """The ends, then the samples that the bound requires, the one that reduces the error most
    first."""
    t, xy, v = trajectory.t, trajectory.xy, trajectory.speeds()
    last = len(t) - 1
    if last < 1:
        return np.zeros(1, np.intp)
    splits: list[Indices] = []
    errors: list[Floats] = []
    begin, end, before = np.array([0]), np.array([last]), np.array([np.inf])
    for level in range(last):
        # The samples of all parts in one array, without the last of each.
        counts = end - begin
        starts = np.concatenate([[0], np.cumsum(counts)[:-1]])
        part = np.repeat(np.arange(len(begin)), counts)
        k = np.arange(len(part)) + (begin - starts)[part]
        span, step = t[end] - t[begin], xy[end] - xy[begin]
        share = (t[k] - t[begin][part]) / span[part]
        off = xy[k] - xy[begin][part] - share[:, None] * step[part]
        away = np.hypot(off[:, 0], off[:, 1])
        faster = np.abs(v[k] - (np.hypot(step[:, 0], step[:, 1]) / span)[part])
        furthest = np.maximum.reduceat(away, starts)
        error = np.maximum(furthest / position, np.maximum.reduceat(faster, starts) / speed)
        split = np.minimum.reduceat(np.where(away == furthest[part], k, last), starts)
        if level > 2 * np.log2(last):
            split = (begin + end) // 2
        # Rounding alone can make a part of two samples, or an even one, miss the bound.
        wide = (error > 1) & (begin < split) & (split < end)
        begin, end, split = begin[wide], end[wide], split[wide]
        error = np.minimum(error[wide], before[wide])
        if len(split) == 0:
            break
        splits.append(split)
        errors.append(error)
        begin, end = np.concatenate([begin, split]), np.concatenate([split, end])
        before = np.concatenate([error, error])
    if not splits:
        return np.array([0, last])
    order = np.argsort(-np.concatenate(errors), kind="stable")
    return np.concatenate([[0, last], np.concatenate(splits)[order]])
