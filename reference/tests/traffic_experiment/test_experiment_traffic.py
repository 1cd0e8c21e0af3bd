"""The experiment on traffic at scale: what is counted and what is broken."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np

from automcm_evaluation.framework.experiment import Cell
from automcm_evaluation.sweeps.catalogue import experiment
from automcm_evaluation.traffic_experiment import traffic_cell
from automcm_evaluation.traffic_experiment.traffic_experiment import Settings, cells
from automcm_evaluation.traffic_experiment.traffic_tables import coverage, indifferent, summary
from automcm_simulation.traffic.mover import Body, RoadUser

SMALL = Settings(
    blocks=(("lane-change-4", 50.0, (0.5, 1.0), 2),),
    receivers=(2,),
    receivers_ms=4000,
    stations=(2,),
    stations_ms=4000,
    crowds=1,
)


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


def test_the_full_grid_is_the_one_that_the_page_counts() -> None:
    full = experiment("traffic").profiles["standard"]
    assert isinstance(full, Settings)
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
