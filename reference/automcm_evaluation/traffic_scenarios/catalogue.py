"""The scenarios of ``automcm simulate traffic``, by name."""

from __future__ import annotations

from collections.abc import Mapping

from automcm_evaluation.traffic.traffic_scenario import Scenario
from automcm_evaluation.traffic_scenarios.lane_change_traffic import LaneChanges

SCENARIOS: Mapping[str, Scenario] = {
    scenario.name: scenario
    for scenario in (
        LaneChanges("lane-change", "two_lanes", lanes=2),
        LaneChanges("lane-change-4", "four_lanes", lanes=4),
    )
}
