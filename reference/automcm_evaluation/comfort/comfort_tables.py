"""The results of ``comfort`` compared with Fig. 6 and section III-D."""

from __future__ import annotations

from collections.abc import Sequence
from statistics import fmean as mean

from automcm.applications.lane_change import Plan
from automcm.applications.vehicle import Driving, LateBraking
from automcm_evaluation.comfort.comfort_courses import COURSES, PRESCRIBER, STAGES, B, C
from automcm_evaluation.comfort.comfort_measures import FAR_S, HARD, JERK_S, SLOWER, WIDTH_M
from automcm_evaluation.framework.experiment import Cell, Values, captions, chosen

TITLES = captions("comfort", "titles")
PLAIN = ("undisturbed", "open-ended", "uncoordinated")
"""The drives without a fault."""
LITTLE = 0.5
"""Braking up to this (m/s²) is "little or no deceleration"; assumed: the paper has no figure."""
COMFORTABLE = 2.0
"""Braking up to this (m/s²) is comfortable in the driver model (road.Driving.comfortable)."""
SAME = 0.1
"""Speeds that differ by less than this, m/s, count as equal."""
CLEAR_M = 1.0
"""Mean distances that differ by less than this, m, count as equal."""
ABANDONED = ("prescriber_dies", "prescriber_aborts", "prescriber_hangs")
"""Courses in which the prescriber no longer uses B's slowing: the case of section III-D."""
LINK = ("cut", "cut_to_b", "cut_to_prescriber")
"""Courses in which only the radio fails."""
WITHOUT = " without"


DRIVES = (*PLAIN, *(name + rules for name in COURSES for rules in ("", WITHOUT)))
"""All drives of a trial, in their order."""


def summary(cells: Sequence[Cell]) -> Values:
    """``fig6`` by speed (km/h, as text); ``rows`` by speed and drive; ``stages`` by drive and
    stage; ``all`` by drive."""
    courses = chosen(cells, part="courses")
    speeds = list(dict.fromkeys(cell.values["speed_kmh"] for cell in courses))
    return {
        "fig6": {str(cell.values["speed_kmh"]): cell.result for cell in chosen(cells, part="fig6")},
        "rows": {
            str(speed): {name: merged(chosen(courses, speed_kmh=speed), name) for name in DRIVES}
            for speed in speeds
        },
        "stages": {
            name: {stage: merged(chosen(courses, stage=stage), name) for stage in STAGES}
            for name in DRIVES
            if name not in PLAIN
        },
        "all": {name: merged(courses, name) for name in DRIVES},
    }


def merged(cells: Sequence[Cell], name: str) -> Values:
    """The means of several cells with equally many drives; ``needless_m`` is the sum of B and C."""
    found = together([cell.result[name] for cell in cells])
    return found | {
        "needless_m": round(found["B needless_m"] + found["C needless_m"], 3),
        "braking": max(found["B braking"], found["C braking"]),
    }


def together(rows: Sequence[Values]) -> Values:
    """The summary of several drives: sums of counts, means of m and s, the worst of the rest."""
    found: Values = {}
    for what in rows[0]:
        values = [row[what] for row in rows]
        if what in ("drives", "moved", "touched", "hard"):
            found[what] = sum(values)
        elif what in ("gap_m", "ttc_s"):
            found[what] = round(min(values), 3)
        elif what.endswith(("braking", "jerk")):
            found[what] = round(max(values), 3)
        else:
            found[what] = round(mean(values), 3)
    return found


# -- what the page and the claims use


def names(report: Values) -> Values:
    """``fig6`` has the figures of each speed, ``mitigation`` the sums over all faults."""
    s = report["summary"]
    all_, fig6 = s["all"], s["fig6"]

    def total(what: str, *, without: bool = False, of: Sequence[str] = tuple(COURSES)) -> int:
        return sum(all_[name + WITHOUT * without][what] for name in of)

    def average(what: str, of: Sequence[str], *, without: bool = False) -> float:
        return mean([all_[name + WITHOUT * without][what] for name in of])

    return {
        "plan": Plan(),
        "late": LateBraking(),
        "hardest": Driving().hardest,
        "hard": HARD,
        "jerk_s": JERK_S,
        "slower": SLOWER,
        "width_m": WIDTH_M,
        "far_s": FAR_S,
        "suffix": WITHOUT,
        "when": lambda s: "never" if s is None else f"{s:.1f}",
        "total": total,
        "average": average,
        "saved": [all_[n + WITHOUT]["needless_m"] - all_[n]["needless_m"] for n in ABANDONED],
        "in_change": {
            str(n): [f["hardest_in_change"][str(n)] for f in fig6.values()] for n in (PRESCRIBER, B)
        },
        "before": [_before(f["slower_s"][str(B)], f["begin_s"]) for f in fig6.values()],
        "follows": [
            _before(f["slower_s"][str(B)], f["slower_s"][str(C)]) and f["c_gap_m"] > 0
            for f in fig6.values()
        ],
    }


def _before(first: float | None, then: float | None) -> bool:
    """Whether both happened, in this order."""
    return first is not None and then is not None and first < then
