"""The experiment on traffic at scale: its cells, crowds, differences by seed, and its page."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from automcm_evaluation.framework.experiment import Cell, ExperimentError
from automcm_evaluation.sweeps.catalogue import experiment
from automcm_evaluation.traffic_experiment import traffic_cell
from automcm_evaluation.traffic_experiment.crowd_sessions import all_ask, answers
from automcm_evaluation.traffic_experiment.traffic_experiment import Scale, cells
from automcm_evaluation.traffic_experiment.traffic_tables import coverage, indifferent, summary
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


def test_one_after_the_other_they_agree() -> None:
    found = all_ask({"stations": 2, "spread_ms": 6000, "run_ms": 15_000}, 3)
    assert found["first"] == found["agreed"] == 2 and found["wrong"] == []


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
    count = traffic_cell.LaneChangeCounter()
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


def test_two_that_ask_at_one_moment_hear_nobody() -> None:
    found = all_ask({"stations": 2, "spread_ms": 0, "run_ms": 4000}, 1)
    assert found["first"] == 0 and found["ended"]["no_participants"] == 2


def test_an_early_window_spares_the_wait() -> None:
    values = {"receivers": 2, "run_ms": 4000}
    late, early = (answers(values | {"early": each}, 1) for each in (False, True))
    assert late["recorded"] == early["recorded"] == late["joined"] == 2
    assert late["chose_ms"] == Parameters().t_advertise > 10 * early["chose_ms"]
    assert late["free_ms"] < late["agreed_ms"] + 100


def test_a_scenario_without_effect_of_cooperation_is_named() -> None:
    where = {"scenario": "merge", "per_km": 50.0, "seed": 1}
    none, other = (
        {"values": where | {"variant": variant}, "result": {"lane_changes": 1}}
        for variant in traffic_cell.ALONE
    )
    assert indifferent([none, other]) == ["merge"]
    assert indifferent([none, other | {"result": {"lane_changes": 2}}]) == []
    assert indifferent([none]) == [], "without a pair nothing is known"


def test_a_hazard_beyond_the_bound_is_broken() -> None:
    hazards = {"hazards": {}, "ended": {}, "agreed": 0, "requested": 0, "first": 0}
    hazards |= {"median_ms": None, "bound_ms": 1540}
    wrong = [{"seed": 2, "ms": 1541, "excuse": "abort"}]
    values = {"part": "all ask", "stations": 2, "spread_ms": 0, "run_ms": 1000}
    (text,) = summary([Cell(values, hazards | {"wrong": wrong})])["broken"]
    assert "1541" in text
