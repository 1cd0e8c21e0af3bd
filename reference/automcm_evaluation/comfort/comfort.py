"""Speeds of the four vehicles (Fig. 6), and the cost of a maneuver in comfort (section III-D).

The maneuver of Fig. 6 is driven undisturbed, without coordination, and with each of the faults of
``comfort_courses.COURSES``, each with and without the rule against it.  The time of a fault is
varied over a grid within each stage of the maneuver.
"""

from __future__ import annotations

from random import Random
from typing import Annotated

import numpy as np
from pydantic import Field

from automcm.applications.vehicle import STEP_S
from automcm_evaluation.comfort import comfort_courses as courses
from automcm_evaluation.comfort import comfort_tables
from automcm_evaluation.comfort.comfort_courses import PRESCRIBER, A, B, C, ComfortSetting
from automcm_evaluation.comfort.comfort_measures import HARD, Tracks, distance
from automcm_evaluation.framework.experiment import ExperimentSettings, Values, grid
from automcm_simulation.road.drive import FourVehicles
from automcm_spec.vocabulary.parameters import Parameters

TITLE = "Speeds and comfort (Fig. 6, III-D)"
DRAWN_STEPS = 5
"""Fig. 6 is drawn from every fifth step of the road."""
DRAWN_S = 25.0
"""Duration of Fig. 6 in seconds."""
Speed = Annotated[int, Field(ge=25, le=80)]


class Settings(ExperimentSettings):
    """Settings in SI units, except for names with km/h or ms."""

    speeds_kmh: tuple[Speed, ...] = Field(default=(30, 50), min_length=1)
    """The speeds of Fig. 6; the paper's (section VI-B)."""
    faults_kmh: tuple[Speed, ...] = Field(default=(30, 50), min_length=1)
    """The speeds of the drives with faults."""
    trials: int = Field(default=5, ge=1, le=100)
    """Number of evenly spread times of each fault in each stage, with new positions and losses."""
    gap_m: float = Field(default=FourVehicles().gap_m, ge=15, le=60)
    """Distance between consecutive receivers, centre to centre; assumed."""
    beside_m: float = Field(default=FourVehicles().beside_m, ge=0, le=10)
    """The prescriber's initial distance ahead of B; assumed."""
    spread_m: float = Field(default=1.0, ge=0, le=3)
    """Both are drawn evenly within so much to either side."""
    until_s: float = Field(default=50.0, ge=40, le=200)
    """Length of a drive."""
    t_cam_loss_ms: int = Field(default=Parameters().t_cam_loss, ge=1001, le=10_000)
    stands_s: float = Field(default=5.0, ge=0, le=20)
    """The duration of A's stop; assumed."""
    sees_s: float = Field(default=0.5, ge=0, le=3)
    """The time after which the prescriber notices A's stop; assumed."""
    open_m: float = Field(default=150.0, ge=30, le=200)
    """Gain of an open-ended prescription, to be ended by a Fin; assumed."""


def cells(settings: Settings) -> list[Values]:
    """Fig. 6 at each speed, and all courses with faults in one stage at one speed."""
    all_ = settings.model_dump(mode="json")
    speeds, faults_kmh, trials = (all_.pop(name) for name in ("speeds_kmh", "faults_kmh", "trials"))
    return grid(part="fig6", speed_kmh=speeds, setting=all_) + grid(
        part="courses", speed_kmh=faults_kmh, stage=courses.STAGES, trials=trials, setting=all_
    )


def run(values: Values, seed: int) -> Values:
    """A cell."""
    s = values["setting"]
    places = {name: s[name] for name in ("gap_m", "beside_m", "until_s")}
    assumed = {name: s[name] for name in ("t_cam_loss_ms", "stands_s", "sees_s", "open_m")}
    setting = ComfortSetting(four=FourVehicles(speed_kmh=values["speed_kmh"], **places), **assumed)
    if values["part"] == "fig6":
        return fig6(setting.drawn(seed, 0.0))
    random = Random(seed)
    trials = values["trials"]
    drives: dict[str, list[Values]] = {}
    for n in range(trials):
        drawn = setting.drawn(random.getrandbits(31), s["spread_m"])
        for name, cost in trial(drawn, values["stage"], (n + 0.5) / trials).items():
            drives.setdefault(name, []).append(cost)
    return {name: comfort_tables.together(costs) for name, costs in drives.items()}


def trial(setting: ComfortSetting, stage: str, share: float) -> dict[str, Values]:
    """Each course once, its fault after ``share`` of the stage.

    "cut" is that course with its rule, "cut without" the same without it.
    """
    begin, end = courses.stage(stage, setting.four.plan)
    at_s = begin + share * (end - begin)
    alone = courses.nobody(setting)
    plain = courses.undisturbed(setting)
    needed = {n: (plain[n].lost(alone[n]), plain[n].slowed(alone[n])) for n in (B, C)}
    found = {
        "undisturbed": cost(plain, alone, needed),
        "open-ended": cost(courses.undisturbed(setting, open_ended=True), alone, needed),
        "uncoordinated": cost(courses.uncoordinated(setting), alone, needed),
    }
    for name, course in courses.COURSES.items():
        without_change = alone
        if course.else_befalls is not None:
            without_change = courses.nobody(setting, course, at_s)
        for with_rules in (True, False):
            driven = courses.disturbed(course, setting, at_s, with_rules=with_rules)
            found[name if with_rules else f"{name} without"] = cost(driven, without_change, needed)
    return found


def cost(found: Tracks, alone: Tracks, needed: dict[int, tuple[float, float]]) -> Values:
    """The measures of one drive.  ``alone``: the drive without a lane change; ``needed``: the
    slowing of B and of C, in m and s, in an undisturbed lane change.

    Any further slowing is needless, and all of it without a lane change.
    """
    moved = bool(found[PRESCRIBER].y[-1] != found[PRESCRIBER].y[0])
    near = [distance(n, found) for n in (PRESCRIBER, B, C)]
    values: Values = {
        "drives": 1,
        "moved": int(moved),
        "touched": int(any(gap < 0 for gap, _ in near)),
        "hard": int(any(found[n].braking > HARD for n in (PRESCRIBER, B, C))),
        "gap_m": min(gap for gap, _ in near),
        "ttc_s": min(ttc for _, ttc in near),
    }
    for name, n in (("prescriber", PRESCRIBER), ("B", B), ("C", C)):
        track = found[n]
        values[f"{name} braking"] = track.braking
        values[f"{name} jerk"] = track.jerk
        values[f"{name} lost_m"] = track.lost(alone[n])
        if n in needed:
            need_m, need_s = needed[n] if moved else (0.0, 0.0)
            values[f"{name} needless_m"] = max(0.0, values[f"{name} lost_m"] - need_m)
            values[f"{name} needless_s"] = max(0.0, track.slowed(alone[n]) - need_s)
    return values


def fig6(setting: ComfortSetting) -> Values:
    """The undisturbed maneuver: speed over position of four vehicles, and its claims."""
    found, alone = courses.undisturbed(setting), courses.nobody(setting)
    prescriber = found[PRESCRIBER]
    moving = np.flatnonzero(np.diff(prescriber.y))
    begin, end = int(moving[0]), int(moving[-1]) + 1
    steps = slice(0, round(DRAWN_S / STEP_S), DRAWN_STEPS)
    gap, _ = distance(C, found)
    return {
        "x_m": {str(n): np.round(found[n].x[steps], 2).tolist() for n in found},
        "speed": {str(n): np.round(found[n].speed[steps], 3).tolist() for n in found},
        "begin_s": round(float(prescriber.t[begin]), 1),
        "end_s": round(float(prescriber.t[end]), 1),
        "begin_m": round(float(prescriber.x[begin]), 2),
        "end_m": round(float(prescriber.x[end]), 2),
        "slower_s": {str(n): found[n].first_slower(alone[n]) for n in (A, B, C)},
        "slowest": {str(n): round(float(found[n].speed.min()), 3) for n in found},
        "a_differs": round(float(np.abs(found[A].speed - alone[A].speed).max()), 3),
        "b_at_begin": round(float(found[B].speed[begin]), 3),
        "hardest": {str(n): round(found[n].braking, 3) for n in found},
        "hardest_in_change": {
            str(n): round(max(0.0, -float(found[n].acceleration[begin + 1 : end + 1].min())), 3)
            for n in found
        },
        "c_gap_m": round(gap, 2),
    }
