"""Stations in the traffic of a real SUMO: ``automcm simulate traffic``, and the cells of
``automcm experiment traffic``.

    python reference/tests/foreign_traffic.py

Needs eclipse-sumo and libsumo (automcm[sumo]); without them it is skipped, and says so; so is a
drive over ns-3 (automcm[radio]).  ``automcm experiment traffic-sweep`` runs more seeds.
"""

from __future__ import annotations

import itertools
import json
import math
import re
import subprocess
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import foreign_checks
import numpy as np

from automcm.applications.vehicle import STEP_S
from automcm_evaluation.sweeps import sweep
from automcm_evaluation.sweeps.catalogue import experiment
from automcm_evaluation.traffic_experiment.traffic_sweep import SECONDS
from automcm_evaluation.traffic_experiment.traffic_sweep import run as short_run
from automcm_simulation.traffic import lanelet_network
from automcm_simulation.traffic.distance_guard import LEFT_M, limits
from automcm_simulation.traffic.mover import AUTOMATED, Body, RoadUser, TrafficError
from automcm_simulation.traffic.sumo_mover import NETWORKS, SUBLANE_M, SumoMover, sumo_home
from automcm_simulation.traffic.traffic_scenario import TrafficSetting
from automcm_simulation.traffic_scenarios.catalogue import SCENARIOS
from automcm_simulation.traffic_scenarios.intersection_traffic import LaneletIntersection
from automcm_simulation.traffic_scenarios.traffic_run import RadioName, TrafficRun, wrong
from automcm_spec.support.extras import missing

SEEDS = 2
"""Short drives of each scenario."""


def nothing_bad_happens() -> None:
    """No collision, no hazard beyond the bound, every log is allowed, and one drive repeats."""
    for name, scenario in SCENARIOS.items():
        if isinstance(scenario, LaneletIntersection) and (reason := missing("map")) is not None:
            print(f"SKIPPED: {name}: Lanelet2 {reason}")
            continue
        agreed = 0
        for seed in range(SEEDS):
            twice = name == "lane-change" and seed == 1
            found = short_run({"scenario": name, "seed": seed, "twice": twice})
            agreed += found["agreed"]
            assert not found["wrong"], (name, seed, found["wrong"])
        print(f"        {name}: {SEEDS} drives, {agreed} agreements, nothing bad")


def a_run_without_stations_has_a_record() -> None:
    for name, scenario in SCENARIOS.items():
        if isinstance(scenario, LaneletIntersection) and missing("map") is not None:
            continue
        run = TrafficRun(
            scenario=name, setting=TrafficSetting(penetration=0.0, vehicles=6, duration_s=2.0)
        )
        assert run.record(run.drive())["outcome"], name


def sumo_drives_along_the_lanelets() -> None:
    if (reason := missing("map")) is not None:
        print(f"SKIPPED: Lanelet2 {reason}")
        return
    lanes = lanelet_network.lane_map(NETWORKS / "town.osm")
    setting, scenario = TrafficSetting(vehicles=9, duration_s=10.0), LaneletIntersection()
    traffic = TrafficRun(scenario=scenario.name, setting=setting).drive()
    for route, lanelets in ((scenario.turning, (10, 30, 31)), (scenario.oncoming, (20, 21, 22))):
        driven = traffic.mover.line(route)
        middle = lanes.line(lanelets, reach=driven.reach)
        apart = np.abs(middle.project(driven.xy).d)
        assert apart.max() < 0.1 and abs(middle.length - driven.length) < 1.0, (route, apart.max())


def a_drive_over_ns3_repeats_and_is_not_that_over_its_table() -> None:
    if (reason := missing("radio")) is not None:
        print(f"SKIPPED: ns-3 {reason}")
        return
    records = []
    radios: tuple[RadioName, ...] = "ns3", "table", "ns3"
    for radio in radios:
        setting = TrafficSetting(seed=3, vehicles=10, duration_s=10.0)
        run = TrafficRun(scenario="lane-change", setting=setting, radio=radio)
        record = run.record(run.drive())
        assert record["sessions"]["agreed"] and not wrong(record), record
        del record["setting"]
        records.append(json.dumps(record))
    assert records[0] == records[2] != records[1]


def a_prescription_is_driven_and_not_teleported() -> None:
    """Nobody moves further in a step than its speed allows, along or to the side."""
    run = TrafficRun(
        scenario="lane-change", setting=TrafficSetting(seed=3, vehicles=10, duration_s=SECONDS)
    )
    last: dict[int, tuple[float, float]] = {}
    far: list[tuple[int, float, float]] = []

    class Watch:
        def add(self, traffic: Any) -> None:
            for number, body in traffic.mover.bodies().items():
                if number in last:
                    x, y = last[number]
                    if abs(body.x - x) > 0.1 * body.speed + 0.5 or abs(body.y - y) > 0.15:
                        far.append((number, body.x - x, body.y - y))
                last[number] = body.x, body.y

    traffic = run.drive(frames=Watch())  # type: ignore[arg-type]
    assert not far and traffic.record()["outcome"]["has changed lanes"] > 0, far


def nobody_stands_across_a_lane() -> None:
    """The rear stays within a sublane of where SUMO's followers take it to be, and nobody collides.
    Without the bound, lorry 18 stops across two lanes."""
    setting = TrafficSetting(seed=6, vehicles=60, density=200.0, penetration=1.0, duration_s=30.0)
    run = TrafficRun(scenario="lane-change-4", setting=setting)
    aside: list[float] = []

    class Watch:
        def add(self, traffic: Any) -> None:
            bodies = traffic.mover.bodies()
            aside.extend(
                abs(math.sin(b.heading)) * traffic.users[n].length for n, b in bodies.items()
            )

    traffic = run.drive(frames=Watch())  # type: ignore[arg-type]
    record = traffic.record()
    assert record["outcome"]["has changed lanes"] > 0, record["outcome"]
    assert max(aside) < SUBLANE_M, max(aside)
    assert not record["collisions"]["all"], record["collisions"]


def a_vehicle_stops_behind_what_sumo_does_not_see() -> None:
    """It brakes as hard as the guard asks, though SUMO's vehicles brake for a speed that is set
    with no more than the comfortable deceleration."""
    car = RoadUser(
        number=1, route=("road",), lane=0, at_m=30.0, speed=20.0, desired=20.0, equipped=True
    )
    lorry = RoadUser(
        number=2, route=(), lane=0, at_m=0.0, speed=0.0, desired=0.0, equipped=False, length=16.0
    )
    users = {user.number: user for user in (car, lorry)}
    with tempfile.TemporaryDirectory() as folder:
        mover = SumoMover([car], "two_lanes", Path(folder), seed=1)
        try:
            begin = mover.bodies()[1]
            stands = Body(begin.x + (car.length + lorry.length) / 2 + 30.0, begin.y, 0.0, 0.0, 0.0)
            speeds = [begin.speed]
            while speeds[-1] > 0.0 and len(speeds) < 100:
                bodies = {1: mover.bodies()[1], 2: stands}
                mover.control(1, None, 0.0, limits({1}, bodies, users, 100.0).get(1))
                mover.step()
                speeds.append(mover.bodies()[1].speed)
            gap = stands.x - mover.bodies()[1].x - (car.length + lorry.length) / 2
        finally:
            mover.close()
    hardest = max(a - b for a, b in itertools.pairwise(speeds)) / STEP_S
    assert LEFT_M - 0.1 < gap < 2.0, (gap, hardest)
    assert AUTOMATED.comfortable < hardest < AUTOMATED.hardest + 1e-6, hardest


def the_command_of_the_readme_draws_a_merge() -> None:
    readme = Path(__file__).parents[2] / "README.md"
    (command,) = re.findall(r"automcm (simulate traffic [^#\n]*[^#\s])", readme.read_text("utf-8"))
    with tempfile.TemporaryDirectory() as folder:
        options = [*command.split(), "--out", folder]
        made = subprocess.run(
            [sys.executable, "-m", "automcm_cli", *options], capture_output=True, text=True
        )
        assert made.returncode == 0, made.stderr
        page = Path(folder, "page.html").read_text("utf-8")
        assert '"traffic":{"every_ms"' in page, made.stdout


def every_variant_of_the_experiment_drives_the_same_vehicles_and_repeats() -> None:
    made = experiment("traffic")
    settings: Any = made.set("quick", {"sumo": True})
    road = [values for values in made.cells(settings) if values["part"] == "road"]
    found, again = (
        {values["variant"]: sweep.run_cell("traffic", values, 1) for values in road}
        for _ in range(2)
    )
    assert found == again and set(found) == {"none", "cooperative", "silent", "stations"}
    assert len({(r["vehicles"], r["vehicle_s"]) for r in found.values()}) == 1, found
    assert found["none"]["equipped"] == 0 < found["stations"]["equipped"]
    assert found["silent"]["received"] == 0 < found["stations"]["received"]
    assert all(not r["wrong"] and not r["collisions"]["all"] for r in found.values()), found


def cooperation_reaches_sumo() -> None:
    """Where a lane ends, SUMO's drivers drive otherwise if nobody makes room."""
    where = {"part": "road", "scenario": "merge", "per_km": 80.0, "metres": 500.0}
    where |= {"seconds": 40.0, "seed": 1, "share": 0.0}
    found = [
        sweep.run_cell("traffic", where | {"variant": variant}, 1)
        for variant in ("none", "cooperative")
    ]
    assert found[0] != found[1], found


CHECKS: tuple[Callable[[], None], ...] = (
    a_run_without_stations_has_a_record,
    sumo_drives_along_the_lanelets,
    a_drive_over_ns3_repeats_and_is_not_that_over_its_table,
    a_prescription_is_driven_and_not_teleported,
    nobody_stands_across_a_lane,
    a_vehicle_stops_behind_what_sumo_does_not_see,
    the_command_of_the_readme_draws_a_merge,
    nothing_bad_happens,
    every_variant_of_the_experiment_drives_the_same_vehicles_and_repeats,
    cooperation_reaches_sumo,
)


def main() -> int:
    try:
        sumo_home()
    except TrafficError as error:
        return foreign_checks.run("stations in traffic", CHECKS, str(error))
    return foreign_checks.run("stations in traffic", CHECKS, None)


if __name__ == "__main__":
    sys.exit(main())
