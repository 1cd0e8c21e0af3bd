"""Short runs of traffic by seed, which look for what must not happen."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Sequence
from pathlib import Path
from random import Random
from typing import Any

from automcm_evaluation.framework.experiment import PAGES, Cell, Values, canonical
from automcm_simulation.traffic.mover import TrafficError
from automcm_simulation.traffic.traffic_scenario import TrafficSetting
from automcm_simulation.traffic_scenarios.traffic_run import RadioName, TrafficRun, wrong
from automcm_spec.support import markdown, scratch

SECONDS = 30.0
VEHICLES = 8, 14
DENSITIES = 20.0, 40.0, 60.0, 80.0
PENETRATIONS = 0.3, 0.6, 1.0
LOSSES = 0.0, 0.2, 0.4, 0.6, 0.75
"""At the highest CAMs are lost long enough for hazards."""

Judge = Callable[[Sequence[Path]], list[str]]
"""A line for each log that the specification does not allow."""


def drawn(scenario: str, seed: int) -> TrafficRun:
    """The run with this seed, which draws all settings.

    Half of the runs use the table radio, the others lose a share of LOSSES.
    """
    draw = Random(f"{scenario}/{seed}")
    setting = TrafficSetting(
        seed=seed,
        vehicles=draw.randint(*VEHICLES),
        density=draw.choice(DENSITIES),
        penetration=draw.choice(PENETRATIONS),
        duration_s=SECONDS,
    )
    radio: RadioName = draw.choice(("even", "table"))
    loss = draw.choice(LOSSES) if radio == "even" else 0.0
    return TrafficRun(scenario=scenario, setting=setting, radio=radio, loss=loss)


def command(run: TrafficRun) -> str:
    """The command that repeats this run with its logs and its page."""
    s = run.setting
    loss = f" --loss {run.loss}" if run.radio == "even" else ""
    return (
        f"automcm simulate traffic --scenario {run.scenario} --vehicles {s.vehicles} "
        f"--density {s.density:g} --penetration {s.penetration:g} --radio {run.radio}{loss} "
        f"--seed {s.seed} --duration-s {s.duration_s:g}"
    )


def check(values: Values, judge: Judge) -> Values:
    """Run ``values["scenario"]`` with ``values["seed"]``; with ``values["twice"]`` a second time.

    ``wrong`` has a line for everything that must not happen (traffic_run.wrong), for each log that
    is not allowed, for a repetition with other bytes, and for an exception that ended the run.
    ``sha256`` is of the record and all logs.  Raises TrafficError without SUMO, OSError,
    MemoryError.
    """
    run = drawn(values["scenario"], values["seed"])
    try:
        return _checked(run, values["twice"], judge)
    except (TrafficError, OSError, MemoryError):  # of this machine, not of the run
        raise
    except Exception as error:
        return {
            "command": command(run),
            "wrong": [f"it broke off: {error!r}"],
            "collisions": dict.fromkeys(COLLISIONS, 0),
            **dict.fromkeys((*SUMS, "longest_ms"), 0),
            "outcome": {},
            "sha256": "",
        }


def _checked(run: TrafficRun, twice: bool, judge: Judge) -> Values:
    record, digest, judged = _once(run, judge)
    found = [*wrong(record), *judged]
    if twice and _once(run, lambda logs: [])[1] != digest:
        found.append("a second run of the same seed wrote other bytes")
    hazards = record["hazards"] or {"lengths": {}}
    lengths = [ms for each in hazards["lengths"].values() for ms in each]
    collisions, sessions = record["collisions"], record["sessions"]
    return {
        "command": command(run),
        "wrong": found,
        "collisions": collisions,
        "hazards": len(lengths),
        "longest_ms": max(lengths, default=0),
        "requested": sessions["requested"],
        "agreed": sessions["agreed"],
        "completed": sessions["completed"],
        "outcome": record["outcome"],
        "sha256": digest,
    }


def _once(run: TrafficRun, judge: Judge) -> tuple[dict[str, Any], str, list[str]]:
    """The record, its digest with the logs, and the judge's lines."""
    with scratch.folder("traffic-logs") as folder:
        record = run.record(run.drive(logs=folder))
        logs = sorted(folder.glob("*.ndjson"))
        digest = hashlib.sha256(canonical(record).encode())
        for log in logs:
            digest.update(f"\n{log.name}\n".encode() + log.read_bytes())
        return record, digest.hexdigest(), judge(logs)


def wanted(scenarios: Sequence[str], seed: int, seeds: int, twice_every: int) -> list[Values]:
    """The values of all runs, by seed, so that an interrupted sweep has run all scenarios.

    ``twice_every``: the seeds that are multiples of it run twice; 0: none.
    """
    return [
        {"scenario": name, "seed": n, "twice": bool(twice_every) and n % twice_every == 0}
        for n in range(seed, seed + seeds)
        for name in scenarios
    ]


def summary(cells: Sequence[Cell]) -> dict[str, Values]:
    """Sums by scenario."""
    found: dict[str, Values] = {}
    for cell in cells:
        row = found.setdefault(
            cell.values["scenario"],
            dict.fromkeys(COLUMNS, 0),
        )
        result = cell.result
        row["runs"] += 1
        row["twice"] += cell.values["twice"]
        for name in SUMS:
            row[name] += result[name]
        for name in COLLISIONS:
            row[name] += result["collisions"][name]
        row["longest_ms"] = max(row["longest_ms"], result["longest_ms"])
        row["wrong"] += bool(result["wrong"])
    return found


def page(report: Values) -> str:
    """Markdown; ``report`` is that of ``--json``."""
    return markdown.page(
        PAGES / "traffic_sweep.md.j2",
        r=report,
        columns=COLUMNS,
        seconds=SECONDS,
        vehicles=VEHICLES,
        densities=DENSITIES,
        penetrations=PENETRATIONS,
        losses=LOSSES,
    )


SUMS = "requested", "agreed", "completed", "hazards"
COLLISIONS = "between_equipped", "by_maneuver", "with_pedestrian", "all"
COLUMNS = "runs", "twice", *SUMS, "longest_ms", *COLLISIONS, "wrong"
"""Of the summary of a scenario."""
