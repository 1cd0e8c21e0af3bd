"""The results of ``comfort`` compared with Fig. 6 and section III-D."""

from __future__ import annotations

from collections.abc import Sequence

from automcm_evaluation.comfort.comfort_courses import COURSES, PRESCRIBER, STAGES, B, C
from automcm_evaluation.comfort.comfort_measures import HARD
from automcm_evaluation.framework.experiment import Cell, Claim, Values, beyond, chosen, graded
from automcm_evaluation.framework.intervals import mean

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


def names() -> list[str]:
    """All drives of a trial, in their order."""
    return [*PLAIN, *(name + rules for name in COURSES for rules in ("", WITHOUT))]


def summary(cells: Sequence[Cell]) -> Values:
    """``fig6`` by speed (km/h, as text); ``rows`` by speed and drive; ``stages`` by drive and
    stage; ``all`` by drive."""
    courses = chosen(cells, part="courses")
    speeds = list(dict.fromkeys(cell.values["speed_kmh"] for cell in courses))
    return {
        "fig6": {str(cell.values["speed_kmh"]): cell.result for cell in chosen(cells, part="fig6")},
        "rows": {
            str(speed): {name: merged(chosen(courses, speed_kmh=speed), name) for name in names()}
            for speed in speeds
        },
        "stages": {
            name: {stage: merged(chosen(courses, stage=stage), name) for stage in STAGES}
            for name in names()
            if name not in PLAIN
        },
        "all": {name: merged(courses, name) for name in names()},
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


def claims(report: Values) -> list[Claim]:
    """The claims on Fig. 6 and section III-D, then further ones."""
    s = report["summary"]
    return [*_fig6(s["fig6"]), *_mitigation(s["all"]), *_beyond(s["all"])]


def _each(fig6: Values, text: str, **values: Sequence[object]) -> str:
    """The text for each speed, with the values of that speed."""
    parts = [
        f"{speed} km/h: " + text.format(**{name: of[n] for name, of in values.items()})
        for n, speed in enumerate(fig6)
    ]
    return "; ".join(parts)


def _fig6(fig6: Values) -> list[Claim]:
    of = list(fig6.values())
    b, c = [f["slower_s"][str(B)] for f in of], [f["slower_s"][str(C)] for f in of]
    begin = [f["begin_s"] for f in of]
    before = [when is not None and when < at for when, at in zip(b, begin, strict=True)]
    follows = [
        after is not None and when is not None and after > when and f["c_gap_m"] > 0
        for when, after, f in zip(b, c, of, strict=True)
    ]
    same = [f["a_differs"] <= SAME for f in of]
    return [
        Claim(
            "B decelerates before the prescriber's lane change (Fig. 6)",
            "it does",
            _each(
                fig6,
                "slower from {b} s on, lane change from {at} s, B then at {v:.1f} m/s",
                b=[_s(x) for x in b],
                at=begin,
                v=[f["b_at_begin"] for f in of],
            ),
            graded(all(before), any(before)),
            "agreed beforehand and held for Δt1",
        ),
        Claim(
            "C, behind B, decelerates as well to keep its distance (Fig. 6)",
            "it does",
            _each(
                fig6,
                "slower from {c} s on, down to {v:.1f} m/s, gap at least {gap:.1f} m",
                c=[_s(x) for x in c],
                v=[f["slowest"][str(C)] for f in of],
                gap=[f["c_gap_m"] for f in of],
            ),
            graded(all(follows), any(follows)),
            "its driver model follows B",
        ),
        Claim(
            "A, ahead of B, is not disturbed (Fig. 6)",
            "it is not",
            _each(fig6, "differs by {d:.2f} m/s at most", d=[f["a_differs"] for f in of]),
            graded(all(same), any(same)),
            "its session is cancelled: it was not chosen",
        ),
        _braking(fig6, B, "B, its gap opened, hardly decelerates during the lane change (VI-B)"),
        _braking(fig6, PRESCRIBER, "The prescriber hardly decelerates during its lane change"),
    ]


def _s(value: float | None) -> str:
    return "never" if value is None else f"{value:.1f}"


def _braking(fig6: Values, station_id: int, claim: str) -> Claim:
    values = [f["hardest_in_change"][str(station_id)] for f in fig6.values()]
    gap = "its driver model wants a longer gap to A"
    return Claim(
        claim,
        "little or no deceleration",
        _each(fig6, "{v:.1f} m/s² at most", v=values),
        graded(max(values) <= LITTLE, max(values) <= COMFORTABLE),
        gap if station_id == PRESCRIBER else "its gap is open by then, and it accelerates",
    )


def _mitigation(all_: Values) -> list[Claim]:
    less = {
        name: all_[name + WITHOUT]["needless_m"] - all_[name]["needless_m"] for name in ABANDONED
    }
    fewer = [way > CLEAR_M for way in less.values()]
    with_ = [all_[name] for name in COURSES]
    without = [all_[name + WITHOUT] for name in COURSES]
    touched, touched_without = (sum(row["touched"] for row in rows) for rows in (with_, without))
    hard, hard_without = (sum(row["hard"] for row in rows) for rows in (with_, without))
    leader, blind = all_["leader_stops"], all_["leader_stops" + WITHOUT]
    calmer = leader["needless_m"] < blind["needless_m"] - CLEAR_M
    softer = leader["hard"] < blind["hard"]
    return [
        Claim(
            "Without mitigation vehicles keep decelerating unnecessarily (III-D)",
            "no figure",
            "needless distance lost by B and C, with and without mitigation: "
            + "; ".join(
                f"{_text(name)} {all_[name]['needless_m']:.1f} and "
                f"{all_[name + WITHOUT]['needless_m']:.1f} m"
                for name in ABANDONED
            ),
            graded(all(fewer), any(fewer)),
            "means over all moments of the fault; an early fallback saves most",
        ),
        Claim(
            "Falling back to driving alone is safe (III-D)",
            "no figure",
            f"vehicles touched in {touched} of {sum(r['drives'] for r in with_)} drives with the "
            f"rules, {touched_without} of {sum(r['drives'] for r in without)} without; a vehicle "
            f"braked harder than {HARD:g} m/s² in {hard} and {hard_without}",
            "not reproduced" if touched else "in shape only" if hard else "reproduced",
            "the driver model cannot hit a vehicle it sees; the hard braking is behind a "
            "stopping A, or by a B that gave up before it was chosen",
        ),
        Claim(
            "Comfort gains when the scenario changes (III-D): A stops, and the prescriber gives up",
            "may improve",
            f"needless distance lost by B and C {leader['needless_m']:.1f} and "
            f"{blind['needless_m']:.1f} m, with and without; a vehicle braked harder than "
            f"{HARD:g} m/s² in {leader['hard']} and {blind['hard']} of {blind['drives']} drives",
            graded(calmer and softer, calmer or softer),
            "B must brake for A in any case, and so must a prescriber already moving over",
        ),
    ]


def _text(name: str) -> str:
    return name.replace("_", " ")


def _beyond(all_: Values) -> list[Claim]:
    more = [all_[name]["needless_m"] - all_[name + WITHOUT]["needless_m"] for name in LINK]
    gave_up, went_on = (
        sum(all_[name + rules]["moved"] for name in LINK) for rules in ("", WITHOUT)
    )
    drives = sum(all_[name]["drives"] for name in LINK)
    b, alone = all_["undisturbed"], all_["uncoordinated"]
    silent = ("b_dies", "b_aborts")
    hard, harder = (
        mean([all_[name + rules]["B lost_m"] for name in silent]) for rules in ("", WITHOUT)
    )
    return [
        beyond(
            "Coordination spares B a hard braking",
            f"hardest {b['B braking']:.1f} m/s² and jerk {b['B jerk']:.1f} m/s³; without "
            f"{alone['B braking']:.1f} and {alone['B jerk']:.1f}; distance lost "
            f"{b['B lost_m']:.1f} and {alone['B lost_m']:.1f} m",
            b["B braking"] < alone["B braking"] and b["B jerk"] < alone["B jerk"],
            "without it, the stop is a rule of the model (road.Late)",
        ),
        beyond(
            "The fallback on CAM loss costs distance where only the radio fails (ACT-2)",
            "needless distance lost by B and C "
            f"{mean([all_[n]['needless_m'] for n in LINK]):.1f} m, "
            f"without the rule {mean([all_[n + WITHOUT]['needless_m'] for n in LINK]):.1f} m; "
            f"the lane change is made in {gave_up} and {went_on} of {drives} drives",
            mean(more) > 0 and gave_up < went_on,
            "a prescriber that hears nothing cannot know that B still makes room",
        ),
        beyond(
            "The fallback saves distance where B no longer makes room (ACT-2, END-1)",
            f"distance lost by B {hard:.1f} m on average, without the rules {harder:.1f} m",
            hard < harder,
            "without the rules the prescriber moves over all the same; a B that gives up before "
            "it is chosen counts as no obstacle",
        ),
    ]
