"""KIN-4: the target vehicle (V-D)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from automcm.kernels.trajectory import NANOMETRE, Floats, TrajectoryError, pair, path, whole


@dataclass(frozen=True, slots=True, eq=False)
class Candidate:
    """A vehicle with which there is a risk of collision.

    ``xy``: its place, (2,), m.  ``direction``: of its travel, (2,), of any length but 0.
    Raises TrajectoryError for other shapes, what is not finite, or a ``station_id`` below 1.
    """

    station_id: int
    xy: Floats
    direction: Floats

    def __post_init__(self) -> None:
        whole("station_id", self.station_id, 1)
        xy, direction = pair("xy", self.xy), pair("direction", self.direction)
        length = np.hypot(*direction)
        if length == 0:
            raise TrajectoryError("direction", "must not be 0, 0")
        direction /= length
        for name, value in (("xy", xy), ("direction", direction)):
            value.flags.writeable = False
            object.__setattr__(self, name, value)


def inside(points: ArrayLike, zone: ArrayLike) -> NDArray[np.bool_]:
    """Which ``points`` (p, 2) lie in the polygon ``zone`` (m, 2), both in m; shape (p,).

    The polygon may be concave, in either sense of rotation, closed (last corner the first) or
    not.  The boundary, a nanometre wide, counts as inside.  Of a polygon that crosses itself,
    which is not looked for, the inside is what a ray leaves an odd number of times.
    """
    of = path("points", points, 0)
    corners = path("zone", zone)
    if len(corners) > 1 and (corners[0] == corners[-1]).all():
        corners = corners[:-1]
    if len(corners) < 3:
        raise TrajectoryError("zone", f"must have at least 3 corners, not {len(corners)}")
    a, b = corners, np.roll(corners, -1, axis=0)
    px, py = of[:, :1], of[:, 1:]
    step = b - a
    square = (step * step).sum(axis=1)

    # Distance to each edge.
    dx, dy = px - a[:, 0], py - a[:, 1]
    share = np.clip((dx * step[:, 0] + dy * step[:, 1]) / np.where(square > 0, square, 1), 0, 1)
    off = np.hypot(dx - share * step[:, 0], dy - share * step[:, 1])
    on_edge = (off <= NANOMETRE).any(axis=1)

    # Edges that a ray towards greater x crosses.
    spans = (a[:, 1] > py) != (b[:, 1] > py)
    ahead = dx * step[:, 1] - dy * step[:, 0]
    crossed = spans & (np.where(step[:, 1] > 0, ahead, -ahead) < 0)
    odd = crossed.sum(axis=1) % 2 == 1
    return np.asarray(odd | on_edge)


def discover(candidates: Sequence[Candidate], zone: ArrayLike) -> int | None:
    """The ``station_id`` of the leader of the ``candidates`` within the target lane's ``zone``
    (KIN-4), or None if there is none: then there is no prescription.

    x_j is in front of x_i where n_i·(x_j - x_i) > 0, with n_i the direction of i.  The leader is
    the one with the fewest others in front of it; of several the one with the lowest
    ``station_id``.  In a lane in which all drive one way that is the foremost.

    Open in the paper: whose n (here: of the one that is judged), two abreast (the lower
    ``station_id``; a nanometre or less is abreast), directions that differ so much that each is in
    front of the other (the paper's loop would depend on the order; the count does not).

    O(n log n) if one has nobody in front of it.  Otherwise, as in a roundabout, each is compared
    with each.

    Raises TrajectoryError for a ``station_id`` given twice or a bad zone.
    """
    ids = [each.station_id for each in candidates]
    if len(set(ids)) < len(ids):
        twice = next(i for n, i in enumerate(ids) if i in ids[:n])
        raise TrajectoryError("candidates", f"station_id {twice} occurs twice")
    xy = np.array([each.xy for each in candidates]).reshape(-1, 2)
    n = np.array([each.direction for each in candidates]).reshape(-1, 2)
    here = sorted(np.flatnonzero(inside(xy, zone)), key=lambda i: ids[i])
    if not here:
        return None
    xy, n = xy[here], n[here]

    ahead = ((furthest(xy, n) - xy) * n).sum(axis=1)
    for k in np.flatnonzero(ahead <= NANOMETRE):
        if _in_front(xy, xy[k], n[k]) == 0:
            return ids[here[k]]
    return min((_in_front(xy, *each), ids[i]) for *each, i in zip(xy, n, here, strict=True))[1]


def _in_front(xy: Floats, of: Floats, direction: Floats) -> int:
    return int(((xy - of) @ direction > NANOMETRE).sum())


def furthest(points: Floats, directions: Floats) -> Floats:
    """Of ``points`` (p, 2) the one furthest along each of ``directions`` (d, 2), up to rounding:
    the corner of the convex hull between whose two edges it points.  O((p + d) log p)."""
    ascending = sorted(points.tolist())
    corners = ascending[:1]
    for way in (ascending[1:], ascending[-2::-1]):
        base = len(corners)
        for x, y in way:
            while len(corners) > base and _right(corners[-2], corners[-1], x, y):
                corners.pop()
            corners.append([x, y])
    hull = np.array(corners)
    edges = np.diff(hull, axis=0)
    outward = np.arctan2(0 - edges[:, 0], edges[:, 1])  # ascending from -pi
    towards = np.arctan2(directions[:, 1], directions[:, 0])
    found: Floats = hull[outward.searchsorted(towards)]
    return found


def _right(a: list[float], b: list[float], x: float, y: float) -> bool:
    """Whether (x, y) is to the right of the way from a to b, or on it."""
    return (b[0] - a[0]) * (y - a[1]) <= (b[1] - a[1]) * (x - a[0])
