"""The tables of ``traffic``: runs and their differences by seed, collisions, hazards, crowds."""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Callable, Mapping, Sequence
from types import MappingProxyType
from typing import Any

from automcm_evaluation.framework.experiment import Cell, Claim, Values, beyond, chosen
from automcm_evaluation.framework.intervals import mean, quantile
from automcm_evaluation.traffic_experiment.traffic_cell import VARIANTS
from automcm_simulation.traffic.traffic_measures import TTC_S
from automcm_spec.vocabulary.parameters import Parameters

OTHERS = tuple(variant for variant in VARIANTS if variant != "stations")
"""What runs with stations are compared with."""


def _rate(name: str) -> Callable[[Values], float]:
    """So many for each vehicle and minute."""
    return lambda result: 60 * float(result[name]) / result["vehicle_s"]


MEASURES: Mapping[str, Callable[[Values], float | None]] = MappingProxyType(
    {
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
)
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


def _spread(values: Sequence[float | None]) -> list[float] | None:
    """Median, least and greatest of those known."""
    known = [value for value in values if value is not None]
    if not known:
        return None
    return [round(v, 4) for v in (quantile(known, 0.5), min(known), max(known))]


def _groups(cells: Sequence[Cell], names: Sequence[str]) -> dict[tuple[Any, ...], list[Cell]]:
    found: dict[tuple[Any, ...], list[Cell]] = defaultdict(list)
    for cell in cells:
        found[tuple(cell.values[name] for name in names)].append(cell)
    return dict(sorted(found.items()))


def _road(runs: Sequence[Cell]) -> list[Values]:
    names = ("scenario", "per_km", "share", "variant")
    found = []
    for key, some in _groups(runs, names).items():
        results = [cell.result for cell in some]
        ended: Counter[str] = Counter()
        outcome: Counter[str] = Counter()
        for result in results:
            ended.update(result["ended"])
            outcome.update(result["outcome"])
        found.append(
            dict(zip(names, key, strict=True))
            | {"seeds": len(some), "vehicles": results[0]["vehicles"]}
            | {name: _spread([of(r) for r in results]) for name, of in MEASURES.items()}
            | {
                name: sum(r["sessions"][name] for r in results)
                for name in ("requested", "agreed", "completed")
            }
            | {
                "ended": dict(sorted(ended.items())),
                "outcome": dict(outcome),
                "most_receivers": max((r["receivers"]["most"] or 0 for r in results), default=0),
                "at_limit": sum(r["receivers"]["at_limit"] for r in results),
            }
        )
    return found


def _paired(runs: Sequence[Cell]) -> list[Values]:
    """The travel time with stations beside that of the same road users without, in per cent."""
    found = []
    place = ("scenario", "per_km", "seed", "metres", "seconds")
    alike = _groups(runs, ("variant", "share", *place))
    stations = chosen(runs, variant="stations")
    for (scenario, per_km, share), some in _groups(
        stations, ("scenario", "per_km", "share")
    ).items():
        row: Values = {"scenario": scenario, "per_km": per_km, "share": share, "seeds": len(some)}
        for other in OTHERS:
            differences = []
            of = share if other == "silent" else 0.0
            for cell in some:
                key = (other, of, *(cell.values[name] for name in place))
                for beside in alike.get(key, []):
                    ratio = cell.result["s_per_km"] / beside.result["s_per_km"]
                    differences.append(100 * (ratio - 1))
            row[other] = _spread(differences)
            row[f"faster_{other}"] = sum(d < 0 for d in differences)
        found.append(row)
    return found


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
    excuses: Counter[str] = Counter()
    for cell in cells:
        excuses.update({excuse: len(each) for excuse, each in cell.result["hazards"].items()})
    bounds = {cell.result["bound_ms"] for cell in cells if cell.result["bound_ms"] is not None}
    return {
        "number": len(lengths),
        "longest_ms": max(lengths, default=0),
        "bound_ms": min(bounds, default=None),
        "excuses": dict(sorted(excuses.items())),
        "wrong": [{"cell": cell.values} | each for cell in cells for each in cell.result["wrong"]],
    }


def _all_ask(crowds: Sequence[Cell]) -> list[Values]:
    found = []
    for (spread_ms, stations), some in _groups(crowds, ("spread_ms", "stations")).items():
        ended: Counter[str] = Counter()
        for cell in some:
            ended.update(cell.result["ended"])
        agreed = sum(cell.result["agreed"] for cell in some)
        known = [c.result["median_ms"] for c in some if c.result["median_ms"] is not None]
        found.append(
            {
                "spread_ms": spread_ms,
                "stations": stations,
                "crowds": len(some),
                "run_ms": some[0].values["run_ms"],
                "of": stations * len(some),
                "requested": sum(cell.result["requested"] for cell in some),
                "first": sum(cell.result["first"] for cell in some),
                "agreed": agreed,
                "agreed_s": round(agreed / len(some) / (some[0].values["run_ms"] / 1000), 3),
                "median_ms": round(mean(known)) if known else None,
                "ended": dict(sorted(ended.items())),
            }
        )
    return found


# -- claims


def claims(report: Values) -> list[Claim]:
    """Further claims; the paper has no traffic."""
    s = report["summary"]
    found = [_limit(s), *_at_once(s)]
    if s["road"]:
        found = [_travel(s), _no_collision(s), _no_nearer(s), *found]
    return [*found, _bound(s)]


def _travel(s: Values) -> Claim:
    def of(other: str) -> list[float]:
        return [row[other][0] for row in s["paired"] if row[other] is not None]

    against = {other: of(other) for other in OTHERS}
    here = "; ".join(
        f"{name} {min(values):+.1f} to {max(values):+.1f}% (medians by density and share)"
        for name, values in (
            ("beside the same vehicles whose messages get lost", against["silent"]),
            ("beside SUMO's drivers", against["cooperative"]),
        )
        if values
    )
    every = [value for values in against.values() for value in values]
    return beyond(
        "with stations, traffic needs less time",
        f"time for a km: {here}",
        bool(every) and max(every) < 0,
        "vehicles with stations change lanes at drawn times, not to be faster; one that makes room "
        "slows down",
    )


def _no_collision(s: Values) -> Claim:
    here = s["collisions"]["stations"]
    return beyond(
        "no vehicles with stations collide, and no maneuver causes a collision",
        f"{here['between_equipped']} between equipped vehicles and {here['by_maneuver']} by a "
        f"maneuver in {here['runs']} runs; {here['all']} in all",
        not (here["between_equipped"] or here["by_maneuver"]),
    )


def _no_nearer(s: Values) -> Claim:
    stations, silent = s["near"]["stations"], s["near"]["silent"]

    def of(name: str, n: Values) -> str:
        least = "" if n["least_ttc_s"] is None else f", least {n['least_ttc_s']:.1f} s"
        return f"{name}: {n['critical_runs']} of {n['runs']} runs{least}"

    here = f"{of('with stations', stations)}; {of('same vehicles, messages lost', silent)}"
    return beyond(
        "agreements bring nobody nearer to a collision",
        f"time to collision below {TTC_S} s: {here}",
        stations["critical_runs"] <= silent["critical_runs"],
        "without agreements these vehicles stay in their lanes",
    )


def _limit(s: Values) -> Claim:
    limit = Parameters().max_participants
    over = [row for row in s["answers"] if row["joined"] > limit and not row["early"]]
    under = [row for row in s["answers"] if row["joined"] <= limit and not row["early"]]
    worst = max((row["free_ms"] or 0 for row in over), default=0)
    usual = max((row["free_ms"] or 0 for row in under), default=0)
    return beyond(
        f"receivers beyond the {limit} that a prescriber records are free as soon as the others",
        f"bound up to {worst / 1000:.1f} s, the others {usual / 1000:.1f} s",
        worst <= usual,
        "no Ack answers them (MEM-1), so that they wait for the hold timer (ADV-7)",
    )


def _at_once(s: Values) -> list[Claim]:
    rows = [row for row in s["all_ask"] if row["spread_ms"] == 0]
    if not rows:
        return []
    here = ", ".join(f"{row['first']} of {row['of']} ({row['stations']})" for row in rows)
    later = ", ".join(f"{row['agreed']} of {row['of']}" for row in rows)
    return [
        beyond(
            "stations that ask at the same moment agree in their first session",
            f"{here} first sessions by number of stations; after retries, at the end of "
            f"{rows[0]['run_ms'] / 1000:g} s: {later}",
            all(row["first"] == row["of"] for row in rows),
            "a bound station ignores every Advertisement (ADV-4)",
        )
    ]


def _bound(s: Values) -> Claim:
    h = s["hazards"]
    return beyond(
        "every hazard in traffic is within B (T-2) and excused (S-5)",
        f"hazards: {h['number']}, the longest of {h['longest_ms']} ms; B = {h['bound_ms']} ms",
        not h["wrong"],
    )
