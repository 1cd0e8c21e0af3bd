"""KIN-2."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from test_trajectory_cases import moved, numbers, plans, raises, sampled, trajectories

from automcm.encoding.codec import FRAME_BYTES, JSON
from automcm.kernels import collide, thin
from automcm.kernels.trajectory import Trajectory, TrajectoryError, to_message
from automcm_spec.vocabulary.messages import Intention


def points(of: Trajectory) -> int:
    """A size that counts: a byte for each point."""
    return len(of)


anything = trajectories(most=40) | plans()
budgets = st.integers(2, 45)


@given(anything, budgets, st.integers(1, 9))
def test_some_of_the_points_with_the_first_and_the_last(
    full: Trajectory, budget: int, every: int
) -> None:
    made = thin.thin(full, budget, points, every)
    assert points(made) <= budget
    kept = np.searchsorted(full.t, made.t)
    assert (full.t[kept] == made.t).all() and (full.xy[kept] == made.xy).all()
    assert kept[0] == 0 and kept[-1] == len(full) - 1
    assert made.stopped == full.stopped


@given(anything, st.integers(1, 9))
def test_every_fifth_and_changes_of_speed(full: Trajectory, every: int) -> None:
    """With room enough: each fifth, each change of speed by more than 1 %, and nothing else."""
    made = thin.thin(full, 10**6, points, every)
    v = full.speeds()
    for n in range(len(full)):
        inner = 0 < n < len(full) - 1
        change = inner and abs(v[n] - v[n - 1]) > 0.01 * max(v[n], v[n - 1])
        assert (full.t[n] in made.t) == (not inner or n % every == 0 or change)


@given(anything, budgets)
def test_changes_go_last(full: Trajectory, budget: int) -> None:
    """While a point is left that is no change of speed, all changes are."""
    made = thin.thin(full, budget, points)
    changes = set(full.t[thin.changes(full)])
    ends = {full.t[0], full.t[-1]}
    if set(made.t) - changes - ends:
        assert changes <= set(made.t)


@given(anything, budgets, budgets)
def test_more_room_keeps_more(full: Trajectory, budget: int, more: int) -> None:
    assert len(thin.thin(full, budget, points)) <= len(thin.thin(full, budget + more, points))


@given(anything, budgets)
def test_deviation_is_the_greatest(full: Trajectory, budget: int) -> None:
    made = thin.thin(full, budget, points)
    times = np.linspace(full.t[0], full.t[-1], 500)
    off = np.hypot(*(sampled(full, times) - sampled(made, times)).T).max()
    assert off <= thin.deviation(full, made) + 1e-6


@given(st.tuples(anything, anything), budgets, numbers(0, 20))
def test_verdict_within_the_deviation(
    pair: tuple[Trajectory, Trajectory], budget: int, threshold: float
) -> None:
    """Thinning moves the closest approach by no more than the deviations of both; so a verdict
    changes only if the distance is that near to the threshold."""
    thinned = [thin.thin(each, budget, points) for each in pair]
    error = sum(map(thin.deviation, pair, thinned)) + 1e-6
    before, after = collide.closest_approach(*pair), collide.closest_approach(*thinned)
    assume(before is not None)
    assert before is not None and after is not None
    assert abs(before.distance - after.distance) <= error
    if abs(before.distance - threshold) > error:
        hits = [collide.collision(*each, threshold) is None for each in (pair, thinned)]
        assert hits[0] == hits[1]


@pytest.mark.slow
@given(plans(), numbers(0.5, 4), numbers(0.5, 4), numbers(-3, 3))
def test_scaled_and_turned(full: Trajectory, space: float, time: float, angle: float) -> None:
    """The same points stay."""
    v = full.speeds()
    near = np.abs(np.abs(np.diff(v)) - 0.01 * np.maximum(v[1:], v[:-1]))
    assume(full.t[0] < 1e6 and (near > 1e-6).all())
    one = thin.thin(full, 10**6, points)
    two = thin.thin(moved(full, angle, (3, 4), 5, space, time), 10**6, points)
    assert len(one) == len(two)
    assert two.t == pytest.approx(one.t * time + 5)


@given(plans())
def test_the_real_size(full: Trajectory) -> None:
    made = thin.thin(full)
    planned = to_message(made)
    message = Intention(src=1, dst=2, session=(1, 1), seq=1, planned=planned)
    assert len(JSON.encode(message)) <= thin.intention_bytes(made) <= FRAME_BYTES


def straight(n: int) -> Trajectory:
    """30 km/h, a point every 5 m, since 1970 and at a kilometre."""
    xy = 1000 + 5.0 * np.arange(n)[:, None] * np.array([0.8, 0.6])
    return Trajectory(1.8e9 + 0.6 * np.arange(n), xy)


@pytest.mark.slow
@given(plans(), st.data())
def test_what_no_message_tells_apart_costs_no_other_point(
    full: Trajectory, data: st.DataObject
) -> None:
    """KIN-2: one more sample within half a millisecond of another, and the thinned is the same but
    for that one; it did cost every point that is no change of speed."""
    full = full.since(float(np.ceil(full.t[0] * 10) / 10))
    full = Trajectory(np.rint(full.t * 1000) / 1000, full.xy, full.stopped)
    n = data.draw(st.integers(0, len(full) - 1))
    by = 4e-4 if n == 0 else data.draw(st.sampled_from([-4e-4, 4e-4]))
    at = n + 1 if by > 0 else n
    place = sampled(full, np.array([full.t[n] + by]))
    close = Trajectory(
        np.insert(full.t, at, full.t[n] + by), np.insert(full.xy, at, place, axis=0), full.stopped
    )
    made = thin.thin(close, 10**5, every=1)
    assert len(made) == len(full)
    assert np.abs(made.t - full.t).max() < 5e-4
    assert {full.t[0], full.t[-1] + max(by, 0) * (n == len(full) - 1)} <= set(made.t)


def test_paper() -> None:
    """60 points do not fit one frame, a fifth does (13 with the last); nor does a fifth of 1000."""
    assert thin.intention_bytes(straight(60)) > FRAME_BYTES
    made = thin.thin(straight(60))
    assert len(made) == 13
    assert thin.deviation(straight(60), made) < 1e-5
    far = thin.thin(straight(1000))
    assert thin.intention_bytes(far) <= FRAME_BYTES
    assert 40 < len(far) < 100
    assert thin.thin(far).t.tolist() != far.t.tolist()  # again: a fifth of what is left


def test_too_close_for_a_message() -> None:
    """Two samples within a millisecond: thinned until a message can carry them."""
    t = np.array([0, 1, 1.0004, 2, 3])
    made = thin.thin(Trajectory(t, np.array([(0, 0), (9, 0), (9.1, 0), (11, 0), (30, 0.0)])))
    assert (np.diff(made.t) > 1e-3).all()
    assert to_message(made)


def test_least_effect_goes_first() -> None:
    """Of two changes, the one whose loss moves the vehicle more stays."""
    full = Trajectory(np.arange(4.0), np.array([(0, 0), (10, 0), (12, 0), (15, 0.0)]))
    assert thin.thin(full, 3, points).t.tolist() == [0, 1, 3]


def test_one_point_and_standing() -> None:
    one = Trajectory(np.zeros(1), np.zeros((1, 2)), True)
    assert len(thin.thin(one)) == 1
    standing = Trajectory(np.arange(20.0), np.zeros((20, 2)))
    assert thin.thin(standing).t.tolist() == [0, 5, 10, 15, 19]


def test_refused() -> None:
    full = straight(20)
    raises("budget: must be a whole number of at least 0, not -1", lambda: thin.thin(full, -1))
    raises(
        "budget: must be a whole number of at least 0, not nan",
        lambda: thin.thin(full, float("nan")),
    )  # type: ignore[arg-type]
    raises("every: must be a whole number of at least 1, not 0", lambda: thin.thin(full, every=0))
    raises(
        "every: must be a whole number of at least 1, not 2.5", lambda: thin.thin(full, every=2.5)
    )  # type: ignore[arg-type]
    raises("budget: too small for the required points (2): ", lambda: thin.thin(full, 30))
    raises(
        "budget: too small for the required points (1)",
        lambda: thin.thin(full.since(full.t[-1]), 0, points),
    )
    with pytest.raises(TrajectoryError, match="less than 1 ms"):
        thin.thin(Trajectory(np.array([0, 1e-4]), np.zeros((2, 2))))
