"""How fast traffic with stations runs, beside SUMO alone and the same traffic without stations."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace
from typing import Any

from automcm_simulation.traffic.mover import STEP_MS
from automcm_simulation.traffic.sumo_mover import SumoMover
from automcm_simulation.traffic_scenarios.catalogue import SCENARIOS
from automcm_simulation.traffic_scenarios.traffic_run import TrafficRun
from automcm_spec.support import scratch


def measured(run: TrafficRun, notify: Callable[[str], None] = lambda text: None) -> dict[str, Any]:
    """The figures of this run: of SUMO alone, and with measures, without and with stations.

    Raises TrafficError without SUMO or ns-3.
    """
    seconds = run.setting.duration_s
    notify("SUMO alone")
    alone_s = _sumo_alone(_with(run, 0.0))
    notify("without stations")
    without_s, _ = _timed(_with(run, 0.0))
    report: dict[str, Any] = {
        "vehicles": run.setting.vehicles,
        "radio": run.radio,
        "alone": {"s": alone_s, "simulated_per_s": seconds / alone_s},
        "without": _figures(without_s, seconds, alone_s),
        "stations": {},
    }
    for share in (0.1, 1.0):
        notify(f"{share:.0%} with a station")
        took_s, received = _timed(_with(run, share))
        figures = _figures(took_s, seconds, alone_s)
        report["stations"][str(share)] = figures | {"received": received}
    return report


def _figures(took_s: float, seconds: float, alone_s: float) -> dict[str, float]:
    return {
        "s": took_s,
        "simulated_per_s": seconds / took_s,
        "times_alone": took_s / alone_s,
    }


def _with(run: TrafficRun, share: float) -> TrafficRun:
    return replace(run, setting=replace(run.setting, penetration=share))


def _sumo_alone(run: TrafficRun) -> float:
    """The processor's seconds of SUMO's steps, with the same vehicles and nothing else."""
    scenario, setting = SCENARIOS[run.scenario], run.setting
    with scratch.folder("traffic") as folder:
        mover = SumoMover(scenario.users(setting), scenario.network, folder, setting.seed)
        try:
            begun = time.process_time()
            for _ in range(round(setting.duration_s * 1000 / STEP_MS) - 1):
                mover.step()
            return time.process_time() - begun
        finally:
            mover.close()


def _timed(run: TrafficRun) -> tuple[float, int]:
    """The processor's seconds of a run from its first step on, and the receptions."""
    begun: list[float] = []

    def progress(now_ms: int) -> None:
        if not begun:
            begun.append(time.process_time())

    traffic = run.drive(progress=progress)
    return time.process_time() - begun[0], traffic.stations.links.received
