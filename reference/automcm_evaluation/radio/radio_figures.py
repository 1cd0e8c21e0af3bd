"""The figures of ``radio``."""

from __future__ import annotations

from automcm_evaluation.framework.experiment import Values
from automcm_simulation.road import figures


def plots(report: Values) -> figures.NamedFigures:
    """The fit, and the sessions."""
    s = report["summary"]
    figure, axes = figures.plots(1, 2, height=3.8)
    for n, fit in enumerate(s["fit"]):
        x, colour = [row["distance_m"] for row in fit["rows"]], f"C{n}"
        axes[0].plot(x, [row["table"] for row in fit["rows"]], color=colour, linewidth=1)
        axes[0].plot(
            x, [row["ns3"] for row in fit["rows"]], ".", color=colour, label=fit["traffic"]
        )
        x = [(band["distance_m"] + band["last_m"]) / 2 for band in fit["bands"]]
        axes[1].plot(x, [band["again"][1] for band in fit["bands"]], color=colour, linewidth=1)
        axes[1].plot(x, [band["again"][0] for band in fit["bands"]], ".", color=colour)
    axes[0].set_ylabel("frames that arrive, %")
    axes[1].set_ylabel("losses followed by a loss, %")
    for plot in axes:
        plot.set_xlabel("distance, m")
    figure.legend(loc="outside upper center", ncols=4)
    yield "fit", figure

    loads = sorted({p["load"] for p in s["sessions"]})
    timeouts = sorted({p["t_timeout"] for p in s["sessions"]})
    figure, axes = figures.plots(1, len(timeouts), height=3.8)
    for plot, t in zip(axes, timeouts, strict=True):
        for n, load in enumerate(loads):
            rows = [p for p in s["sessions"] if (p["t_timeout"], p["load"]) == (t, load)]
            figures.shares(plot, "distance_m", rows, color=f"C{n}", label=f"load {load:g}")
            for name, style in (("three_even", ":"), ("three_lasting", "--")):
                values = [100 * p[name] for p in rows]
                plot.plot(
                    [p["distance_m"] for p in rows], values, style, color=f"C{n}", linewidth=1
                )
        plot.set_title(f"t_timeout {t / 1000:g} s")
    axes[0].set_ylabel("sessions agreed, %")
    axes[len(axes) // 2].set_xlabel("distance, m")
    figures.legend(figure, axes[0], 4)
    yield "sessions", figure
