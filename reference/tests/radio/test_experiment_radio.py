"""The experiment on the radio channel: its cells, its figures and its page."""

from __future__ import annotations

from typing import Any

import pytest

from automcm_evaluation.radio import radio_crowd, radio_sessions
from automcm_evaluation.radio.radio_tables import MODELS, arrivals, bursts, largest
from automcm_evaluation.radio.radio_traffic import DistanceRow, Measured, ns3_measured, pooled

Json = Any


def test_differences_are_in_points_and_rare_losses_are_not_compared() -> None:
    ns3 = next(m for m in ns3_measured() if m.traffic.name == "100 per km")
    rows = [row.model_copy(update={"arrived": row.arrived + row.frames // 50}) for row in ns3.rows]
    pairs = [(row["ns3"], row["table"]) for row in arrivals(ns3, rows)]
    assert largest(pairs) == pytest.approx(2, abs=0.02) and largest([]) is None
    assert [band["distance_m"] for band in bursts(ns3, ns3.rows)] == [25, 125, 225, 325, 425]
    few = [row.model_copy(update={"runs": 10}) for row in ns3.rows]
    rare = ns3.model_copy(update={"rows": few})
    assert bursts(rare, ns3.rows) == []


def test_runs_of_one_traffic_are_added() -> None:
    one = ns3_measured()[0]
    both = pooled([one, one])
    assert both.busy == one.busy and both.rows[0].frames == 2 * one.rows[0].frames
    assert isinstance(both, Measured) and isinstance(both.rows[0], DistanceRow)


@pytest.mark.slow
def test_near_sessions_agree_and_the_models_expect_it() -> None:
    values = {"distance_m": 25, "load": 0.0, "t_timeout": 2000, "trials": 4}
    near = radio_sessions.block(values, 1)
    assert near["agreed"] == 4 and all(near[name] > 0.99 for name in MODELS)
    far = radio_sessions.models(0, 1, apart_m=400, load=0.0)
    assert far["loss"] > 0.4 > far["three_even"]


@pytest.mark.slow
@pytest.mark.parametrize("control", [False, True])
def test_a_small_crowd_sends_every_cam_with_and_without_control(control: bool) -> None:
    values = {"per_km": 20, "size_bytes": 159, "run_ms": 3000, "control": control}
    found = radio_crowd.crowd(values, 1)
    assert found["per_s"] == pytest.approx(10, abs=0.05)
    assert 0 < found["busy"] < 0.1 and found["arrived"] > 0.95
