"""The tables of the safety experiment, from its cells."""

from __future__ import annotations

from collections.abc import Sequence

from automcm_evaluation.framework.experiment import Cell, Values, canonical, chosen, grid
from automcm_evaluation.framework.intervals import quantile, wilson
from automcm_evaluation.safety.ablations import BY_NAME, WHOLE
from automcm_evaluation.safety.safety_road import (
    LOOKS,
    NEAR_M,
    PROTOCOLS,
    UNCOORDINATED,
    WINDOWS_MS,
)

COUNTS = (
    *("with_hazard", "unexcused", "beyond"),
    *("agreed", "maneuvers", "completed", "in_vain", "stuck"),
)
REACHED = 0.95
"""A hazard of this share of B shows that B is nearly minimal."""
HARD = 4.0
"""Harder braking of a receiver counts as hard, m/s²: twice the IDM's comfortable deceleration."""


def summary(cells: Sequence[Cell]) -> Values:
    """Tables by fault, mechanism, fault class and protocol on the road, and violations."""
    whole = [c for c in cells if c.values.get("ablation", WHOLE.name) == WHOLE.name]
    faults = chosen(cells, part="faults")
    classes = [_class(cell) for cell in chosen(cells, part="classes")]
    broken = _broken(whole) + [
        f"T-2: {row['fault']}, perfect radio: hazard of {row['longest_ms']} ms, "
        f"{row['formula']} = {row['bound_ms']} ms"
        for row in classes
        if row["ablation"] == WHOLE.name and row["longest_ms"] > row["bound_ms"]
    ]
    return {
        "bound_ms": whole[0].result["bound_ms"],
        "delay_ms": whole[0].values["delay_ms"],
        "all": _all(whole),
        "faults": _by(faults, "fault"),
        "losses": _by(faults, "loss"),
        "mechanisms": _mechanisms(chosen(cells, part="mechanisms")),
        "classes": classes,
        "road": _road(chosen(cells, part="road")),
    } | ({"broken": broken} if broken else {})


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
    found = {
        "hazards without excuse (S-5)": row["unexcused"],
        "hazards longer than B (T-2)": row["beyond"],
        "stations that never come free (L-1)": row["stuck"],
        "more hazards": _apart(whole, row, "with_hazard", "drives"),
        "fewer agreements (L-2)": _apart(row, whole, "agreed", "drives"),
        "more maneuvers finished that the target takes for failed (L-2)": _apart(
            whole, row, "in_vain", "completed"
        ),
    }
    return [text for text, worse in found.items() if worse]


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
    speeds = list(dict.fromkeys(cell.values["speed_kmh"] for cell in cells))
    for row in grid(ablation=PROTOCOLS, speed_kmh=speeds, begins=[*WINDOWS_MS]):
        some = chosen(cells, **row)
        rooms, gaps, times = (
            [value for cell in some for value in cell.result[what] if value is not None]
            for what in ("room_m", "gap_m", "ttc_s")
        )
        row |= {n: sum(c.result[n] for c in some) for n in ("with_hazard", "begun", "unasked")}
        row |= {
            "drives": sum(cell.values["drives"] for cell in some),
            "moved": len(rooms),
            "longest_ms": max(lengths(some), default=0),
            "least_room_m": min(rooms, default=None),
            "median_room_m": round(quantile(rooms, 0.5), 1) if rooms else None,
            "abreast": sum(room < 0 for room in rooms),
            "near": sum(room < NEAR_M for room in rooms),
            "least_gap_m": min(gaps, default=None),
            "collisions": sum(gap <= 0 for gap in gaps),
            "least_ttc_s": min(times, default=None),
            "hard": sum(b > HARD for cell in some for b in cell.result["braking"]),
        }
        rows.append(row)
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


# -- what the page and the claims use


def names(report: Values) -> Values:
    """``own``: the fault classes of the complete protocol; ``class_of`` of a fault without a
    mechanism; ``road_*``: sums for each window of faults of a protocol, at all speeds."""
    s = report["summary"]
    mechanisms = [row for row in s["mechanisms"] if row["rule"]]
    of = {(row["ablation"], row["fault"]): row for row in s["classes"]}
    protocols = list(dict.fromkeys(name for name, _ in of))
    faults = dict.fromkeys(fault for _, fault in of)
    own = [row for row in s["classes"] if row["ablation"] == WHOLE.name]
    outside = [row["ablation"] for row in mechanisms if row["unexcused"] or row["beyond"]]

    def road(protocol: str) -> list[Values]:
        return [
            {"begins": begins}
            | {
                n: sum(
                    r[n] for r in s["road"] if (r["ablation"], r["begins"]) == (protocol, begins)
                )
                for n in ("drives", "moved", "near", "hard")
            }
            for begins in WINDOWS_MS
        ]

    return {
        "class_names": protocols,
        "classes": {
            fault: [of[n, fault] for n in protocols if (n, fault) in of] for fault in faults
        },
        "class_of": lambda fault, protocol=WHOLE.name: of[protocol, fault],
        "own": own,
        "kept": sum(row["longest_ms"] <= row["bound_ms"] for row in own),
        "removed": len(mechanisms),
        "shown": sum(bool(row["shows"]) for row in mechanisms),
        "outside": outside,
        "road_whole": road(WHOLE.name),
        "road_looks": road(LOOKS),
        "road_alone": road(UNCOORDINATED),
    }
