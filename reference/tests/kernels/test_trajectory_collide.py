"""KIN-3, against brute force, shapely and pycrcc."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import assume, example, given
from hypothesis import strategies as st
from test_trajectory_cases import BAD, moved, numbers, paths, raises, sampled, trajectories

from automcm.kernels import collide
from automcm.kernels.trajectory import Trajectory

pairs = st.tuples(trajectories(), trajectories())
Pair = tuple[Trajectory, Trajectory]
EXACT = 1e-6
"""Metres: rounding at places of a hundred metres and times of ten seconds."""


def fastest(of: Trajectory) -> float:
    return float(of.speeds().max(initial=0))


def clock(pair: Pair) -> np.ndarray | None:
    """Each millisecond common to both; a stopped one goes on until the other ends, or a second."""
    a, b = pair
    end_a, end_b = (each.t[-1] + (1e3 if each.stopped else 0) for each in pair)
    end = min(end_a, end_b)
    if a.stopped and b.stopped:
        end = max(a.t[-1], b.t[-1])
    begin = max(a.t[0], b.t[0])
    if begin > end:
        return None
    return np.append(np.arange(begin, end, 1e-3), end)


@given(pairs)
def test_never_misses_what_brute_force_finds(pair: Pair) -> None:
    """And is closer by at most the way of both in a millisecond."""
    a, b = pair
    times = clock(pair)
    found = collide.closest_approach(a, b)
    if times is None:
        assert found is None
        return
    assert found is not None
    distances = np.hypot(*(sampled(a, times) - sampled(b, times)).T)
    least = distances.min()
    assert found.distance <= least + EXACT
    assert found.distance >= least - (fastest(a) + fastest(b)) * 1e-3 - EXACT


@given(pairs)
def test_time_place_and_distance_agree(pair: Pair) -> None:
    a, b = pair
    found = collide.closest_approach(a, b)
    assume(found is not None)
    assert found is not None
    assert math.dist(found.place_a, found.place_b) == pytest.approx(found.distance, abs=EXACT)
    when = np.array([found.time])
    assert sampled(a, when)[0] == pytest.approx(found.place_a, abs=EXACT)
    assert sampled(b, when)[0] == pytest.approx(found.place_b, abs=EXACT)


@given(pairs)
def test_symmetric(pair: Pair) -> None:
    one, two = collide.closest_approach(*pair), collide.closest_approach(*pair[::-1])
    if one is None or two is None:
        assert one is two
        return
    assert one.distance == pytest.approx(two.distance, abs=EXACT)
    assert one.time == pytest.approx(two.time, abs=1e-3)
    hit, back = (collide.collision(*each, 5.0) for each in (pair, pair[::-1]))
    assume(abs(one.distance - 5) > EXACT)
    assert (hit is None) == (back is None)
    if hit is not None and back is not None:
        assert hit.place_a == pytest.approx(back.place_b, abs=1e-3)


@given(pairs, numbers(0.5, 30))
@example(
    (
        Trajectory(np.array([0.0, 2]), np.array([(0, 0), (20.0, 0)])),
        Trajectory(np.array([0.0, 2]), np.array([(20, 0), (0.0, 0)])),
    ),
    4.0,
)
def test_first_time_below(pair: Pair, threshold: float) -> None:
    """No millisecond before it is below, the distance then is the threshold unless it begins
    below, and just after it is below."""
    a, b = pair
    hit = collide.collision(a, b, threshold)
    times = clock(pair)
    if hit is None:
        if times is not None:
            distances = np.hypot(*(sampled(a, times) - sampled(b, times)).T)
            assert distances.min() >= threshold - EXACT
        return
    assert times is not None
    distance = math.dist(hit.place_a, hit.place_b)
    before = times[times < hit.time - 1e-9]
    if len(before):
        assert distance == pytest.approx(threshold, abs=EXACT)
        assert np.hypot(*(sampled(a, before) - sampled(b, before)).T).min() >= threshold - EXACT
    assert distance <= threshold + EXACT
    assert sampled(a, np.array([hit.time]))[0] == pytest.approx(hit.place_a, abs=EXACT)


@given(st.tuples(trajectories(least=2), trajectories(least=2)), numbers(-0.2, 0.2))
def test_clock_error_covers_a_late_clock(pair: Pair, late: float) -> None:
    """Whoever's clock is off by ε, within the common time nothing closer is missed."""
    a, b = pair
    off = moved(b, later=late)
    real = collide.closest_approach(a, off)
    common = collide.common_time(a, b)
    assume(real is not None and common is not None)
    assert real is not None and common is not None
    assume(common[0] <= real.time <= common[1])
    assert collide.collision(a, b, real.distance + EXACT, clock_error=abs(late)) is not None


@pytest.mark.slow
@given(trajectories(), st.lists(trajectories(), max_size=6))
def test_many_as_one_by_one(a: Trajectory, others: list[Trajectory]) -> None:
    found = collide.closest_approach_many(a, others)
    assert len(found) == len(others)
    for b, many in zip(others, found, strict=True):
        one = collide.closest_approach(a, b)
        if one is None or many is None:
            assert one is many
            continue
        assert many.distance == pytest.approx(one.distance, abs=EXACT)
        assert math.dist(many.place_a, many.place_b) == pytest.approx(one.distance, abs=EXACT)
        assert sampled(a, np.array([many.time]))[0] == pytest.approx(many.place_a, abs=EXACT)


@given(st.integers(1, 8), st.integers(1, 9), st.data())
def test_pairs_as_one_by_one(n: int, count: int, data: st.DataObject) -> None:
    t = np.cumsum(data.draw(st.lists(numbers(0.1, 2), min_size=n, max_size=n)))
    shape = count * 2
    xy = np.array([data.draw(paths(n, n)) for _ in range(shape)]).reshape(2, count, n, 2)
    found = collide.closest_approach_pairs(t, xy[0], xy[1])
    assert len(found) == count
    for k in range(count):
        a, b = Trajectory(t, xy[0, k]), Trajectory(t, xy[1, k])
        one = collide.closest_approach(a, b)
        assert one is not None
        assert found.distance[k] == pytest.approx(one.distance, abs=EXACT)
        when = found.time[k : k + 1]
        off = sampled(a, when)[0] - sampled(b, when)[0]
        assert np.hypot(*off) == pytest.approx(one.distance, abs=EXACT)


def test_chunks(monkeypatch: pytest.MonkeyPatch) -> None:
    """Many chunks give the same result as one."""
    rng = np.random.default_rng(1)
    t = np.arange(30.0)
    a, b = np.cumsum(rng.normal(size=(2, 200, 30, 2)), axis=2)
    one = collide.closest_approach_pairs(t, a, b)
    others = [Trajectory(t + 0.1 * k, xy) for k, xy in enumerate(b)]
    each = collide.closest_approach_many(Trajectory(t, a[0]), others)
    monkeypatch.setattr(collide, "CHUNK_BYTES", 1000)
    many = collide.closest_approach_pairs(t, a, b)
    assert (one.distance == many.distance).all() and (one.time == many.time).all()
    assert collide.closest_approach_many(Trajectory(t, a[0]), others) == each


# -- examples


def line(*rows: tuple[float, float, float], stopped: bool = False) -> Trajectory:
    made = np.array(rows)
    return Trajectory(made[:, 0], made[:, 1:], stopped)


@pytest.mark.parametrize(
    ("a", "b", "expected"),
    [
        (line((0, 0, 0), (1, 9, 0)), line((2, 0, 0), (3, 9, 0)), None),  # disjoint
        (line((0, 0, 0), (1, 9, 0)), line((1, 0, 0), (3, 9, 0)), (1, 9)),  # one common instant
        (line((0, 0, 0), (1, 9, 0), stopped=True), line((2, 0, 0), (3, 9, 0)), (3, 0)),
        (line((0, 0, 0)), line((0, 3, 4)), (0, 5)),  # one point each
        (line((0, 0, 0)), line((1, 3, 4)), None),
        (line((0, 0, 0), stopped=True), line((1, 3, 4), stopped=True), (1, 5)),
        (line((5, 0, 0), stopped=True), line((0, 3, 4)), None),  # ends before the other begins
        (line((0, 0, 0), (9, 90, 0)), line((0, 0, 3), (9, 90, 3)), (0, 3)),  # tie: the earliest
        (line((0, 0, 0), (9, 9, 0)), line((0, 5, 0), (4, 5, 0), (5, 9, 9), (9, 0, 9)), (4, 1)),
        (line((0, 0, 0), (4, 4, 0), (8, 0, 0)), line((0, 4, 3), (8, 4, 3)), (4, 3)),
    ],
)
def test_edges(a: Trajectory, b: Trajectory, expected: tuple[float, float] | None) -> None:
    found = collide.closest_approach(a, b)
    assert (None if found is None else pytest.approx((found.time, found.distance))) == expected


def test_tie_despite_rounding() -> None:
    """A constant distance, at odd angles and since 1970: the first time."""
    t = 1.8e9 + np.arange(30) * 0.6
    for angle in np.linspace(0, 6, 20):
        step = 5 * np.array([np.cos(angle), np.sin(angle)])
        way = np.cumsum(np.tile(step, (30, 1)), axis=0) + np.array([65500, 32700])
        a, b = Trajectory(t, way), Trajectory(t, way + np.array([0.3, 7.7]))
        found = collide.closest_approach(a, b)
        assert found is not None and found.time == t[0]
        assert collide.closest_approach_pairs(t, a.xy[None], b.xy[None]).time[0] == t[0]


def test_clock_error_inflates() -> None:
    """Of one that drives at 0.5 m/s to one that stands."""
    a, b = line((0, 0, 0), (20, 10, 0)), line((0, 14, 0), (20, 14, 0))
    for speed, error, by in ((None, 2, 1), (3, 2, 6), (None, 0, 0)):
        hit = collide.collision(a, b, 8 - by, clock_error=error, speed=speed)
        assert hit is not None and (hit.threshold, hit.time) == (8, pytest.approx(12))


def test_equal_to_the_threshold_is_no_collision() -> None:
    a, b = line((0, 0, 0), (1, 9, 0)), line((0, 0, 4), (1, 9, 4))
    assert collide.collision(a, b, 4.0) is None
    hit = collide.collision(a, b, 4.0 + 1e-9)
    assert hit is not None and hit.time == 0
    assert collide.collision(a, a, 0.0) is None


def test_refused() -> None:
    a = line((0, 0, 0), (1, 9, 0))
    for bad in (*BAD, -1.0):
        raises("threshold", lambda bad=bad: collide.collision(a, a, bad))
        raises("clock_error", lambda bad=bad: collide.collision(a, a, 1, clock_error=bad))
        raises("speed", lambda bad=bad: collide.collision(a, a, 1, speed=bad))
    t, xy = np.arange(3.0), np.zeros((4, 3, 2))
    each = collide.closest_approach_pairs
    raises("xy_a: must have shape (pairs, 3, 2), not (4, 2, 2)", lambda: each(t, xy[:, :2], xy))
    raises("xy_b: must have shape", lambda: each(t, xy, xy[0]))
    raises("xy_b: must have 4 pairs, not 3", lambda: each(t, xy, xy[:3]))
    raises("t: ", lambda: each([0, 0, 1], xy, xy))
    raises("t: ", lambda: each([], np.zeros((4, 0, 2)), np.zeros((4, 0, 2))))
    for bad in BAD:
        wrong = xy.copy()
        wrong[2, 1, 1] = bad
        raises("xy_a[2, 1, 1]", lambda wrong=wrong: each(t, wrong, xy))
        raises("xy_b[2, 1, 1]", lambda wrong=wrong: each(t, xy, wrong))
        raises("t[1]", lambda bad=bad: each([0, bad, 1], xy, xy))
    assert len(each(t, xy[:0], xy[:0])) == 0
    assert collide.closest_approach_many(a, []) == []
