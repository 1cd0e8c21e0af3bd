"""The page of ``comfort`` and its figures, from the report alone."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

from automcm.experiments import figures as drawing
from automcm.experiments.comfort_claims import PLAIN, WITHOUT
from automcm.experiments.comfort_courses import COURSES, STAGES
from automcm.experiments.comfort_measures import FAR_S, HARD, JERK_S, SLOWER, WIDTH_M
from automcm.experiments.experiment import Values
from automcm.experiments.intervals import wilson
from automcm.road import Driving, Late
from automcm.scenarios.drive import NAMES
from automcm.scenarios.lane_change import Plan

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

TITLES = {
    "undisturbed": "undisturbed",
    "open-ended": "undisturbed, open-ended prescription",
    "uncoordinated": "no coordination",
    "cut": "radio cut both ways",
    "cut_to_b": "radio cut, prescriber to B",
    "cut_to_prescriber": "radio cut, B to prescriber",
    "prescriber_dies": "prescriber's station dies",
    "b_dies": "B's station dies",
    "prescriber_aborts": "prescriber gives up",
    "b_aborts": "B gives up",
    "leader_stops": "A stops, prescriber gives up",
    "prescriber_hangs": "prescriber's application hangs",
}
STYLES = {
    1: ("tab:red", "-"),
    2: ("tab:green", "--"),
    3: ("tab:blue", "-"),
    4: ("tab:orange", "-."),
}


def page(report: Values) -> list[str]:
    """All but title and claims."""
    return [
        *_run(report),
        *_fig6(report["summary"]["fig6"]),
        *_courses(),
        *_costs(report),
        *_stages(report["summary"]["stages"]),
        *_doubts(report),
    ]


def _run(report: Values) -> list[str]:
    s, plan, late = report["settings"], Plan(), Late()
    rows = [
        ("speed of all, km/h", " and ".join(map(str, s["speeds_kmh"])), "paper"),
        ("ΔV, km/h", f"{plan.delta_v * 3.6:g}", "paper"),
        ("gap gained, m", f"{plan.gain_m:g}", "paper"),
        ("Δt1, s", f"{plan.hold_s:g}", "paper"),
        ("receiver to receiver, centre to centre, m", f"{s['gap_m']:g}", "assumed"),
        ("prescriber ahead of B, m", f"{s['beside_m']:g}", "assumed"),
        ("both are drawn within, m", f"± {s['spread_m']:g}", "assumed"),
        ("CAM loss is noticed after, ms", f"{s['t_cam_loss_ms']}", "assumed"),
        ("A brakes to a stop at, m/s²", f"{Driving().hardest:g}", "assumed"),
        ("A stands, s", f"{s['stands_s']:g}", "assumed"),
        ("the prescriber sees that after, s", f"{s['sees_s']:g}", "assumed"),
        ("an open-ended prescription gains, m", f"{s['open_m']:g}", "assumed"),
        ("who was not told brakes late, at m/s²", f"{late.brake:g}", "assumed"),
        ("and restarts at a gap of, m", f"{late.restart_gap:g}", "calibrated"),
        ("moments of each fault in each stage", f"{s['trials']}", "-"),
    ]
    return [
        "## What was run",
        "",
        "The four vehicles of Fig. 6 on a straight road of two lanes: receivers A, B and C one",
        "behind the other, and the prescriber beside A and B. It asks B to drive slower and moves",
        "over before it. Following is by the intelligent driver model. Who is in the way of a lane",
        "change that it is not bound to notices it late, brakes and stops (road.Late).",
        "",
        "| parameter | value | source |",
        "|---|---|---|",
        *(f"| {name} | {value} | *{source}* |" for name, value, source in rows),
        "",
        f"Jerk is the change of acceleration over {JERK_S:g} s, divided by that: from one step of",
        "the road to the next it would be the step's, as the model has no limit for it. A vehicle",
        f"is slowed while it is more than {SLOWER:g} m/s slower than if nobody wanted to change",
        "lanes; the way lost is how far it is behind that at the end of the drive. Slowing is",
        "*needless* as far as it is more than what the undisturbed maneuver takes, and all of",
        "it if in the end nobody moves over. Gap and time to collision are of the prescriber, B",
        f"and C, to who is ahead of each and less than {WIDTH_M:g} m aside, bumper to bumper.",
    ]


def _fig6(fig6: Values) -> list[str]:
    lines = [
        "",
        "## Speed over position (Fig. 6)",
        "",
        "![Speed over position of prescriber, A, B and C at each speed](fig6.svg)",
        "",
        "| | prescriber | A | B | C |",
        "|---|---|---|---|---|",
    ]
    for speed, of in fig6.items():
        for label, what in (
            ("slowest, m/s", "slowest"),
            ("hardest braking, m/s²", "hardest"),
            ("the same during the lane change", "hardest_in_change"),
        ):
            cells = " | ".join(f"{of[what][str(n)]:.1f}" for n in NAMES)
            lines.append(f"| {speed} km/h: {label} | {cells} |")
    return [
        *lines,
        "",
        "B holds its speed for Δt1, then drives slower by ΔV until it has gained the gap; C",
        "follows. When the prescriber begins to move over B is about at its slowest, and speeds up",
        "from then on. The prescriber does not slow down for B: it slows down as it now follows A,",
        "and the driver model wants a longer gap than there is, the more so the faster they are.",
        "For the same reason B and C slow down a little at the start, where nobody has asked yet.",
    ]


def _courses() -> list[str]:
    return [
        "",
        "## Courses",
        "",
        "Each fault is run with all rules and without the one that is for it. What is taken away",
        "is outside of the protocol: a timer too long to expire, or an application that does not",
        "say what it should.",
        "",
        "| course | what happens | without | how it is taken away |",
        "|---|---|---|---|",
        *(f"| {TITLES[name]} | {c.text} | {c.rule} | {c.taken} |" for name, c in COURSES.items()),
        "",
        "III-D names two cases, a scenario that changes and a vehicle that fails. The first is",
        "taken as: A stops, so that there is no place for the prescriber any more; and: the",
        "prescriber no longer wants to move over. The second as: a station that dies, an",
        "application that hangs or gives up.",
    ]


def _label(name: str) -> str:
    title = TITLES[name.removesuffix(WITHOUT)]
    if name in PLAIN:
        return title
    course = COURSES[name.removesuffix(WITHOUT)]
    return f"{title}, without {course.rule}" if name.endswith(WITHOUT) else f"{title}, with"


def _costs(report: Values) -> list[str]:
    lines = [
        "",
        "## What it costs",
        "",
        "Ways lost and slowing are means over all moments of the fault, all else is the worst. The",
        "interval is Wilson's, 95 %.",
        "",
        "![Needless way lost, hardest braking and least gap of each course, with and without its "
        "rule](costs.svg)",
    ]
    for speed, rows in report["summary"]["rows"].items():
        lines += [
            "",
            f"### {speed} km/h",
            "",
            "| course | moved over | hardest braking of prescriber, B, C, m/s² "
            "| largest jerk of the same, m/s³ | way lost by the same, m | as time, B, s "
            "| needless, B, m / s | needless, C, m / s | least gap, m | least time to collision, s "
            f"| touched | braked harder than {HARD:g} m/s² |",
            "|---|---|---|---|---|---|---|---|---|---|---|---|",
        ]
        for name, row in rows.items():
            lines.append(_row(name, row, int(speed) / 3.6))
    return lines


def _row(name: str, row: Values, speed: float) -> str:
    low, high = wilson(row["moved"], row["drives"])
    who = ("prescriber", "B", "C")
    far = row["ttc_s"] >= FAR_S
    cells = [
        _label(name),
        f"{row['moved']} of {row['drives']} ({low:.0%} to {high:.0%})",
        ", ".join(f"{row[f'{n} braking']:.1f}" for n in who),
        ", ".join(f"{row[f'{n} jerk']:.1f}" for n in who),
        ", ".join(f"{row[f'{n} lost_m']:.1f}" for n in who),
        f"{row['B lost_m'] / speed:.1f}",
        *(f"{row[f'{n} needless_m']:.1f} / {row[f'{n} needless_s']:.1f}" for n in ("B", "C")),
        f"{row['gap_m']:.1f}",
        f"over {FAR_S:g}" if far else f"{row['ttc_s']:.1f}",
        str(row["touched"]),
        str(row["hard"]),
    ]
    return f"| {' | '.join(cells)} |"


def _stages(stages: Values) -> list[str]:
    lines = [
        "",
        "## When it happens",
        "",
        "Needless way lost by B and C together, m (mean), and hardest braking of B or C, m/s²",
        "(worst), by the stage of the maneuver that the fault falls into; all speeds.",
        "",
        f"| course | {' | '.join(STAGES)} |",
        f"|---{'|---' * len(STAGES)}|",
    ]
    for name, by in stages.items():
        cells = (f"{by[s]['needless_m']:.1f}; {by[s]['braking']:.1f}" for s in STAGES)
        lines.append(f"| {_label(name)} | {' | '.join(cells)} |")
    return [
        *lines,
        "",
        "- While it is negotiated nobody drives slower yet, and a fault has nothing to cost. There",
        "  is one exception: if B gives up in that time and says so (END-2), the prescriber's",
        "  application is told of A and C only, finds nobody in the way and moves over before B.",
        "- A fault while B holds its speed is over with next to no slowing if it is noticed before",
        "  Δt1 ends. CAM loss takes its time-out longer to notice than an abort.",
        "- In the slow-down less is saved the later it comes: B has slowed already, and the lane",
        "  change that it slowed for is not made. Where only the radio fails, that is the price of",
        "  ACT-2; without the rule all goes as planned.",
        "- During the lane change there is nothing to be saved but of an open-ended prescription:",
        "  B drives its own speed again, and what is begun the prescriber ends by itself.",
        "- An application that hangs does not end what it prescribed. ACT-4 ends it when the lease",
        "  does: late, as a lease has to last for the whole maneuver.",
    ]


def _doubts(report: Values) -> list[str]:
    return [
        "",
        "## Doubts",
        "",
        "- The paper's Fig. 6 is a picture, and III-D has no figure: only directions are compared.",
        "- At its start the gap between receivers is shorter than the driver model wants at these",
        "  speeds, so that B and C brake a little, whatever happens. Ways lost are against a drive",
        "  that has that, too; hardest braking is not.",
        "- Deceleration and jerk of who notices late come from a model with assumed values.",
        f"- Each drive ends after {report['settings']['until_s']:g} s; a vehicle that is not yet",
        "  back at its speed then has lost less than it will have.",
        "- One place and one radio are drawn for each moment; the worst of more would be worse.",
        "  The moments are spread evenly, not drawn, and intervals take them as if they were.",
    ]


# -- figures


def figures(report: Values) -> Iterator[tuple[str, Figure]]:
    """Fig. 6, and costs by course."""
    yield "fig6", _speeds(report["summary"]["fig6"])
    yield "costs", _bars(report["summary"]["all"])


def _speeds(fig6: Values) -> Figure:
    figure, plots = drawing.plots(len(fig6), 1, height=3.2 * len(fig6) + 0.5)
    for plot, (speed, of) in zip(plots, fig6.items(), strict=True):
        for n, name in NAMES.items():
            colour, line = STYLES[n]
            label = name if n == 1 else f"receiver {name}"
            speeds = [v * 3.6 for v in of["speed"][str(n)]]
            plot.plot(of["x_m"][str(n)], speeds, line, color=colour, label=label)
        plot.axvspan(of["begin_m"], of["end_m"], color="0.88", label="prescriber moves over")
        plot.set(title=f"{speed} km/h", ylabel="speed, km/h", ylim=(0, int(speed) * 1.2))
    plots[-1].set_xlabel("position along the road, m")
    handles, labels = plots[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper center", ncols=5)
    return figure


def _bars(all_: Values) -> Figure:
    figure, plots = drawing.plots(1, 3, height=6.5)
    names = [*(n for n in PLAIN), *COURSES]
    places = {name: len(names) - n for n, name in enumerate(names)}
    for plot, what, label in (
        (plots[0], "needless_m", "needless way lost\nby B and C, m (mean)"),
        (plots[1], "braking", "hardest braking\nof B or C, m/s² (worst)"),
        (plots[2], "gap_m", "least gap, m (worst)"),
    ):
        _with_and_without(plot, all_, places, what)
        plot.set(xlabel=label, yticks=list(places.values()), ylim=(0.4, len(names) + 0.6))
        plot.set_yticklabels([TITLES[name] for name in names] if plot is plots[0] else [])
        plot.axvline(0, color="black", linewidth=0.8)
    handles, labels = plots[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper center", ncols=3)
    return figure


def _with_and_without(plot: Axes, all_: Values, places: dict[str, int], what: str) -> None:
    plain = [name for name in places if name in PLAIN]
    for shift, names, suffix, colour, label in (
        (0.0, plain, "", "0.55", "no fault"),
        (0.2, list(COURSES), "", "tab:blue", "fault, with its rule"),
        (-0.2, list(COURSES), WITHOUT, "tab:orange", "fault, without"),
    ):
        plot.barh(
            [places[name] + shift for name in names],
            [all_[name + suffix][what] for name in names],
            height=0.38,
            color=colour,
            label=label,
        )
