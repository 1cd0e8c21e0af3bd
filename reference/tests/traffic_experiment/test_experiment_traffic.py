"""The experiment on traffic at scale: its cells, crowds, differences by seed, and its page."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from automcm_evaluation.framework.experiment import Cell, ExperimentError, Values
from automcm_evaluation.sweeps import report, sweep
from automcm_evaluation.sweeps.catalogue import experiment
from automcm_evaluation.traffic_experiment import traffic_cell
from automcm_evaluation.traffic_experiment.crowd_sessions import all_ask, answers
from automcm_evaluation.traffic_experiment.traffic_experiment import Scale, cells
from automcm_evaluation.traffic_experiment.traffic_page import coverage, indifferent
from automcm_evaluation.traffic_experiment.traffic_tables import claims, summary
from automcm_simulation.traffic.mover import Body, RoadUser, TrafficError
from automcm_spec.vocabulary.parameters import Parameters

Json = Any
SMALL = Scale(
    blocks=(("lane-change-4", 50.0, (0.5, 1.0), 2),),
    receivers=(2,),
    receivers_ms=4000,
    stations=(2,),
    stations_ms=4000,
    crowds=1,
)


def result(s_per_km: float) -> Values:
    """A run with this travel time; all else is the same."""
    return {
        "vehicles": 15,
        "equipped": 10,
        "vehicle_s": 450.0,
        "s_per_km": s_per_km,
        "lost": 0.1,
        "lane_changes": 3,
        "hard_brakings": 1,
        "hard_brakings_equipped": 0,
        "critical_s": 0.0,
        "least_ttc_s": 3.0,
        "jerk_equipped": 1.0,
        "jerk_others": 20.0,
        "busy": 0.1,
        "cam_age_ms": {"p50": 50.0, "p95": 100.0, "p99": 110.0},
        "bytes": 10_000,
        "sessions": {"requested": 5, "agreed": 2, "completed": 1},
        "ended": {"abort": 1},
        "outcome": {},
        "receivers": {"median": 3.0, "most": 4, "at_limit": 0},
        "collisions": {"between_equipped": 0, "by_maneuver": 0, "with_pedestrian": 0, "all": 0},
        "collision_list": [],
        "hazards": {"abort": [120]},
        "bound_ms": 1540,
        "wrong": [],
    }


@pytest.fixture(scope="module")
def made() -> Json:
    """A report of few cells; only the crowds are simulated."""
    one = experiment("traffic")
    found = []
    for values in cells(SMALL):
        if values["part"] == "road":
            slower = {"none": 0, "cooperative": 0, "silent": 4, "stations": 5}[values["variant"]]
            measured = result(50.0 * values["seed"] + slower)
        else:
            measured = sweep.run_cell("traffic", values, 1)
        found.append(Cell(values, measured))
    return report.assemble(one, sweep.header(one, "quick", 1, SMALL), found)


def test_the_full_grid_is_the_one_that_the_page_counts() -> None:
    full = experiment("traffic").profiles["standard"]
    assert isinstance(full, Scale)
    grid = [block for block in full.blocks if block[0] == "lane-change-4"]
    runs = [
        v for v in cells(full) if (v.get("scenario"), v.get("variant")) == (grid[0][0], "stations")
    ]
    one = {"scenario": "lane-change-4", "variant": "stations", "seeds": 20}
    road = [one | {"per_km": b[1], "share": share} for b in grid for share in b[2]]
    found = coverage(road)
    assert len(runs) == found["asked"] == found["ran"] == 8 * 10 * 20
    assert coverage(road[1:])["ran"] == found["asked"] - 20
    assert coverage(road[1:])["rows"][0]["seeds"] == [0, *[20] * 9]


def test_runs_without_stations_are_shared_by_all_penetrations() -> None:
    found = [v for v in cells(SMALL) if v["part"] == "road"]
    assert [v["variant"] for v in found].count("none") == 2
    assert [v["variant"] for v in found].count("silent") == 4
    two = tuple(("lane-change-4", 50.0, (share,), 1) for share in (0.5, 1.0))
    assert [v.get("variant") for v in cells(Scale(blocks=two))].count("none") == 1
    assert not [v for v in cells(SMALL.model_copy(update={"sumo": False})) if v["part"] == "road"]
    with pytest.raises(ExperimentError, match="no scenario 'circus'"):
        cells(Scale(blocks=(("circus", 50.0, (1.0,), 1),)))


def test_a_scenario_without_effect_of_cooperation_is_named(made: Json) -> None:
    cells = made["cells"]
    text = "SUMO's cooperation changed nothing in any run"
    assert indifferent(cells) == ["lane-change-4"] and text in report.page(made)
    changed = next(c for c in cells if c["values"].get("variant") == "cooperative")
    other = changed | {"result": changed["result"] | {"lane_changes": -1}}
    cells = [other if c is changed else c for c in cells]
    assert indifferent(cells) == [] and text not in report.page(made | {"cells": cells})
    none = [c for c in cells if c["values"].get("variant") == "none"]
    assert indifferent(none) == [], "without a pair nothing is known"


def test_travel_times_are_compared_by_seed(made: Json) -> None:
    row = made["summary"]["paired"][0]
    assert row["none"] == [7.5, 5.0, 10.0] and row["faster_none"] == 0
    assert row["silent"] == pytest.approx([1.4, 100 / 104, 100 / 54], abs=0.01)
    assert made["claims"][0]["verdict"] == "not reproduced"
    assert "+1.4 to +1.4%" in made["claims"][0]["here"]


def test_a_faster_run_is_counted_and_makes_the_claim_hold() -> None:
    found = [Cell(v, result(50.0)) for v in cells(SMALL) if v["part"] == "road"]
    for cell in found:
        if cell.values["variant"] == "stations":
            cell.result["s_per_km"] = 45.0
    made = summary(found)
    assert made["paired"][0]["faster_silent"] == 2
    held = claims({"summary": made | {"answers": [], "all_ask": [_asked(first=2)]}})
    assert held[0].verdict == "beyond the paper"


def test_runs_that_come_near_a_collision_are_counted_by_variant() -> None:
    found = [Cell(v, result(50.0)) for v in cells(SMALL) if v["part"] == "road"]
    of = {
        name: [c for c in found if c.values["variant"] == name] for name in ("stations", "silent")
    }
    for some, ttc in ((of["silent"], 1.4), (of["stations"], 1.5)):
        some[0].result.update(least_ttc_s=ttc, critical_s=0.2, hard_brakings_equipped=2)
    some[1].result["least_ttc_s"] = None
    made = summary(found) | {"answers": [], "all_ask": []}
    silent, stations = made["near"]["silent"], made["near"]["stations"]
    assert (silent["critical_runs"], stations["critical_runs"]) == (1, 0), "below 1.5 s"
    assert (silent["least_ttc_s"], silent["critical_s"], silent["hard_equipped"]) == (1.4, 0.2, 2)
    assert stations["vehicle_hours"] == round(len(of["stations"]) * 450 / 3600, 1)
    assert silent["hard_per_100_h"] == round(100 / 450 * 3600, 1), "one in each run"
    (claim,) = [c for c in claims({"summary": made}) if "nobody nearer" in c.claim]
    assert claim.verdict == "beyond the paper" and "least 1.4 s" in claim.here
    made["near"]["stations"]["critical_runs"] = 2
    (claim,) = [c for c in claims({"summary": made}) if "nobody nearer" in c.claim]
    assert claim.verdict == "not reproduced"


def _asked(first: int) -> Values:
    row = {"spread_ms": 0, "stations": 2, "of": 2, "first": first, "agreed": 2}
    return row | {"run_ms": 4000}


def test_a_hazard_beyond_the_bound_is_broken(made: Json) -> None:
    assert made["summary"]["broken"] == []
    assert made["summary"]["hazards"]["longest_ms"] == 120
    worse = [Cell(v, result(50.0)) for v in cells(SMALL) if v["part"] == "road"]
    worse[-1].result["wrong"] = [{"seed": 2, "ms": 1541, "excuse": "abort"}]
    (text,) = summary(worse)["broken"]
    assert "1541" in text


def test_two_that_ask_at_one_moment_hear_nobody(made: Json) -> None:
    (row,) = [r for r in made["summary"]["all_ask"] if r["spread_ms"] == 0]
    assert row["first"] == 0 and row["ended"]["no_participants"] == 2
    (later,) = [r for r in made["summary"]["all_ask"] if r["spread_ms"]]
    assert later["of"] == 2
    assert next(c for c in made["claims"] if "same moment" in c["claim"])["verdict"] == (
        "not reproduced"
    )


def test_one_after_the_other_they_agree() -> None:
    found = all_ask({"stations": 2, "spread_ms": 6000, "run_ms": 15_000}, 3)
    assert found["first"] == found["agreed"] == 2 and found["wrong"] == []


def test_an_early_window_spares_the_wait(made: Json) -> None:
    late, early = made["summary"]["answers"]
    assert late["recorded"] == early["recorded"] == late["joined"] == 2
    assert late["chose_ms"] == Parameters().t_advertise > 10 * early["chose_ms"]
    assert late["free_ms"] < late["agreed_ms"] + 100


@pytest.mark.slow
def test_a_receiver_that_is_not_recorded_waits_for_the_hold_timer() -> None:
    limit = Parameters().max_participants
    found = answers({"receivers": limit + 1, "early": True, "run_ms": 10_000}, 1)
    assert (found["joined"], found["recorded"]) == (limit + 1, limit)
    assert found["chose_ms"] == Parameters().t_advertise
    assert found["free_ms"] > Parameters().t_hold - Parameters().t_resend


def test_lane_changes_are_counted_once_each() -> None:
    user = RoadUser(
        number=1, route=("road",), lane=0, at_m=0.0, speed=0.0, desired=1.0, equipped=False
    )
    line = SimpleNamespace(xy=np.array([(0.0, -12.25)]))
    at = Body(0.0, 0.0, 0.0, 1.0, 0.0)
    mover = SimpleNamespace(line=lambda route: line)
    traffic: Any = SimpleNamespace(mover=mover, users={1: user})
    count = traffic_cell.LaneChanges()
    for aside in (0.0, 1.8, 1.7, 3.4, 3.6, 5.3, 5.2, 3.5, 0.2):
        mover.bodies = lambda y=-12.25 + aside: {1: at._replace(y=y)}
        count.look(traffic)
    assert count.changes == 2


def test_without_sumo_the_extra_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    def missing(*args: object, **more: object) -> None:
        raise TrafficError("SUMO is missing: pip install 'automcm[sumo]'")

    monkeypatch.setattr(traffic_cell, "SumoMover", missing)
    values = next(v for v in cells(SMALL) if v["part"] == "road")
    with pytest.raises(ExperimentError, match=r"pip install 'automcm\[sumo\]'"):
        traffic_cell.run(values, 1)


def test_the_page_has_every_part(made: Json) -> None:
    text = report.page(made)
    for part in (
        "| 50 | 0 | 0 | 0 | 0 | 2 |",
        "| lane-change-4 | 50 | 50% | 2 | +1.4% (+1.0 to +1.9) | 0 | +7.5%",
        "There was none in any run.",
        "| 2 | fixed | 2 | 2.100 s |",
        "| 2 | at one moment | 1 |",
        "12 hazards (12 abort)",
    ):
        assert part in text, part
    assert "None" not in text and "nan" not in text
    alone = dict(made, summary=dict(made["summary"], road=[]))
    assert "--set sumo=true" in report.page(alone)
