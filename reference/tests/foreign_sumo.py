"""The comparison of ``automcm experiment arrival`` with a real SUMO.

    python reference/tests/foreign_sumo.py

Needs eclipse-sumo and libsumo (automcm[sumo]); without them it is skipped, and says so.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from typing import Any

from foreign_checks import run

from automcm_evaluation.arrival import arrival, sumo
from automcm_evaluation.framework.experiment import Cell, ExperimentError, chosen

SIGNAL_S = 5.0
FREE_S = {30: 260 * 3.6 / 30 - SIGNAL_S, 50: 260 * 3.6 / 50 - SIGNAL_S}
"""Arrival undisturbed, since the signal."""


def trial(how: sumo.How, speed_kmh: float, beside_m: float = 5.5, seed: int = 0) -> Any:
    return sumo.Trial(
        how=how, speed=speed_kmh / 3.6, beside_m=beside_m, signal_s=SIGNAL_S, seed=seed
    ).run()


def with_nobody_in_the_way_it_arrives_undisturbed() -> None:
    for how in ("cooperative", "forced"):
        for speed_kmh, free_s in FREE_S.items():
            found = trial(how, speed_kmh, beside_m=300.0)
            assert abs(found["arrival_s"] - free_s) < 0.01, (how, speed_kmh, found)
            assert found["hardest"] == found["collisions"] == 0, found


def the_same_trial_gives_the_same_after_another_one() -> None:
    first = trial("forced", 30, seed=4)
    trial("cooperative", 50, seed=2)
    assert trial("forced", 30, seed=4) == first


def a_prescription_slows_it_down_by_20_km_h_and_costs_what_its_gap_takes() -> None:
    for speed_kmh, free_s in FREE_S.items():
        found = trial("prescribed", speed_kmh)
        assert abs(found["slowest"] - (speed_kmh - 20) / 3.6) < 0.01, found
        lost = found["arrival_s"] - free_s
        assert 20 / (speed_kmh / 3.6) - 0.1 < lost < 20 / (speed_kmh / 3.6) + 0.6, lost
        assert found["collisions"] == 0


def a_lane_change_at_once_makes_it_brake_hard_but_not_stop() -> None:
    for speed_kmh in FREE_S:
        found = trial("forced", speed_kmh)
        assert found["hardest"] > 5 and found["slowest"] > 0, found
        assert found["hardest"] > trial("cooperative", speed_kmh)["hardest"] > 0


def the_cells_of_the_experiment_have_no_gain() -> None:
    settings = arrival.Settings(trials=3, draws=1)
    cells = [Cell(v, arrival.run(v, 1)) for v in arrival.cells(settings) if v["part"] == "sumo"]
    for speed_kmh in FREE_S:
        here = {c.values["how"]: c.result for c in chosen(cells, speed_kmh=speed_kmh)}
        gain = here["forced"]["lost_s"] - here["prescribed"]["lost_s"]
        assert -3 < gain < 0, (speed_kmh, gain)
        assert 0 < here["forced"]["lost_s"] < 2


CHECKS: tuple[Callable[[], None], ...] = (
    with_nobody_in_the_way_it_arrives_undisturbed,
    the_same_trial_gives_the_same_after_another_one,
    a_prescription_slows_it_down_by_20_km_h_and_costs_what_its_gap_takes,
    a_lane_change_at_once_makes_it_brake_hard_but_not_stop,
    the_cells_of_the_experiment_have_no_gain,
)


def main() -> int:
    try:
        sumo.libsumo()
    except ExperimentError as error:
        return run("the comparison with SUMO", CHECKS, str(error))
    return run("the comparison with SUMO", CHECKS, None)


if __name__ == "__main__":
    sys.exit(main())
