"""The claims of all experiments: each verdict is from the figures.

The committed summaries, with some of their figures changed.
"""

from __future__ import annotations

import copy
from collections.abc import Iterable, Iterator
from typing import Any

import pytest
from fixed_cells import committed

from automcm_evaluation.framework.claims import Claim
from automcm_evaluation.sweeps.catalogue import experiment

Json = Any
YES, SHAPE, NO, BEYOND = "reproduced", "in shape only", "not reproduced", "beyond the paper"


def places(at: Json, part: str) -> Iterator[Json]:
    """The keys of ``at`` that ``part`` names: one, all (``*``), or rows with ``name=value,...``."""
    keys: Iterable[Json] = range(len(at)) if isinstance(at, list) else at
    for key in keys:
        wanted = [each.split("=") for each in part.split(",") if "=" in each]
        if part in ("*", key) or (wanted and all(str(at[key][n]) == v for n, v in wanted)):
            yield key


def changed(at: Json, path: list[str], to: Json) -> int:
    """Put a value at all places of a path, and return their number."""
    keys = list(places(at, path[0]))
    if path[1:]:
        return sum(changed(at[key], path[1:], to) for key in keys)
    for key in keys:
        at[key] = to
    return len(keys)


def claims(name: str, changes: dict[str, Json]) -> list[Claim]:
    found = committed(name)
    other = found | {"summary": copy.deepcopy(found["summary"])}
    for path, to in changes.items():
        assert changed(other["summary"], path.split("/"), to), path
    return experiment(name).claims(other)


def gains(gain: float, low: float, high: float, least: float, greatest: float) -> dict[str, Json]:
    tried = {"tried/least_s/30": least, "tried/greatest_s/30": greatest}
    return {"speeds/30/gain_s": gain, "speeds/30/range_s": [low, high]} | tried


def ways(*ranges: tuple[float, float]) -> dict[str, Json]:
    names = [f"ways/{kmh}/{reading}" for reading in ("reduction", "ratio") for kmh in (30, 50)]
    return {n: [(low + high) / 2, low, high] for n, (low, high) in zip(names, ranges, strict=True)}


def braking(with_: float, without: float, stopped: int) -> dict[str, Json]:
    return {"speeds/*/with/after": with_, "speeds/*/without/after": without} | {
        "speeds/*/without/stopped": stopped
    }


def counts(kind: str, two: float, four: float, times: float) -> dict[str, Json]:
    """So many messages with two vehicles and with four, and the ratio of their bytes."""
    return {
        f"drives/vehicles=2,loss=0.0/count/{kind}": two,
        f"drives/vehicles=4,loss=0.0/count/{kind}": four,
        f"drives/vehicles=2,loss=0.0/bytes/*/{kind}": 100.0,
        f"drives/vehicles=4,loss=0.0/bytes/*/{kind}": 100.0 * times,
    }


def savings(every: float, **others: float) -> dict[str, Json]:
    rivals = dict.fromkeys(("factor", "rare", "signed", "rare_signed"), every) | others
    return {f"drives/*/saving/*/*/{name}": value for name, value in rivals.items()}


def late(*knees: tuple[int, int, int]) -> dict[str, Json]:
    """By t_timeout: so many drives are late from this loss on, and all from that one on."""
    found = {}
    for t, (loss, some, all_) in zip((0, 1000, 2000), knees, strict=True):
        found[f"road/{t}"] = [
            {"loss": x, "trials": 100, "classes": [100 - s, 0, 0, s], "completed": 100 - s}
            for x, s in ((0, 0), (loss, some), (all_, 100), (20, 0))
        ]
    return found


def agreed(*shares: float) -> dict[str, Json]:
    found: dict[str, Json] = {}
    for t, share in zip((0, 1000, 2000), shares, strict=True):
        found |= {f"points/{t}/*/low": share - 0.01, f"points/{t}/*/high": share + 0.01}
    return found


def robust(even: float, bursts: float) -> dict[str, Json]:
    found: dict[str, Json] = {}
    for where, share in (("points/*", even), ("bursts/*/*", bursts)):
        found |= {f"{where}/loss=20/share": share, f"{where}/loss=20/low": share - 0.005}
    return found


def knees(*first: int) -> dict[str, Json]:
    pairs = zip((0, 1000, 2000), first, strict=True)
    return {f"knees/{t}/eq2": {"knee": at, "half": at + 10} for t, at in pairs}


ABANDONED = ("prescriber_dies", "prescriber_aborts", "prescriber_hangs")
LEADER, BLIND = "all/leader_stops", "all/leader_stops without"
SILENT, PLAIN = "ablation=silent CAM-loss fallback", "ablation=plain CAMs count"
WHOLE = "ablation=whole protocol"
ROOM = {"road/begins=negotiation/near": 0, "road/begins=maneuver/near": 0}

CASES: list[tuple[str, str, dict[str, Json], str]] = [
    ("arrival", "at 30 km/h", gains(5.2, 5.1, 5.3, 1.0, 9.0), SHAPE),
    ("arrival", "at 30 km/h", gains(5.2, 5.1, 5.3, 4.6, 5.4), YES),
    ("arrival", "at 30 km/h", gains(4.4, 4.3, 4.5, 4.6, 5.4), SHAPE),
    ("arrival", "at 30 km/h", gains(0.1, -0.1, 0.3, 4.6, 5.4), NO),
    ("arrival", "gain grows", {"tried/grows": 9, "tried/baselines": 9}, YES),
    ("arrival", "gain grows", {"tried/grows": 8, "tried/baselines": 9}, SHAPE),
    ("arrival", "gain grows", {"speeds/50/range_s": [5.4, 7.1]}, NO),
    ("arrival", "fit one", ways((180, 240), (190, 230), (250, 270), (240, 280)), YES),
    ("arrival", "fit one", ways((250, 270), (255, 280), (0, 1), (2, 3)), YES),
    ("arrival", "fit one", ways((180, 240), (190, 230), (250, 270), (280, 290)), SHAPE),
    ("arrival", "fit one", ways((180, 190), (200, 230), (250, 270), (280, 290)), NO),
    ("arrival", "hardly brakes", braking(0.4, 8.0, 100), YES),
    ("arrival", "hardly brakes", braking(0.4, 8.0, 99), SHAPE),
    ("arrival", "hardly brakes", braking(0.6, 8.0, 100), SHAPE),
    ("arrival", "hardly brakes", braking(8.0, 8.0, 100), NO),
    ("bandwidth", "far larger", {"ratios/*/*": 12.0, "etsi/ratio": 12.0}, YES),
    ("bandwidth", "far larger", {"ratios/*/*": 12.0, "etsi/ratio": 7.0}, SHAPE),
    ("bandwidth", "far larger", {"ratios/*/*": 9.0, "etsi/ratio": 12.0}, SHAPE),
    ("bandwidth", "far larger", {"ratios/*/*": 2.0, "etsi/ratio": 12.0}, NO),
    ("bandwidth", "as many Intentions", counts("Intention", 1, 3, 3.0), YES),
    ("bandwidth", "as many Intentions", counts("Intention", 1, 4, 3.0), SHAPE),
    ("bandwidth", "as many Intentions", counts("Intention", 1, 3, 2.5), SHAPE),
    ("bandwidth", "as many Intentions", counts("Intention", 1, 1, 1.0), NO),
    ("bandwidth", "Acceptance and Fin take", counts("Fin", 1, 1, 1.2), SHAPE),
    ("bandwidth", "Acceptance and Fin take", counts("Fin", 1, 2, 1.0), NO),
    ("bandwidth", "Acceptance and Fin take", counts("Fin", 0, 1, 1.0), NO),
    ("bandwidth", "get a Cancel", {"drives/vehicles=4/cancelled": [3]}, SHAPE),
    ("bandwidth", "get a Cancel", {"drives/vehicles=4/cancelled": []}, NO),
    ("bandwidth", "get a Cancel", {"drives/vehicles=2/cancelled": [2]}, NO),
    ("bandwidth", "less bandwidth", savings(1.5), YES),
    *(("bandwidth", "less bandwidth", savings(1.5, **{name: 0.9}), SHAPE)
      for name in ("factor", "rare", "signed", "rare_signed")),
    ("bandwidth", "less bandwidth", savings(0.9), NO),
    *(("comfort", "B decelerates", {f"fig6/{kmh}/slower_s/3": s}, verdict)
      for kmh, s, verdict in (("*", 9.0, NO), ("*", None, NO), ("50", 9.0, SHAPE))),
    *(("comfort", "C, behind B", {f"fig6/*/{what}": to}, NO)
      for what, to in (("slower_s/4", 0.0), ("slower_s/4", None), ("c_gap_m", -0.1))),
    ("comfort", "A, ahead of B", {"fig6/*/a_differs": 0.2}, NO),
    ("comfort", "A, ahead of B", {"fig6/50/a_differs": 1.0}, SHAPE),
    *(("comfort", claim, {f"fig6/*/hardest_in_change/{n}": by}, verdict)
      for n, claim in (("3", "B, its gap opened"), ("1", "The prescriber hardly"))
      for by, verdict in ((0.4, YES), (1.9, SHAPE), (2.1, NO))),
    ("comfort", "Without mitigation", {"all/prescriber_dies/needless_m": 1000.0}, SHAPE),
    ("comfort", "Without mitigation", {f"all/{n}/needless_m": 1000.0 for n in ABANDONED}, NO),
    ("comfort", "Falling back", {"all/*/touched": 0, "all/*/hard": 0}, YES),
    ("comfort", "Falling back", {"all/*/touched": 0, "all/*/hard": 1}, SHAPE),
    ("comfort", "Falling back", {"all/cut/touched": 1, "all/*/hard": 0}, NO),
    *(("comfort", "Comfort gains",
       {f"{LEADER}/needless_m": 1.0, f"{BLIND}/needless_m": way, f"{LEADER}/hard": 1,
        f"{BLIND}/hard": hard}, verdict)
      for way, hard, verdict in ((3.0, 2, YES), (1.0, 2, SHAPE), (3.0, 1, SHAPE), (1.0, 1, NO))),
    ("comfort", "spares B", {"all/uncoordinated/B braking": 1.0}, NO),
    ("comfort", "spares B", {"all/uncoordinated/B jerk": 1.0}, NO),
    ("comfort", "costs distance", {"all/cut without/needless_m": 1000.0}, NO),
    ("comfort", "costs distance", {"all/cut/moved": 1000}, NO),
    ("comfort", "fallback saves distance", {"all/b_aborts/B lost_m": 1000.0}, NO),
    ("loss", "arrival times", late((10, 20, 30), (60, 20, 80), (70, 20, 90)), YES),
    ("loss", "arrival times", late((30, 0, 40), (70, 0, 80), (85, 0, 95)), SHAPE),
    ("loss", "arrival times", late((30, 0, 40), (20, 0, 30), (85, 0, 95)), NO),
    ("loss", "the longest time-out", agreed(0.5, 0.7, 0.9), YES),
    ("loss", "the longest time-out", agreed(0.5, 0.9, 0.7), NO),
    ("loss", "the longest time-out",
     agreed(0.5, 0.7, 0.9) | {"road/1000/*/completed": 60, "road/2000/*/completed": 0}, NO),
    ("loss", "robust", robust(0.999, 0.999), YES),
    ("loss", "robust", robust(0.999, 0.75), SHAPE),
    ("loss", "robust", robust(0.95, 0.95), SHAPE),
    ("loss", "robust", robust(0.5, 0.999), NO),
    ("loss", "Eq. 2", knees(10, 60, 70), YES),
    ("loss", "Eq. 2", knees(10, 60, 90), NO),
    ("radio", "the table", {"fit/*/largest/arrived": 0.0, "fit/*/largest/again": 3.0}, BEYOND),
    ("radio", "the table", {"fit/*/largest/arrived": None, "fit/*/largest/again": 3.1}, NO),
    ("radio", "KIN-7", {"deviation/three_even": 0.1}, BEYOND),
    ("safety", "longer than B", {"all/beyond": 1}, NO),
    ("safety", "longer than B", {"all/hazards": 0}, NO),
    ("safety", "B is reached", {"all/longest_ms": 1400}, NO),
    ("safety", "Without an abort", {"all/unexcused": 1}, NO),
    ("safety", "each fault class", {f"classes/{WHOLE},fault=cut back/longest_ms": 1}, NO),
    ("safety", "one-way cut", {f"classes/{SILENT},fault=cut forth/longest_ms": 30}, NO),
    ("safety", "restart of", {f"classes/{PLAIN},fault=target restarts/longest_ms": 30}, NO),
    ("safety", "Mechanisms", {"mechanisms/*/beyond": 0, "mechanisms/*/unexcused": 0}, NO),
    ("safety", "counting", ROOM, BEYOND),
    ("safety", "looking", ROOM | {"road/begins=maneuver/moved": 0}, NO),
    ("safety", "counting", ROOM | {"road/begins=negotiation/moved": 0}, NO),
    ("traffic", "needs less time", {f"paired/*/{n}": [-1.0, -2.0, 3.0] for n in
                                    ("none", "cooperative", "silent")}, BEYOND),
    ("traffic", "needs less time", {"paired/*/silent": [1.0, 0.5, 2.0]}, NO),
    ("traffic", "no vehicles", {"collisions/stations/between_equipped": 1}, NO),
    ("traffic", "no vehicles", {"collisions/stations/by_maneuver": 1}, NO),
    ("traffic", "nobody nearer", {"near/*/critical_runs": 2}, BEYOND),
    ("traffic", "nobody nearer", {"near/*/critical_runs": 2, "near/silent/critical_runs": 1}, NO),
    ("traffic", "receivers beyond", {"answers/*/free_ms": None}, BEYOND),
    ("traffic", "same moment", {"all_ask/*/first": 2, "all_ask/*/of": 2}, BEYOND),
    ("traffic", "within B", {"hazards/wrong": [{"ms": 1541}]}, NO),
]  # fmt: skip


@pytest.mark.parametrize(("name", "words", "changes", "verdict"), CASES)
def test_each_verdict_is_from_the_figures(
    name: str, words: str, changes: dict[str, Json], verdict: str
) -> None:
    (claim,) = [each for each in claims(name, changes) if words in each.claim]
    assert claim.verdict == verdict


@pytest.mark.parametrize(
    ("name", "changes", "gone"),
    [
        ("loss", {"bursts": {}, "road_bursts": {}}, "loss in bursts"),
        ("loss", {"udp": []}, "UDP"),
        ("traffic", {"road": []}, "nobody nearer"),
    ],
)
def test_what_was_not_run_makes_no_claim(name: str, changes: dict[str, Json], gone: str) -> None:
    assert [c for c in claims(name, {}) if gone in c.claim]
    assert not [c for c in claims(name, changes) if gone in c.claim]


def test_without_sumo_it_says_so() -> None:
    claim = claims("arrival", {"sumo/30": {}})[-1]
    assert (claim.here, claim.why) == ("not run", "needs automcm[sumo]")
