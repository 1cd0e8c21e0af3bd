"""The paper's loss figures over a radio channel, and the table beside ns-3 (beyond the paper).

The parts are the fit of the table, sessions and drives over it, and a crowded channel.
"""

from __future__ import annotations

from typing import Annotated, Any

from pydantic import Field

from automcm_evaluation.arrival.arrival import Arrival
from automcm_evaluation.framework.experiment import Experiment, Settings, Values
from automcm_evaluation.loss.loss_tables import T_TIMEOUTS
from automcm_evaluation.radio import radio_crowd, radio_page, radio_sessions, radio_tables
from automcm_evaluation.radio.radio_traffic import drive, measured, ns3_measured, pooled
from automcm_simulation.radio.table_radio import TableRadio

BLOCK = 50
"""Sessions in one cell."""
PLACE = Arrival()
"""Start, signal and target as for Fig. 8."""
Metres = Annotated[int, Field(ge=1, le=1000)]
Share = Annotated[float, Field(ge=0, le=2)]


class Over(Settings):
    """Settings; distances in m, loads as shares of airtime, times in ms."""

    fit_seeds: int = Field(default=2, ge=1, le=100)
    """Runs of the table for each traffic measured in ns-3."""
    distances: tuple[Metres, ...] = (25, 200, 250, 300, 350, 400, 500)
    loads: tuple[Share, ...] = (0.0, 0.3, 0.6)
    sessions: int = Field(default=100, ge=1, le=10_000)
    """At each distance, load and t_timeout."""
    road_distances: tuple[Metres, ...] = (25, 200, 300, 400, 500)
    road: int = Field(default=20, ge=1, le=1000)
    """Drives at each distance and t_timeout, without other load."""
    crowds: tuple[Annotated[int, Field(ge=1, le=1000)], ...] = (50, 167, 333)
    """Vehicles a kilometre."""
    crowd_ms: int = Field(default=9_000, ge=3000, le=100_000)
    sizes: tuple[Annotated[int, Field(ge=1, le=2000)], ...] = (radio_sessions.CAM_BYTES, 400)
    """CAMs in JSON, and about the size of signed ones."""


def cells(settings: Over) -> list[Values]:
    """The longest first."""
    found: list[Values] = [
        {
            "part": "crowd",
            "per_km": per_km,
            "control": control,
            "size_bytes": size,
            "run_ms": settings.crowd_ms,
        }
        for per_km in sorted(settings.crowds, reverse=True)
        for size in settings.sizes
        for control in (False, True)
    ]
    found += [
        {"part": "fit", "traffic": each.traffic.name, "seeds": settings.fit_seeds}
        for each in reversed(ns3_measured())
    ]
    found += [
        {
            "part": "road",
            "distance_m": distance,
            "load": 0.0,
            "t_timeout": t_timeout,
            "trials": settings.road,
            "target_m": PLACE.target_m,
            "beside_m": [PLACE.beside_m, PLACE.beside_m + PLACE.beside_span_m],
            "signal_m": [PLACE.signal_m, PLACE.signal_m + PLACE.signal_span_m],
        }
        for t_timeout in T_TIMEOUTS
        for distance in settings.road_distances
    ]
    return found + [
        {
            "part": "sessions",
            "distance_m": distance,
            "load": load,
            "t_timeout": t_timeout,
            "block": n // BLOCK,
            "trials": min(BLOCK, settings.sessions - n),
        }
        for t_timeout in sorted(T_TIMEOUTS, reverse=True)
        for load in settings.loads
        for distance in settings.distances
        for n in range(0, settings.sessions, BLOCK)
    ]


def run(values: Values, seed: int) -> Values:
    """Run one cell."""
    match values["part"]:
        case "crowd":
            return radio_crowd.crowd(values, seed)
        case "fit":
            return _fit(values, seed)
        case "road":
            return radio_sessions.drives(values, seed)
    return radio_sessions.block(values, seed)


def _fit(values: Values, seed: int) -> Values:
    """What ``TableRadio`` lets arrive of a traffic measured in ns-3, at its places and phases."""
    traffic = next(m.traffic for m in ns3_measured() if m.traffic.name == values["traffic"])
    parts = []
    for n in range(values["seeds"]):
        own = TableRadio(traffic.seed if n == 0 else seed % 2**31 + n)  # the first: as in ns-3
        parts.append(measured(traffic, drive(own, traffic)))
    found: dict[str, Any] = pooled(parts).model_dump(mode="json")
    return {"busy": found["busy"], "rows": found["rows"]}


EXPERIMENT = Experiment(
    name="radio",
    title="The paper's loss figures over a radio channel",
    settings=Over,
    profiles={
        "quick": Over(
            fit_seeds=1,
            distances=(25, 300, 500),
            loads=(0.0,),
            sessions=20,
            road_distances=(25, 400),
            road=3,
            crowds=(50,),
            crowd_ms=3000,
        ),
        "standard": Over(),
    },
    cells=cells,
    run=run,
    summary=radio_tables.summary,
    claims=radio_tables.claims,
    page=radio_page.page,
    figures=radio_page.plots,
)
