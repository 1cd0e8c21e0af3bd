"""The page and the figures of ``loss``."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

from automcm_evaluation.framework.experiment import PAGES, Values
from automcm_evaluation.loss.loss_tables import (
    MODELS,
    NAMES,
    PAPER_KNEES,
    ROBUST,
    T_TIMEOUTS,
    late,
    robust_drives,
)
from automcm_simulation.road import figures
from automcm_spec.support import markdown

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

CLASSES = ("29 s or less", "29 to 30 s", "30 to 31 s", "31 s or more")
SHADES = ("#1b7837", "#a6dba0", "#fdb863", "#b2182b")
COLOURS = {0: "#b2182b", 1000: "#e08214", 2000: "#2166ac"}
STYLES = {"eq2": ":", "three_exchanges": "--", "four_messages": "-"}


def page(report: Values) -> str:
    """Markdown."""
    return markdown.page(
        PAGES / "loss.md.j2",
        s=report["summary"],
        settings=report["settings"],
        t_timeouts=T_TIMEOUTS,
        classes=CLASSES,
        models=list(MODELS),
        names=NAMES,
        paper_knees=PAPER_KNEES,
        late=late,
        by_loss=lambda points: {p["loss"]: p for p in points},
        robust=ROBUST,
        drives_at=lambda t: [
            (name, rows[t]) for name, rows in robust_drives(report["summary"]).items()
        ],
    )


def _seconds(t: int) -> str:
    return f"{t / 1000:g} s"


def plots(report: Values) -> Iterator[tuple[str, Figure]]:
    """The counterpart of Fig. 9, the agreement with its models, and the costs."""
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
    axes[0].set_ylabel("coordinations agreed, %")
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
