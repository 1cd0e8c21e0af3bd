"""KIN-2."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from test_trajectory_cases import numbers, plans, raises, sampled, trajectories

from automcm.encoding.codec import FRAME_BYTES, JSON
from automcm.kernels import thin
from automcm.kernels.trajectory import Trajectory, TrajectoryError, to_message
from automcm_spec.vocabulary.messages import Prescription


def points(of: Trajectory) -> int:
    """A size that counts: a byte for each point."""
    return len(of)


anything = trajectories(most=40) | plans()
budgets = st.integers(2, 45)


@given(anything, budgets)
def test_some_of_the_points_with_the_first_and_the_last(full: Trajectory, budget: int) -> None:
    made = thin.thin(full, budget, points)
    assert points(made) <= budget
    kept = np.searchsorted(full.t, made.t)
    assert (full.t[kept] == made.t).all() and (full.xy[kept] == made.xy).all()
    assert kept[0] == 0 and kept[-1] == len(full) - 1
    assert made.stopped == full.stopped


@given(anything, numbers(0.01, 3), numbers(0.01, 3))
def test_within_the_bound_if_there_is_room(full: Trajectory, position: float, speed: float) -> None:
    """Positions and speeds at 500 times, and by ``deviation``."""
    made = thin.thin(full, 10**6, points, position, speed)
    found = thin.deviation(full, made)
    assert found.position <= position * (1 + 1e-9) and found.speed <= speed * (1 + 1e-9)
    times = np.linspace(full.t[0], full.t[-1], 500)
    off = np.hypot(*(sampled(full, times) - sampled(made, times)).T).max()
    assert off <= found.position + 1e-6


@given(anything, budgets)
def test_a_smaller_budget_keeps_some_of_the_same(full: Trajectory, budget: int) -> None:
    """And the bound, if it does not use all of its room."""
    made, more = (thin.thin(full, each, points) for each in (budget, budget + 3))
    assert set(made.t) <= set(more.t)
    if len(made) < min(budget, len(full)):
        assert thin.deviation(full, made).position <= thin.POSITION * (1 + 1e-9)


@given(plans())
def test_the_real_size(full: Trajectory) -> None:
    made = thin.thin(full)
    planned = to_message(made)
    message = Prescription(
        src=1, dst=2, session=(1, 1), seq=1, proposal=1, prescribed=planned, hold_ms=0, lease_ms=1
    )
    assert len(JSON.encode(message)) <= thin.prescription_bytes(made) <= FRAME_BYTES


def straight(n: int) -> Trajectory:
    """30 km/h, a point every 5 m, since 1970 and at a kilometre."""
    xy = 1000 + 5.0 * np.arange(n)[:, None] * np.array([0.8, 0.6])
    return Trajectory(1.8e9 + 0.6 * np.arange(n), xy)


def test_paper() -> None:
    """60 points do not fit one frame; of a straight and even drive two do."""
    assert thin.prescription_bytes(straight(60)) > FRAME_BYTES
    made = thin.thin(straight(60))
    assert len(made) == 2
    assert max(thin.deviation(straight(60), made)) < 1e-5


def test_noisy_speed() -> None:
    """1,000 points that all have their own speed: within the frame, in few steps."""
    v = 10 + np.random.default_rng(26).standard_normal(1000)
    noisy = Trajectory(0.1 * np.arange(1000.0), np.outer(np.cumsum(0.1 * v), [0.8, 0.6]))
    calls = []

    def counted(of: Trajectory) -> int:
        calls.append(len(of))
        return thin.prescription_bytes(of)

    made = thin.thin(noisy, size=counted)
    assert FRAME_BYTES - 50 < thin.prescription_bytes(made) <= FRAME_BYTES
    assert len(calls) < 12 and max(calls) < 200


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
    assert thin.thin(standing).t.tolist() == [0, 19]


def test_refused() -> None:
    full = straight(20)
    raises("budget: must be a whole number of at least 0, not -1", lambda: thin.thin(full, -1))
    raises(
        "budget: must be a whole number of at least 0, not nan",
        lambda: thin.thin(full, float("nan")),
    )  # type: ignore[arg-type]
    for bound in ("position", "speed"):
        for bad in (0.0, -1.0, float("nan")):
            raises(bound, lambda bound=bound, bad=bad: thin.thin(full, **{bound: bad}))
    raises("budget: too small for the required points (2): ", lambda: thin.thin(full, 30))
    raises(
        "budget: too small for the required points (1)",
        lambda: thin.thin(full.since(full.t[-1]), 0, points),
    )
    with pytest.raises(TrajectoryError, match="less than 1 ms"):
        thin.thin(Trajectory(np.array([0, 1e-4]), np.zeros((2, 2))))
