"""Traffic at scale: scenarios in SUMO by penetration and density, with stations and without, and
crowds in which many stations ask at once."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from automcm_evaluation.framework.experiment import ExperimentSettings, Values, grid
from automcm_evaluation.traffic_experiment import crowd_sessions, traffic_cell

TITLE = "Traffic at scale"
Share = Annotated[float, Field(gt=0, le=1)]
Number = Annotated[int, Field(ge=1, le=500)]
Block = tuple[
    traffic_cell.Scenario,
    Annotated[float, Field(gt=0, le=1000)],
    Annotated[tuple[Share, ...], Field(min_length=1)],
    Annotated[int, Field(ge=1, le=1000)],
]
"""A scenario, vehicles per km over all lanes, penetrations, and the number of seeds."""


class Settings(ExperimentSettings):
    """Settings; lengths in m, times in ms unless the name says otherwise."""

    sumo: bool = True
    """Whether to run the scenarios, which needs automcm[sumo]."""
    blocks: tuple[Block, ...] = ()
    metres: Annotated[float, Field(ge=50, le=5000)] = 300
    """The stretch on which the vehicles start."""
    seconds: Annotated[float, Field(ge=1, le=3600)] = 30
    receivers: tuple[Number, ...] = (8, 32, 33, 48)
    receivers_ms: Annotated[int, Field(ge=2000, le=100_000)] = 10_000
    stations: tuple[Number, ...] = (2, 5, 10, 20)
    spreads_ms: tuple[Annotated[int, Field(ge=0, le=100_000)], ...] = (0, 10_000)
    stations_ms: Annotated[int, Field(ge=2000, le=1_000_000)] = 31_000
    crowds: Annotated[int, Field(ge=1, le=1000)] = 3
    """Seeds of each crowd that asks."""


def cells(settings: Settings) -> list[Values]:
    """By seed, so that an interrupted sweep has run all blocks with its first seeds."""
    s = settings
    found = grid(part="answers", receivers=s.receivers, early=(False, True), run_ms=s.receivers_ms)
    crowd = {"part": "all ask", "run_ms": s.stations_ms}
    crowds = [crowd | each for each in grid(stations=s.stations, spread_ms=s.spreads_ms)]
    blocks = settings.blocks if settings.sumo else ()
    last = max((settings.crowds, *(block[3] for block in blocks)))
    for seed in range(1, last + 1):
        if seed <= settings.crowds:
            found += [each | {"seed": seed} for each in crowds]
        for block in blocks:
            if seed <= block[3]:
                found += [values for values in _runs(settings, block, seed) if values not in found]
    return found


def _runs(settings: Settings, block: Block, seed: int) -> list[Values]:
    """Those without stations do not depend on the penetration."""
    scenario, per_km, shares, _ = block
    where = {"part": "road", "scenario": scenario, "per_km": per_km, "seed": seed}
    where |= {"metres": settings.metres, "seconds": settings.seconds}
    runs = grid(share=0.0, variant=traffic_cell.ALONE)
    return [where | run for run in runs + grid(share=shares, variant=("silent", "stations"))]


def run(values: Values, seed: int) -> Values:
    """Run one cell.  Raises ExperimentError without SUMO, if it needs it."""
    match values["part"]:
        case "answers":
            return crowd_sessions.answers(values, seed)
        case "all ask":
            return crowd_sessions.all_ask(values, seed)
    return traffic_cell.run(values, seed)
