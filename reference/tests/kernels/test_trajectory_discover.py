"""KIN-4, the inside of a zone against shapely."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from shapely import Point, Polygon
from test_trajectory_cases import numbers, places, turned

from automcm.kernels import discover
from automcm.kernels.trajectory import Floats

LANE = np.array([(-60, -60), (60, -60), (60, 60), (-60, 60.0)])
"""Holds every place of the strategies."""


@st.composite
def zones(draw: st.DrawFn) -> Floats:
    """Simple, often concave: corners by angle around a centre, in either sense of rotation."""
    angles = sorted(draw(st.sets(st.integers(0, 35), min_size=4, max_size=10)))
    around = np.array(angles) * math.tau / 36
    far = draw(st.lists(numbers(5, 60), min_size=len(angles), max_size=len(angles)))
    corners = np.array(far)[:, None] * np.stack([np.cos(around), np.sin(around)], axis=1)
    assume(np.diff([*angles, angles[0] + 36]).max() < 18)
    return corners[:: draw(st.sampled_from([1, -1]))]


@st.composite
def candidates(draw: st.DrawFn, one_way: bool = False, most: int = 7) -> list[discover.Candidate]:
    ids = draw(st.lists(st.integers(1, 2**32 - 1), unique=True, max_size=most))
    grid = st.tuples(st.integers(-3, 3), st.integers(-3, 3)).map(lambda p: (10.0 * p[0], p[1]))
    towards = st.tuples(numbers(-3, 3), numbers(-3, 3)).filter(lambda d: math.hypot(*d) > 0.01)
    same = draw(towards)
    return [
        discover.Candidate(
            each, np.array(draw(places | grid)), np.array(same if one_way else draw(towards))
        )
        for each in ids
    ]


@given(zones(), st.lists(places, max_size=20), st.booleans())
def test_inside_against_shapely(
    zone: Floats, points: list[tuple[float, float]], closed: bool
) -> None:
    polygon = Polygon(zone)
    corners = np.concatenate([zone, zone[:1]]) if closed else zone
    middles = (zone + np.roll(zone, -1, axis=0)) / 2
    found = discover.inside(np.array([*points, *zone, *middles]), corners)
    for point, here in zip(points, found, strict=False):
        if polygon.boundary.distance(Point(point)) > 1e-6:  # shapely's boundary has no width
            assert here == polygon.contains(Point(point))
    assert found[len(points) :].all()  # corners and middles of edges


@given(candidates(), zones(), st.randoms())
def test_unique_and_independent_of_order(
    of: list[discover.Candidate], zone: Floats, random: object
) -> None:
    one = discover.discover(of, zone)
    shuffled = of[:]
    random.shuffle(shuffled)  # type: ignore[attr-defined]
    assert discover.discover(shuffled, zone) == one
    within = [each for each in of if discover.inside(each.xy[None], zone)[0]]
    assert (one is None) == (not within)
    assert one is None or one in [each.station_id for each in within]


@given(st.integers(1, 9), st.integers(11, 99), numbers(-3, 3), numbers(0.1, 9))
def test_abreast_the_lower_id(low: int, high: int, angle: float, apart: float) -> None:
    """Whatever the heading, and with a slower one behind that has a lower id still."""
    n = turned(np.array([(1.0, 0)]), angle)[0]
    beside = np.array([-n[1], n[0]]) * apart
    here = np.array([3.0, 4.0])
    of = [
        discover.Candidate(high, here, n),
        discover.Candidate(low + 1, here + beside, n),
        discover.Candidate(low, here - n, n),
    ]
    assert discover.discover(of, LANE) == low + 1


def test_only_those_in_the_zone() -> None:
    """A concave lane; the foremost drives beside it, in the notch."""
    zone = [(0, 0), (30, 0), (30, 3), (20, 3), (20, 1), (10, 1), (10, 3), (0, 3)]
    of = [
        discover.Candidate(1, np.array([15.0, 2]), np.array([1.0, 0])),
        discover.Candidate(2, np.array([5.0, 2]), np.array([1.0, 0])),
        discover.Candidate(3, np.array([2.0, 2]), np.array([1.0, 0])),
    ]
    assert discover.discover(of, zone) == 2
    assert discover.discover(of[:1], zone) is None
    assert discover.discover([], zone) is None


def count(of: list[discover.Candidate]) -> int | None:
    """The rule word for word: for each how many are in front of it."""
    in_front = [
        (sum(each.direction @ (other.xy - each.xy) > 1e-9 for other in of), each.station_id)
        for each in of
    ]
    return min(in_front)[1] if of else None


@given(candidates() | candidates(one_way=True) | candidates(most=40))
def test_it_is_the_one_whom_a_loop_counts(of: list[discover.Candidate]) -> None:
    assert discover.discover(of, LANE) == count(of)


def test_the_leader_is_found_without_comparing_each_with_each(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """20,000 in a bend: one is compared with all."""
    compared = []
    in_front = discover._in_front

    def counted(xy: Floats, of: Floats, direction: Floats) -> int:
        compared.append(of)
        return in_front(xy, of, direction)

    monkeypatch.setattr(discover, "_in_front", counted)
    angle = np.linspace(0, 1, 20_000)
    xy = np.stack([50 * np.sin(angle), 50 * (1 - np.cos(angle))], axis=1)
    of = [
        discover.Candidate(k + 1, place, np.array([math.cos(a), math.sin(a)]))
        for k, (place, a) in enumerate(zip(xy, angle, strict=True))
    ]
    assert discover.discover(of, LANE) == 20_000
    assert len(compared) == 1


@given(st.lists(places | st.tuples(st.integers(-2, 2), st.integers(-2, 2)), min_size=1))
def test_the_furthest_is_that_of_all(points: list[tuple[float, float]]) -> None:
    """With points that are repeated and on a line, in directions along and across the edges."""
    xy = np.array(points, float)
    angles = np.arange(-8, 9) * math.pi / 8
    directions = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    found = (discover.furthest(xy, directions) * directions).sum(axis=1)
    assert found == pytest.approx((xy @ directions.T).max(axis=0), abs=1e-12)
