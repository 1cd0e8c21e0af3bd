"""The cost of the trajectory kernels, each beside another way to compute the same.

Baselines are a loop over the points, the cheapest formulation in numpy without checks, and shapely,
whose areas are only compared at time steps.
"""

from __future__ import annotations

import math
from functools import partial
from itertools import pairwise
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


# -- kernels of one vehicle


@points
def bench_loop(n: int, timed: Timed) -> None:
    """The lengths of all steps, one after the other."""
    xy = road(n).xy.tolist()
    timed(lambda: [math.dist(a, b) for a, b in pairwise(xy)])


@points
@beside("loop", 40)
def bench_convert(n: int, timed: Timed) -> None:
    """KIN-1."""
    timed(partial(convert, road(n).xy, np.full(n, SPEED), HERE, 0.0))


@points
@beside("loop", 400)
def bench_thin(n: int, timed: Timed) -> None:
    """KIN-2, with encoding."""
    timed(partial(thin, noisy(n)))


@points
@beside("loop", 60)
def bench_discover(n: int, timed: Timed) -> None:
    """KIN-4."""
    timed(partial(discover, cars(n), ZONE))


@points
@beside("loop", 120)
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
def bench_cheapest(n: int, timed: Timed) -> None:
    """In numpy, without checks."""
    timed(partial(cheapest, *two(n)))


@points
@beside("cheapest", 4)
def bench_closest_approach(n: int, timed: Timed) -> None:
    """KIN-3."""
    timed(partial(closest_approach, *two(n)))


@points
@beside("cheapest", 4)
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


def areas(shapely: Any, way: Floats, size: Extent) -> Any:
    """A vehicle's rectangle at each step."""
    ahead = np.exp(1j * np.arctan2(*np.gradient(way, axis=0).T[::-1]))[:, None]
    corners = np.array([1 + 1j, 1 - 1j, -1 - 1j, -1 + 1j])
    corners = corners.real * size.length / 2 + 1j * corners.imag * size.width / 2
    places = (way[:, 0] + 1j * way[:, 1])[:, None] + ahead * corners
    return shapely.polygons(np.stack([places.real, places.imag], axis=2))
