"""The tables of the safety experiment, from its cells."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import product

from automcm_evaluation.framework.experiment import Cell, Values, canonical, chosen
from automcm_evaluation.framework.intervals import quantile, wilson
from automcm_evaluation.safety import safety_road
from automcm_evaluation.safety.ablations import BY_NAME, WHOLE

COUNTS = (
    *("with_hazard", "unexcused", "beyond"),
    *("agreed", "maneuvers", "completed", "in_vain", "stuck"),
)
HARD = 4.0
"""Harder braking of a receiver counts as hard, m/s²: twice the IDM's comfortable deceleration."""


def summary(cells: Sequence[Cell]) -> Values:
    """Tables by fault, mechanism, fault class and protocol on the road, and violations."""
    whole = [c for c in cells if c.values.get("ablation", WHOLE.name) == WHOLE.name]
    found: Values = {
        "bound_ms": whole[0].result["bound_ms"],
        "delay_ms": whole[0].values["delay_ms"],
        "all": _all(whole),
        "faults": _by(chosen(cells, part="faults"), "fault"),
        "losses": _by(chosen(cells, part="faults"), "loss"),
        "mechanisms": _mechanisms(chosen(cells, part="mechanisms")),
        "classes": [_class(cell) for cell in chosen(cells, part="classes")],
        "road": _road(chosen(cells, part="road")),
    }
    broken = _broken(whole) + _classes_broken(found["classes"])
    return found | ({"broken": broken} if broken else {})


def lengths(cells: Sequence[Cell]) -> list[int]:
    """The lengths of all hazards in ms, sorted."""
    return sorted(ms for cell in cells for found in cell.result["lengths"].values() for ms in found)


def _all(whole: Sequence[Cell]) -> Values:
    """The hazards of all runs with the complete protocol, including the road."""
    found = lengths(whole)
    return {
        "drives": sum(cell.values["drives"] for cell in whole),
        "hazards": len(found),
        "longest_ms": max(found, default=0),
        "unexcused": sum(len(cell.result["lengths"].get("none", ())) for cell in whole),
        "beyond": sum(ms > cell.result["bound_ms"] for cell in whole for ms in lengths([cell])),
    }


def _sum(cells: Sequence[Cell]) -> Values:
    found = lengths(cells)
    row: Values = {name: sum(cell.result[name] for cell in cells) for name in COUNTS}
    return row | {
        "drives": sum(cell.values["drives"] for cell in cells),
        "hazards": len(found),
        "median_ms": round(quantile(found, 0.5)) if found else None,
        "longest_ms": max(found, default=None),
    }


def _by(cells: Sequence[Cell], name: str) -> list[Values]:
    """A row for each value of a parameter of the cells."""
    values = list(dict.fromkeys(cell.values[name] for cell in cells))
    return [{name: value} | _sum(chosen(cells, **{name: value})) for value in values]


def _mechanisms(cells: Sequence[Cell]) -> list[Values]:
    rows = _by(cells, "ablation")
    (whole,) = (row for row in rows if row["ablation"] == WHOLE.name)
    for row in rows:
        ablation = BY_NAME[row["ablation"]]
        row |= {"rule": ablation.rule, "breaks": ablation.breaks, "model": ablation.model}
        row["shows"] = shows(row, whole)
    return rows


def shows(row: Values, whole: Values) -> list[str]:
    """The measures that are worse than with the complete protocol.

    For hazards that no theorem allows, and for stations that stay in a session, one drive is
    enough; for shares, the 95 % intervals must not overlap.
    """
    if row is whole:
        return []
    found = []
    if row["unexcused"]:
        found.append("hazards without excuse (S-5)")
    if row["beyond"]:
        found.append("hazards longer than B (T-2)")
    if row["stuck"]:
        found.append("stations that never come free (L-1)")
    if _apart(whole, row, "with_hazard", "drives"):
        found.append("more hazards")
    if _apart(row, whole, "agreed", "drives"):
        found.append("fewer agreements (L-2)")
    if _apart(whole, row, "in_vain", "completed"):
        found.append("more maneuvers finished that the target takes for failed (L-2)")
    return found


def _apart(low: Values, high: Values, hits: str, trials: str) -> bool:
    return wilson(low[hits], low[trials])[1] < wilson(high[hits], high[trials])[0]


def _class(cell: Cell) -> Values:
    found = lengths([cell])
    return {
        "ablation": cell.values["ablation"],
        "fault": cell.values["fault"],
        "drives": cell.values["drives"],
        "formula": cell.result["class_bound"],
        "bound_ms": cell.result["class_bound_ms"],
        "hazards": len(found),
        "longest_ms": max(found, default=0),
    }


def _road(cells: Sequence[Cell]) -> list[Values]:
    """A row for each protocol, speed and window of faults."""
    rows = []
    speeds = dict.fromkeys(cell.values["speed_kmh"] for cell in cells)
    for name in safety_road.PROTOCOLS:
        for speed, begins in product(speeds, safety_road.WINDOWS_MS):
            some = chosen(cells, ablation=name, speed_kmh=speed, begins=begins)
            found = lengths(some)
            rooms, gaps, times = (
                [value for cell in some for value in cell.result[what] if value is not None]
                for what in ("room_m", "gap_m", "ttc_s")
            )
            rows.append(
                {
                    "ablation": name,
                    "speed_kmh": speed,
                    "begins": begins,
                    "drives": sum(cell.values["drives"] for cell in some),
                    "moved": len(rooms),
                    "with_hazard": sum(cell.result["with_hazard"] for cell in some),
                    "begun": sum(cell.result["begun"] for cell in some),
                    "unasked": sum(cell.result["unasked"] for cell in some),
                    "longest_ms": max(found, default=0),
                    "least_room_m": min(rooms, default=None),
                    "median_room_m": round(quantile(rooms, 0.5), 1) if rooms else None,
                    "abreast": sum(room < 0 for room in rooms),
                    "near": sum(room < safety_road.NEAR_M for room in rooms),
                    "least_gap_m": min(gaps, default=None),
                    "collisions": sum(gap <= 0 for gap in gaps),
                    "least_ttc_s": min(times, default=None),
                    "hard": sum(b > HARD for cell in some for b in cell.result["braking"]),
                }
            )
    return rows


def _broken(whole: Sequence[Cell]) -> list[str]:
    """Hazards of the complete protocol that S-5 or T-2 does not allow, and stations that stay in a
    session (T-1), with the data to repeat the runs."""
    texts = []
    for cell in whole:
        b, values = cell.result["bound_ms"], canonical(cell.values)
        module = "safety_road" if cell.values["part"] == "road" else "safety"
        for one in cell.result["wrong"]:
            rule = "T-2: longer than B" if one["excuse"] else "S-5: without excuse"
            texts.append(
                f"{rule}: hazard of {one['ms']} ms, B = {b} ms: "
                f"{module}.drive({values}, {one['seed']})"
            )
        if cell.result.get("stuck"):
            texts.append(f"T-1: {cell.result['stuck']} runs had no end: {values}")
    return texts


def _classes_broken(classes: Sequence[Values]) -> list[str]:
    return [
        f"T-2: {row['fault']}, perfect radio: hazard of {row['longest_ms']} ms, "
        f"{row['formula']} = {row['bound_ms']} ms"
        for row in classes
        if row["ablation"] == WHOLE.name and row["longest_ms"] > row["bound_ms"]
    ]
