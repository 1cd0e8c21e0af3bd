"""What a maneuver costs in comfort: the measures, the faults with and without their rules, and
what is claimed of them."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from automcm.applications.lane_change import Plan
from automcm_evaluation.comfort import comfort, comfort_tables
from automcm_evaluation.comfort.comfort_courses import (
    COURSES,
    NEVER_MS,
    PRESCRIBER,
    STAGES,
    B,
    C,
    Changer,
    ComfortRun,
    ComfortSetting,
    disturbed,
    nobody,
    stage,
    uncoordinated,
    undisturbed,
)
from automcm_evaluation.comfort.comfort_measures import (
    FAR_S,
    DrivenTrack,
    braking,
    distance,
    first_slower,
    jerk,
    lost,
    slowed,
    tracks,
)
from automcm_evaluation.framework.experiment import Cell
from automcm_simulation.road.drive import FourVehicles
from automcm_spec.vocabulary.parameters import Parameters

Json = Any
SETTING = ComfortSetting(four=FourVehicles(until_s=30.0))


def track(speeds: list[float], x: float = 0.0, y: float = 0.0) -> DrivenTrack:
    """A vehicle with these speeds, one each 0.1 s."""
    v = np.array(speeds)
    t = np.arange(len(v)) * 0.1
    acceleration = np.diff(v, prepend=v[0]) / 0.1
    return DrivenTrack(t, x + np.cumsum(v) * 0.1, np.full(len(v), y), v, acceleration)


# -- measures


def test_braking_jerk_and_way_lost() -> None:
    even = track([10.0] * 30)
    slowing = track([10.0] * 10 + [9.8, 9.6, 9.4, 9.2, 9.0] + [9.0] * 5 + [10.0] * 10)
    assert braking(even) == 0 and jerk(even) == 0
    assert braking(slowing) == pytest.approx(2.0)
    assert jerk(slowing) == pytest.approx(20.0)  # from 0 to 10 m/s² within 0.5 s
    assert lost(slowing, even) == pytest.approx(0.1 * (0.2 + 0.4 + 0.6 + 0.8 + 1.0 * 6))
    assert slowed(slowing, even) == pytest.approx(0.8)  # those slower by more than 0.5 m/s
    assert first_slower(slowing, even) == 1.2 and first_slower(even, even) is None


def test_distance_is_to_who_is_next_ahead_and_in_the_way() -> None:
    me = track([10.0] * 10)
    found = {1: me, 2: track([5.0] * 10, x=24.5), 3: track([0.0] * 10, x=15.0, y=3.5)}
    d = distance(1, found)
    assert d.gap == pytest.approx(24.5 - 4.5 - 5.0 * 0.1 * 10, abs=0.01)
    assert d.collision_s == pytest.approx(d.gap / 5.0)
    assert distance(2, found).gap == np.inf
    faster = found | {2: track([11.0] * 10, x=24.5)}
    assert distance(1, faster).collision_s is None


# -- courses


def test_the_stages_follow_one_another_as_the_maneuver_does() -> None:
    ends = [stage(name, Plan(), Parameters(), 4.0) for name in STAGES]
    assert [end for _, end in ends[:-1]] == [begin for begin, _ in ends[1:]]
    moved = next(s.t for s in undisturbed(SETTING).drive.road.of(PRESCRIBER) if s.y > 0)
    assert moved == pytest.approx(SETTING.four.signal_s + ends[3][0], abs=0.3)
    with pytest.raises(ValueError, match="no stage 'parking'"):
        stage("parking", Plan(), Parameters(), 4.0)


def test_services_fall_silent_only_when_nothing_driven_depends_on_them(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    at_s = 5.0
    short = disturbed(COURSES["prescriber_aborts"], SETTING, at_s, with_rules=True)
    sent = len(short.drive.sent)
    monkeypatch.setattr(ComfortRun, "_silence", lambda self: None)
    whole = disturbed(COURSES["prescriber_aborts"], SETTING, at_s, with_rules=True)
    assert whole.drive.road.samples == short.drive.road.samples
    assert len(whole.drive.sent) >= sent


def test_no_coordination_costs_b_more_than_the_maneuver() -> None:
    alone, with_, without = (
        tracked(drive(SETTING)) for drive in (nobody, undisturbed, uncoordinated)
    )
    assert braking(with_[B]) <= 2.0 < braking(without[B])
    assert 0 < lost(with_[B], alone[B]) < lost(without[B], alone[B])
    assert with_[PRESCRIBER].y[-1] == without[PRESCRIBER].y[-1] > 3
    assert alone[PRESCRIBER].y[-1] == 0


def tracked(run: ComfortRun) -> dict[int, DrivenTrack]:
    return tracks(run.drive.road.samples)


def slowing(name: str, at_s: float, *, with_rules: bool) -> tuple[float, bool]:
    """How much way B loses, and whether the prescriber moved over."""
    alone = tracked(nobody(SETTING))
    found = tracked(disturbed(COURSES[name], SETTING, at_s, with_rules=with_rules))
    return lost(found[B], alone[B]), bool(found[PRESCRIBER].y[-1] > 3)


@pytest.mark.sweep(3)
@pytest.mark.parametrize(
    ("name", "at_s", "moved_without", "most", "saved"),
    [
        # Slowing that nobody makes use of ends.
        *((name, 5.0, False, 999, 3) for name in comfort_tables.ABANDONED),
        # A lane change that would have gone well is given up.
        *((name, 5.0, True, 999, 0) for name in comfort_tables.LINK),
        # Without its rule the prescriber moves over before B, which makes no room.
        *((name, 3.0, True, 1, 29) for name in ("b_dies", "b_aborts")),
    ],
)
def test_with_its_rule_a_course_costs_b_less_way_and_nobody_moves_over(
    name: str, at_s: float, moved_without: bool, most: float, saved: float
) -> None:
    with_, moved = slowing(name, at_s, with_rules=True)
    without, other = slowing(name, at_s, with_rules=False)
    assert (moved, other) == (False, moved_without)
    assert with_ < min(most, without - saved)


def test_a_stops_and_the_prescriber_looks_or_does_not() -> None:
    course = COURSES["leader_stops"]
    seen, blind = (
        tracked(disturbed(course, SETTING, 6.0, with_rules=rules)) for rules in (True, False)
    )
    assert seen[PRESCRIBER].y[-1] == 0 < blind[PRESCRIBER].y[-1]
    assert min(seen[2].speed) == 0 < seen[2].speed[-1]
    assert distance(PRESCRIBER, blind).gap < 1 < distance(B, seen).gap


def test_what_is_taken_away_is_taken_from_the_stations_and_nothing_else() -> None:
    for name, course in COURSES.items():
        run = disturbed(
            course, replace(SETTING, four=FourVehicles(until_s=0.5)), 0, with_rules=False
        )
        losses = {s.parameters.t_cam_loss for s in run.drive.simulation.services.values()}
        assert losses == {1500 if course.cams else NEVER_MS}, name
        assert all(isinstance(driver, Changer) for driver in run.drive.drivers)


def test_slowing_is_needless_unless_a_lane_change_takes_it() -> None:
    even = track([10.0] * 30)
    slow = track([10.0] * 10 + [8.0] * 10 + [10.0] * 10)
    alone = {1: even, 2: track([10.0] * 30, x=60), 3: even, 4: even}
    needed = {B: (1.5, 0.4), C: (0.0, 0.0)}
    stayed = comfort.cost(alone | {3: slow}, alone, needed)
    assert (stayed["moved"], stayed["B needless_m"]) == (0, pytest.approx(2.0))
    assert stayed["B needless_s"] == pytest.approx(1.0) and stayed["C needless_m"] == 0
    over = replace(even, y=np.linspace(0, 3.5, 30))
    moved = comfort.cost(alone | {1: over, 3: slow}, alone, needed)
    assert (moved["moved"], moved["B needless_m"]) == (1, pytest.approx(0.5))
    assert moved["B needless_s"] == pytest.approx(0.6)
    counts = moved["drives"], moved["hard"], moved["touched"]
    assert counts == (1, 1, 1)  # 20 m/s², and nobody is a length away
    assert moved["B lost_m"] == pytest.approx(2.0) and moved["ttc_s"] == FAR_S


# -- the experiment


def test_cells_are_fig_6_and_each_stage_at_each_speed() -> None:
    cells = comfort.cells(comfort.Comfort())
    assert [c["speed_kmh"] for c in cells if c["part"] == "fig6"] == [30, 50]
    courses = [(c["speed_kmh"], c["stage"]) for c in cells if c["part"] == "courses"]
    assert courses == [(speed, name) for speed in (30, 50) for name in STAGES]


def test_drawn_places_stay_within_their_spread() -> None:
    fours = [SETTING.drawn(seed, 1.0).four for seed in range(40)]
    for values, middle in (([f.gap_m for f in fours], 22.0), ([f.beside_m for f in fours], 3.0)):
        assert middle - 1 <= min(values) < middle - 0.5 < middle + 0.5 < max(values) <= middle + 1
    assert SETTING.drawn(5, 0.0).four == replace(SETTING.four, seed=5)


def test_cells_merge_to_sums_means_and_the_worst() -> None:
    row = {"drives": 2, "moved": 1, "touched": 0, "hard": 1, "gap_m": 3.0, "ttc_s": 9.0}
    row |= {f"{n} {what}": 1.0 for n in "BC" for what in ("braking", "needless_m")}
    other = row | {"gap_m": 1.0, "moved": 2, "C braking": 4.0, "B needless_m": 2.0}
    other |= {"touched": 1, "ttc_s": 5.0}
    cells = [Cell({}, {"cut": row}), Cell({}, {"cut": other})]
    found = comfort_tables.merged(cells, "cut")
    assert (found["drives"], found["moved"], found["gap_m"], found["ttc_s"]) == (4, 3, 1.0, 5.0)
    assert (found["B needless_m"], found["C needless_m"], found["needless_m"]) == (1.5, 1.0, 2.5)
    assert (found["C braking"], found["braking"], found["hard"]) == (4.0, 4.0, 2)
    assert found["touched"] == 1
