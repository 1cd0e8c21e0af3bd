"""The figures of the bandwidth experiment."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import Any

from automcm_evaluation.bandwidth.bandwidth_air import CODECS
from automcm_evaluation.bandwidth.bandwidth_tables import ALWAYS, CASES, COLOURS
from automcm_evaluation.framework.experiment import Values
from automcm_simulation.road import figures as drawing


def plots(report: Values) -> drawing.NamedFigures:
    """Fig. 7 in each codec, and the scaling."""
    s = report["summary"]
    for name in CODECS:
        yield f"fig7-{name}", _fig_7(s, name)
    yield "scaling", _scaled(s)


def _fig_7(s: Values, name: str) -> drawing.Figure:
    figure, plots = drawing.plots(2, height=6.5)
    for plot, n, letter in zip(plots, ("2", "4"), "ab", strict=True):
        _stacked(plot, s["time"][n][name], s["bin_ms"] / 1000)
        plot.set_title(f"({letter}) {n} vehicles", loc="left", fontsize=10)
        plot.set_ylabel(f"kB/s ({name.upper()})")
    for plot in plots[:-1]:
        plot.sharex(plots[-1])
        plot.sharey(plots[-1])
    plots[-1].set_xlabel("time, s (the turn signal is set at 1 s)")
    handles, labels = plots[-1].get_legend_handles_labels()
    figure.legend(handles[::-1], labels[::-1], loc="outside right upper", fontsize=8)
    return figure


def _stacked(plot: drawing.Axes, time: Values, width: float) -> None:
    number = len(time[ALWAYS])
    left = [width * n for n in range(number)]
    below = [0.0] * number
    for kind, colour in COLOURS.items():
        values = [value / width / 1000 for value in time.get(kind, [0] * number)]
        plot.bar(left, values, width, below, align="edge", color=colour, label=kind)
        below = [a + b for a, b in zip(below, values, strict=True)]
    edges = [*left, left[-1] + width]
    both = zip(time[ALWAYS], time["CAM"], strict=True)
    heights = [(offer + cam) / width / 1000 for offer, cam in both]
    label = f"{ALWAYS}, with CAMs"
    plot.stairs(heights, edges, baseline=None, color="black", linestyle="--", label=label)
    plot.set_xlim(0, edges[-1])


def _scaled(s: Values) -> drawing.Figure:
    figure, plots = drawing.plots(1, 2, height=4.2)
    usual = min(each["participants"] for each in s["many"])
    many = [each for each in s["many"] if each["participants"] == usual]
    styles = {
        "always": ("#cc3311", "o-"),
        "busiest": ("#ee7733", "v:"),
        "maneuver": ("#0077bb", "s-"),
        "minute": ("#009988", "^--"),
        "cams": ("#888888", "-"),
    }
    raised = [each for each in s["many"] if each["participants"] > usual]
    for plot, name in zip(plots, CODECS, strict=True):
        draw = partial(_line, plot, name)
        for case, (colour, style) in styles.items():
            draw(many, case, style, color=colour, markersize=4, label=CASES[case])
        for case in ("busiest", "maneuver") if raised else ():
            label = "max_participants raised" if case == "maneuver" else None
            colour, style = styles[case]
            draw(raised, case, style[0], color=colour, fillstyle="none", label=label)
        plot.set_title(name.upper(), loc="left", fontsize=10)
        plot.set_xlabel("vehicles in range")
        plot.set_ylabel(f"share of {s['channel_bit_s'] / 1e6:g} Mbit/s, CAMs included, %")
        plot.set_ylim(bottom=0)
    plots[0].legend(fontsize=8)
    return figure


def _line(
    plot: drawing.Axes, name: str, rows: Sequence[Values], case: str, style: str, **more: Any
) -> None:
    shares = [100 * each["channel"][name][case] for each in rows]
    plot.plot([each["vehicles"] for each in rows], shares, style, **more)
