"""The paper's loss figures over a radio channel, and the table beside ns-3 (beyond the paper).

The parts are the fit of the table, sessions and drives over it, and a crowded channel.
"""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from automcm_evaluation.arrival import arrival
from automcm_evaluation.framework.experiment import ExperimentSettings, Values, blocks, grid
from automcm_evaluation.loss.loss_tables import T_TIMEOUTS
from automcm_evaluation.radio import radio_crowd, radio_sessions
from automcm_evaluation.radio.radio_traffic import measured, ns3_measured, pooled
from automcm_simulation.radio.table_radio import TableRadio

TITLE = "The paper's loss figures over a radio channel"
BLOCK = 50
"""Sessions in one cell."""
PLACE = arrival.Settings()
"""Start, signal and target as for Fig. 8."""
Metres = Annotated[int, Field(ge=1, le=1000)]
Share = Annotated[float, Field(ge=0, le=2)]


class Settings(ExperimentSettings):
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


def cells(settings: Settings) -> list[Values]:
    """The longest first."""
    s = settings
    crowds = sorted(s.crowds, reverse=True)
    own = {"part": "crowd", "run_ms": s.crowd_ms}
    sizes = grid(per_km=crowds, size_bytes=s.sizes, control=(False, True))
    found = [own | each for each in sizes]
    traffics = [each.traffic.name for each in reversed(ns3_measured())]
    found += grid(part="fit", traffic=traffics, seeds=s.fit_seeds)
    road = grid(part="road", load=0.0, t_timeout=T_TIMEOUTS, distance_m=s.road_distances)
    found += [each | PLACE.drawn_from | {"trials": s.road} for each in road]
    timeouts = sorted(T_TIMEOUTS, reverse=True)
    sessions = grid(part="sessions", t_timeout=timeouts, load=s.loads, distance_m=s.distances)
    return found + [one | block for one in sessions for block in blocks(s.sessions, BLOCK)]


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
        parts.append(measured(own, traffic))
    return pooled(parts).model_dump(mode="json", include={"busy", "rows"})
