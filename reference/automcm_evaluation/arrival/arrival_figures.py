"""The figures of ``arrival``, made only from the report."""

from __future__ import annotations

from automcm_evaluation.arrival.arrival_tables import NEAR_S, PAPER, SPEEDS_KMH
from automcm_evaluation.framework.experiment import Values, cells_of, chosen
from automcm_simulation.road import figures as drawing

COLOURS = {"with": "tab:blue", "without": "tab:orange"}
FRAME = {"boxstyle": "round,pad=0.25", "fill": False, "edgecolor": "tab:red", "linewidth": 1.5}


def plots(report: Values) -> drawing.NamedFigures:
    """Fig. 8, and the gain over two parameters of the baseline."""
    yield "arrival", _arrival(report)
    yield "baseline", _grid(report)


def _arrival(report: Values) -> drawing.Figure:
    figure, plots = drawing.plots(2, 1, height=6)
    for plot, speed_kmh, letter in zip(plots, SPEEDS_KMH, "ab", strict=True):
        cells = chosen(cells_of(report), part="trials", speed_kmh=speed_kmh)
        here = report["summary"]["speeds"][str(speed_kmh)]
        for which, colour in COLOURS.items():
            times = sorted(t for cell in cells for t in cell.result[which]["arrival_s"])
            shares = [100 * (n + 1) / len(times) for n in range(len(times))]
            plot.step([times[0], *times], [0, *shares], where="post", color=colour)
            middle = here[which]["mean_s"]
            label = f"{which} coordination, mean {middle:.1f} s"
            plot.axvline(middle, color=colour, linestyle="--", linewidth=1, label=label)
        plot.set_title(f"({letter}) {speed_kmh} km/h: {here['gain_s']:.2f} s earlier")
        plot.set_ylabel("trials arrived, %")
        plot.legend(loc="center")
    plots[-1].set_xlabel("time since the prescriber's signal, s")
    return figure


def _grid(report: Values) -> drawing.Figure:
    figure, plots = drawing.plots(1, 2, height=3.8)
    grids, used = report["summary"]["grid"], report["settings"]
    brakes = {point["brake"] for point in grids[str(SPEEDS_KMH[0])]}
    brake = min(brakes, key=lambda b: (abs(b - used["brake"]), b))
    top = max(point["gain_s"] for grid in grids.values() for point in grid)
    for plot, speed_kmh in zip(plots, SPEEDS_KMH, strict=True):
        points = [p for p in grids[str(speed_kmh)] if p["brake"] == brake]
        waits = sorted({p["restart_s"] for p in points})
        gaps = sorted({p["restart_gap"] for p in points})
        gain = {(p["restart_gap"], p["restart_s"]): p["gain_s"] for p in points}
        rows = [[gain[gap, wait] for wait in waits] for gap in gaps]
        image = plot.imshow(rows, origin="lower", aspect="auto", cmap="viridis", vmin=0, vmax=top)
        for y, row in enumerate(rows):
            for x, value in enumerate(row):
                colour = "white" if value < top / 2 else "black"
                box = FRAME if abs(value - PAPER[speed_kmh][0]) <= NEAR_S else None
                plot.text(x, y, f"{value:.1f}", ha="center", va="center", color=colour, bbox=box)
        plot.grid(visible=False)
        plot.set_xticks(range(len(waits)), [f"{wait:g}" for wait in waits])
        plot.set_yticks(range(len(gaps)), [f"{gap:g}" for gap in gaps])
        plot.set_xlabel("stands at least, s")
        plot.set_title(f"{speed_kmh} km/h; framed: {PAPER[speed_kmh][0]:.0f} ± {NEAR_S:g} s")
    plots[0].set_ylabel("restarts at a gap of, m")
    figure.colorbar(image, ax=plots, label=f"gain, s (brakes at {brake:g} m/s²)")
    return figure
