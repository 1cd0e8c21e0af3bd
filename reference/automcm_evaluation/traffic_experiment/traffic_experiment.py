"""Traffic at scale: scenarios in SUMO by penetration and density, with stations and without, and
crowds in which many stations ask at once."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from automcm_evaluation.framework.experiment import Experiment, ExperimentError, Settings, Values
from automcm_evaluation.traffic_experiment import (
    crowd_sessions,
    traffic_cell,
    traffic_page,
    traffic_tables,
)
from automcm_simulation.traffic_scenarios.catalogue import SCENARIOS

Share = Annotated[float, Field(gt=0, le=1)]
Number = Annotated[int, Field(ge=1, le=500)]
Block = tuple[
    str,
    Annotated[float, Field(gt=0, le=1000)],
    Annotated[tuple[Share, ...], Field(min_length=1)],
    Annotated[int, Field(ge=1, le=1000)],
]
"""A scenario, vehicles per km over all lanes, penetrations, and the number of seeds."""
FOUR, MERGE = traffic_page.ASKED, "merge"


class Scale(Settings):
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


def cells(settings: Scale) -> list[Values]:
    """By seed, so that an interrupted sweep has run all blocks with its first seeds.

    Raises ExperimentError for an unknown scenario.
    """
    for name in (block[0] for block in settings.blocks):
        if name not in SCENARIOS:
            raise ExperimentError(
                f"blocks: there is no scenario {name!r}; there are: {', '.join(SCENARIOS)}"
            )
    found: list[Values] = [
        {"part": "answers", "receivers": n, "early": early, "run_ms": settings.receivers_ms}
        for n in settings.receivers
        for early in (False, True)
    ]
    blocks = settings.blocks if settings.sumo else ()
    last = max((settings.crowds, *(block[3] for block in blocks)))
    for seed in range(1, last + 1):
        if seed <= settings.crowds:
            found += _crowds(settings, seed)
        for block in blocks:
            if seed <= block[3]:
                found += [values for values in _runs(settings, block, seed) if values not in found]
    return found


def _crowds(settings: Scale, seed: int) -> list[Values]:
    return [
        {
            "part": "all ask",
            "stations": n,
            "spread_ms": spread,
            "seed": seed,
            "run_ms": settings.stations_ms,
        }
        for n in settings.stations
        for spread in settings.spreads_ms
    ]


def _runs(settings: Scale, block: Block, seed: int) -> list[Values]:
    """Those without stations do not depend on the penetration."""
    scenario, per_km, shares, _ = block
    where = {
        "part": "road",
        "scenario": scenario,
        "per_km": per_km,
        "metres": settings.metres,
        "seconds": settings.seconds,
        "seed": seed,
    }
    return [where | {"variant": variant, "share": 0.0} for variant in traffic_cell.ALONE] + [
        where | {"variant": variant, "share": share}
        for share in shares
        for variant in ("silent", "stations")
    ]


def run(values: Values, seed: int) -> Values:
    """Run one cell.  Raises ExperimentError without SUMO, if it needs it."""
    match values["part"]:
        case "answers":
            return crowd_sessions.answers(values, seed)
        case "all ask":
            return crowd_sessions.all_ask(values, seed)
    return traffic_cell.run(values, seed)


def _grid() -> tuple[Block, ...]:
    """What was asked for."""
    shares, seeds = traffic_page.ASKED_SHARES, traffic_page.ASKED_SEEDS
    return tuple((FOUR, per_km, shares, seeds) for per_km in traffic_page.ASKED_DENSITIES)


EXPERIMENT = Experiment(
    name="traffic",
    title="Traffic at scale",
    settings=Scale,
    profiles={
        "quick": Scale(
            sumo=False,
            blocks=((FOUR, 50.0, (1.0,), 1),),
            metres=200,
            seconds=10,
            receivers=(8, 33),
            stations=(2, 5),
            crowds=1,
        ),
        "standard": Scale(
            blocks=((MERGE, 40.0, (0.5, 1.0), traffic_page.ASKED_SEEDS), *_grid()),
            crowds=traffic_page.ASKED_SEEDS,
        ),
        "coarse": Scale(
            blocks=(
                (FOUR, 50.0, (0.1, 0.5, 1.0), 3),
                (MERGE, 40.0, (0.5, 1.0), 3),
                (FOUR, 100.0, (0.1, 0.5, 1.0), 3),
                (FOUR, 200.0, (0.1, 0.5, 1.0), 3),
                (FOUR, 400.0, (0.1, 0.5), 3),
                (FOUR, 400.0, (1.0,), 1),
            )
        ),
    },
    cells=cells,
    run=run,
    summary=traffic_tables.summary,
    claims=traffic_tables.claims,
    page=traffic_page.page,
    figures=traffic_page.plots,
)
