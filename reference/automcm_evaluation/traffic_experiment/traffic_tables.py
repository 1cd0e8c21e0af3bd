"""The tables of ``traffic``: runs and their differences by seed, collisions, hazards, crowds."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import partial
from statistics import fmean as mean

from automcm.applications.occupancy import HARDEST
from automcm_evaluation.framework.experiment import Cell, Values, canonical, chosen, data, groups
from automcm_evaluation.framework.intervals import quantile
from automcm_evaluation.traffic_experiment.crowd_sessions import PER_KM
from automcm_evaluation.traffic_experiment.traffic_cell import ALONE, VARIANTS
from automcm_simulation.traffic.mover import STEP_MS
from automcm_simulation.traffic.traffic_measures import OVER_STEPS, TTC_S
from automcm_spec.vocabulary.parameters import Parameters

OTHERS = tuple(variant for variant in VARIANTS if variant != "stations")
"""What runs with stations are compared with."""


def _rate(name: str) -> Callable[[Values], float]:
    """So many for each vehicle and minute."""
    return lambda result: 60 * float(result[name]) / result["vehicle_s"]


MEASURES: dict[str, Callable[[Values], float | None]] = {
    "s_per_km": lambda r: r["s_per_km"],
    "lost": lambda r: 100 * r["lost"],
    "lane_changes": _rate("lane_changes"),
    "hard": _rate("hard_brakings"),
    "critical": _rate("critical_s"),
    "ttc": lambda r: r["least_ttc_s"],
    "jerk_equipped": lambda r: r["jerk_equipped"],
    "jerk_others": lambda r: r["jerk_others"],
    "busy": lambda r: r["busy"],
    "cam_p95": lambda r: r["cam_age_ms"]["p95"],
    "cam_p99": lambda r: r["cam_age_ms"]["p99"],
    "bytes": lambda r: r["bytes"] / r["equipped"] if r["equipped"] else None,
}
"""Of one run; rates are for each vehicle and minute, bytes for each equipped vehicle."""


def summary(cells: Sequence[Cell]) -> Values:
    """``road`` by scenario, density, penetration and variant; ``paired`` differences in travel
    time; ``near`` (how near they came to a collision) and ``collisions`` by variant; ``hazards`` of
    all runs; ``answers`` and ``all_ask`` of crowds."""
    runs = chosen(cells, part="road")
    crowds = chosen(cells, part="all ask")
    hazards = _hazards([*runs, *crowds])
    return {
        "road": _road(runs),
        "paired": _paired(runs),
        "near": _near(runs),
        "collisions": _collisions(runs),
        "hazards": hazards,
        "answers": [cell.values | cell.result for cell in chosen(cells, part="answers")],
        "all_ask": _all_ask(crowds),
        "broken": [f"a hazard beyond T-2 or S-5: {each}" for each in hazards["wrong"]],
    }


def added(counts: Iterable[Mapping[str, int]]) -> dict[str, int]:
    """The sums by name, in order of the names."""
    found: Counter[str] = Counter()
    for each in counts:
        found.update(each)
    return dict(sorted(found.items()))


def _spread(values: Sequence[float | None]) -> list[float] | None:
    """Median, least and greatest of those known."""
    known = [value for value in values if value is not None]
    if not known:
        return None
    return [round(v, 4) for v in (quantile(known, 0.5), min(known), max(known))]


def _road(runs: Sequence[Cell]) -> list[Values]:
    found = []
    for row, some in groups(runs, "scenario", "per_km", "share", "variant"):
        results = [cell.result for cell in some]
        found.append(
            row
            | {"seeds": len(some), "vehicles": results[0]["vehicles"]}
            | {name: _spread([of(r) for r in results]) for name, of in MEASURES.items()}
            | {
                name: sum(r["sessions"][name] for r in results)
                for name in ("requested", "agreed", "completed")
            }
            | {
                "ended": added(r["ended"] for r in results),
                "outcome": added(r["outcome"] for r in results),
                "most_receivers": max((r["receivers"]["most"] or 0 for r in results), default=0),
                "at_limit": sum(r["receivers"]["at_limit"] for r in results),
            }
        )
    return found


def _paired(runs: Sequence[Cell]) -> list[Values]:
    """The travel time with stations beside that of the same road users without, in per cent."""
    by_values = {canonical(cell.values): cell.result for cell in runs}
    found = groups(chosen(runs, variant="stations"), "scenario", "per_km", "share")
    for row, some in found:
        row["seeds"] = len(some)
        for other in OTHERS:
            differences = []
            drivers = {"variant": other, "share": row["share"] if other == "silent" else 0.0}
            for cell in some:
                beside = by_values.get(canonical(cell.values | drivers))
                if beside is not None:
                    ratio = cell.result["s_per_km"] / beside["s_per_km"]
                    differences.append(100 * (ratio - 1))
            row[other] = _spread(differences)
            row[f"faster_{other}"] = sum(d < 0 for d in differences)
    return [row for row, _ in found]


def _near(runs: Sequence[Cell]) -> dict[str, Values]:
    found = {}
    for variant in VARIANTS:
        results = [cell.result for cell in chosen(runs, variant=variant)]
        least = [r["least_ttc_s"] for r in results if r["least_ttc_s"] is not None]
        hours = sum(r["vehicle_s"] for r in results) / 3600
        hard = sum(r["hard_brakings"] for r in results)
        found[variant] = {
            "runs": len(results),
            "critical_runs": sum(ttc < TTC_S for ttc in least),
            "critical_s": round(sum(r["critical_s"] for r in results), 1),
            "least_ttc_s": min(least, default=None),
            "hard": hard,
            "hard_per_100_h": round(100 * hard / hours, 1) if hours else None,
            "hard_equipped": sum(r["hard_brakings_equipped"] for r in results),
            "vehicle_hours": round(hours, 1),
        }
    return found


def _collisions(runs: Sequence[Cell]) -> Values:
    found: Values = {}
    for variant in VARIANTS:
        some = chosen(runs, variant=variant)
        found[variant] = {"runs": len(some)} | {
            name: sum(cell.result["collisions"][name] for cell in some)
            for name in ("between_equipped", "by_maneuver", "all")
        }
    found["list"] = [
        {name: cell.values[name] for name in ("scenario", "per_km", "share", "variant", "seed")}
        | each
        for cell in runs
        for each in cell.result["collision_list"]
    ]
    return found


def _hazards(cells: Sequence[Cell]) -> Values:
    lengths = [ms for cell in cells for each in cell.result["hazards"].values() for ms in each]
    by_excuse = [{e: len(ms) for e, ms in c.result["hazards"].items()} for c in cells]
    bounds = {cell.result["bound_ms"] for cell in cells if cell.result["bound_ms"] is not None}
    return {
        "number": len(lengths),
        "longest_ms": max(lengths, default=0),
        "bound_ms": min(bounds, default=None),
        "excuses": added(by_excuse),
        "wrong": [{"cell": cell.values} | each for cell in cells for each in cell.result["wrong"]],
    }


def _all_ask(crowds: Sequence[Cell]) -> list[Values]:
    found = []
    for row, some in groups(crowds, "spread_ms", "stations"):
        agreed = sum(cell.result["agreed"] for cell in some)
        known = [c.result["median_ms"] for c in some if c.result["median_ms"] is not None]
        found.append(
            row
            | {
                "crowds": len(some),
                "run_ms": some[0].values["run_ms"],
                "of": row["stations"] * len(some),
                "requested": sum(cell.result["requested"] for cell in some),
                "first": sum(cell.result["first"] for cell in some),
                "agreed": agreed,
                "agreed_s": round(agreed / len(some) / (some[0].values["run_ms"] / 1000), 3),
                "median_ms": round(mean(known)) if known else None,
                "ended": added(cell.result["ended"] for cell in some),
            }
        )
    return found


ASKED = "lane-change-4"
"""The scenario of the grid that the profile ``standard`` runs."""


def coverage(road: Sequence[Values]) -> Values:
    """Which part of the grid of ``standard`` was run: seeds by density and penetration."""
    ran = {
        (row["per_km"], row["share"]): row["seeds"]
        for row in road
        if row["scenario"] == ASKED and row["variant"] == "stations"
    }
    grid = [block for block in data("profiles")["traffic"]["standard"]["blocks"] if ASKED in block]
    rows = [
        {"per_km": per_km, "seeds": [ran.get((per_km, share), 0) for share in shares]}
        for _, per_km, shares, _ in grid
    ]
    _, _, shares, seeds = grid[0]
    return {
        "shares": shares,
        "rows": rows,
        "asked": len(rows) * len(shares) * seeds,
        "ran": sum(min(number, seeds) for row in rows for number in row["seeds"]),
    }


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


def spread(
    value: Sequence[float] | None, digits: int = 1, *, sign: str = "", unit: str = ""
) -> str:
    """Median, and in brackets least and greatest."""
    if value is None:
        return "-"
    middle, low, high = (f"{each:{sign}.{digits}f}" for each in value)
    return middle + unit + (f" ({low} to {high})" if low != high else "")


def names(report: Values) -> Values:
    """What the page and the claims use; ``gains``: paired travel times, beside each variant;
    ``ended``: how many sessions ended for each reason, in all runs with stations."""
    s = report["summary"]
    gains = {n: [row[n][0] for row in s["paired"] if row[n] is not None] for n in OTHERS}
    return {
        "gains": gains,
        "all_gains": [value for values in gains.values() for value in values],
        "coverage": coverage(s["road"]),
        "indifferent": indifferent(report["cells"]),
        "spread": spread,
        "signed": partial(spread, sign="+", unit="%"),
        "ended": added(row["ended"] for row in s["road"] if row["variant"] == "stations"),
        "hardest": HARDEST,
        "per_km": PER_KM,
        "over_s": OVER_STEPS * STEP_MS / 1000,
        "limit": Parameters().max_participants,
        "window_s": Parameters().t_advertise / 1000,
        "hold_s": Parameters().t_hold / 1000,
    }
