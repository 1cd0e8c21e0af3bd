"""The experiment on the radio channel: its figures."""

from __future__ import annotations

import pytest

from automcm_evaluation.radio.radio_tables import arrivals, bursts, largest
from automcm_evaluation.radio.radio_traffic import DistanceRow, Measured, ns3_measured, pooled


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
