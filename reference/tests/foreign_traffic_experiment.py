"""The cells of ``automcm experiment traffic`` in a real SUMO.

    python reference/tests/foreign_traffic_experiment.py

Needs eclipse-sumo and libsumo (automcm[sumo]); without them it is skipped, and says so.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from typing import Any

from foreign_checks import run

from automcm_evaluation.framework.experiment import Values
from automcm_evaluation.sweeps import sweep
from automcm_evaluation.sweeps.catalogue import experiment
from automcm_simulation.traffic.mover import TrafficError
from automcm_simulation.traffic.sumo_mover import sumo_home


def _quick() -> dict[str, Values]:
    made = experiment("traffic")
    settings: Any = made.set("quick", {"sumo": True})
    found = [values for values in made.cells(settings) if values["part"] == "road"]
    return {v["variant"]: sweep.run_cell("traffic", v, 1) for v in found}


def every_variant_drives_the_same_vehicles() -> None:
    found = _quick()
    assert set(found) == {"none", "cooperative", "silent", "stations"}
    assert len({(r["vehicles"], r["vehicle_s"]) for r in found.values()}) == 1, found
    assert found["none"]["equipped"] == 0 < found["stations"]["equipped"]
    assert found["silent"]["received"] == 0 < found["stations"]["received"]
    assert all(not r["wrong"] and not r["collisions"]["all"] for r in found.values()), found


def a_cell_repeats() -> None:
    assert _quick() == _quick()


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
    every_variant_drives_the_same_vehicles,
    a_cell_repeats,
    cooperation_reaches_sumo,
)


def main() -> int:
    try:
        sumo_home()
    except TrafficError as error:
        return run("the experiment on traffic", CHECKS, str(error))
    return run("the experiment on traffic", CHECKS, None)


if __name__ == "__main__":
    sys.exit(main())
