"""The safety experiment's figures."""

from __future__ import annotations

from itertools import cycle

from automcm_evaluation.framework.experiment import Values, cells_of, chosen
from automcm_evaluation.framework.intervals import wilson
from automcm_evaluation.safety.safety_tables import lengths
from automcm_simulation.road import figures as drawing


def plots(report: Values) -> drawing.NamedFigures:
    """Lengths of hazards, mechanisms, and room on the road."""
    yield "hazards", _hazards(report)
    yield "mechanisms", _mechanism_bars(report["summary"])
    yield "room", _room(report)


def _hazards(report: Values) -> drawing.Figure:
    figure, (plot,) = drawing.plots()
    s, cells = report["summary"], chosen(cells_of(report), part="faults")
    b, faults = s["bound_ms"], [row["fault"] for row in s["faults"] if row["hazards"]]
    for fault, style in zip(faults, cycle(("-", "--", "-.", ":")), strict=False):
        found = lengths(chosen(cells, fault=fault))
        shares = [n / len(found) for n in range(len(found) + 1)]
        label = f"{fault} ({len(found)})"
        plot.step([0, *found], shares, where="post", label=label, linestyle=style)
    plot.axvline(b, color="black", linewidth=1.5)
    plot.annotate(
        f"B = {b} ms", (b, 1.0), xytext=(4, 0), textcoords="offset points", rotation=90, va="top"
    )
    plot.set(xlabel="length of the hazard, ms", ylabel="share of hazards no longer")
    plot.set(xlim=(0, b * 1.06), ylim=(0, 1.03))
    if faults:
        figure.legend(title="fault (hazards)", loc="outside upper center", ncols=3)
    return figure


def _mechanism_bars(s: Values) -> drawing.Figure:
    figure, (longest, share) = drawing.plots(1, 2, height=5.5)
    rows = list(reversed(s["mechanisms"]))
    b = s["bound_ms"]
    values = [row["longest_ms"] or 0 for row in rows]
    colours = ["C3" if value > b else "C0" for value in values]
    longest.barh([row["ablation"] for row in rows], values, color=colours)
    longest.axvline(b, color="black", linewidth=1.5)
    longest.annotate(
        f"B = {b} ms", (b, len(rows) - 0.4), xytext=(4, 0), textcoords="offset points", va="bottom"
    )
    longest.set(
        xlabel="longest hazard, ms",
        xlim=(0, 1.08 * max([b, *values])),
        ylim=(-0.6, len(rows) + 0.5),
    )
    for name, label, colour, shift in (
        ("unexcused", "without excuse (S-5)", "C1", 0.2),
        ("beyond", "longer than B (T-2)", "C3", -0.2),
    ):
        met = [(n + shift, row) for n, row in enumerate(rows) if row[name]]
        shares = [row[name] / row["drives"] * 100 for _, row in met]
        limits = [wilson(row[name], row["drives"]) for _, row in met]
        low = [v - lo * 100 for v, (lo, _) in zip(shares, limits, strict=True)]
        high = [hi * 100 - v for v, (_, hi) in zip(shares, limits, strict=True)]
        places = [place for place, _ in met]
        share.errorbar(
            shares, places, xerr=[low, high], fmt="o", color=colour, label=label, capsize=2
        )
    share.set(xlabel="share of drives, %, with 95 % interval", xlim=(0, None))
    share.set(yticks=range(len(rows)), yticklabels=[], ylim=(-0.6, len(rows) + 0.5))
    share.legend(title="drives with a hazard", loc="lower right")
    return figure


def _room(report: Values) -> drawing.Figure:
    figure, plots = drawing.plots(1, len(report["settings"]["speeds_kmh"]), height=4)
    names = [row["ablation"] for row in report["summary"]["road"]]
    names = list(reversed(dict.fromkeys(names)))
    for plot, speed in zip(plots, report["settings"]["speeds_kmh"], strict=True):
        for n, name in enumerate(names):
            rooms = [
                room
                for cell in chosen(cells_of(report), speed_kmh=speed, ablation=name)
                for room in cell.result["room_m"]
                if room is not None
            ]
            plot.plot(rooms, [n] * len(rooms), "|", color=f"C{n}", markersize=12)
        plot.axvline(0, color="black", linewidth=1.5)
        plot.set(title=f"{speed} km/h", xlabel="room when moving over begins, m", xlim=(-5, 20))
        plot.set(yticks=range(len(names)), ylim=(-0.6, len(names) - 0.4))
        plot.set_yticklabels(names if plot is plots[0] else [])
    return figure
