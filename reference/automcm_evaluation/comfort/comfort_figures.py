"""The figures of ``comfort``, made only from the report."""

from __future__ import annotations

from automcm_evaluation.comfort.comfort_courses import COURSES
from automcm_evaluation.comfort.comfort_tables import PLAIN, TITLES, WITHOUT
from automcm_evaluation.framework.experiment import Values
from automcm_simulation.road import figures as drawing
from automcm_simulation.road.drive import NAMES

STYLES = {
    1: ("tab:red", "-"),
    2: ("tab:green", "--"),
    3: ("tab:blue", "-"),
    4: ("tab:orange", "-."),
}


def plots(report: Values) -> drawing.NamedFigures:
    """Fig. 6, and costs by course."""
    yield "fig6", _speeds(report["summary"]["fig6"])
    yield "costs", _bars(report["summary"]["all"])


def _speeds(fig6: Values) -> drawing.Figure:
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
    drawing.legend(figure, plots[0], 5)
    return figure


def _bars(all_: Values) -> drawing.Figure:
    figure, plots = drawing.plots(1, 3, height=6.5)
    names = [*PLAIN, *COURSES]
    places = {name: len(names) - n for n, name in enumerate(names)}
    for plot, what, label in (
        (plots[0], "needless_m", "needless way lost\nby B and C, m (mean)"),
        (plots[1], "braking", "hardest braking\nof B or C, m/s² (worst)"),
        (plots[2], "gap_m", "least gap, m (worst)"),
    ):
        for shift, own, suffix, colour, kind in (
            (0.0, PLAIN, "", "0.55", "no fault"),
            (0.2, COURSES, "", "tab:blue", "fault, with its rule"),
            (-0.2, COURSES, WITHOUT, "tab:orange", "fault, without"),
        ):
            plot.barh(
                [places[name] + shift for name in own],
                [all_[name + suffix][what] for name in own],
                height=0.38,
                color=colour,
                label=kind,
            )
        plot.set(xlabel=label, yticks=list(places.values()), ylim=(0.4, len(names) + 0.6))
        plot.set_yticklabels([TITLES[name] for name in names] if plot is plots[0] else [])
        plot.axvline(0, color="black", linewidth=0.8)
    drawing.legend(figure, plots[0], 3)
    return figure
