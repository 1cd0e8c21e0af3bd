"""One run of a scenario in SUMO's traffic, with stations or without."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import closing
from typing import Annotated

from pydantic import AfterValidator

from automcm.applications.vehicle import LANE_WIDTH
from automcm_evaluation.framework.experiment import ExperimentError, Values, captions
from automcm_evaluation.framework.intervals import quantile
from automcm_simulation.radio.radio import RadioModel
from automcm_simulation.radio.table_radio import TableRadio
from automcm_simulation.traffic.even_radio import EvenRadio
from automcm_simulation.traffic.mover import TrafficError
from automcm_simulation.traffic.sumo_mover import SumoMover
from automcm_simulation.traffic.traffic import Traffic
from automcm_simulation.traffic.traffic_scenario import TrafficSetting
from automcm_simulation.traffic_scenarios.catalogue import SCENARIOS
from automcm_spec.support import scratch
from automcm_spec.vocabulary.parameters import Parameters

VARIANTS = captions("traffic", "variants")
ALONE = ("none", "cooperative")
"""Those without stations."""
IN_LANE_M = 0.5
"""A vehicle so near to the middle of another lane has changed lanes."""


def _known(scenario: str) -> str:
    if scenario not in SCENARIOS:
        raise ValueError(f"there is no such scenario; there are: {', '.join(SCENARIOS)}")
    return scenario


Scenario = Annotated[str, AfterValidator(_known)]
"""The name of a scenario."""


class LaneChangeCounter:
    """Counts the lane changes of all vehicles; an observer of ``Traffic``."""

    def __init__(self) -> None:
        self.changes = 0
        self._lanes: dict[int, int] = {}

    def look(self, traffic: Traffic) -> None:
        """Take the present lanes."""
        for number, body in traffic.mover.bodies().items():
            # The rightmost lane of the first route is the origin: all lanes are parallel to it.
            line = traffic.mover.line(traffic.users[number].route)
            aside = (body.y - float(line.xy[0, 1])) / LANE_WIDTH
            lane = round(aside)
            if abs(aside - lane) * LANE_WIDTH <= IN_LANE_M:
                self.changes += self._lanes.get(number, lane) != lane
                self._lanes[number] = lane


def run(values: Values, seed: int) -> Values:
    """Run a cell.  The road users are those of ``values["seed"]`` in every variant; ``seed`` is
    that of the radio.  Raises ExperimentError without SUMO."""
    scenario, variant = SCENARIOS[values["scenario"]], values["variant"]
    setting = TrafficSetting(
        seed=values["seed"],
        vehicles=max(1, round(values["per_km"] * values["metres"] / 1000)),
        density=values["per_km"],
        penetration=values["share"],
        duration_s=values["seconds"],
    )
    users = scenario.users(setting)
    radio: RadioModel = EvenRadio(1.0, 0) if variant != "stations" else TableRadio(seed % 2**31)
    lanes = LaneChangeCounter()
    try:
        with scratch.folder("traffic") as folder:
            patience = 0.0 if variant == "none" else 1.0
            made = SumoMover(users, scenario.network, folder, setting.seed, cooperative=patience)
            with closing(made) as mover:
                traffic = Traffic(scenario, setting, mover, users, radio, observe=lanes.look)
                traffic.run()
                return _result(traffic) | {"lane_changes": lanes.changes}
    except TrafficError as error:
        raise ExperimentError(str(error)) from None


def _result(traffic: Traffic) -> Values:
    found = traffic.record()
    stations, radio, jerk = traffic.stations, found["radio"], found["jerk"]
    travel = {
        name: sum(part[name] for part in found["travel"].values()) for name in ("s", "m", "lost_s")
    }
    bound = [len(each) - 1 for each in stations.partners.values()]
    hazards = found["hazards"] or {"bound_ms": None, "lengths": {}, "wrong": []}
    return {
        "vehicles": len(traffic.users),
        "equipped": sum(user.equipped for user in traffic.users.values()),
        "vehicle_s": round(travel["s"], 1),
        "s_per_km": round(1000 * travel["s"] / max(travel["m"], 1.0), 2),
        "lost": round(travel["lost_s"] / max(travel["s"], 1.0), 4),
        "equipped_s_per_km": _per_km(found["travel"]["equipped"]),
        "others_s_per_km": _per_km(found["travel"]["others"]),
        "hard_brakings": sum(found["hard_brakings"].values()),
        "hard_brakings_equipped": found["hard_brakings"].get("equipped", 0),
        "critical_s": round(sum(found["critical_s"].values()), 1),
        "critical_equipped_s": found["critical_s"].get("equipped", 0.0),
        "least_ttc_s": found["least_ttc_s"],
        "jerk_equipped": jerk["equipped"]["p99"],
        "jerk_others": jerk["others"]["p99"],
        "collisions": {
            name: found["collisions"][name] for name in ("between_equipped", "by_maneuver", "all")
        },
        "collision_list": found["collisions"]["list"],
        "sessions": {
            "requested": stations.requested,
            "agreed": len(stations.agreed),
            "completed": len(stations.completed),
        },
        "ended": found["sessions"]["ended"],
        "receivers": {
            "median": quantile(bound, 0.5) if bound else None,
            "most": max(bound, default=None),
            "at_limit": sum(n >= Parameters().max_participants for n in bound),
        },
        "bytes": radio["sent_bytes"],
        "received": radio["received"],
        "busy": radio["busy"]["p50"],
        "busy_p95": radio["busy"]["p95"],
        "cam_age_ms": radio["cam_age_ms"],
        "hazards": hazards["lengths"],
        "bound_ms": hazards["bound_ms"],
        "wrong": hazards["wrong"],
        "outcome": found["outcome"],
    }


def _per_km(travel: Mapping[str, float]) -> float | None:
    return round(1000 * travel["s"] / travel["m"], 2) if travel["m"] else None
