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
from numpy.typing import NDArray

from automcm.kernels.collide import relative, tie
from automcm.kernels.trajectory import NANOMETRE, Floats, Trajectory, number

Complex = NDArray[np.complex128]


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
    # Complex numbers, turned so that the relative motion of an interval is along the real axis.
    place = pair.x + 1j * pair.y
    motion = place[1:] - place[:-1]
    way = np.abs(motion)
    still = way <= NANOMETRE
    turn = motion.conj() / (way + still)
    turn[still], way[still] = 1, 0
    middle = place[:-1] * turn
    # A pair of discs is at most this much nearer than the middles, and one of them at most this
    # much further apart.
    nearer = discs_a.offsets[-1] + discs_b.offsets[-1]
    further = discs_a.inmost + discs_b.inmost
    square = _squares(middle, way)
    within = max(math.sqrt(square.min()) + further, limit) + nearer + NANOMETRE
    i = np.flatnonzero(square <= within * within)

    t, turn, way = pair.t[i], turn[i], way[i]
    off_a = np.multiply.outer(discs_a.offsets, _directions(a, t) * turn)
    off_b = np.multiply.outer(discs_b.offsets, _directions(b, t) * turn)
    apart = ((off_a + middle[i])[:, None] - off_b).reshape(-1, len(i))
    along, aside = apart.real, apart.imag
    square = _squares(apart, way)
    least = square.min()
    near = square <= tie(least)

    k = int(near.any(axis=0).argmax())
    gone = np.minimum(np.maximum(-along[near[:, k], k], 0), way[k])
    time, _, _ = pair.at(int(i[k]), float(gone.min() / (way[k] or 1)))
    since = None
    below = square < limit * limit
    if below.any():
        k = int(below.any(axis=0).argmax())
        enters = -along[below[:, k], k] - np.sqrt(limit * limit - aside[below[:, k], k] ** 2)
        since, _, _ = pair.at(int(i[k]), max(float(enters.min()), 0) / (way[k] or 1))
    return Clearance(time, math.sqrt(least) - radii, since)


def _squares(apart: Complex, way: Floats) -> Floats:
    """The least squared distance in each interval, at whose begin they are ``apart``."""
    along, aside = apart.real, apart.imag
    beyond = np.maximum(np.maximum(along, -way - along), 0)
    square: Floats = beyond * beyond + aside * aside
    return square


def discs(of: Trajectory, extent: Extent) -> Cover:
    """The discs of a vehicle: ``cover``, or one around it if it never moves."""
    (x0, y0), (x1, y1) = of.xy[0].tolist(), of.xy[-1].tolist()
    moves = math.hypot(x1 - x0, y1 - y0) > NANOMETRE or of.arc()[-1] > NANOMETRE
    return cover(extent, None if moves else 1)


def _directions(of: Trajectory, t: Floats) -> Complex:
    """Its direction from each of these times on, complex numbers of length 1; any direction if it
    never moves."""
    place = of.xy[:, 0] + 1j * of.xy[:, 1]
    steps = place[1:] - place[:-1]
    segment = np.minimum(of.t[1:].searchsorted(t, side="right"), len(steps) - 1)
    length = np.abs(steps)
    if length.min(initial=np.inf) <= NANOMETRE or len(steps) == 0:
        moving = np.flatnonzero(length > NANOMETRE)
        if len(moving) == 0:
            return np.ones(len(t), np.complex128)
        segment = moving[np.maximum(moving.searchsorted(segment, side="right") - 1, 0)]
    directions: Complex = steps[segment] / length[segment]
    return directions
