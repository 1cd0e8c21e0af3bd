"""The cost of the trajectory kernels.

Baselines are a loop over the points, and the cheapest formulation of KIN-3 in numpy without checks.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial
from itertools import pairwise
from typing import NamedTuple

import numpy as np
import pytest

from automcm.kernels.collide import (
    closest_approach,
    closest_approach_many,
    closest_approach_pairs,
    collision,
)
from automcm.kernels.convert import convert
from automcm.kernels.discover import Candidate, discover
from automcm.kernels.extents import Extent, clearance
from automcm.kernels.prescribe import prescribe
from automcm.kernels.road_line import RoadLine
from automcm.kernels.thin import thin
from automcm.kernels.trajectory import Floats, Trajectory
from automcm.kernels.verify import Limits, verify
from automcm_maintenance.benches.plugin import Baseline, Timed

FEW = (50, 500)
POINTS = (*FEW, 1000, 10_000)
PAIRS = 256
"""Pairs of the batched kernels."""
PLACES = 100
"""Places that are projected onto a road's line at a time."""
THRESHOLD = 4.0
CAR, LORRY = Extent(4.5, 1.8), Extent(16.5, 2.55)
SPEED = 30 / 3.6
ZONE = ((-1e4, -2.0), (1e4, -2.0), (1e4, 2.0), (-1e4, 2.0))
HERE, HOLD, GAIN = (1.0, 1.0), 1.0, 5.0


def road(n: int, ahead: float = 0.0, aside: float = 0.0, speed: float = SPEED) -> Trajectory:
    """n points 5 m apart on a slightly curved road."""
    x = np.arange(0.0, 5 * n, 5)
    xy = np.stack([x + ahead, aside + 3 * np.sin(x / 60)], axis=1)
    return Trajectory(x / speed, xy)


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


def traffic(n: int) -> tuple[Floats, Floats, Floats]:
    """Times (n,), and positions (PAIRS, n, 2) of vehicles in two lanes."""
    one, other = two(n)
    apart = np.random.default_rng(0).uniform(-50, 50, (2, PAIRS, 1, 1)) * [1.0, 0.0]
    return one.t, one.xy + apart[0], other.xy + apart[1]


def project(n: int) -> Callable[[], object]:
    """Places on a road's line."""
    line = RoadLine(road(n).xy)
    return partial(line.project, line.place(np.linspace(0, line.length, PLACES), 2.0))


def checks(n: int) -> Callable[[], object]:
    """KIN-6, of what was prescribed."""
    plan = road(n)
    prescribed = prescribe(plan, 1.0, hold=HOLD, gain=GAIN)
    return partial(verify, prescribed, plan, 1.5, Limits(), None, None)


def many(n: int) -> Callable[[], object]:
    """KIN-3 of one vehicle and many others."""
    t, a, b = traffic(n)
    others = [Trajectory(t + 0.01 * k, xy) for k, xy in enumerate(b)]
    return partial(closest_approach_many, Trajectory(t, a[0]), others)


def loop(n: int) -> Callable[[], object]:
    """The lengths of all steps, one after the other."""
    xy = road(n).xy.tolist()
    return lambda: [math.dist(a, b) for a, b in pairwise(xy)]


def cheapest(a: Trajectory, b: Trajectory) -> float:
    """The least distance of two trajectories, by a quadratic equation on their united times."""
    start, end = max(a.t[0], b.t[0]), min(a.t[-1], b.t[-1])
    t = np.concatenate([a.t, b.t])
    t.sort()
    t = t[t.searchsorted(start) : t.searchsorted(end, side="right")]
    x = np.interp(t, a.t, a.xy[:, 0]) - np.interp(t, b.t, b.xy[:, 0])
    y = np.interp(t, a.t, a.xy[:, 1]) - np.interp(t, b.t, b.xy[:, 1])
    x0, y0, wx, wy = x[:-1], y[:-1], np.diff(x), np.diff(y)
    share = np.clip(-(x0 * wx + y0 * wy) / (wx * wx + wy * wy + 1e-300), 0, 1)
    return math.sqrt(((x0 + share * wx) ** 2 + (y0 + share * wy) ** 2).min())


class Kernel(NamedTuple):
    """What is timed for so many points, in µs over ``per``; its baseline with the bar."""

    call: Callable[[int], Callable[[], object]]
    beside: Baseline | None = None
    per: int = 1
    points: tuple[int, ...] = POINTS


KERNELS = {
    "loop": Kernel(loop),
    "convert": Kernel(
        lambda n: partial(convert, road(n).xy, np.full(n, SPEED), HERE, 0.0), ("loop", 40)
    ),
    "thin": Kernel(lambda n: partial(thin, noisy(n)), ("loop", 400)),  # with encoding
    "discover": Kernel(lambda n: partial(discover, cars(n), ZONE), ("loop", 60)),
    "prescribe": Kernel(
        lambda n: partial(prescribe, road(n), 1.0, hold=HOLD, gain=GAIN), ("loop", 120)
    ),
    "verify": Kernel(checks, ("prescribe", 4)),
    "project": Kernel(project, ("loop", 1), PLACES),
    "cheapest": Kernel(lambda n: partial(cheapest, *two(n))),
    "closest_approach": Kernel(lambda n: partial(closest_approach, *two(n)), ("cheapest", 4)),
    "collision": Kernel(lambda n: partial(collision, *two(n), THRESHOLD), ("cheapest", 4)),
    "clearance": Kernel(lambda n: partial(clearance, *two(n), LORRY, CAR, 0.5), ("cheapest", 10)),
    "pairs": Kernel(
        lambda n: partial(closest_approach_pairs, *traffic(n)), ("cheapest", 0.5), PAIRS, FEW
    ),
    "many": Kernel(many, ("cheapest", 2), PAIRS, FEW),
}


@pytest.mark.parametrize(
    ("name", "n"), [(name, n) for name, kernel in KERNELS.items() for n in kernel.points]
)
def bench_kernel(name: str, n: int, timed: Timed) -> None:
    """A kernel of one vehicle beside a loop, of two beside the cheapest form of KIN-3."""
    kernel, beside = KERNELS[name], None
    if kernel.beside:
        baseline, at_most = kernel.beside
        beside = f"kernel[{baseline}-{n}]", at_most
    timed(kernel.call(n), per=kernel.per, beside=beside)
