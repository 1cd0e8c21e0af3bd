"""Small cells of every experiment and of traffic, and their results: ``fixed_cells.json``; the
committed reports.

To renew the results after a change that is meant to change them: ``python fixed_cells.py``.
"""

from __future__ import annotations

import json
from dataclasses import asdict
from functools import cache
from pathlib import Path
from typing import Any

from traffic_stage import traffic

from automcm_evaluation.sweeps import report, sweep
from automcm_evaluation.traffic_experiment import traffic_sweep
from automcm_simulation.traffic.seen_from_above import Frames
from automcm_simulation.traffic.traffic_scenario import TrafficSetting
from automcm_simulation.traffic_scenarios.catalogue import SCENARIOS

EVALUATION = Path(__file__).parents[2] / "docs" / "evaluation"
FILE = Path(__file__).with_suffix(".json")
CELLS: list[dict[str, Any]] = json.loads(FILE.read_text(encoding="utf-8"))


@cache
def committed(name: str) -> Any:
    """The report of an experiment, with its summary and claims from the cells."""
    return report.load(EVALUATION / name / report.RESULTS)


def rounded(value: Any) -> Any:
    """With 9 digits of each float, which are those of any processor."""
    if isinstance(value, float):
        return float(f"{value:.9g}")
    if isinstance(value, list):
        return [rounded(each) for each in value]
    if isinstance(value, dict):
        return {name: rounded(each) for name, each in value.items()}
    return value


def result(cell: dict[str, Any]) -> Any:
    """Of a cell of an experiment, of a run of traffic on the small road, the road users that a
    scenario draws, or the runs that the sweep draws of it."""
    match cell:
        case {"experiment": name, "values": values}:
            found = sweep.run_cell(name, values, 1)
        case {"traffic": setting}:
            frames = Frames()
            made, _ = traffic(**setting, observe=frames.add)
            made.run()
            seen = json.loads(frames.as_json())
            found = made.record() | {"seen": seen | {"frames": seen["frames"][:4]}}
        case {"users": name, "setting": setting}:
            found = [asdict(user) for user in SCENARIOS[name].users(TrafficSetting(**setting))]
        case {"drawn": name}:
            found = [traffic_sweep.command(traffic_sweep.drawn(name, seed)) for seed in range(8)]
        case _:
            raise ValueError(f"no such cell: {cell}")
    return rounded(json.loads(json.dumps(found)))


if __name__ == "__main__":
    lines = ",\n".join(json.dumps(cell | {"result": result(cell)}) for cell in CELLS)
    FILE.write_text(f"[\n{lines}\n]\n", encoding="utf-8")
