"""KIN-5 and KIN-6."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from shapely import LineString, Point, hausdorff_distance
from test_trajectory_cases import BAD, moved, numbers, plans, raises, sampled

from automcm.kernels import prescribe, verify
from automcm.kernels.thin import thin
from automcm.kernels.trajectory import Floats, Trajectory, TrajectoryError, from_message, to_message

Case = tuple[Trajectory, float, dict[str, float]]


@st.composite
def cases(draw: st.DrawFn) -> Case:
    """A plan, a start within its first part, and the distance to gain."""
    plan = draw(plans())
    start = float(plan.t[0] + draw(st.just(0.0) | numbers(0, 2)))
    wanted = {
        "hold": draw(st.sampled_from([0.0, 0.5, 2.0])),
        "delta_v": draw(st.sampled_from([20 / 3.6]) | numbers(1, 8)),
        "gain": draw(st.sampled_from([20.0, 0.0, 5.0]) | numbers(0, 12)),
        "v_min": draw(st.sampled_from([0.0, 1.0, 3.0])),
    }
    return plan, start, wanted


def ways(of: Trajectory, times: Floats) -> Floats:
    return np.interp(times, of.t, of.arc())


def simulated(case: Case, dt: float = 1e-3) -> tuple[Floats, Floats]:
    """Times and gap to the plan, m, by stepping through KIN-5."""
    plan, start, wanted = case
    times = np.arange(start, plan.t[-1], dt)
    v = np.diff(ways(plan, times)) / np.diff(times)
    slower = np.minimum(wanted["delta_v"], np.maximum(v - wanted["v_min"], 0))
    slower[times[:-1] < start + wanted["hold"]] = 0
    gap = np.concatenate([[0], np.cumsum(slower * np.diff(times))])
    return times, np.minimum(gap, wanted["gain"])


def made(case: Case) -> Trajectory:
    plan, start, wanted = case
    try:
        return prescribe.prescribe(plan, start, **wanted)
    except TrajectoryError as error:
        assert str(error).startswith("planned: too short to gain")
        gained = simulated(case)[1][-1]
        assert gained < wanted["gain"] + 1e-2, "it could have been gained"
        assume(False)
        raise


BENDS = 0.02
"""Metres: what leaving out a bend within 1 ms of another sample may shorten the way."""


@given(cases())
def test_gains_what_it_should_by_the_end(case: Case) -> None:
    plan, start, wanted = case
    result = made(case)
    assert result.t[0] == start and result.t[-1] == pytest.approx(plan.t[-1], abs=1e-6, rel=0)
    (length,) = plan.arc()[-1:] - wanted["gain"]
    line = LineString(plan.xy)
    end = line.interpolate(length)
    assert np.hypot(*(result.xy[-1] - (end.x, end.y))) < 5e-6
    assert sampled(plan, np.array([start]))[0] == pytest.approx(result.xy[0], abs=1e-5)


@pytest.mark.slow
@given(cases())
def test_the_gap_at_each_time(case: Case) -> None:
    """As by stepping through the rule: while holding, acting and after."""
    plan, start, wanted = case
    result = made(case)
    times, gap = simulated(case)
    begun = ways(plan, np.array([start]))[0]
    behind = ways(plan, times) - begun - ways(result, times)
    error = BENDS * len(plan) / 40 + 2e-3 * wanted["delta_v"] + 1e-4
    assert np.abs(behind - gap).max() < max(error, 0.03)


@given(cases())
def test_same_path(case: Case) -> None:
    plan, _, _ = case
    result = made(case)
    line = LineString(plan.xy)
    for xy in result.xy:
        assert line.distance(Point(xy)) < 1e-6
    between = result.at((result.t[1:] + result.t[:-1]) / 2)
    for xy in between:
        assert line.distance(Point(xy)) < BENDS
    assert (np.diff([line.project(Point(xy)) for xy in result.xy]) > -1e-5).all()


@given(cases())
def test_the_action_ends_when_gained(case: Case) -> None:
    """Exact samples: the beginning and the end of the action; before it as planned, after it
    ``gain`` behind."""
    plan, start, wanted = case
    result = made(case)
    begun = start + wanted["hold"]
    if begun < plan.t[-1]:
        assert np.abs(result.t - begun).min() < 1e-6
    as_planned = result.t <= begun
    assert result.xy[as_planned] == pytest.approx(sampled(plan, result.t[as_planned]), abs=1e-5)
    line, arc = LineString(plan.xy), ways(plan, result.t)
    behind = arc - np.array([line.project(Point(xy)) for xy in result.xy])
    assert behind.max() == pytest.approx(wanted["gain"], abs=1e-5)
    if wanted["gain"] > 0:
        over = int(np.flatnonzero(behind > wanted["gain"] - 1e-5)[0])
        assert (np.abs(behind[over:] - wanted["gain"]) < 2e-5).all()
        assert (behind[:over] < wanted["gain"]).all()


def straight(v: float, seconds: float = 30.0, n: int = 31, t0: float = 0.0) -> Trajectory:
    t = np.linspace(0, seconds, n)
    return Trajectory(t0 + t, np.stack([v * t, 0 * t], axis=1))


def test_standing_gains_nothing() -> None:
    """In the middle: the gain goes on after it."""
    t = np.array([0, 5, 10, 20.0])
    plan = Trajectory(t, np.array([(0, 0), (50, 0), (50, 0), (150, 0.0)]))
    result = prescribe.prescribe(plan, 0.0, hold=4.0, delta_v=5.0, gain=20.0)
    assert result.at([5, 10, 13])[:, 0] == pytest.approx([45, 45, 60])
    standing = Trajectory(t, np.zeros((4, 2)), True)
    raises("planned: too short", lambda: prescribe.prescribe(standing, 0.0, hold=0))
    raises("planned: too short", lambda: prescribe.prescribe(standing.since(20), 20.0, hold=0))
    same = prescribe.prescribe(standing.since(20), 20.0, hold=0, gain=0)
    assert len(same) == 1 and same.stopped


def test_refused() -> None:
    plan = straight(10.0)
    call: Any = prescribe.prescribe
    for bad in (*BAD, -1.0):
        raises("hold", lambda bad=bad: call(plan, 0.0, hold=bad))
        raises("delta_v", lambda bad=bad: call(plan, 0.0, hold=2, delta_v=bad))
        raises("gain", lambda bad=bad: call(plan, 0.0, hold=2, gain=bad))
        raises("v_min", lambda bad=bad: call(plan, 0.0, hold=2, v_min=bad))
        raises("start", lambda bad=bad: call(plan, bad, hold=2))
    raises("delta_v", lambda: call(plan, 0.0, hold=2, delta_v=0))
    raises("start: 31", lambda: call(plan, 31, hold=2))
    raises("planned: too short to gain 20 m: only 0.000", lambda: call(plan, 0.0, hold=30))
    raises("planned: too short to gain 20 m: only 0.000", lambda: call(plan, 0.0, hold=99))
    raises("planned: too short to gain 200", lambda: call(plan, 0.0, hold=2, gain=200))


# -- verification

WIDE = verify.Limits(v_max=16.0, deceleration=6.0, acceleration=6.0, lateral=99.0)
"""More than ΔV and what the plans themselves vary and turn, within the reaction."""
Reason = verify.Reason


@given(cases(), numbers(0, 1))
def test_a_prescribed_trajectory_is_safe(case: Case, late: float) -> None:
    """As made, and thinned and through a message."""
    plan, start, _ = case
    result = made(case)
    assert verify.verify(result, plan, start, WIDE) == ()
    if case[2]["hold"] >= late:
        assert verify.verify(result, plan, start + late, WIDE) == ()
    received = from_message(to_message(thin(result, 10**5)))
    assert verify.verify(received, plan, start, WIDE) == ()


@given(cases(), numbers(1.2, 30), numbers(-3, 3))
def test_elsewhere_is_not(case: Case, away: float, angle: float) -> None:
    """Shifted by more than the limits: it does not start where the vehicle is."""
    plan, start, _ = case
    by = away * np.array([np.cos(angle), np.sin(angle)])
    found = verify.verify(moved(made(case), by=(by[0], by[1])), plan, start, WIDE)
    assert Reason.START in found


@pytest.mark.slow
@given(cases(), numbers(0.6, 10), st.data())
def test_off_the_path_is_not(case: Case, aside: float, data: st.DataObject) -> None:
    """shapely says how far a bent one is off; none further off than the limit passes, and none
    is refused for it if both lines are within 3/4 of it."""
    plan, start, _ = case
    result = made(case)
    k = data.draw(st.integers(1, len(result) - 1))
    aside = data.draw(st.sampled_from([aside, 0.3]))
    xy = result.xy.copy()
    step = xy[k] - xy[k - 1]
    assume(np.hypot(*step) > 0.1)
    xy[k] += aside * np.array([-step[1], step[0]]) / np.hypot(*step)
    bent = Trajectory(result.t, xy)
    line = LineString(plan.xy)
    dense = LineString(xy).segmentize(0.05)
    off = max(line.distance(Point(p)) for p in dense.coords)
    found = verify.verify(bent, plan, start, WIDE)
    limit = WIDE.path + WIDE.position_error
    if off > limit:
        assert Reason.PATH in found
    if max(off, BENDS + aside) < 0.75 * limit:
        assert Reason.PATH not in found
    assert off <= hausdorff_distance(LineString(xy), line, densify=0.01) + 0.06


@given(numbers(2, 14), numbers(0.5, 8), numbers(0.5, 4), numbers(0.5, 6), numbers(5, 15))
def test_mean_deceleration_over_the_reaction(
    v: float, step: float, reaction: float, bound: float, last: float
) -> None:
    """One step: ΔV within the bound times the reaction, and not above; up and down."""
    assume(step < v and abs(step - bound * reaction) > 0.3)
    plan = straight(v, 60)
    result = prescribe.prescribe(plan, 0.0, hold=2.0, delta_v=step, gain=5 * step, v_min=0)
    assume(reaction < 5)
    for wide, wanted in (("acceleration", "deceleration"), ("deceleration", "acceleration")):
        limits = verify.Limits(
            **{wanted: bound, wide: 1e3, "v_max": 99, "reaction": reaction, "path": 0.5}
        )
        found = verify.verify(result, plan, 0.0, limits)
        assert found == ((Reason.ACCELERATION,) if step > bound * reaction else ())


def test_two_steps_within_the_reaction_add_up() -> None:
    plan = straight(12.0)
    t = np.array([0, 3, 4, 30.0])
    v = np.array([12, 9, 6.0])
    x = np.concatenate([[0], np.cumsum(v * np.diff(t))])
    two = Trajectory(t, np.stack([x, 0 * x], axis=1))
    for reaction, expected in ((0.9, ()), (2.0, (Reason.ACCELERATION,))):
        limits = verify.Limits(deceleration=4.5 / reaction, reaction=reaction)
        assert verify.verify(two, plan, 0.0, limits) == expected


def test_many_tiny_segments_hide_no_speed() -> None:
    """1 ms each at 25 m/s, where rounding could explain any speed."""
    t = np.arange(0, 2, 1e-3)
    fast = Trajectory(t, np.stack([25 * t, 0 * t], axis=1))
    plan = straight(13.0)
    assert Reason.SPEED in verify.verify(fast, plan, 0.0, verify.Limits(acceleration=99))


def test_back_and_across() -> None:
    plan = straight(10.0)
    back = Trajectory(np.array([0, 5, 6, 20.0]), np.array([(0, 0), (50, 0), (45, 0), (150, 0.0)]))
    wide = verify.Limits(v_max=50, acceleration=99, deceleration=99, lateral=99)
    assert verify.verify(back, plan, 0.0, wide) == (Reason.PATH,)
    # A plan that crosses itself; the prescription skips the loop.
    xy = np.array([(0, 0), (50, 0), (50, 30), (25, 30), (25, -30), (80, -30.0)])
    arc = np.concatenate([[0], np.cumsum(np.hypot(*np.diff(xy, axis=0).T))])
    loop = Trajectory(arc / 10, xy)
    places = np.array([(0, 0), (25, 0), (25, -30), (80, -30.0)])
    short = Trajectory(np.array([0, 2.5, 5.5, 10]), places)
    assert Reason.PATH in verify.verify(short, loop, 0.0, wide)
    assert verify.verify(loop, loop, 0.0, wide) == ()


@given(numbers(0, 30), numbers(0, 30), numbers(1, 20))
def test_gaps(ahead: float, behind: float, limit: float) -> None:
    """Closed form: the vehicle 20 m further back closes up to the follower, away from the
    leader."""
    plan = straight(12.0)
    result = prescribe.prescribe(plan, 0.0, hold=2.0)
    leader, follower = (moved(plan, by=(d, 0.0)) for d in (ahead, -20 - behind))
    assume(abs(ahead - limit) > 1e-6 and abs(behind - limit) > 1e-6)
    limits = verify.Limits(leader_gap=limit, follower_gap=limit)
    found = verify.verify(result, plan, 0.0, limits, leader, follower)
    assert (Reason.LEADER_GAP in found) == (ahead < limit)
    assert (Reason.FOLLOWER_GAP in found) == (behind < limit)
    assert set(found) <= {Reason.LEADER_GAP, Reason.FOLLOWER_GAP}


def test_gap_between_samples_and_from_now_on() -> None:
    plan = straight(10.0)
    crossing = Trajectory(np.array([4.0, 6]), np.array([(50, -20), (50, 20.0)]))
    limits = verify.Limits()
    assert verify.verify(plan, plan, 0.0, limits, crossing) == (Reason.LEADER_GAP,)
    old = verify.Limits(age=99)
    assert verify.verify(plan, plan, 0.0, old, None, crossing) == (Reason.FOLLOWER_GAP,)
    assert verify.verify(plan, plan, 5.9, old, crossing) == ()  # has passed
    late = moved(plan, later=100)
    assert verify.verify(plan, plan, 0.0, limits, late) == (Reason.LEADER_GAP,)  # not known


def test_expired() -> None:
    plan = straight(10.0)
    limits = verify.Limits(age=2.6)
    assert verify.verify(plan, plan, 2.6, limits) == ()
    assert verify.verify(plan, plan, 2.7, limits) == (Reason.EXPIRED,)
    assert Reason.EXPIRED in verify.verify(plan, plan, 31.0, verify.Limits(age=99))
    assert Reason.EXPIRED in verify.verify(plan.since(30), plan, 30.0, limits)  # nothing is left
    result = prescribe.prescribe(plan, 0.0, hold=0.5)
    assert verify.verify(result, plan, 2.0, limits) == (Reason.START,)  # the action has begun
    assert verify.verify(plan.since(1), plan, 0.0, limits) == ()  # begins in a second
    assert Reason.START in verify.verify(moved(plan, later=40), plan, 0.0, limits)


def test_one_point() -> None:
    here = Trajectory(np.zeros(1), np.zeros((1, 2)), True)
    limits = verify.Limits()
    assert verify.verify(here, here, 0.0, limits) == ()
    assert verify.verify(here, straight(5.0), 0.0, limits) == ()
    assert verify.verify(here, straight(12.0), 0.0, limits) == (Reason.ACCELERATION,)
    moving = Trajectory(np.zeros(1), np.zeros((1, 2)))
    assert verify.verify(moving, straight(5.0), 0.0, limits) == (Reason.EXPIRED,)


def test_however_long_it_costs_no_time() -> None:
    plan = straight(10.0)
    far = Trajectory(np.array([0.0, 1]), np.array([(0, 0), (9e12, 0.0)]))
    found = verify.verify(far, plan, 0.0, verify.Limits())
    assert {Reason.PATH, Reason.SPEED} <= set(found)
    n = 20_000
    zigzag = Trajectory(np.arange(n) * 1e-2, np.stack([np.arange(n) % 2, np.zeros(n)], axis=1))
    assert Reason.PATH in verify.verify(zigzag, plan, 0.0, verify.Limits())
