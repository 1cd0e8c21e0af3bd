"""How fast traffic with stations runs, beside the same traffic without them."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace
from typing import Any

from automcm_evaluation.traffic_scenarios.traffic_run import Run


def measured(run: Run, notify: Callable[[str], None] = lambda text: None) -> dict[str, Any]:
    """The figures of this run, without stations and with them.

    Raises TrafficError without SUMO or ns-3.
    """
    seconds = run.setting.duration_s
    notify("without stations")
    alone_s, _ = _timed(_with(run, 0.0))
    report: dict[str, Any] = {
        "vehicles": run.setting.vehicles,
        "radio": run.radio,
        "alone": {"s": alone_s, "simulated_per_s": seconds / alone_s},
        "stations": {},
    }
    for share in (0.1, 1.0):
        notify(f"{share:.0%} with a station")
        took_s, received = _timed(_with(run, share))
        report["stations"][str(share)] = {
            "s": took_s,
            "simulated_per_s": seconds / took_s,
            "times_alone": took_s / alone_s,
            "received": received,
        }
    return report


def _with(run: Run, share: float) -> Run:
    return replace(run, setting=replace(run.setting, penetration=share))


def _timed(run: Run) -> tuple[float, int]:
    """The processor's seconds of a run from its first step on, and the receptions."""
    begun: list[float] = []

    def progress(now_ms: int) -> None:
        if not begun:
            begun.append(time.process_time())

    traffic = run.drive(progress=progress)
    return time.process_time() - begun[0], traffic.stations.links.received
