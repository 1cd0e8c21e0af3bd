"""The tables of ``radio``: the fit, sessions and their models, drives, crowds."""

from __future__ import annotations

from collections.abc import Sequence
from statistics import fmean as mean

from automcm_evaluation.framework.experiment import Cell, Values, agreed_share, chosen, groups
from automcm_evaluation.loss.loss_tables import CLASSES, classes
from automcm_evaluation.radio.radio_traffic import (
    REACH_M,
    WIDTH_M,
    DistanceRow,
    Measured,
    ns3_measured,
    summed,
)

POINTS = 3.0
"""The largest difference between the table and ns-3 that is accepted, in per cent points."""
BAND_M = 100
ENOUGH = 1000
"""Runs of losses of which the lengths are known well enough to compare them."""
MODELS = {
    "three_even": "KIN-7, even loss",
    "three_lasting": "KIN-7, lasting states",
    "four_even": "four messages, even loss",
    "four_lasting": "four messages, lasting states",
}
TARGET = 0.68
"""Of the channel busy ratio (dcc)."""


def arrivals(ns3: Measured, rows: Sequence[DistanceRow]) -> list[Values]:
    """By distance: the share that arrives in ns-3 and by the table, in per cent."""
    return [
        {
            "distance_m": a.distance_m,
            "ns3": _percent(a.arrived, a.frames),
            "table": _percent(b.arrived, b.frames),
        }
        for a, b in zip(ns3.rows, rows, strict=True)
    ]


def bursts(ns3: Measured, rows: Sequence[DistanceRow]) -> list[Values]:
    """By bands of BAND_M, likewise: ``again`` is how often the next frame of a pair is lost after a
    loss, ``long`` how many runs of losses are long.  Bands with fewer than ENOUGH runs in ns-3 are
    left out."""
    found = []
    for first in range(WIDTH_M, REACH_M + 1, BAND_M):
        both = [
            summed([row for row in part if first <= row.distance_m < first + BAND_M], first)
            for part in (ns3.rows, rows)
        ]
        if both[0].runs >= ENOUGH:
            again = [_percent(row.next_lost, row.losses) for row in both]
            long = [_percent(row.long_runs, row.runs) for row in both]
            found.append(
                {"distance_m": first, "last_m": first + BAND_M - WIDTH_M}
                | {"again": again, "long": long}
            )
    return found


def _percent(part: int, of: int) -> float:
    return round(100 * part / max(of, 1), 2)


def largest(pairs: Sequence[Sequence[float]]) -> float | None:
    """The largest difference in points, and None if nothing was compared."""
    return round(max((abs(a - b) for a, b in pairs), default=0.0), 2) if pairs else None


def summary(cells: Sequence[Cell]) -> Values:
    """``fit`` by traffic; ``sessions`` and ``road`` by t_timeout in ms, as text; ``crowds``."""
    ns3 = {m.traffic.name: m for m in ns3_measured()}
    fit = []
    for cell in reversed(chosen(cells, part="fit")):
        own = ns3[cell.values["traffic"]]
        rows = [DistanceRow.model_validate(row) for row in cell.result["rows"]]
        arrived, bands = arrivals(own, rows), bursts(own, rows)
        fit.append(
            {
                "traffic": own.traffic.name,
                "fitted": own.traffic.fitted,
                "vehicles": own.traffic.vehicles,
                "busy": [own.busy, cell.result["busy"]],
                "rows": arrived,
                "bands": bands,
                "largest": {
                    "arrived": largest([(row["ns3"], row["table"]) for row in arrived]),
                    "again": largest([band["again"] for band in bands]),
                    "long": largest([band["long"] for band in bands]),
                },
            }
        )
    sessions = [
        row
        | agreed_share(some, 5)
        | {n: round(mean([c.result[n] for c in some]), 5) for n in ("loss", *MODELS)}
        for row, some in groups(chosen(cells, part="sessions"), "t_timeout", "load", "distance_m")
    ]
    road = [
        row | classes(some)
        for row, some in groups(chosen(cells, part="road"), "t_timeout", "distance_m")
    ]
    return {
        "fit": fit,
        "sessions": sessions,
        "deviation": {
            name: round(max((abs(p[name] - p["share"]) for p in sessions), default=0.0), 5)
            for name in MODELS
        },
        "road": road,
        "crowds": [cell.values | cell.result for cell in reversed(chosen(cells, part="crowd"))],
    }


def names(report: Values) -> Values:
    """``worst``: the largest differences over the traffics that were fitted, and over others."""
    s = report["summary"]

    def worst(fitted: bool, what: str) -> float:
        values = (f["largest"][what] for f in s["fit"] if f["fitted"] == fitted)
        return max((value for value in values if value is not None), default=0.0)

    busy = [r["per_km"] for r in s["crowds"] if not r["control"] and r["busy"] > TARGET]
    return {
        "classes": CLASSES,
        "worst": [worst(fitted, of) for fitted in (True, False) for of in ("arrived", "again")],
        "crowded_per_km": min(busy, default=None),
    }
