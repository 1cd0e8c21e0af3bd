"""The cost of the trajectory kernels, each beside another way to compute the same.

Baselines are loops in Python, the cheapest formulation in numpy without checks, and shapely, whose
areas are only compared at time steps.  docs/kernels.md discusses
the results.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import partial
from typing import Any

import numpy as np
import pytest

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
from automcm_maintenance.benches.plugin import Timed, beside

POINTS = (50, 500, 1000, 10_000)
PAIRS = ((50, 256), (50, 4096), (500, 256), (500, 4096))
"""Points and pairs of the batched kernels."""
SOME = 16
"""Pairs for a baseline whose cost per pair is constant."""
PLACES = 100
"""Places that are projected onto a road's line at a time."""
THRESHOLD = 4.0
CAR, LORRY = Extent(4.5, 1.8), Extent(16.5, 2.55)
SPEED = 30 / 3.6
ZONE = ((-1e4, -2.0), (1e4, -2.0), (1e4, 2.0), (-1e4, 2.0))
HERE, HOLD, GAIN = (1.0, 1.0), 1.0, 5.0
Way = Sequence[tuple[float, float, float]]
points = pytest.mark.parametrize("n", POINTS)
pairs = pytest.mark.parametrize(("n", "pairs"), PAIRS)


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


def noisy(n: int) -> Trajectory:
    """The road with uneven steps."""
    way = np.cumsum(5 + 0.6 * np.random.default_rng(0).standard_normal(n))
    return Trajectory(road(n).t, np.stack([way, 3 * np.sin(way / 60)], axis=1))


def cars(n: int) -> list[Candidate]:
    """n vehicles around the origin."""
    places = np.random.default_rng(0).uniform(-3, 3, (n, 2))
    return [Candidate(i + 1, xy, np.array([1.0, 0.0])) for i, xy in enumerate(places)]


def two(n: int) -> tuple[Trajectory, Trajectory]:
    """A vehicle and a faster one behind it in the next lane."""
    return road(n), road(n, ahead=-20.0, aside=3.5, speed=SPEED * 1.07)


def rows(way: Trajectory) -> list[tuple[float, float, float]]:
    """Times and places as Python has them."""
    return [(t, *xy) for t, xy in zip(way.t.tolist(), way.xy.tolist(), strict=True)]


# -- kernels of one vehicle


@points
def bench_python_convert(n: int, timed: Timed) -> None:
    """A loop."""
    timed(partial(python_convert, road(n).xy.tolist(), [SPEED] * n, HERE))


@points
@beside("python_convert", 5)
def bench_convert(n: int, timed: Timed) -> None:
    """KIN-1."""
    timed(partial(convert, road(n).xy, np.full(n, SPEED), HERE, 0.0))


@points
def bench_python_thin(n: int, timed: Timed) -> None:
    """A loop."""
    timed(partial(python_thin, noisy(n).t.tolist(), noisy(n).xy.tolist()))


@points
@beside("python_thin", 6)
def bench_thin(n: int, timed: Timed) -> None:
    """KIN-2, with encoding."""
    timed(partial(thin, noisy(n)))


@points
def bench_python_discover(n: int, timed: Timed) -> None:
    """A loop."""
    timed(partial(python_discover, cars(n)))


@points
@beside("python_discover", 2)
def bench_discover(n: int, timed: Timed) -> None:
    """KIN-4."""
    timed(partial(discover, cars(n), ZONE))


@points
def bench_python_prescribe(n: int, timed: Timed) -> None:
    """A loop, without places."""
    timed(partial(python_prescribe, road(n).t.tolist(), road(n).xy.tolist(), 1.0, HOLD, GAIN))


@points
@beside("python_prescribe", 25)
def bench_prescribe(n: int, timed: Timed) -> None:
    """KIN-5."""
    timed(partial(prescribe, road(n), 1.0, hold=HOLD, gain=GAIN))


@points
@beside("prescribe", 4)
def bench_verify(n: int, timed: Timed) -> None:
    """KIN-6, of what was prescribed."""
    plan = road(n)
    prescribed = prescribe(plan, 1.0, hold=HOLD, gain=GAIN)
    timed(partial(verify, prescribed, plan, 1.5, Limits(), None, None))


@points
def bench_nearest(n: int, timed: Timed) -> None:
    """The nearest points of a line, without distances along it; µs a place, as below."""
    line = RoadLine(road(n).xy)
    places = line.place(np.linspace(0, line.length, PLACES), 2.0)
    timed(partial(closest_points, line.xy, places), per=PLACES)


@points
@beside("nearest", 2)
def bench_project(n: int, timed: Timed) -> None:
    """Places on a road's line."""
    line = RoadLine(road(n).xy)
    timed(partial(line.project, line.place(np.linspace(0, line.length, PLACES), 2.0)), per=PLACES)


# -- kernels of two vehicles


@points
def bench_python_approach(n: int, timed: Timed) -> None:
    """A loop along both."""
    timed(partial(python_approach, *map(rows, two(n))))


@points
def bench_cheapest(n: int, timed: Timed) -> None:
    """In numpy, without checks."""
    timed(partial(cheapest, *two(n)))


@points
@beside("cheapest", 4)
def bench_closest_approach(n: int, timed: Timed) -> None:
    """KIN-3."""
    timed(partial(closest_approach, *two(n)))


@points
@beside("python_approach", 0.8)
def bench_collision(n: int, timed: Timed) -> None:
    """KIN-3."""
    timed(partial(collision, *two(n), THRESHOLD))


@points
@pytest.mark.parametrize("first", [CAR, LORRY], ids=["car", "lorry"])
def bench_shapely_areas(n: int, first: Extent, timed: Timed) -> None:
    """The distance of two rectangles at each step only."""
    shapely = pytest.importorskip("shapely")
    one, other = (areas(shapely, way.xy, of) for way, of in zip(two(n), (first, CAR), strict=True))
    timed(lambda: shapely.distance(one, other).min())


@points
@pytest.mark.parametrize("first", [CAR, LORRY], ids=["car", "lorry"])
@beside("shapely_areas", 6)
def bench_clearance(n: int, first: Extent, timed: Timed) -> None:
    """Of discs along two vehicles."""
    timed(partial(clearance, *two(n), first, CAR, 0.5))


@pairs
def bench_dense(n: int, pairs: int, timed: Timed) -> None:
    """An equation for every interval of every pair; µs a pair, as below."""
    _, a, b = traffic(n, pairs)
    timed(partial(dense, a, b), per=pairs)


@pairs
@beside("dense", 2)
def bench_pairs(n: int, pairs: int, timed: Timed) -> None:
    """KIN-3 for many pairs at equal times."""
    timed(partial(closest_approach_pairs, *traffic(n, pairs)), per=pairs)


@pairs
def bench_cheapest_of_some(n: int, pairs: int, timed: Timed) -> None:
    """One after the other, without checks."""
    t, a, b = traffic(n, SOME)
    ego, others = Trajectory(t, a[0]), [Trajectory(t, xy) for xy in b]
    timed(lambda: [cheapest(ego, each) for each in others], per=SOME)


@pairs
@beside("cheapest_of_some", 2)
def bench_many(n: int, pairs: int, timed: Timed) -> None:
    """KIN-3 of one vehicle and many others."""
    if pairs > 256:
        pytest.skip("takes too long")
    t, a, b = traffic(n, pairs)
    others = [Trajectory(t + 0.01 * k, xy) for k, xy in enumerate(b)]
    timed(partial(closest_approach_many, Trajectory(t, a[0]), others), per=pairs)


# -- baselines


def cheapest(a: Trajectory, b: Trajectory) -> float:
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


def dense(a: Floats, b: Floats) -> Floats:
    """The equation for every interval of every pair, vectorized."""
    d = a - b
    least: Floats = np.sqrt(_dense_squares(d[..., 0], d[..., 1]).min(axis=1))
    return least


def python_approach(
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


def areas(shapely: Any, way: Floats, size: Extent) -> Any:
    """A vehicle's rectangle at each step."""
    ahead = np.exp(1j * np.arctan2(*np.gradient(way, axis=0).T[::-1]))[:, None]
    corners = np.array([1 + 1j, 1 - 1j, -1 - 1j, -1 + 1j])
    corners = corners.real * size.length / 2 + 1j * corners.imag * size.width / 2
    places = (way[:, 0] + 1j * way[:, 1])[:, None] + ahead * corners
    return shapely.polygons(np.stack([places.real, places.imag], axis=2))


def python_convert(
    xy: list[list[float]], v: list[float], here: tuple[float, float]
) -> list[tuple[float, float, float]]:
    """The path from the nearest place on, with times."""
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


def python_thin(t: list[float], xy: list[list[float]]) -> list[int]:
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


def python_discover(cars: Sequence[Candidate]) -> int:
    """The foremost vehicle in the zone."""
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


def python_prescribe(
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
