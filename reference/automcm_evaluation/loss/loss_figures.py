"""The figures of ``loss``."""

from __future__ import annotations

from collections.abc import Sequence

from automcm_evaluation.framework.experiment import Values
from automcm_evaluation.loss.loss_tables import CLASSES, MODELS, NAMES, PAPER_KNEES, T_TIMEOUTS
from automcm_simulation.road import figures

SHADES = ("#1b7837", "#a6dba0", "#fdb863", "#b2182b")
COLOURS = {0: "#b2182b", 1000: "#e08214", 2000: "#2166ac"}
STYLES = {"eq2": ":", "three_exchanges": "--", "four_messages": "-"}


def plots(report: Values) -> figures.NamedFigures:
    """The counterpart of Fig. 9, the agreement with its models, and the costs."""
    s = report["summary"]
    for name, label, height, columns, table, draw in (
        ("fig9", "drives, %", 3.6, 4, s["road"], _stacked),
        ("success", "coordinations agreed, %", 4.1, 2, s["points"], _measured),
    ):
        figure, axes = figures.plots(1, 3, height=height)
        for plot, t in zip(axes, T_TIMEOUTS, strict=True):
            draw(plot, table[str(t)], t)
            plot.set(title=f"t_timeout {t / 1000:g} s", xticks=range(0, 101, 20))
        axes[0].set_ylabel(label)
        axes[1].set_xlabel("loss, %")
        figures.legend(figure, axes[0], columns)
        yield name, figure

    figure, axes = figures.plots(1, 2, height=3.8)
    for n, loss in enumerate(sorted({r["loss"] for r in s["cost"]})):
        rows = [r for r in s["cost"] if r["loss"] == loss and r["messages"] and r["share"] >= 0.05]
        x = [r["t_timeout"] / 1000 for r in rows]
        axes[0].plot(x, [r["messages"] for r in rows], ".-", color=f"C{n}", label=f"{loss}%")
        axes[1].plot(x, [r["mean_ms"] / 1000 for r in rows], ".-", color=f"C{n}")
    axes[0].set_ylabel("messages for each agreement")
    axes[1].set_ylabel("time to agreement, s")
    for plot in axes:
        plot.set_xlabel("t_timeout, s")
        plot.set_ylim(bottom=0)
    axes[0].legend(title="loss", ncols=2)
    yield "cost", figure


def _stacked(plot: figures.Axes, rows: Sequence[Values], t: int) -> None:
    below = [0.0] * len(rows)
    for k, name in enumerate(CLASSES):
        shares = [100 * r["classes"][k] / r["trials"] for r in rows]
        plot.bar([r["loss"] for r in rows], shares, 7, bottom=below, color=SHADES[k], label=name)
        below = [a + b for a, b in zip(below, shares, strict=True)]
    plot.axvline(PAPER_KNEES[t], color="black", linestyle=":", linewidth=1)


def _measured(plot: figures.Axes, points: Sequence[Values], t: int) -> None:
    label = "measured, 95 % interval"
    figures.shares(plot, "loss", points, label=label, markersize=4, color=COLOURS[t])
    for name, style in STYLES.items():
        y = [100 * MODELS[name](loss / 100, t) for loss in range(101)]
        plot.plot(range(101), y, style, color="#444444", linewidth=1, label=NAMES[name])
    plot.axvline(PAPER_KNEES[t], color="black", linestyle=":", linewidth=0.6)
