"""The results of ``arrival`` beside the paper's figures on Fig. 8."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import chain
from statistics import fmean as mean

from automcm.applications.lane_change import Plan
from automcm_evaluation.arrival.sumo import HOWS
from automcm_evaluation.framework.experiment import Cell, Json, Values, captions, chosen, columns
from automcm_evaluation.framework.intervals import Z, quantile

SPEEDS_KMH = (30, 50)
PAPER = {30: (5.0, 0.15), 50: (7.0, 0.28)}
"""The paper's gains in seconds, and as a share (section VI-B)."""
NEAR_S = 0.5
"""The paper's seconds are rounded; a figure within this tolerance agrees with them."""
NEAR_SHARE = 0.005
FIG_9_S = 29.0
"""The upper limit of the best class of the paper's Fig. 9, at 30 km/h."""
LITTLE = 0.5
"""Braking up to this (m/s²) is "little or no deceleration"; assumed: the paper has no figure."""
BOTH = ("with", "without")
MODEL_NAMES = captions("arrival", "model_names")


def summary(cells: Sequence[Cell]) -> Values:
    """By speed (km/h, as text): ``speeds``, ``ways``, ``ones``, ``grid`` and ``sumo``; and
    ``by_29_s`` (trials at 30 km/h in Fig. 9's best class) and ``tried`` (all baselines).

    A speed's ``range_s`` contains the gains over the baselines that fit the paper, and the 95 %
    interval of the mean over the trials, ``low_s`` to ``high_s``.
    """
    found: Values = {"speeds": {}, "ways": {}, "ones": {}, "grid": {}, "sumo": {}}
    for speed_kmh in SPEEDS_KMH:
        name = str(speed_kmh)
        here = chosen(cells, speed_kmh=speed_kmh)
        found["speeds"][name] = _trials(chosen(here, part="trials"), speed_kmh)
        found["ways"][name] = ways(speed_kmh, found["speeds"][name]["with"]["lost_s"])
        found["ones"][name] = {
            c.values["name"]: list(
                map(list, zip(c.values["tried"], c.result["gain_s"], strict=True))
            )
            for c in chosen(here, part="one")
        }
        found["grid"][name] = [
            {"brake": cell.values["brake"], "restart_gap": gap, "restart_s": wait, "gain_s": gain}
            for cell in chosen(here, part="grid")
            for gap, gains in zip(cell.values["restart_gaps"], cell.result["gain_s"], strict=True)
            for wait, gain in zip(cell.values["restarts_s"], gains, strict=True)
        ]
        found["sumo"][name] = {c.values["how"]: c.result for c in chosen(here, part="sumo")}
    trials = chosen(cells, part="trials")
    tried = _tried(found, trials[0].values["model"])
    for name, here in found["speeds"].items():
        low_s, high_s = tried["fit_s"][name]
        here["range_s"] = [min(low_s, here["low_s"]), max(high_s, here["high_s"])]
    slow = chosen(trials, speed_kmh=30)
    best = {n: sum(t <= FIG_9_S for t in _each(slow, n)["arrival_s"]) for n in BOTH}
    best["trials"] = sum(cell.values["trials"] for cell in slow)
    return found | {"by_29_s": best, "tried": tried}


def _each(cells: Sequence[Cell], which: str) -> Values:
    """The results of all trials, ``with`` or ``without``."""
    lists = columns([cell.result[which] for cell in cells])
    return {name: list(chain.from_iterable(parts)) for name, parts in lists.items()}


def _trials(cells: Sequence[Cell], speed_kmh: int) -> Values:
    """The figures of all trials at one speed."""
    signals = [m for cell in cells for m in cell.result["signal_m"]]
    timed_m = cells[0].values["places"]["target_m"] - mean(signals)
    found: Values = {"trials": len(signals), "timed_m": round(timed_m, 3)}
    each = {which: _each(cells, which) for which in BOTH}
    for which, lists in each.items():
        times = lists["arrival_s"]
        found[which] = {
            "mean_s": mean(times),
            "lost_s": mean(times) - timed_m / (speed_kmh / 3.6),
            "q05_s": quantile(times, 0.05),
            "q95_s": quantile(times, 0.95),
            "stood_s": mean(lists["stood_s"]),
            "stopped": sum(stood > 0 for stood in lists["stood_s"]),
            "completed": sum(lists["completed"]),
        } | {name: quantile(lists[name], 0.5) for name in ("slowest", "hardest", "after")}
    pairs = zip(*(each[which]["arrival_s"] for which in BOTH), strict=True)
    gains = [without - with_ for with_, without in pairs]
    gain = mean(gains)
    spread = math.sqrt(math.fsum((g - gain) ** 2 for g in gains) / max(len(gains) - 1, 1))
    half = Z * spread / math.sqrt(len(gains))
    made: Values = rounded(
        found
        | {
            "gain_s": gain,
            "low_s": gain - half,
            "high_s": gain + half,
            "reduction": gain / found["without"]["mean_s"],
            "ratio": gain / found["with"]["mean_s"],
        }
    )
    return made


def rounded(value: Json) -> Json:
    """The value with floats rounded to six places."""
    if isinstance(value, dict):
        return {name: rounded(each) for name, each in value.items()}
    return round(value, 6) if isinstance(value, float) else value


def ways(speed_kmh: int, lost_s: float) -> Values:
    """The timed distance (m) if both the paper's seconds and its percentage are right.

    ``lost_s`` is what coordination costs against driving on undisturbed.  By each reading of
    "15 % faster": the way, and the shortest and the longest as the figures are rounded.
    ``reduction``: less time, gain / without; ``ratio``: more speed, without / with - 1.
    """
    gain, share = PAPER[speed_kmh]
    speed = speed_kmh / 3.6

    def way(reading: str, gain: float, share: float) -> float:
        with_s = gain / share - gain if reading == "reduction" else gain / share
        return round((with_s - lost_s) * speed, 3)

    return {
        reading: [
            way(reading, gain, share),
            way(reading, gain - NEAR_S, share + NEAR_SHARE),
            way(reading, gain + NEAR_S, share - NEAR_SHARE),
        ]
        for reading in ("reduction", "ratio")
    }


def _tried(found: Values, used: Values) -> Values:
    """Over all baselines tried: the least and the greatest gain at each speed, in how many the
    paper's gains come out at both and their range there (that of all if there are none), in how
    many the gain is greater at the higher speed, and which one of the grid comes nearest to the
    paper's gains (least squares)."""
    each: list[dict[tuple[float, ...], float]] = []
    for name in map(str, SPEEDS_KMH):
        points = [{n: v, "gain_s": g} for n, one in found["ones"][name].items() for v, g in one]
        points += found["grid"][name]
        each.append(
            {
                tuple((used | {n: p[n] for n in used.keys() & p}).values()): p["gain_s"]
                for p in points
            }
        )
    both = list(zip(*(gains.values() for gains in each), strict=True))

    def off(gains: Sequence[float]) -> list[float]:
        return [abs(gain - PAPER[kmh][0]) for gain, kmh in zip(gains, SPEEDS_KMH, strict=True)]

    fit = [gains for gains in both if max(off(gains)) <= NEAR_S]
    grid = zip(*(found["grid"][str(kmh)] for kmh in SPEEDS_KMH), strict=True)
    best = min(grid, key=lambda at: sum(o**2 for o in off([point["gain_s"] for point in at])))

    def by_speed(values: Sequence[Json]) -> Values:
        return dict(zip(map(str, SPEEDS_KMH), values, strict=True))

    return {
        "best": best[0] | {"gain_s": by_speed([point["gain_s"] for point in best])},
        "baselines": len(both),
        "least_s": by_speed(list(map(min, zip(*both, strict=True)))),
        "greatest_s": by_speed(list(map(max, zip(*both, strict=True)))),
        "fit": len(fit),
        "fit_s": by_speed([[min(gains), max(gains)] for gains in zip(*(fit or both), strict=True)]),
        "grows": sum(fast > slow for slow, fast in both),
    }


# -- what the page and the claims use


def names(report: Values) -> Values:
    """``ranges``: by reading, the distances that fit the paper's rounded figures at both speeds."""
    s = report["summary"]
    both = {speed_kmh: s["speeds"][str(speed_kmh)] for speed_kmh in SPEEDS_KMH}
    ranges = {}
    for reading in ("reduction", "ratio"):
        limits = [s["ways"][str(speed_kmh)][reading] for speed_kmh in SPEEDS_KMH]
        ranges[reading] = max(low for _, low, _ in limits), min(high for *_, high in limits)
    return {
        "both": both,
        "slow": both[30],
        "fast": both[50],
        "asked_s": [Plan().gain_m / speed_kmh * 3.6 for speed_kmh in SPEEDS_KMH],
        "hows": HOWS,
        "ranges": ranges,
        "sumo_gain": sumo_gain,
    }


def sumo_gain(found: Values, speed_kmh: int, against: str) -> float:
    """The gain in arrival time with a prescription over this behaviour, s."""
    of = found["sumo"][str(speed_kmh)]
    return float(of[against]["arrival_s"] - of["prescribed"]["arrival_s"])
