"""Positions along and across a road's centre line (a plain polyline).

A position has ``s``, the distance along the line, and ``d``, the distance to its left, both in m.
At ``d`` the line's parallel has mitred corners, so that to each (s, d) within ``reach`` there is
one place: the projection and its inverse are exact on polylines, and continuous.  Beyond both ends
the road goes straight on.
"""

from __future__ import annotations

from bisect import bisect_right
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from automcm.kernels.trajectory import NANOMETRE, Floats, TrajectoryError, number, path

REACH_M = 20.0
"""Positions further to the side are not on the road, m."""
APART_M = 1e-6
"""Two positions of one place that differ by more (m) make it ambiguous."""
BLOCK = 16
"""Segments that are looked at only if a place is near their middle."""
CHUNK = 1 << 12
"""Places that are projected at a time, so that the temporary arrays fit in the cache."""


@dataclass(frozen=True, slots=True, eq=False)
class Projected:
    """The positions of m places, each (m,): ``s`` and ``d``, m; the ``heading`` of the road there,
    rad; ``scale``: metres driven at ``d`` for one of ``s``.

    A place beyond the reach has a ``d`` of infinity; an ambiguous one has NaN, as where the road
    comes back to itself.  Their other values are NaN.
    """

    s: Floats
    d: Floats
    heading: Floats
    scale: Floats


class RoadLine:
    """A centre line through the points ``xy``, (n, 2), m.

    Raises TrajectoryError for fewer than two points, two that are the same in a row, or a bend that
    is too sharp for ``reach``, so that the sides would overlap, or of a right angle.
    """

    def __init__(self, xy: ArrayLike, reach: float = REACH_M) -> None:
        self.xy = path("xy", xy, 2)
        self.reach = number("reach", reach, 0, above=True)
        step = np.diff(self.xy, axis=0)
        self._length = np.hypot(step[:, 0], step[:, 1])
        short = np.flatnonzero(self._length <= NANOMETRE)
        if len(short):
            raise TrajectoryError("xy", "repeats the point before it", int(short[0]) + 1)
        self._unit = step / self._length[:, None]
        ux, uy = self._unit[:, 0], self._unit[:, 1]
        sin = ux[:-1] * uy[1:] - uy[:-1] * ux[1:]
        cos = ux[:-1] * ux[1:] + uy[:-1] * uy[1:]
        half = np.concatenate([[0.0], sin / (1 + np.maximum(cos, 0)), [0.0]])
        # At d, a segment begins this times d later; and is this times d longer.
        self._later, self._longer = half[:-1], -half[1:] - half[:-1]
        bends = self._length <= self.reach * np.abs(self._longer)
        bends[:-1] |= cos <= 0
        sharp = np.flatnonzero(bends)
        if len(sharp):
            why = f"the road bends too sharply for a reach of {self.reach:g} m"
            raise TrajectoryError("xy", why, int(sharp[0]))
        self._s = np.concatenate([[0.0], np.cumsum(self._length)])
        self._heading = np.arctan2(uy, ux)
        self.length = float(self._s[-1])
        """m."""
        # Blocks of segments: their middles, and the square of the distance from there within which
        # a place may be on one of them.  The ends go on for ever.
        begins = np.arange(0, len(step), BLOCK)
        ends = np.minimum(begins + BLOCK, len(step))
        self._middles = (self.xy[begins] + self.xy[ends]) / 2
        half_way = (self._s[ends] - self._s[begins]) / 2
        self._near = np.square(half_way + self.reach * np.hypot(1, np.abs(half).max()))
        self._near[[0, -1]] = np.inf
        self._starts: list[float] = self._s[:-1].tolist()
        columns = (*self.xy[:-1].T, ux, uy, self._heading, self._length, self._later, self._longer)
        self._rows = list(zip(*(column.tolist() for column in columns), strict=True))

    def place(self, s: ArrayLike, d: ArrayLike) -> Floats:
        """The places, (m, 2), of these positions, (m,)."""
        along, aside = np.broadcast_arrays(np.asarray(s, float), np.asarray(d, float))
        k = np.clip(self._s.searchsorted(along, side="right") - 1, 0, len(self._length) - 1)
        t = along - self._s[k]
        share = np.clip(t / self._length[k], 0, 1)
        t = t + aside * (self._later[k] + share * self._longer[k])
        u = self._unit[k]
        x = self.xy[k, 0] + t * u[:, 0] - aside * u[:, 1]
        return np.stack([x, self.xy[k, 1] + t * u[:, 1] + aside * u[:, 0]], axis=1)

    def pose(self, s: float, d: float) -> tuple[float, float, float]:
        """The place of one position, and the heading of the road there: ``place``, without numpy's
        overhead."""
        k = max(bisect_right(self._starts, s) - 1, 0)
        x, y, ux, uy, heading, length, later, longer = self._rows[k]
        t = s - self._starts[k]
        t += d * (later + min(max(t / length, 0.0), 1.0) * longer)
        return x + t * ux - d * uy, y + t * uy + d * ux, heading

    def scale(self, s: float, d: float) -> float:
        """Metres driven at ``d`` for one of ``s``."""
        if not 0 <= s < self.length:
            return 1.0
        *_, length, _, longer = self._rows[bisect_right(self._starts, s) - 1]
        return float(1.0 + d * longer / length)

    def project(self, xy: ArrayLike) -> Projected:
        """The positions of these places, (m, 2)."""
        points = path("xy", xy, 0)
        found = np.full((4, len(points)), np.nan)
        found[1] = np.inf
        for begin in range(0, len(points), CHUNK):
            self._project(points[begin : begin + CHUNK], found[:, begin : begin + CHUNK])
        return Projected(*found)

    def _project(self, points: Floats, found: Floats) -> None:
        x, y = (points[:, axis, None] - self._middles[:, axis] for axis in (0, 1))
        point, block = np.nonzero(x * x + y * y <= self._near)
        last = len(self._length) - 1
        k = block[:, None] * BLOCK + np.arange(BLOCK)
        point = np.repeat(point, BLOCK)[k.ravel() <= last]
        k = k[k <= last]
        x, y = points[point, 0] - self.xy[k, 0], points[point, 1] - self.xy[k, 1]
        ux, uy = self._unit[k, 0], self._unit[k, 1]
        t, d = x * ux + y * uy, y * ux - x * uy
        length = self._length[k] + d * self._longer[k]
        way = t - d * self._later[k]  # from 0 to ``length`` in the segment's cell
        begins, ends = (way >= -NANOMETRE) | (k == 0), (way <= length + NANOMETRE) | (k == last)
        here = np.flatnonzero(begins & ends & (np.abs(d) <= self.reach))
        point, k, t, d, way, length = (each[here] for each in (point, k, t, d, way, length))
        s = self._s[k] + np.clip(way / length, 0, 1) * self._length[k]
        s = np.where(((k == 0) & (way < 0)) | ((k == last) & (way > length)), self._s[k] + t, s)
        scale = np.where((s >= 0) & (s < self.length), length / self._length[k], 1.0)
        on, first, count = np.unique(point, return_index=True, return_counts=True)
        found[:, on] = s[first], d[first], self._heading[k[first]], scale[first]
        twice = np.abs(s[first + count - 1] - s[first]) > APART_M
        found[:, on[twice]] = np.nan

    def parallel(self, d: float) -> RoadLine:
        """The line at ``d``, whose ``s`` are metres driven there.

        Raises TrajectoryError if ``d`` is not within the reach.
        """
        if not abs(d) < self.reach:
            raise TrajectoryError("d", f"{d} m is not within the reach of {self.reach:g} m")
        return RoadLine(self.place(self._s, d), self.reach - abs(d))

    def zone(self, right: float, left: float, begin: float, end: float) -> Floats:
        """The polygon, (m, 2), of all positions from ``begin`` to ``end`` (s) and from ``right`` to
        ``left`` (d)."""
        s = np.concatenate([[begin], self._s[(self._s > begin) & (self._s < end)], [end]])
        return np.concatenate([self.place(s, right), self.place(s[::-1], left)])
