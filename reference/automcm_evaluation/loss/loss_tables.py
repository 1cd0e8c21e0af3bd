"""The tables of ``loss``: success and its models, knees, classes of Fig. 9, costs."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from itertools import pairwise
from statistics import fmean as mean

from automcm_evaluation.framework.experiment import Cell, Values, agreed_share, chosen, groups
from automcm_evaluation.framework.intervals import wilson
from automcm_evaluation.loss.loss_sessions import BIN_MS
from automcm_simulation.radio import success
from automcm_spec.vocabulary.parameters import Parameters

T_TIMEOUTS = (0, 1000, 2000)
"""The paper's, ms."""
PAPER_KNEES = {0: 10, 1000: 60, 2000: 70}
"""The loss in per cent from which arrival times increase rapidly (section VI-C)."""
CLASSES_S = (29.0, 30.0, 31.0)
"""The limits of the four classes of Fig. 9."""
CLASSES = ("29 s or less", "29 to 30 s", "30 to 31 s", "31 s or more")
KNEE, HALF = 0.9, 0.5
NEAR = 5.0
"""The paper's losses are multiples of 10 %; a knee within this tolerance agrees with them."""
ROBUST = 20
"""The maximum loss that the paper expects without obstacles, %."""
ROBUST_TIMEOUTS = ("1000", "2000")
WANTED = 0.99
T_RESEND = Parameters().t_resend


def eq2(loss: float, t_timeout: int) -> float:
    """Eq. 2 as printed: 1 - λ^(t_timeout / t_resend); 0 for t_timeout = 0."""
    return float(1 - loss ** (t_timeout / T_RESEND))


def one_message(loss: float, t_timeout: int) -> float:
    """Eq. 2 with the first sending counted (KIN-7)."""
    return float(success.message(loss, success.sendings(t_timeout, T_RESEND)))


def three_exchanges(loss: float, t_timeout: int) -> float:
    """KIN-7: three exchanges in a row, each a message and its Ack."""
    return float(success.session(loss, success.sendings(t_timeout, T_RESEND)))


def four_messages(loss: float, t_timeout: int) -> float:
    """The probability of an agreement by the rules.

    It requires an Advertisement and an Intention within the window, then a Prescription and its
    Acceptance before the give-up, but no Ack.  A message is sent N times, and the answer in the
    slot of the message; so two of N + 1 trials must succeed.
    """
    n = success.sendings(t_timeout, T_RESEND)
    pair = 1 - loss ** (n + 1) - (n + 1) * (1 - loss) * loss**n
    return float(pair**2)


MODELS = {of.__name__: of for of in (eq2, one_message, three_exchanges, four_messages)}
NAMES = {
    "eq2": "Eq. 2 as printed",
    "one_message": "one message in N sendings",
    "three_exchanges": "three exchanges with Acks (KIN-7)",
    "four_messages": "four messages without Acks",
}


def falls(points: Sequence[tuple[float, float]], below: float) -> float | None:
    """The interpolated loss in % at which a share first falls below a limit, or None."""
    for (a, high), (b, low) in pairwise(points):
        if high >= below > low:
            return round(a + (b - a) * (high - below) / (high - low), 1)
    return points[0][0] if points and points[0][1] < below else None


def knees(points: Sequence[tuple[float, float]]) -> Values:
    """The losses at which success falls below 90 % and below a half, %."""
    return {"knee": falls(points, KNEE), "half": falls(points, HALF)}


def by_loss(cells: Sequence[Cell]) -> list[Values]:
    """The share that agrees at each loss."""
    return [row | agreed_share(some) for row, some in groups(cells, "loss")]


def summary(cells: Sequence[Cell]) -> Values:
    """Keys by t_timeout in ms, as text: ``points``, ``knees``, ``bursts`` and ``road_bursts`` (by
    length before), ``road``; and ``deviation`` (by model), ``cost``, ``smallest`` and ``udp``."""
    found: Values = {"points": {}, "knees": {}, "road": {}}
    for t in T_TIMEOUTS:
        own = chosen(cells, t_timeout=t)
        points = by_loss([c for c in own if c.values["part"] in ("tens", "fine")])
        for p in points:
            p |= {name: round(model(p["loss"] / 100, t), 6) for name, model in MODELS.items()}
        drives = [classes(some) for _, some in groups(chosen(own, part="road"), "loss")]
        found["points"][str(t)], found["road"][str(t)] = points, drives
        found["knees"][str(t)] = {
            "measured": knees([(p["loss"], p["share"]) for p in points]),
            "completed": knees([(r["loss"], r["completed"] / r["trials"]) for r in drives]),
        } | {n: knees([(x / 10, f(x / 1000, t)) for x in range(1001)]) for n, f in MODELS.items()}
    bursts = dict.fromkeys(c.values["burst_ms"] for c in chosen(cells, part="bursts"))
    for name, table in (("bursts", by_loss), ("road_bursts", classes)):
        own = chosen(cells, part=name.replace("_", " "))
        found[name] = {
            str(ms): {str(t): table(chosen(own, burst_ms=ms, t_timeout=t)) for t in T_TIMEOUTS}
            for ms in bursts
        }
    found["deviation"] = {}
    for name in MODELS:
        apart = [abs(p[name] - p["share"]) for some in found["points"].values() for p in some]
        found["deviation"][name] = {
            "largest": round(max(apart), 6),
            "mean": round(mean(apart), 6),
        }
    found["cost"] = cost(chosen(cells, part="cost"))
    found["smallest"] = _smallest(found["cost"])
    found["udp"] = [
        {name: c.values[name] for name in ("t_timeout", "loss")}
        | {"latest_ms": c.result["latest_ms"]}
        | agreed_share([c])
        for c in chosen(cells, part="udp")
    ]
    return found


def classes(cells: Sequence[Cell]) -> Values:
    """The number of drives by their class of Fig. 9."""
    times = [t for cell in cells for t in cell.result["arrival_s"]]
    limits = [-math.inf, *CLASSES_S, math.inf]
    return {
        "loss": cells[0].values.get("loss", 0),
        "trials": len(times),
        "classes": [sum(low < t <= high for t in times) for low, high in pairwise(limits)],
        "mean_s": round(mean(times), 3),
    } | {n: sum(sum(c.result[n]) for c in cells) for n in ("agreed", "completed", "stopped")}


def cost(cells: Sequence[Cell]) -> list[Values]:
    """By t_timeout and loss: messages sent for each agreement, those of failures included, and
    the time from request to agreement, on average and in 95 %; None without agreement."""
    found = []
    for row, some in groups(cells, "t_timeout", "loss"):
        of = agreed_share(some)
        sent, took = (sum(c.result[name] for c in some) for name in ("sent", "agreed_ms"))
        counts: Counter[int] = Counter()
        for cell in some:
            counts.update(dict(cell.result["bins"]))
        times = sorted(counts.elements())
        last = times[math.ceil(0.95 * of["agreed"]) - 1] if times else None
        found.append(
            row
            | of
            | {
                "messages": round(sent / of["agreed"], 2) if times else None,
                "mean_ms": round(took / of["agreed"]) if times else None,
                "q95_ms": None if last is None else (last + 1) * BIN_MS,
            }
        )
    return found


def _smallest(cost: Sequence[Values]) -> list[Values]:
    """By loss: the smallest tried t_timeout with which 99 % agree, and that of the model."""
    found = []
    for loss in sorted({row["loss"] for row in cost}):
        own = [row for row in cost if row["loss"] == loss]
        tried = [row["t_timeout"] for row in own]
        found.append(
            {
                "loss": loss,
                "measured": next((r["t_timeout"] for r in own if r["share"] >= WANTED), None),
                "model": next((t for t in tried if four_messages(loss / 100, t) >= WANTED), None),
                "longest": max(tried),
            }
        )
    return found


def percent(value: float | None) -> str:
    """A loss as text, or that it was not reached."""
    return "never" if value is None else f"{value:g}%"


# -- what the page and the claims use


def names(report: Values) -> Values:
    """``late``: the losses from which a tenth, and a half, of the drives are in the slowest class,
    %; ``fits``: whether the paper's knees lie between two such losses; ``drives``: those at ROBUST
    by kind of loss."""
    s = report["summary"]
    late = {
        t: knees([(r["loss"], 1 - r["classes"][-1] / r["trials"]) for r in s["road"][str(t)]])
        for t in T_TIMEOUTS
    }
    halves = [100.0 if late[t]["half"] is None else late[t]["half"] for t in T_TIMEOUTS]
    by_model = {n: {t: s["knees"][str(t)][n] for t in T_TIMEOUTS} for n in MODELS}
    even = {t: next(r for r in rows if r["loss"] == ROBUST) for t, rows in s["road"].items()}
    bursts = {f"bursts of {int(ms) / 1000:g} s": of for ms, of in s["road_bursts"].items()}
    at_robust = {
        name: {t: next(p for p in points[t] if p["loss"] == ROBUST) for t in ROBUST_TIMEOUTS}
        for name, points in zip(
            ["even", *bursts], [s["points"], *s["bursts"].values()], strict=True
        )
    }
    udp = [
        (r, next(p for p in s["points"][str(r["t_timeout"])] if p["loss"] == r["loss"]))
        for r in s["udp"]
    ]
    return {
        "model_names": NAMES,
        "late": late,
        "later": halves == sorted(set(halves)),
        "fits": {name: [_fits(of[t], t) for t in T_TIMEOUTS] for name, of in by_model.items()}
        | {"late": [_fits(late[t], t) for t in T_TIMEOUTS]},
        "longer": _longer(s),
        "robust_points": at_robust,
        "robust_even": min(p["share"] for p in at_robust["even"].values()),
        "robust_low": min(p["low"] for of in at_robust.values() for p in of.values()),
        "overlapping": sum(a["low"] <= b["high"] and b["low"] <= a["high"] for a, b in udp),
        "drives": {"even": even} | bursts,
        "percent": percent,
        "by_loss": lambda points: {p["loss"]: p for p in points},
    }


def _fits(knee: Values, t: int) -> bool:
    """Whether the paper's knee is between the losses at which a share falls below 90 % and 50 %."""
    high = 100.0 if knee["half"] is None else knee["half"]
    return knee["knee"] is not None and knee["knee"] - NEAR <= PAPER_KNEES[t] <= high + NEAR


def _longer(s: Values) -> Values:
    """Of agreements and of drives: the number of comparisons of two time-outs at one loss, in how
    many the longer one is significantly better; and whether it is never significantly worse."""
    at = [{p["loss"]: (p["low"], p["high"]) for p in s["points"][str(t)]} for t in T_TIMEOUTS]
    agreed = [(a[x], b[x]) for x in set.intersection(*map(set, at)) for a, b in pairwise(at)]
    drives = [[wilson(r["completed"], r["trials"]) for r in rows] for rows in s["road"].values()]
    driven = [both for some in pairwise(drives) for both in zip(*some, strict=True)]
    better = [sum(b[0] > a[1] for a, b in pairs) for pairs in (agreed, driven)]
    never_worse = all(b[1] >= a[0] for a, b in agreed + driven)
    return {"better": better, "of": [len(agreed), len(driven)], "never_worse": never_worse}
