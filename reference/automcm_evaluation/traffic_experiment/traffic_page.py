"""The page and the figures of ``traffic``."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

from automcm.applications.occupancy import HARDEST
from automcm_evaluation.framework.experiment import PAGES, Values
from automcm_evaluation.traffic_experiment.crowd_sessions import PER_KM
from automcm_evaluation.traffic_experiment.traffic_cell import ALONE, VARIANTS
from automcm_simulation.road import figures
from automcm_simulation.traffic.mover import STEP_MS
from automcm_simulation.traffic.traffic_measures import OVER_STEPS, TTC_S
from automcm_spec.support import markdown
from automcm_spec.vocabulary.parameters import Parameters

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

ASKED_DENSITIES = (50.0, 100.0, 150.0, 200.0, 250.0, 300.0, 350.0, 400.0)
ASKED_SHARES = (0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 1.0)
ASKED_SEEDS = 20
ASKED = "lane-change-4"
"""The grid that the profile ``standard`` runs."""


def coverage(road: Sequence[Values]) -> Values:
    """Which part of the grid of ``standard`` was run: seeds by density and penetration."""
    ran = {
        (row["per_km"], row["share"]): row["seeds"]
        for row in road
        if row["scenario"] == ASKED and row["variant"] == "stations"
    }
    seeds = [[ran.get((per_km, share), 0) for share in ASKED_SHARES] for per_km in ASKED_DENSITIES]
    return {
        "shares": ASKED_SHARES,
        "rows": [
            {"per_km": per_km, "seeds": row}
            for per_km, row in zip(ASKED_DENSITIES, seeds, strict=True)
        ],
        "asked": len(ASKED_DENSITIES) * len(ASKED_SHARES) * ASKED_SEEDS,
        "ran": sum(min(number, ASKED_SEEDS) for row in seeds for number in row),
    }


def ended(road: Sequence[Values]) -> dict[str, int]:
    """How many sessions ended for each reason, in all runs with stations."""
    found: Counter[str] = Counter()
    for row in road:
        if row["variant"] == "stations":
            found.update(row["ended"])
    return dict(sorted(found.items()))


def indifferent(cells: Sequence[Values]) -> list[str]:
    """The scenarios in which SUMO's cooperation (lcCooperative) changed nothing in any run."""
    alone: dict[str, dict[tuple[str, float, int], Values]] = {name: {} for name in ALONE}
    for cell in cells:
        v = cell["values"]
        if v.get("variant") in ALONE:
            alone[v["variant"]][v["scenario"], v["per_km"], v["seed"]] = cell["result"]
    none, cooperative = (alone[name] for name in ALONE)
    both = none.keys() & cooperative.keys()
    differ = {key[0] for key in both if none[key] != cooperative[key]}
    return sorted({key[0] for key in both} - differ)


def spread(value: Sequence[float] | None, digits: int = 1) -> str:
    """Median, and in brackets least and greatest."""
    if value is None:
        return "-"
    middle, low, high = (f"{each:.{digits}f}" for each in value)
    return middle if low == high else f"{middle} ({low} to {high})"


def signed(value: Sequence[float] | None) -> str:
    """As ``spread``, in per cent with a sign."""
    if value is None:
        return "-"
    middle, low, high = (f"{each:+.1f}" for each in value)
    return f"{middle}%" if low == high else f"{middle}% ({low} to {high})"


def page(report: Values) -> str:
    """Markdown."""
    s = report["summary"]
    return markdown.page(
        PAGES / "traffic.md.j2",
        s=s,
        settings=report["settings"],
        variants=VARIANTS,
        coverage=coverage(s["road"]),
        indifferent=indifferent(report["cells"]),
        spread=spread,
        signed=signed,
        reasons=list(ended(s["road"])),
        hardest=HARDEST,
        over_s=OVER_STEPS * STEP_MS / 1000,
        ttc_s=TTC_S,
        per_km=PER_KM,
        limit=Parameters().max_participants,
        window_s=Parameters().t_advertise / 1000,
        hold_s=Parameters().t_hold / 1000,
    )


def plots(report: Values) -> Iterator[tuple[str, Figure]]:
    """The travel time and the radio by density; the crowds."""
    s = report["summary"]
    if s["road"]:
        yield "road", _road(s)
    yield "crowds", _crowds(s)


def _road(s: Values) -> Figure:
    figure, (travel, radio) = figures.plots(1, 2, height=4.2)
    four = [row for row in s["road"] if row["scenario"] == ASKED]
    for n, variant in enumerate(("none", "silent", "stations")):
        for share, style in ((0.0, "-"), (0.1, ":"), (0.5, "--"), (1.0, "-")):
            rows = [r for r in four if (r["variant"], r["share"]) == (variant, share)]
            label = variant if not share else f"{variant}, {share:.0%}"
            _line(travel, rows, "s_per_km", style, f"C{n}", label)
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


def _line(
    plot: Axes, rows: Sequence[Values], name: str, style: str, colour: str, label: str
) -> None:
    if not rows:
        return
    x, middle = [row["per_km"] for row in rows], [row[name][0] for row in rows]
    low = [row[name][0] - row[name][1] for row in rows]
    high = [row[name][2] - row[name][0] for row in rows]
    plot.errorbar(
        x, middle, [low, high], fmt=".", linestyle=style, color=colour, label=label, linewidth=1
    )


def _crowds(s: Values) -> Figure:
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
