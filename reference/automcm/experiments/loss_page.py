"""The page and the figures of ``loss``."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

from automcm.experiments import figures
from automcm.experiments.experiment import Values
from automcm.experiments.loss_tables import MODELS, NAMES, PAPER_KNEES, T_TIMEOUTS, late
from automcm.experiments.markdown import table

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

CLASSES = ("29 s or less", "29 to 30 s", "30 to 31 s", "31 s or more")
SHADES = ("#1b7837", "#a6dba0", "#fdb863", "#b2182b")
COLOURS = {0: "#b2182b", 1000: "#e08214", 2000: "#2166ac"}
STYLES = {"eq2": ":", "three_exchanges": "--", "four_messages": "-"}


def page(report: Values) -> list[str]:
    """Markdown."""
    s, settings = report["summary"], report["settings"]
    lines = [
        "## What was run",
        "",
        "*On the road*: two vehicles at 30 km/h, started as for Fig. 8; the clock runs from the",
        "prescriber's signal to the receiver's arrival at the target. Without agreement the",
        "prescriber moves over all the same, and the receiver brakes late, stops and restarts",
        "(`road.Late`, *calibrated* to Fig. 8). *Sessions*: the two stations alone, from the",
        "request to the agreement or to giving up; the receiver agrees to everything. A success",
        "is that both act (S-3).",
        "",
        "| parameter | value | source |",
        "|---|---|---|",
        "| t_timeout, s | 0, 1 and 2; Δt1 is the same | *paper* |",
        "| t_resend, ms | 100 | *paper* |",
        f"| drives at each loss and time-out | {settings['road']} | *60 in the paper* |",
        f"| sessions at each multiple of 10%, and between | {settings['sessions']:,}, "
        f"{settings['fine']:,} | *ours* |",
        "| loss | of each copy by itself, both ways, CAMs too | *assumed* |",
        "| delay of a copy, ms, even | 2 to 40 | *assumed* |",
        f"| target, m from the receiver's start | {settings['target_m']:g} | *paper* |",
        "| place of the signal, so that the paper's classes fit | as for Fig. 8 | *calibrated* |",
        "",
        "## Arrival times (Fig. 9)",
        "",
        "![Share of drives in each class of arrival time over the loss, by time-out](fig9.svg)",
        "",
        *_road(s),
        "",
        "The classes are the paper's own, without a shift: the place of the signal makes the drive",
        "without loss as long as the paper's. Between the two extremes there is little: a drive is",
        "coordinated, or it is not.",
        "",
        "## Success, and what explains it",
        "",
        "![Success over the loss, measured and by three models, by time-out](success.svg)",
        "",
        *_success(s),
        "",
        *_knees(s),
        "",
        *_deviation(s),
        "",
        "Eq. 2 is about one message that needs no answer. Three exchanges with their Acks (KIN-7)",
        "have their knees where the paper's are: the paper's implementation may well need every",
        "Ack. By the rules here none is needed: an Intention counts though its Acks are lost",
        "(ADV-6), an Acceptance ends a Prescription (PRE-4), and what counts is that four messages",
        "get there once. What is left between that model and the figures: the Ack of a",
        "Prescription also stops its give-up, so that an Acceptance has more time; and what",
        "arrives after the window's end is late.",
        "",
    ]
    if s["bursts"]:
        lines += ["## Loss in bursts", "", *_bursts(s), ""]
    lines += ["## What a longer time-out costs", ""]
    lines += ["![Messages and time for each agreement over the time-out](cost.svg)", ""]
    lines += [*_cost(s), "", *_smallest(s), "", "## Over UDP", ""]
    lines += _udp(s) if s["udp"] else ["Not run (`--set udp=20`)."]
    return lines


def _seconds(t: int) -> str:
    return f"{t / 1000:g} s"


def _percent(value: float | None) -> str:
    return "never" if value is None else f"{value:g}%"


def _road(s: Values) -> list[str]:
    rows: list[list[object]] = [
        [
            _seconds(t),
            f"{r['loss']}%",
            *(r["trials"], *r["classes"], r["mean_s"], r["agreed"], r["stopped"]),
        ]
        for t in T_TIMEOUTS
        for r in s["road"][str(t)]
    ]
    heads = ["t_timeout", "loss", "drives", *CLASSES, "mean, s", "agreed", "stopped"]
    found = table(heads, rows, 2)
    knees = [
        f"{_percent(late(s, t)['knee'])} and {_percent(late(s, t)['half'])} ({_seconds(t)}; the "
        f"paper: from {PAPER_KNEES[t]}%)"
        for t in T_TIMEOUTS
    ]
    return [*found, "", f"A tenth and a half are in the slowest class at {', '.join(knees)}."]


def _success(s: Values) -> list[str]:
    rows: list[list[object]] = [
        [
            _seconds(t),
            f"{p['loss']}%",
            f"{p['agreed']:,} of {p['trials']:,}",
            f"{p['share']:.1%}",
            f"{p['low']:.1%} to {p['high']:.1%}",
            *(f"{p[name]:.1%}" for name in MODELS),
        ]
        for t in T_TIMEOUTS
        for p in s["points"][str(t)]
        if p["loss"] % 10 == 0
    ]
    heads = ["t_timeout", "loss", "agreed", "success", "95 % interval", *NAMES.values()]
    return table(heads, rows, 2)


def _knees(s: Values) -> list[str]:
    rows: list[list[object]] = []
    for name in ("measured", *MODELS):
        row: list[object] = [NAMES.get(name, name)]
        for t in T_TIMEOUTS:
            k = s["knees"][str(t)][name]
            row.append(f"{_percent(k['knee'])} to {_percent(k['half'])}")
        rows.append(row)
    rows.append(['*the paper, "from"*', *(f"{PAPER_KNEES[t]}%" for t in T_TIMEOUTS)])
    heads = ["success falls below 90 % and below 50 % at", *map(_seconds, T_TIMEOUTS)]
    return table(heads, rows)


def _deviation(s: Values) -> list[str]:
    rows: list[list[object]] = [
        [NAMES[name], f"{d['largest']:.1%}", f"{d['mean']:.2%}"]
        for name, d in s["deviation"].items()
    ]
    return table(["model, against what was measured", "largest difference", "mean"], rows)


def _bursts(s: Values) -> list[str]:
    lines = [
        "A chain of two states for each direction (Gilbert 1960, Elliott 1963): in the bad one all",
        "is lost, in the good one nothing; it is bad as often as the mean loss says.",
        "",
    ]
    rows: list[list[object]] = []
    for t in T_TIMEOUTS:
        plain = {p["loss"]: p for p in s["points"][str(t)]}
        ways = [{p["loss"]: p for p in s["bursts"][b][str(t)]} for b in s["bursts"]]
        for loss in sorted(ways[0]):
            row: list[object] = [_seconds(t), f"{loss}%", f"{plain[loss]['share']:.1%}"]
            for way in ways:
                p = way[loss]
                row.append(f"{p['share']:.1%} ({p['low']:.0%} to {p['high']:.0%})")
            rows.append(row)
    bursts = (f"in bursts of {int(b) / 1000:g} s (95 % interval)" for b in s["bursts"])
    heads = ["t_timeout", "mean loss", "success, each copy by itself", *bursts]
    return [*lines, *table(heads, rows, 2)]


def _cost(s: Values) -> list[str]:
    rows: list[list[object]] = [
        [
            f"{r['t_timeout']:,} ms",
            f"{r['loss']}%",
            f"{r['share']:.1%} ({r['low']:.1%} to {r['high']:.1%})",
            "-" if r["messages"] is None else r["messages"],
            "-" if r["mean_ms"] is None else f"{r['mean_ms']:,}",
            "-" if r["q95_ms"] is None else f"{r['q95_ms']:,}",
        ]
        for r in s["cost"]
    ]
    heads = [
        *("t_timeout", "loss", "success (95 % interval)", "messages for each agreement"),
        *("time to it, ms", "within which 95 % of them are, ms"),
    ]
    return [
        *table(heads, rows, 2),
        "",
        "Most of the time is the window in which the prescriber advertises: it lasts t_timeout and",
        "100 ms whatever the loss, and is most of the messages too.",
    ]


def _smallest(s: Values) -> list[str]:
    def said(row: Values, name: str) -> str:
        if row[name] is None:
            return f"none up to {row['longest']:,} ms"
        return f"{row[name]:,} ms"

    rows: list[list[object]] = [
        [f"{row['loss']}%", said(row, "measured"), said(row, "model")] for row in s["smallest"]
    ]
    best = "smallest t_timeout tried with which 99 % agree"
    heads = ["loss", best, f"by {NAMES['four_messages']}"]
    return table(heads, rows)


def _udp(s: Values) -> list[str]:
    rows: list[list[object]] = []
    for r in s["udp"]:
        same = next(p for p in s["points"][str(r["t_timeout"])] if p["loss"] == r["loss"])
        rows.append(
            [
                _seconds(r["t_timeout"]),
                f"{r['loss']}%",
                f"{r['agreed']} of {r['trials']}",
                f"{r['low']:.0%} to {r['high']:.0%}",
                f"{same['share']:.1%}",
                r["latest_ms"],
            ]
        )
    heads = [
        *("t_timeout", "loss", "agreed over UDP", "95 % interval", "simulated radio"),
        "alarms late by, ms",
    ]
    return [
        "The same two stations on sockets of this machine, through the relay that loses, in real",
        "time. These cells are not the same again with the same seed. With t_timeout = 0 a machine",
        "that is late by some 80 ms loses messages of its own.",
        "",
        *table(heads, rows, 2),
    ]


def plots(report: Values) -> Iterator[tuple[str, Figure]]:
    """Fig. 9's look-alike, success with models, costs."""
    s = report["summary"]
    figure, axes = figures.plots(1, 3, height=3.6)
    for plot, t in zip(axes, T_TIMEOUTS, strict=True):
        _stacked(plot, s["road"][str(t)], t)
    axes[0].set_ylabel("drives, %")
    axes[1].set_xlabel("loss, %")
    figure.legend(*axes[0].get_legend_handles_labels(), loc="outside upper center", ncols=4)
    yield "fig9", figure

    figure, axes = figures.plots(1, 3, height=4.1)
    for plot, t in zip(axes, T_TIMEOUTS, strict=True):
        _measured(plot, s["points"][str(t)], t)
    axes[0].set_ylabel("coordinations that succeed, %")
    axes[1].set_xlabel("loss, %")
    figure.legend(*axes[0].get_legend_handles_labels(), loc="outside upper center", ncols=2)
    yield "success", figure

    figure, axes = figures.plots(1, 2, height=3.8)
    for n, loss in enumerate(sorted({r["loss"] for r in s["cost"]})):
        rows = [r for r in s["cost"] if r["loss"] == loss and r["messages"] is not None]
        rows = [r for r in rows if r["share"] >= 0.05]
        x = [r["t_timeout"] / 1000 for r in rows]
        shade = f"C{n}"
        axes[0].plot(x, [r["messages"] for r in rows], ".-", color=shade, label=f"{loss}%")
        axes[1].plot(x, [r["mean_ms"] / 1000 for r in rows], ".-", color=shade)
    axes[0].set_ylabel("messages for each agreement")
    axes[1].set_ylabel("time to agreement, s")
    for plot in axes:
        plot.set_xlabel("t_timeout, s")
        plot.set_ylim(bottom=0)
    axes[0].legend(title="loss", ncols=2)
    yield "cost", figure


def _stacked(plot: Axes, rows: list[Values], t: int) -> None:
    places = [r["loss"] for r in rows]
    below = [0.0] * len(rows)
    for k, name in enumerate(CLASSES):
        shares = [100 * r["classes"][k] / r["trials"] for r in rows]
        plot.bar(places, shares, 7, bottom=below, color=SHADES[k], label=name)
        below = [a + b for a, b in zip(below, shares, strict=True)]
    plot.axvline(PAPER_KNEES[t], color="black", linestyle=":", linewidth=1)
    plot.set_title(f"t_timeout {_seconds(t)}")
    plot.set_xticks(range(0, 101, 20))


def _measured(plot: Axes, points: list[Values], t: int) -> None:
    x = [p["loss"] for p in points]
    low = [100 * (p["share"] - p["low"]) for p in points]
    high = [100 * (p["high"] - p["share"]) for p in points]
    shares = [100 * p["share"] for p in points]
    plot.errorbar(
        x,
        shares,
        [low, high],
        fmt=".",
        markersize=4,
        color=COLOURS[t],
        label="measured, 95 % interval",
    )
    for name, style in STYLES.items():
        plot.plot(
            range(101),
            [100 * MODELS[name](loss / 100, t) for loss in range(101)],
            style,
            color="#444444",
            linewidth=1,
            label=NAMES[name],
        )
    plot.axvline(PAPER_KNEES[t], color="black", linestyle=":", linewidth=0.6)
    plot.set_title(f"t_timeout {_seconds(t)}")
    plot.set_xticks(range(0, 101, 20))
