"""How fast traffic with stations runs, beside the same traffic without them."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace
from typing import Any

from automcm_evaluation.traffic.traffic_scenario import Setting
from automcm_evaluation.traffic_scenarios.traffic_run import RadioName, Run


def measured(
    scenario: str,
    vehicles: int,
    density: float,
    radio: RadioName,
    seconds: float,
    notify: Callable[[str], None] = lambda text: None,
) -> dict[str, Any]:
    """The figures, without and with stations.  Raises TrafficError without SUMO or ns-3."""
    setting = Setting(vehicles=vehicles, density=density, penetration=0.0, duration_s=seconds)
    run = Run(scenario=scenario, setting=setting, radio=radio)
    notify("without stations")
    alone_s, _ = _timed(run)
    report: dict[str, Any] = {
        "vehicles": vehicles,
        "radio": radio,
        "alone": {"s": alone_s, "simulated_per_s": seconds / alone_s},
        "stations": {},
    }
    for share in (0.1, 1.0):
        notify(f"{share:.0%} with a station")
        took_s, received = _timed(replace(run, setting=replace(setting, penetration=share)))
        report["stations"][str(share)] = {
            "s": took_s,
            "simulated_per_s": seconds / took_s,
            "times_alone": took_s / alone_s,
            "received": received,
        }
    return report


def _timed(run: Run) -> tuple[float, int]:
    """The processor's seconds of a run from its first step on, and the receptions."""
    begun: list[float] = []

    def progress(now_ms: int) -> None:
        if not begun:
            begun.append(time.process_time())

    traffic = run.drive(progress=progress)
    return time.process_time() - begun[0], traffic.stations.links.received
