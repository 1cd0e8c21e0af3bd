"""The scenarios of ``automcm simulate traffic``, by name."""

from __future__ import annotations

from collections.abc import Mapping

from automcm_simulation.traffic.traffic_scenario import Scenario
from automcm_simulation.traffic_scenarios.crossing_traffic import PedestrianCrossing
from automcm_simulation.traffic_scenarios.intersection_traffic import (
    Intersection,
    LaneletIntersection,
)
from automcm_simulation.traffic_scenarios.lane_change_traffic import LaneChanges
from automcm_simulation.traffic_scenarios.ramp_traffic import Ramps

SCENARIOS: Mapping[str, Scenario] = {
    scenario.name: scenario
    for scenario in (
        LaneChanges("lane-change", "two_lanes", lanes=2),
        LaneChanges("lane-change-4", "four_lanes", lanes=4),
        Ramps("merge", unit=False),
        Ramps("merge-unit", unit=True),
        Intersection(),
        LaneletIntersection(),
        PedestrianCrossing(),
    )
}
