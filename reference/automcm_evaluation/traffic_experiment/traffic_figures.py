"""The figures of ``traffic``."""

from __future__ import annotations

import numpy as np

from automcm_evaluation.framework.experiment import Values
from automcm_evaluation.traffic_experiment.traffic_tables import ASKED
from automcm_simulation.road import figures


def plots(report: Values) -> figures.NamedFigures:
    """The travel time and the radio by density; the crowds."""
    s = report["summary"]
    if s["road"]:
        yield "road", _road(s)
    yield "crowds", _crowds(s)


def _road(s: Values) -> figures.Figure:
    figure, (travel, radio) = figures.plots(1, 2, height=4.2)
    four = [row for row in s["road"] if row["scenario"] == ASKED]
    for n, variant in enumerate(("none", "silent", "stations")):
        for share, style in ((0.0, "-"), (0.1, ":"), (0.5, "--"), (1.0, "-")):
            rows = [r for r in four if (r["variant"], r["share"]) == (variant, share)]
            if not rows:
                continue
            middle, low, high = zip(*(row["s_per_km"] for row in rows), strict=True)
            travel.errorbar(
                [row["per_km"] for row in rows],
                middle,
                [np.subtract(middle, low), np.subtract(high, middle)],
                fmt=".",
                linestyle=style,
                color=f"C{n}",
                label=variant if not share else f"{variant}, {share:.0%}",
                linewidth=1,
            )
    rows = sorted(
        (r for r in four if r["variant"] == "stations"), key=lambda r: r["per_km"] * r["share"]
    )
    x = [row["per_km"] * row["share"] for row in rows]
    known = [(at, row) for at, row in zip(x, rows, strict=True) if row["busy"] and row["cam_p95"]]
    radio.plot([at for at, _ in known], [r["busy"][0] for _, r in known], "o", label="busy")
    ages = [r["cam_p95"][0] / 1000 for _, r in known]
    radio.plot([at for at, _ in known], ages, "x", label="age of CAMs, 95 %, s")
    travel.set(xlabel="vehicles per km", ylabel="time for a km, s")
    radio.set(xlabel="vehicles with stations per km", ylim=(0, None))
    radio.legend()
    travel.legend(fontsize=7)
    return figure


def _crowds(s: Values) -> figures.Figure:
    figure, (bound, agreed) = figures.plots(1, 2, height=3.8)
    for early, mark in ((False, "o"), (True, "x")):
        rows = [row for row in s["answers"] if row["early"] == early]
        label = "closed when all have answered (ADV-9)" if early else "fixed window"
        for name, colour in (("agreed_ms", "C0"), ("free_ms", "C3")):
            at = [(r["joined"], r[name] / 1000) for r in rows if r[name] is not None]
            what = "agreed" if name == "agreed_ms" else "all others free"
            bound.plot(*zip(*at, strict=True), mark, color=colour, label=f"{what}, {label}")
    bound.set(xlabel="receivers", ylabel="time since the request, s", ylim=(0, None))
    bound.legend(fontsize=7)
    for spread_ms in sorted({row["spread_ms"] for row in s["all_ask"]}):
        rows = [row for row in s["all_ask"] if row["spread_ms"] == spread_ms]
        label = f"within {spread_ms / 1000:g} s" if spread_ms else "at one moment"
        x = [row["stations"] for row in rows]
        for name, style in (("first", ":"), ("agreed", "-")):
            shares = [100 * row[name] / row["of"] for row in rows]
            what = "first session" if name == "first" else "at the end"
            agreed.plot(x, shares, f"o{style}", label=f"{label}, {what}", markersize=3)
    agreed.set(xlabel="stations that ask", ylabel="agreed, %", ylim=(0, 105))
    agreed.legend(fontsize=7)
    return figure
