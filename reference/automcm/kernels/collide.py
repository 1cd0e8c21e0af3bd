"""KIN-3: the closest approach of two trajectories, also between samples (V-B).

Between two samples both vehicles move with constant velocity, so the position of a relative to b is
d_0 + s·w with w = d_1 - d_0 and s from 0 to 1.  The distance is least at s = -(d_0·w)/(w·w),
clipped to 0 and 1.
"""

from __future__ import annotations

import math
import threading
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from automcm.kernels.trajectory import NANOMETRE, Floats, Trajectory, TrajectoryError, array, number

ROUNDING = 1e-12
"""Relative tolerance: batched kernels ignore a smaller reduction between samples."""
CHUNK_BYTES = 1 << 18
"""Size of a temporary array in the batched kernels, so that all five fit in the cache."""

Place = tuple[float, float]


@dataclass(frozen=True, slots=True)
class Approach:
    """The closest approach of two: time in s, distance in m, and both positions then."""

    time: float
    distance: float
    place_a: Place
    place_b: Place


@dataclass(frozen=True, slots=True)
class Collision:
    """The first ``time`` (s) at which the distance falls below ``threshold`` (m, inflated by the
    clock error), the places of both then, and the closest approach."""

    time: float
    threshold: float
    place_a: Place
    place_b: Place
    approach: Approach


@dataclass(frozen=True, slots=True, eq=False)
class Approaches:
    """The closest approaches of p pairs: ``time`` (p,), s; ``distance`` (p,), m."""

    time: Floats
    distance: Floats

    def __len__(self) -> int:
        return len(self.time)


# -- the equation


def least_share(x0: Floats, y0: Floats, x1: Floats, y1: Floats) -> tuple[Floats, Floats]:
    """The least distance in each interval, from the relative positions at its ends: s and the
    squared distance.

    If the two move less than a nanometre relative to each other, s is 0.
    """
    wx, wy = x1 - x0, y1 - y0
    square = wx * wx + wy * wy
    moving = square > NANOMETRE**2
    share = (x0 * wx + y0 * wy) / np.where(moving, -square, 1)
    share = np.minimum(np.maximum(share, 0), 1) * moving
    x, y = x0 + share * wx, y0 + share * wy
    return share, x * x + y * y


def tie(square: Floats) -> Floats:
    """Squared distances up to this value count as equal to the least, ``square``."""
    limit: Floats = np.square(np.sqrt(square) + NANOMETRE)
    return limit


# -- one pair


@dataclass(frozen=True, slots=True, eq=False)
class Relative:
    """Two trajectories on the union of their time grids; x and y are a minus b."""

    t: Floats
    a: tuple[Floats, Floats]
    b: tuple[Floats, Floats]
    x: Floats
    y: Floats

    def at(self, i: int, share: float) -> tuple[float, Place, Place]:
        """Time and positions at ``share`` of interval i."""

        def between(of: Floats) -> float:
            return float(of[i] + share * (of[i + 1] - of[i]))

        (ax, ay), (bx, by) = self.a, self.b
        return between(self.t), (between(ax), between(ay)), (between(bx), between(by))


def common_time(a: Trajectory, b: Trajectory) -> tuple[float, float] | None:
    """The time range (s) in which both are known, or None.

    A stopped trajectory is known for ever; if both are, the range ends when both stand.
    """
    start = max(a.t[0], b.t[0])
    if a.stopped and b.stopped:
        end = max(a.t[-1], b.t[-1])
    else:
        end = min(each.t[-1] for each in (a, b) if not each.stopped)
    return (float(start), float(end)) if start <= end else None


def relative(a: Trajectory, b: Trajectory) -> Relative | None:
    """Both over their common times; None without one."""
    common = common_time(a, b)
    if common is None:
        return None
    t = np.concatenate([a.t, b.t])
    t.sort()
    t = np.minimum(np.maximum(t, common[0]), common[1])
    at_a = np.interp(t, a.t, a.xy[:, 0]), np.interp(t, a.t, a.xy[:, 1])
    at_b = np.interp(t, b.t, b.xy[:, 0]), np.interp(t, b.t, b.xy[:, 1])
    return Relative(t, at_a, at_b, at_a[0] - at_b[0], at_a[1] - at_b[1])


def _approach(pair: Relative, share: Floats, square: Floats) -> Approach:
    least = square.min()
    i = int((square <= tie(least)).argmax())
    time, place_a, place_b = pair.at(i, float(share[i]))
    return Approach(time, math.sqrt(least), place_a, place_b)


def closest_approach(a: Trajectory, b: Trajectory) -> Approach | None:
    """The least distance over the common times, and the first time of it (KIN-3).

    Distances that differ by no more than a nanometre are equal.  None without a common time.  Open
    in the paper: "the distance at each time" of two trajectories with different sample times; here
    the union of the two grids, and the minimum between samples in closed form.
    """
    pair = relative(a, b)
    if pair is None:
        return None
    return _approach(pair, *least_share(pair.x[:-1], pair.y[:-1], pair.x[1:], pair.y[1:]))


def collision(
    a: Trajectory,
    b: Trajectory,
    threshold: float,
    *,
    clock_error: float = 0.0,
    speed: float | None = None,
) -> Collision | None:
    """The first time at which the distance, centre to centre, is below ``threshold`` + v·ε (KIN-3).

    ``threshold``: m.  ``clock_error``: ε, s, of each of the two clocks.  ``speed``: v, m/s; if
    None, the greatest speed of a plus the greatest of b, because each position is uncertain by its
    speed times ε.  A distance equal to the threshold is not a collision.  Times outside of the
    common range are not checked; the clock error does not widen it.

    Open in the paper: the value and the reference points of the threshold, and clocks.
    Raises TrajectoryError for a negative or infinite threshold, clock error or speed.
    """
    number("threshold", threshold, 0)
    number("clock_error", clock_error, 0)
    if speed is None:
        speed = sum(float(each.speeds().max(initial=0)) for each in (a, b)) if clock_error else 0.0
    limit = float(threshold) + number("speed", speed, 0) * clock_error
    pair = relative(a, b)
    if pair is None:
        return None
    x, y = pair.x, pair.y
    share, square = least_share(x[:-1], y[:-1], x[1:], y[1:])
    below = square < limit * limit
    i = int(below.argmax())
    if not below[i]:
        return None
    since = falls(x[i], y[i], x[i + 1] - x[i], y[i + 1] - y[i], limit)
    time, place_a, place_b = pair.at(i, since)
    return Collision(time, limit, place_a, place_b, _approach(pair, share, square))


def falls(x: float, y: float, wx: float, wy: float, limit: float) -> float:
    """The smaller s with |d + s·w| = limit, for an interval in which the distance falls below it;
    0 if it is below from the start.  The formula avoids cancellation."""
    a, b, c = wx * wx + wy * wy, x * wx + y * wy, x * x + y * y - limit * limit
    if c <= 0:
        return 0.0
    return float(min(c / (math.sqrt(max(b * b - a * c, 0.0)) - b), 1.0))


# -- many pairs


def closest_approach_pairs(t: ArrayLike, xy_a: ArrayLike, xy_b: ArrayLike) -> Approaches:
    """``closest_approach`` of p pairs with common times: ``t`` (n,), s, increasing; ``xy_a`` and
    ``xy_b`` (p, n, 2), m.  Many pairs at a time, as many as stay within the cache.

    Raises TrajectoryError for bad shapes, times that do not increase, or the first entry that is
    not finite or beyond LIMIT.
    """
    times = array("t", t, 1)
    if len(times) == 0 or (np.diff(times) <= 0).any():
        raise TrajectoryError("t", "must have at least one point, and each after the one before")
    a, b = (np.asarray(xy, dtype=np.float64) for xy in (xy_a, xy_b))
    for name, xy in (("xy_a", a), ("xy_b", b)):
        if xy.ndim != 3 or xy.shape[1:] != (len(times), 2):
            raise TrajectoryError(name, f"must have shape (pairs, {len(times)}, 2), not {xy.shape}")
    if len(a) != len(b):
        raise TrajectoryError("xy_b", f"must have {len(a)} pairs, not {len(b)}")
    key, square = np.empty(len(a)), np.empty(len(a))
    for rows in _chunks(len(a), len(times)):
        x, y, *spare = _work(rows.stop - rows.start, len(times))
        np.subtract(a[rows, :, 0], b[rows, :, 0], out=x)
        np.subtract(a[rows, :, 1], b[rows, :, 1], out=y)
        if not math.isfinite(x.sum() + y.sum()):  # true if any entry is not finite
            _refuse(a[rows], b[rows], rows.start)
        key[rows], square[rows] = _least(x, y, *spare)
    return Approaches(np.interp(key, np.arange(len(times)), times), np.sqrt(square))


def closest_approach_many(a: Trajectory, others: Sequence[Trajectory]) -> list[Approach | None]:
    """``closest_approach(a, b)`` for each b of ``others``, with any times."""
    common = [common_time(a, b) for b in others]
    met = [n for n, times in enumerate(common) if times is not None]
    found: list[Approach | None] = [None] * len(others)
    longest = max((len(others[n]) for n in met), default=0)
    for rows in _chunks(len(met), len(a) + longest):
        part = met[rows]
        start, end = np.array([common[n] for n in part])[:, :, None].transpose(1, 0, 2)
        t = np.full((len(part), len(a) + longest), np.inf)
        t[:, : len(a)] = a.t
        for row, n in zip(t, part, strict=True):
            row[len(a) : len(a) + len(others[n])] = others[n].t
        t.sort(axis=1)
        t = np.minimum(np.maximum(t, start), end)
        ax, ay = np.interp(t, a.t, a.xy[:, 0]), np.interp(t, a.t, a.xy[:, 1])
        bx, by = np.empty_like(t), np.empty_like(t)
        for k, n in enumerate(part):
            b = others[n]
            bx[k], by[k] = np.interp(t[k], b.t, b.xy[:, 0]), np.interp(t[k], b.t, b.xy[:, 1])
        key, square = _least(ax - bx, ay - by, *_work(*t.shape)[2:])
        i = np.minimum(key.astype(np.intp), t.shape[1] - 2)
        row, share = np.arange(len(part)), key - i
        when, ax, ay, bx, by = (
            of[row, i] + share * (of[row, i + 1] - of[row, i]) for of in (t, ax, ay, bx, by)
        )
        columns = (each.tolist() for each in (when, np.sqrt(square), ax, ay, bx, by))
        for n, (time, distance, *places) in zip(part, zip(*columns, strict=True), strict=True):
            found[n] = Approach(time, distance, (places[0], places[1]), (places[2], places[3]))
    return found


def _refuse(a: Floats, b: Floats, before: int) -> None:
    """Raises TrajectoryError for the first entry that is not finite."""
    for name, xy in (("xy_a", a), ("xy_b", b)):
        for pair, sample, axis in np.argwhere(~np.isfinite(xy))[:1]:
            raise TrajectoryError(name, "not a finite number", before + pair, sample, axis)


def _least(
    x: Floats, y: Floats, square: Floats, bound: Floats, product: Floats
) -> tuple[Floats, Floats]:
    """Relative places (rows, n): of each row where the distance is least first, as a number of
    samples and a share of the next interval; and its square.  The other arrays are overwritten.

    The distance is least at a sample or between two.  Between two its square is at least
    (min(d_0·d_0, d_1·d_1) + d_0·d_1) / 2, so few intervals are left for the equation.
    """
    rows, n = np.arange(len(x)), x.shape[1]
    np.multiply(x, x, out=square)
    square += np.multiply(y, y, out=product)
    least = square[rows, square.argmin(axis=1)]

    # All rows as one array, which is several times as fast as row by row; the step from the last
    # sample of a row to the first of the next is not an interval.
    line_x, line_y, line = x.reshape(-1), y.reshape(-1), square.reshape(-1)
    along, other = bound.reshape(-1)[:-1], product.reshape(-1)[:-1]
    np.multiply(line_x[:-1], line_x[1:], out=along)
    along += np.multiply(line_y[:-1], line_y[1:], out=other)
    along += np.minimum(line[:-1], line[1:], out=other)
    bound[:, -1] = np.inf
    i = np.flatnonzero(bound < ((2 - ROUNDING) * least)[:, None])
    share, between = least_share(line_x[i], line_y[i], line_x[i + 1], line_y[i + 1])
    row = i // n
    np.minimum.at(least, row, between)

    limit = tie(least)
    near = square <= limit[:, None]
    first = near.argmax(axis=1)
    key = np.where(near[rows, first], first, np.inf)
    close = between <= limit[row]
    np.minimum.at(key, row[close], (i - row * n + share)[close])
    return key, least


class _Work(threading.local):
    """The temporary arrays of each thread, reused because new memory costs more than the
    arithmetic."""

    block = np.empty(0)


_WORK = _Work()


def _work(rows: int, n: int) -> Floats:
    """Five uninitialized arrays (rows, n), valid until the next call in this thread."""
    if _WORK.block.size < 5 * rows * n:
        _WORK.block = np.empty(5 * rows * n)
    return _WORK.block[: 5 * rows * n].reshape(5, rows, n)


def _chunks(rows: int, n: int) -> Iterator[slice]:
    """Slices of rows of n numbers with CHUNK_BYTES each."""
    step = max(1, CHUNK_BYTES // (8 * n))
    for begin in range(0, rows, step):
        yield slice(begin, min(begin + step, rows))
