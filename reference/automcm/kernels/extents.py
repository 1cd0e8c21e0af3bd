"""KIN-3 for vehicles with a length and a width: rectangles, covered by discs.

The discs lie on the axis of the vehicle, which points along its motion.  Between two samples all
discs move straight and evenly, so the closed form for points holds for each pair of discs.  At a
sample of its own a vehicle turns at once, and counts with both headings.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from automcm.kernels.collide import falls, least_share, relative, tie
from automcm.kernels.trajectory import NANOMETRE, Floats, Trajectory, number


@dataclass(frozen=True, slots=True)
class Extent:
    """The length and the width of a vehicle, m; its position is the middle.

    Raises TrajectoryError unless both are above 0.
    """

    length: float
    width: float

    def __post_init__(self) -> None:
        number("length", self.length, 0, above=True)
        number("width", self.width, 0, above=True)


@dataclass(frozen=True, slots=True)
class Cover:
    """Discs of one ``radius`` (m) that cover a rectangle.

    ``offsets``: of their centres from its middle along its axis, m, ascending.  ``error``: the
    greatest distance of a point of a disc from the rectangle, m.
    """

    offsets: tuple[float, ...]
    radius: float
    error: float

    @property
    def inmost(self) -> float:
        """The least distance of a disc's centre from the middle, m."""
        return abs(self.offsets[len(self.offsets) // 2])


@dataclass(frozen=True, slots=True)
class Clearance:
    """The least distance (m) of two vehicles' discs, negative if they overlap, and its first time
    (s); ``since``: when it first falls below the margin, or None."""

    time: float
    distance: float
    since: float | None


@lru_cache(maxsize=256)
def cover(extent: Extent, parts: int | None = None) -> Cover:
    """``parts`` equal parts of the length, each with the disc around it; without ``parts`` so many
    that no part is longer than it is wide.

    Then the error is at most 0.5 width: each disc reaches beyond the side by less than 0.21 width,
    and beyond the end by less than half the width.
    """
    count = parts or math.ceil(extent.length / extent.width)
    half, side = extent.length / count / 2, extent.width / 2
    radius = math.hypot(half, side)
    offsets = tuple(half * (2 * n + 1 - count) for n in range(count))
    return Cover(offsets, radius, radius - min(half, side))


def clearance(
    a: Trajectory, b: Trajectory, extent_a: Extent, extent_b: Extent, margin: float = 0.0
) -> Clearance | None:
    """The clearance of two vehicles over their common times; None without one (KIN-3).

    ``margin``: m; a clearance that equals it is not below it.  The rectangles are at least as far
    apart as the discs, and further by at most both errors (``cover``).  A standing vehicle keeps
    its heading, or has the one with which it moves off; one that never moves has none, and is one
    disc around its rectangle.  Distances within a nanometre are equal.

    Raises TrajectoryError for a negative margin.
    """
    number("margin", margin, 0)
    pair = relative(a, b)
    if pair is None:
        return None
    discs_a, discs_b = discs(a, extent_a), discs(b, extent_b)
    radii = discs_a.radius + discs_b.radius
    limit = margin + radii
    _, middle = least_share(pair.x[:-1], pair.y[:-1], pair.x[1:], pair.y[1:])
    # A pair of discs is at most this much nearer than the middles, and one of them at most this
    # much further apart.
    nearer = discs_a.offsets[-1] + discs_b.offsets[-1]
    further = discs_a.inmost + discs_b.inmost
    within = max(math.sqrt(middle.min()) + further, limit) + nearer + NANOMETRE
    i = np.flatnonzero(middle <= within * within)

    x, y = pair.x[i], pair.y[i]
    wx, wy = pair.x[i + 1] - x, pair.y[i + 1] - y
    t = pair.t[i]
    off_a = np.multiply.outer(discs_a.offsets, _directions(a, t))
    off_b = np.multiply.outer(discs_b.offsets, _directions(b, t))
    off = (off_a[:, None] - off_b).reshape(-1, 2, len(i))
    x, y = x + off[:, 0], y + off[:, 1]
    share, square = least_share(x, y, x + wx, y + wy)
    least = square.min()
    near = square <= tie(least)
    k = int(near.any(axis=0).argmax())
    time, _, _ = pair.at(int(i[k]), float(share[near[:, k], k].min()))
    since = None
    if least < limit * limit:
        k = int((square < limit * limit).any(axis=0).argmax())
        begins = (
            falls(x[d, k], y[d, k], wx[k], wy[k], limit)
            for d in np.flatnonzero(square[:, k] < limit * limit)
        )
        since, _, _ = pair.at(int(i[k]), min(begins))
    return Clearance(time, math.sqrt(least) - radii, since)


def discs(of: Trajectory, extent: Extent) -> Cover:
    """The discs of a vehicle: ``cover``, or one around it if it never moves."""
    moves = math.dist(of.xy[0], of.xy[-1]) > NANOMETRE or of.arc()[-1] > NANOMETRE
    return cover(extent, None if moves else 1)


def _directions(of: Trajectory, t: Floats) -> Floats:
    """Its direction from each of these times on, unit vectors, (2, n); 0 if it never moves."""
    segment = np.minimum(of.t.searchsorted(t, side="right"), max(len(of) - 1, 1)) - 1
    x, y = of.xy[:, 0], of.xy[:, 1]
    after = np.minimum(segment + 1, len(of) - 1)
    step_x, step_y = x[after] - x[segment], y[after] - y[segment]
    length = np.hypot(step_x, step_y)
    if length.min() <= NANOMETRE:
        moving = np.flatnonzero(np.diff(of.arc()) > NANOMETRE)
        if len(moving) == 0:
            return np.zeros((2, len(t)))
        segment = moving[np.maximum(moving.searchsorted(segment, side="right") - 1, 0)]
        step_x, step_y = x[segment + 1] - x[segment], y[segment + 1] - y[segment]
        length = np.hypot(step_x, step_y)
    return np.array([step_x / length, step_y / length])
