"""Short runs of traffic by seed, which look for what must not happen."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from pathlib import Path
from random import Random
from typing import Annotated, Any

from pydantic import Field

from automcm_evaluation.framework.experiment import (
    Cell,
    ExperimentError,
    ExperimentSettings,
    Values,
    canonical,
)
from automcm_evaluation.traffic_experiment.traffic_cell import Scenario
from automcm_simulation.road.simulation import unwarned
from automcm_simulation.traffic.mover import TrafficError
from automcm_simulation.traffic.traffic_scenario import TrafficSetting
from automcm_simulation.traffic_scenarios.catalogue import SCENARIOS
from automcm_simulation.traffic_scenarios.traffic_run import RadioName, TrafficRun, wrong
from automcm_spec.support import scratch
from automcm_traces.explain.explain import verdicts_of

TITLE = "Many short runs in traffic"
SECONDS = 30.0
VEHICLES = 8, 14
DENSITIES = 20.0, 40.0, 60.0, 80.0
PENETRATIONS = 0.3, 0.6, 1.0
LOSSES = 0.0, 0.2, 0.4, 0.6, 0.75
"""At the highest CAMs are lost long enough for hazards."""


class Settings(ExperimentSettings):
    """The runs: each scenario with each seed."""

    scenarios: Annotated[tuple[Scenario, ...], Field(min_length=1)] = tuple(SCENARIOS)
    seeds: int = Field(default=20, ge=1)
    first: int = Field(default=0, ge=0)
    """The first seed."""
    twice_every: int = Field(default=10, ge=0)
    """The seeds that are multiples of it run twice, and the bytes are compared; 0: none."""


def cells(settings: Settings) -> list[Values]:
    """By seed, so that an interrupted sweep has run all scenarios."""
    every = settings.twice_every
    return [
        {"scenario": name, "seed": n, "twice": bool(every) and n % every == 0}
        for n in range(settings.first, settings.first + settings.seeds)
        for name in settings.scenarios
    ]


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


@unwarned()  # of lost messages
def run(values: Values, seed: int = 0) -> Values:
    """Run ``values["scenario"]`` with ``values["seed"]``; with ``values["twice"]`` a second time.

    ``wrong`` has a line for everything that must not happen (traffic_run.wrong), for each log that
    is not allowed, for a repetition with other bytes, and for an exception that ended the run.
    ``sha256`` is of the record and all logs.  Raises ExperimentError without SUMO, OSError,
    MemoryError.
    """
    drawn_run = drawn(values["scenario"], values["seed"])
    nothing: Values = dict.fromkeys((*SUMS, "longest_ms"), 0) | {"sha256": ""}
    nothing |= {"collisions": dict.fromkeys(COLLISIONS, 0), "command": command(drawn_run)}
    try:
        return nothing | _checked(drawn_run, values["twice"])
    except TrafficError as error:
        raise ExperimentError(str(error)) from None
    except (OSError, MemoryError):  # of this machine, not of the run
        raise
    except Exception as error:
        return nothing | {"wrong": [f"it broke off: {error!r}"]}


def _checked(run: TrafficRun, twice: bool) -> Values:
    record, digest, judged = _once(run, judge=True)
    found = [*wrong(record), *judged]
    if twice and _once(run, judge=False)[1] != digest:
        found.append("a second run of the same seed wrote other bytes")
    hazards = record["hazards"] or {"lengths": {}}
    lengths = [ms for each in hazards["lengths"].values() for ms in each]
    return {
        "wrong": found,
        "collisions": record["collisions"],
        "hazards": len(lengths),
        "longest_ms": max(lengths, default=0),
        **{name: record["sessions"][name] for name in SESSIONS},
        "sha256": digest,
    }


def _once(run: TrafficRun, *, judge: bool) -> tuple[dict[str, Any], str, list[str]]:
    """The record, its digest with the logs, and with ``judge`` the logs that are not allowed."""
    with scratch.folder("traffic-logs") as folder:
        record = run.record(run.drive(logs=folder))
        logs = sorted(folder.glob("*.ndjson"))
        digest = hashlib.sha256(canonical(record).encode())
        for log in logs:
            digest.update(f"\n{log.name}\n".encode() + log.read_bytes())
        return record, digest.hexdigest(), not_allowed(logs) if judge else []


def not_allowed(logs: Sequence[Path]) -> list[str]:
    """A line for each log that ``trace explain`` does not allow."""
    return [
        f"{Path(one.file).name}:{one.finding.at.line}: {one.verdict}"
        for one in verdicts_of(logs)
        if one.verdict != "allowed"
    ]


def summary(cells: Sequence[Cell]) -> Values:
    """Sums by scenario; ``broken`` names the bad runs."""
    found: dict[str, Values] = {}
    broken = []
    for cell in cells:
        row = found.setdefault(cell.values["scenario"], dict.fromkeys(COLUMNS, 0))
        result = cell.result
        row["runs"] += 1
        row["twice"] += cell.values["twice"]
        for name in SUMS:
            row[name] += result[name]
        for name in COLLISIONS:
            row[name] += result["collisions"][name]
        row["longest_ms"] = max(row["longest_ms"], result["longest_ms"])
        if result["wrong"]:
            row["wrong"] += 1
            what = f"{cell.values['scenario']}, seed {cell.values['seed']}"
            broken.append(f"{what}: {'; '.join(result['wrong'])} ({result['command']})")
    return {"scenarios": found, "broken": broken}


SESSIONS = "requested", "agreed", "completed"
SUMS = *SESSIONS, "hazards"
COLLISIONS = "between_equipped", "by_maneuver", "with_pedestrian", "all"
COLUMNS = "runs", "twice", *SUMS, "longest_ms", *COLLISIONS, "wrong"
"""Of the summary of a scenario."""


def names(report: Values) -> Values:
    """What the page uses."""
    return {"runs": len(report["cells"]), "run_s": SECONDS}
