"""The cost of the trajectory kernels, each figure with its peers measured in the same run.

Times are CPU times, the best of several repetitions, in microseconds, for batched kernels per pair.
``floor`` is a copy of the bytes that must at least be read, in the same arrays.  shapely and pycrcc
solve a simpler problem: the STRtree has no time, and pycrcc, and both for rectangles, only check
time steps.  docs/kernels.md discusses the results.
"""

from __future__ import annotations

import importlib
import math
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from functools import partial
from typing import Any

import numpy as np

from automcm.kernels.collide import (
    closest_approach,
    closest_approach_many,
    closest_approach_pairs,
    collision,
)
from automcm.kernels.convert import closest_points, convert
from automcm.kernels.discover import Candidate, discover
from automcm.kernels.extents import Extent, clearance
from automcm.kernels.prescribe import prescribe
from automcm.kernels.road_line import RoadLine
from automcm.kernels.thin import thin
from automcm.kernels.trajectory import Floats, Trajectory
from automcm.kernels.verify import Limits, verify
from automcm_maintenance.benches.core_bench import best_us
from automcm_simulation.radio import success

POINTS = (50, 100, 500, 1000, 10_000)
PAIRS = (1, 256, 4096)
PLACES = 100
"""Places that are projected onto a road's line at a time."""
MOST_SAMPLES = 2**21
"""Greater batches would take longer than all the others."""
PEERS = ("numpy", "python", "shapely", "pycrcc")
DISCS = ("clearance", "clearance_lorry")
MEASURED, MEASURED_OF_PAIRS = 40, 9
"""How many times are measured for each number of points, and for each number of pairs above 1."""
QUADRATIC = 1000
"""Peers that compare each point with each are not measured beyond: it takes a minute."""
THRESHOLD = 4.0
CAR, LORRY = Extent(4.5, 1.8), Extent(16.5, 2.55)
SPEED = 30 / 3.6
ZONE = ((-1e4, -2.0), (1e4, -2.0), (1e4, 2.0), (-1e4, 2.0))

Call = Callable[[], object]


@dataclass(frozen=True, slots=True)
class KernelRow:
    """One kernel on ``points`` points and ``pairs`` pairs, in µs per pair.

    A peer that does not support the problem, or is not installed, is None.
    """

    kernel: str
    points: int
    pairs: int
    us: float
    floor_us: float
    numpy_us: float | None
    """The cheapest formulation of the problem in numpy, without checks."""
    python_us: float | None
    shapely_us: float | None
    pycrcc_us: float | None

    @property
    def to_floor(self) -> float:
        """The ratio to the floor."""
        return self.us / self.floor_us

    @property
    def ahead(self) -> dict[str, float]:
        """The ratio of each peer's time to the kernel's."""
        peers = {name: getattr(self, f"{name}_us") for name in PEERS}
        return {name: us / self.us for name, us in peers.items() if us is not None}


@dataclass(frozen=True, slots=True)
class KernelFigures:
    """All figures of one run."""

    rows: tuple[KernelRow, ...]
    missing: dict[str, str]
    """Why a peer could not be imported."""

    @property
    def discs_to_points(self) -> dict[int, dict[str, float]]:
        """By number of points, the ratio of ``clearance`` of two cars, and of a lorry and a car, to
        ``closest_approach``."""
        us = {(row.points, row.kernel): row.us for row in self.rows}
        return {
            n: {name: us[n, name] / us[n, "closest_approach"] for name in DISCS}
            for n in sorted({row.points for row in self.rows})
        }

    def as_dict(self) -> dict[str, Any]:
        """The report for ``--json``."""
        rows = [{**asdict(r), "to_floor": r.to_floor, "ahead": r.ahead} for r in self.rows]
        return {
            "rows": rows,
            "discs_to_points": self.discs_to_points,
            "missing": list(self.missing),
            "reasons": self.missing,
        }


def run(
    seconds: float = 60.0,
    points: Sequence[int] = POINTS,
    pairs: Sequence[int] = PAIRS,
    notify: Callable[[str], None] = lambda text: None,
) -> KernelFigures:
    """Measure all figures in about ``seconds``."""
    peers: dict[str, Any] = {}
    missing: dict[str, str] = {}
    for name in ("shapely", "commonroad_dc.pycrcc"):
        try:
            peers[name] = importlib.import_module(name)
        except ImportError as error:
            peers[name], missing[name] = None, str(error)
    each = seconds / (len(points) * (MEASURED + MEASURED_OF_PAIRS * (len(pairs) - 1)))
    rows: list[KernelRow] = []
    for n in points:
        notify(f"{n} points")
        rows += [*_kernels(n, each, peers["shapely"]), *_single(n, each, peers)]
        rows.append(_project(n, each, peers["shapely"]))
        for count in pairs:
            if count > 1 and count * n <= MOST_SAMPLES:
                notify(f"{n} points, {count} pairs")
                rows += _batched(n, count, each, peers)
    return KernelFigures(tuple(rows), missing)


def _copy_us(arrays: Sequence[Floats], seconds: float, count: int = 1) -> float:
    kept = [np.empty_like(each) for each in arrays]

    def copy() -> None:
        for to, each in zip(kept, arrays, strict=True):
            np.copyto(to, each)

    return best_us(copy, seconds, count)


# -- inputs


def road(n: int, ahead: float = 0.0, aside: float = 0.0, speed: float = SPEED) -> Trajectory:
    """n points 5 m apart on a slightly curved road."""
    x = np.arange(0.0, 5 * n, 5)
    xy = np.stack([x + ahead, aside + 3 * np.sin(x / 60)], axis=1)
    return Trajectory(x / speed, xy)


def traffic(n: int, pairs: int) -> tuple[Floats, Floats, Floats]:
    """Times (n,), and positions (pairs, n, 2) of cars in two lanes at 20 to 50 km/h."""
    rng = np.random.default_rng(0)
    t = np.arange(0.0, n) * 0.6
    sides = []
    for aside in (0.0, 3.5):
        start, speed = rng.uniform(-50, 50, (pairs, 1)), rng.uniform(5.5, 14, (pairs, 1))
        phase = rng.uniform(0, 6, (pairs, 1))
        sides.append(np.stack([start + speed * t, aside + np.sin(t / 9 + phase)], axis=2))
    return t, sides[0], sides[1]


# -- kernels of one vehicle


def _kernels(n: int, seconds: float, shapely: Any) -> list[KernelRow]:
    plan, speed = road(n), np.full(n, SPEED)
    times, places, speeds = plan.t.tolist(), plan.xy.tolist(), speed.tolist()
    here, hold, gain = (1.0, 1.0), 1.0, 5.0
    prescribed = prescribe(plan, 1.0, hold=hold, gain=gain)
    rng = np.random.default_rng(0)
    way = np.cumsum(5 + 0.6 * rng.standard_normal(n))
    noisy = Trajectory(plan.t, np.stack([way, 3 * np.sin(way / 60)], axis=1))
    cars = [
        Candidate(i + 1, np.array(xy), np.array([1.0, 0.0]))
        for i, xy in enumerate(rng.uniform(-3, 3, (n, 2)))
    ]
    losses, limits = np.linspace(0, 1, n), Limits()
    path = [plan.t, plan.xy]

    lines = [shapely.LineString(each.xy) for each in (plan, noisy, prescribed)] if shapely else []
    near = shapely.Point(here) if shapely else None
    zone = shapely.Polygon(ZONE) if shapely else None
    crowd = np.array([each.xy for each in cars]).T

    def row(
        name: str,
        read: Sequence[Floats],
        call: Call,
        python: Call | None,
        geos: Call | None = None,
    ) -> KernelRow:
        us, floor = best_us(call, seconds), _copy_us(read, seconds / 3)
        loop = best_us(python, seconds) if python else None
        peer = best_us(geos, seconds) if geos and shapely else None
        return KernelRow(name, n, 1, us, floor, None, loop, peer, None)

    return [
        row(
            "convert",
            [plan.xy, speed],
            lambda: convert(plan.xy, speed, here, 0.0),
            lambda: _python_convert(places, speeds, here),
            lambda: lines[0].project(near),  # the closest point only
        ),
        row(
            "thin",
            path,
            lambda: thin(plan, 10**6, len),
            lambda: _python_thin(times, places),
            lambda: lines[0].simplify(0.1),  # in the plane, without times
        ),
        row(
            "thin_noisy",
            path,
            lambda: thin(noisy),
            lambda: _python_thin(times, noisy.xy.tolist()),
            lambda: lines[1].simplify(0.1),
        ),
        row(
            "discover",
            [np.array([each.xy for each in cars])],
            lambda: discover(cars, ZONE),
            lambda: _python_discover(cars),
            lambda: shapely.contains_xy(zone, *crowd),  # the zone only
        ),
        row(
            "prescribe",
            path,
            lambda: prescribe(plan, 1.0, hold=hold, gain=gain),
            lambda: _python_prescribe(times, places, 1.0, hold, gain),
        ),
        row(
            "verify",
            [*path, prescribed.t, prescribed.xy],
            lambda: verify(prescribed, plan, 1.5, limits, None, None),
            (lambda: _python_follows(prescribed.xy.tolist(), places)) if n <= QUADRATIC else None,
            # the path only
            (lambda: shapely.hausdorff_distance(lines[0], lines[2])) if n <= QUADRATIC else None,
        ),
        row(
            "success",
            [losses],
            lambda: success.session(losses, 21),
            lambda: [(1 - (1 - (1 - x) ** 2) ** 21) ** 3 for x in losses.tolist()],
        ),
    ]


# -- kernels of two vehicles


def _single(n: int, seconds: float, peers: dict[str, Any]) -> list[KernelRow]:
    a = road(n)
    b = road(n, ahead=-20.0, aside=3.5, speed=SPEED * 1.07)
    rows_a, rows_b = ([(t, *xy) for t, xy in zip(each.t.tolist(), each.xy.tolist(), strict=True)]
                      for each in (a, b))  # fmt: skip
    floor = _copy_us([a.t, a.xy, b.t, b.xy], seconds / 3)
    cheap = best_us(lambda: _cheapest(a, b), seconds)
    python = best_us(lambda: _python_approach(rows_a, rows_b), seconds)
    shapely, crcc = peers["shapely"], peers["commonroad_dc.pycrcc"]
    tree = best_us(_tree(shapely, [a.xy], [b.xy]), seconds) if shapely else None
    steps = 0.6 * np.arange(n)
    at = [np.stack([np.interp(steps, e.t, e.xy[:, k]) for k in (0, 1)], axis=1) for e in (a, b)]
    circles = best_us(_circles(crcc, at[0][None], at[1][None]), seconds) if crcc else None
    points = [
        KernelRow(name, n, 1, best_us(call, seconds), floor, cheap, python, tree, circles)
        for name, call in (
            ("closest_approach", lambda: closest_approach(a, b)),
            ("collision", lambda: collision(a, b, THRESHOLD)),
        )
    ]
    discs = []
    for name, first in zip(DISCS, (CAR, LORRY), strict=True):
        us = best_us(partial(clearance, a, b, first, CAR, 0.5), seconds)
        boxes = best_us(_boxes(crcc, at, (first, CAR)), seconds) if crcc else None
        areas = best_us(_areas(shapely, at, (first, CAR)), seconds) if shapely else None
        discs.append(KernelRow(name, n, 1, us, floor, cheap, None, areas, boxes))
    return points + discs


def _project(n: int, seconds: float, shapely: Any) -> KernelRow:
    """Places on a road's line, µs for each; the peers find the nearest point of the line."""
    line = RoadLine(road(n).xy)
    places = line.place(np.linspace(0, line.length, PLACES), 2.0)
    us = best_us(lambda: line.project(places), seconds, PLACES)
    floor = _copy_us([line.xy, places], seconds / 3, PLACES)
    nearest = best_us(lambda: closest_points(line.xy, places), seconds, PLACES)
    peer = None
    if shapely:
        geo, points = shapely.LineString(line.xy), shapely.points(places)
        peer = best_us(lambda: shapely.line_locate_point(geo, points), seconds, PLACES)
    return KernelRow("project", n, PLACES, us, floor, nearest, None, peer, None)


def _batched(n: int, pairs: int, seconds: float, peers: dict[str, Any]) -> list[KernelRow]:
    t, a, b = traffic(n, pairs)
    some = min(pairs, 16)  # fewer for slow peers, whose cost per pair is constant
    floor = _copy_us([a, b], seconds, pairs)
    times = t.tolist()
    lists = [
        [[(s, *xy) for s, xy in zip(times, way, strict=True)] for way in side[:some].tolist()]
        for side in (a, b)
    ]

    def loop() -> None:
        for one, other in zip(*lists, strict=True):
            _python_approach(one, other)

    shapely, crcc = peers["shapely"], peers["commonroad_dc.pycrcc"]
    tree = best_us(_tree(shapely, a[:some], b[:some]), seconds, some) if shapely else None
    circles = best_us(_circles(crcc, a, b), seconds, pairs) if crcc else None
    python = best_us(loop, seconds, some)
    aligned = best_us(lambda: closest_approach_pairs(t, a, b), seconds, pairs)
    dense = best_us(lambda: _dense(a, b), seconds, pairs)
    rows = [KernelRow("pairs", n, pairs, aligned, floor, dense, python, tree, circles)]
    if pairs <= 256:
        ego = Trajectory(t, a[0])
        others = [Trajectory(t + 0.01 * k, xy) for k, xy in enumerate(b)]
        cheap = best_us(lambda: [_cheapest(ego, each) for each in others[:some]], seconds, some)
        many = best_us(lambda: closest_approach_many(ego, others), seconds, pairs)
        rows.append(KernelRow("many", n, pairs, many, floor, cheap, python, tree, None))
    return rows


# -- peers


def _cheapest(a: Trajectory, b: Trajectory) -> float:
    """The least distance of two trajectories, by a quadratic equation on their united times."""
    start, end = max(a.t[0], b.t[0]), min(a.t[-1], b.t[-1])
    t = np.concatenate([a.t, b.t])
    t.sort()
    t = t[t.searchsorted(start) : t.searchsorted(end, side="right")]
    x = np.interp(t, a.t, a.xy[:, 0]) - np.interp(t, b.t, b.xy[:, 0])
    y = np.interp(t, a.t, a.xy[:, 1]) - np.interp(t, b.t, b.xy[:, 1])
    return math.sqrt(_dense_squares(x, y).min())


def _dense_squares(x: Floats, y: Floats) -> Floats:
    x0, y0 = x[..., :-1], y[..., :-1]
    wx, wy = x[..., 1:] - x0, y[..., 1:] - y0
    s = np.clip(-(x0 * wx + y0 * wy) / (wx * wx + wy * wy + 1e-300), 0, 1)
    squares: Floats = (x0 + s * wx) ** 2 + (y0 + s * wy) ** 2
    return squares


def _dense(a: Floats, b: Floats) -> Floats:
    """The equation for every interval of every pair, vectorized."""
    d = a - b
    least: Floats = np.sqrt(_dense_squares(d[..., 0], d[..., 1]).min(axis=1))
    return least


def _python_approach(
    a: Sequence[tuple[float, float, float]], b: Sequence[tuple[float, float, float]]
) -> tuple[float, float]:
    """A loop along both trajectories; the least distance and its time."""
    start, end = max(a[0][0], b[0][0]), min(a[-1][0], b[-1][0])
    i = j = 0
    best, when = math.inf, start
    t0, x0, y0, first = start, 0.0, 0.0, True
    while True:
        while i < len(a) - 2 and a[i + 1][0] <= t0:
            i += 1
        while j < len(b) - 2 and b[j + 1][0] <= t0:
            j += 1
        (ta, xa, ya), (ua, va, wa) = a[i], a[i + 1]
        (tb, xb, yb), (ub, vb, wb) = b[j], b[j + 1]
        t1 = t0 if first else min(ua, ub, end)
        p, q = (t1 - ta) / (ua - ta), (t1 - tb) / (ub - tb)
        x1 = xa + p * (va - xa) - xb - q * (vb - xb)
        y1 = ya + p * (wa - ya) - yb - q * (wb - yb)
        if first:
            x0, y0, first = x1, y1, False
            best = x0 * x0 + y0 * y0
            continue
        wx, wy = x1 - x0, y1 - y0
        square = wx * wx + wy * wy
        s = min(max(-(x0 * wx + y0 * wy) / square, 0.0), 1.0) if square else 0.0
        d = (x0 + s * wx) ** 2 + (y0 + s * wy) ** 2
        if d < best:
            best, when = d, t0 + s * (t1 - t0)
        if t1 >= end:
            return math.sqrt(best), when
        t0, x0, y0 = t1, x1, y1


def _tree(shapely: Any, a: Sequence[Floats] | Floats, b: Sequence[Floats] | Floats) -> Call:
    """An STRtree of the segments of all b, queried for those within the threshold of each a."""

    def segments(ways: Sequence[Floats] | Floats) -> Any:
        ends = np.concatenate([np.stack([way[:-1], way[1:]], axis=1) for way in ways])
        return shapely.linestrings(ends)

    def call() -> object:
        if len(a) == 1:
            return shapely.STRtree(segments(b)).query(segments(a), "dwithin", THRESHOLD)
        return [
            shapely.STRtree(segments(one)).query(segments(other), "dwithin", THRESHOLD)
            for one, other in zip(np.asarray(a)[:, None], np.asarray(b)[:, None], strict=True)
        ]

    return call


def _circles(pycrcc: Any, a: Floats, b: Floats) -> Call:
    """Two circles at each time step; only the collision check is timed."""

    def moving(way: Floats) -> Any:
        made = pycrcc.TimeVariantCollisionObject(0)
        for x, y in way.tolist():
            made.append_obstacle(pycrcc.Circle(THRESHOLD / 2, x, y))
        return made

    both = [(moving(one), moving(other)) for one, other in zip(a[:256], b[:256], strict=True)]
    times = max(1, len(a) // len(both))

    def call() -> None:
        for _ in range(times):
            for one, other in both:
                one.collide(other)

    return call


def _headings(way: Floats) -> Floats:
    step_x, step_y = np.gradient(way, axis=0).T
    angles: Floats = np.arctan2(step_y, step_x)
    return angles


def _boxes(pycrcc: Any, ways: Sequence[Floats], extents: Sequence[Extent]) -> Call:
    """Two rectangles at each time step; only the collision check is timed."""
    one, other = (pycrcc.TimeVariantCollisionObject(0) for _ in ways)
    for made, way, size in zip((one, other), ways, extents, strict=True):
        for (x, y), angle in zip(way.tolist(), _headings(way).tolist(), strict=True):
            made.append_obstacle(pycrcc.RectOBB(size.length / 2, size.width / 2, angle, x, y))
    return lambda: one.collide(other)


def _areas(shapely: Any, ways: Sequence[Floats], extents: Sequence[Extent]) -> Call:
    """The distance of two rectangles at each time step; only the distance is timed."""

    def rectangles(way: Floats, size: Extent) -> Any:
        ahead = np.exp(1j * _headings(way))[:, None]
        corners = np.array([1 + 1j, 1 - 1j, -1 - 1j, -1 + 1j])
        corners = corners.real * size.length / 2 + 1j * corners.imag * size.width / 2
        places = (way[:, 0] + 1j * way[:, 1])[:, None] + ahead * corners
        return shapely.polygons(np.stack([places.real, places.imag], axis=2))

    one, other = map(rectangles, ways, extents)
    return lambda: shapely.distance(one, other).min()


def _python_convert(
    xy: list[list[float]], v: list[float], here: tuple[float, float]
) -> list[tuple[float, float, float]]:
    best, k, foot = math.inf, 0, (0.0, 0.0)
    for n in range(len(xy) - 1):
        (ax, ay), (bx, by) = xy[n], xy[n + 1]
        dx, dy = bx - ax, by - ay
        square = dx * dx + dy * dy
        s = ((here[0] - ax) * dx + (here[1] - ay) * dy) / square if square else 0.0
        s = min(max(s, 0.0), 1.0)
        x, y = ax + s * dx, ay + s * dy
        d = math.hypot(here[0] - x, here[1] - y)
        if d < best:
            best, k, foot = d, n, (x, y)
    t, (x, y) = 0.0, foot
    made = [(t, x, y)]
    while k < len(xy) - 1 and v[k] > 0.1:
        t += math.hypot(xy[k + 1][0] - x, xy[k + 1][1] - y) / v[k]
        x, y = xy[k + 1]
        k += 1
        made.append((t, x, y))
    return made


def _python_thin(t: list[float], xy: list[list[float]]) -> list[int]:
    """Douglas-Peucker at equal times, with a stack; of the bounds only that of the position."""
    kept, parts = {0, len(t) - 1}, [(0, len(t) - 1)]
    while parts:
        a, b = parts.pop()
        worst, at = 0.1, a
        for k in range(a + 1, b):
            s = (t[k] - t[a]) / (t[b] - t[a])
            x, y = (xy[a][i] + s * (xy[b][i] - xy[a][i]) for i in (0, 1))
            away = math.hypot(xy[k][0] - x, xy[k][1] - y)
            if away > worst:
                worst, at = away, k
        if at > a:
            kept.add(at)
            parts += [(a, at), (at, b)]
    return sorted(kept)


def _python_discover(cars: Sequence[Candidate]) -> int:
    best, leader = -math.inf, 0
    for each in cars:
        x, y = each.xy
        crossed = False
        for k in range(len(ZONE)):
            (ax, ay), (bx, by) = ZONE[k - 1], ZONE[k]
            if (ay > y) != (by > y) and x < ax + (y - ay) * (bx - ax) / (by - ay):
                crossed = not crossed
        ahead = x * each.direction[0] + y * each.direction[1]
        if crossed and ahead > best:
            best, leader = ahead, each.station_id
    return leader


def _python_prescribe(
    t: list[float], xy: list[list[float]], start: float, hold: float, gain: float
) -> list[tuple[float, float]]:
    """Times and distances only, without positions on the path."""
    made, gained, way = [], 0.0, 0.0
    for k in range(len(t) - 1):
        span = t[k + 1] - t[k]
        step = math.dist(xy[k], xy[k + 1])
        if t[k] >= start + hold:
            gained = min(gain, gained + min(20 / 3.6, step / span - 1) * span)
        way += step
        made.append((t[k + 1], way - gained))
    return made


def _python_follows(a: list[list[float]], b: list[list[float]]) -> float:
    """The greatest distance of a sample of a from the path b, without the other checks."""
    worst = 0.0
    for x, y in a:
        best = math.inf
        for k in range(len(b) - 1):
            (ax, ay), (bx, by) = b[k], b[k + 1]
            dx, dy = bx - ax, by - ay
            s = min(max(((x - ax) * dx + (y - ay) * dy) / (dx * dx + dy * dy), 0.0), 1.0)
            best = min(best, (x - ax - s * dx) ** 2 + (y - ay - s * dy) ** 2)
        worst = max(worst, best)
    return math.sqrt(worst)
