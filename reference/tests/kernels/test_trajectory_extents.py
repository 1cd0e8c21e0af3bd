"""KIN-3 for vehicles with a length and a width."""

from __future__ import annotations

import math

import numpy as np
import pytest
import shapely
from hypothesis import assume, given
from hypothesis import strategies as st
from shapely import Point, box
from test_trajectory_cases import moved, numbers, plans, raises, trajectories

from automcm.kernels import extents
from automcm.kernels.extents import Cover, Extent
from automcm.kernels.trajectory import Floats, Trajectory

sizes = st.builds(Extent, numbers(0.5, 18), numbers(0.5, 3))
CAR, LORRY = Extent(4.5, 1.8), Extent(16.5, 2.55)


def rectangle(extent: Extent) -> shapely.Polygon:
    return box(-extent.length / 2, -extent.width / 2, extent.length / 2, extent.width / 2)


@given(sizes, st.none() | st.integers(1, 9))
def test_the_discs_cover_the_rectangle_and_the_error_is_stated(
    extent: Extent, discs: int | None
) -> None:
    made = extents.cover(extent, discs)
    whole = shapely.union_all(
        [Point(x, 0).buffer(made.radius, quad_segs=256) for x in made.offsets]
    )
    exact = rectangle(extent)
    assert exact.difference(whole.buffer(1e-3)).is_empty
    furthest = max(exact.distance(Point(xy)) for xy in whole.exterior.coords)
    assert furthest == pytest.approx(made.error, abs=1e-4)
    if discs is None and extent.length >= extent.width:
        assert made.error <= extent.width / 2


def directions(of: Trajectory, times: Floats) -> Floats:
    """The direction at each time, by a walk: the last motion before, or else the next."""
    steps = np.diff(of.xy, axis=0)
    found = []
    for t in times:
        now = min(int(np.sum(of.t <= t)) - 1, len(steps) - 1)
        order = [*range(now, -1, -1), *range(now, len(steps))]
        k = next((k for k in order if math.hypot(*steps[k]) > 1e-9), None)
        found.append((0.0, 0.0) if k is None else steps[k] / math.hypot(*steps[k]))
    return np.array(found)


def discs(of: Trajectory, extent: Extent) -> Cover:
    if (of.xy == of.xy[0]).all():
        radius = math.hypot(extent.length, extent.width) / 2
        return Cover((0.0,), radius, radius - min(extent.length, extent.width) / 2)
    return extents.cover(extent)


def apart(a: Trajectory, b: Trajectory, one: Extent, other: Extent, times: Floats) -> Floats:
    """The least distance of the discs at each of these times, by a loop."""
    least = np.full(len(times), np.inf)
    (da, db) = discs(a, one), discs(b, other)
    xy_a, xy_b = (np.stack([np.interp(times, of.t, of.xy[:, k]) for k in (0, 1)], 1)
                  for of in (a, b))  # fmt: skip
    ahead_a, ahead_b = directions(a, times), directions(b, times)
    for p in da.offsets:
        for q in db.offsets:
            off = xy_a + p * ahead_a - xy_b - q * ahead_b
            least = np.minimum(least, np.hypot(off[:, 0], off[:, 1]))
    return least - da.radius - db.radius


anything = trajectories(least=2, most=8) | plans()


@pytest.mark.slow
@given(st.tuples(anything, anything), sizes, sizes, numbers(0, 10))
def test_against_brute_force(
    pair: tuple[Trajectory, Trajectory], one: Extent, other: Extent, margin: float
) -> None:
    found = extents.clearance(*pair, one, other, margin)
    assume(found is not None)
    assert found is not None
    ends = [of.t[-1] for of in pair if not of.stopped] or [max(of.t[-1] for of in pair)]
    start, end = max(of.t[0] for of in pair), min(ends)
    turns = np.concatenate([of.t + by for of in pair for by in (-1e-6, 0)])  # both headings
    times = np.concatenate([np.linspace(start, end, 1500), turns])
    times = np.sort(times[(times >= start) & (times <= end)])
    least = apart(*pair, one, other, times)
    fastest = sum(of.speeds().max(initial=0) for of in pair) * (end - start) / 1499
    assert found.distance <= least.min() + 1e-6
    assert found.distance >= least.min() - fastest - 1e-4
    assert start - 1e-9 <= found.time <= end + 1e-9
    around = np.clip(found.time + np.array([-1e-6, 0, 1e-6]), start, end)
    assert apart(*pair, one, other, around).min() == pytest.approx(found.distance, abs=1e-3)
    below = times[least < margin - 1e-6]
    if len(below):
        assert found.since is not None and found.since <= below[0] + 1e-9
    if found.since is None:
        assert found.distance >= margin - 1e-9


@given(numbers(0, 6), numbers(-30, 30), numbers(3, 15), numbers(3, 15))
def test_on_straight_lines_the_rectangles_are_within_the_errors(
    aside: float, ahead: float, v: float, w: float
) -> None:
    """shapely's distance of the rectangles at 200 times."""
    a = Trajectory([0, 10], [(0, 0), (10 * v, 0)])
    b = Trajectory([0, 10], [(ahead, aside), (ahead + 10 * w, aside)])
    found = extents.clearance(a, b, LORRY, CAR)
    assert found is not None
    one, other = rectangle(LORRY), rectangle(CAR)
    exact = min(
        shapely.distance(
            shapely.affinity.translate(one, v * t, 0),
            shapely.affinity.translate(other, ahead + w * t, aside),
        )
        for t in np.linspace(0, 10, 200)
    )
    errors = extents.cover(LORRY).error + extents.cover(CAR).error
    step = abs(v - w) * 10 / 199
    assert found.distance - 1e-6 <= exact <= max(found.distance, 0) + errors + step + 1e-6


def test_it_is_near_from_its_first_disc_on() -> None:
    """A lorry drives up to a standing car: its foremost disc comes near first."""
    lorry, car = Trajectory([0, 10], [(0, 0), (100, 0)]), Trajectory([0, 10], [(50, 0), (50, 0)])
    found = extents.clearance(lorry, car, LORRY, CAR, 1.0)
    cover = extents.cover(LORRY)
    way = 50 - max(cover.offsets) - cover.radius - discs(car, CAR).radius - 1.0
    assert found is not None and found.since == pytest.approx(way / 10, abs=1e-6)


def test_headings_of_standing_ones() -> None:
    """The last motion, else the next, else none: then one disc around."""
    passing = Trajectory([0, 1], [(4, -50), (4, 50)])
    waits = Trajectory([0, 2], [(-5, 0), (0, 0)], True)
    starts = Trajectory([0, 5, 10], [(0, 0), (0, 0), (5, 0)])
    late = moved(passing, later=3.0)
    for standing, radius, nose in (
        (waits, extents.cover(CAR).radius, 1.5),
        (starts, extents.cover(CAR).radius, 1.5),
        (Trajectory([0], [(0, 0)], True), math.hypot(4.5, 1.8) / 2, 0.0),
    ):
        found = extents.clearance(standing, late, CAR, Extent(1, 1))
        assert found is not None
        assert found.distance == pytest.approx(4 - nose - radius - math.hypot(0.5, 0.5), abs=1e-9)


@given(st.tuples(anything, anything), numbers(-3, 3), numbers(0.5, 4))
def test_symmetric_turned_and_moved(
    pair: tuple[Trajectory, Trajectory], angle: float, later: float
) -> None:
    one, back = (
        extents.clearance(*each) for each in ((*pair, CAR, LORRY), (*pair[::-1], LORRY, CAR))
    )
    assume(one is not None and pair[0].t[0] < 1e6 and pair[1].t[0] < 1e6)
    a, b = (moved(each, angle, (3, 4), later) for each in pair)
    other = extents.clearance(a, b, CAR, LORRY)
    assert one is not None and back is not None and other is not None
    assert one.distance == pytest.approx(back.distance, abs=1e-6)
    assert one.distance == pytest.approx(other.distance, abs=1e-6)


def test_refused_and_unknown() -> None:
    a, b = Trajectory([0, 1], [(0, 0), (1, 0)]), Trajectory([2, 3], [(0, 0), (1, 0)])
    assert extents.clearance(a, b, CAR, CAR) is None
    raises("margin: must be at least 0", lambda: extents.clearance(a, a, CAR, CAR, -1.0))
    raises("length: must be above 0", lambda: Extent(0.0, 1.0))
    raises("width: must be above 0", lambda: Extent(1.0, -1.0))
