"""Success under packet loss for three time-outs (section VI-C, Fig. 9 and Eq. 2).

The parts are the paper's measurement on the road, many sessions without a road, bursts of loss,
sessions over UDP sockets, and the cost of a longer time-out.
"""

from __future__ import annotations

from functools import partial
from typing import Annotated

from pydantic import Field

from automcm.links.simulated_radio import Channel
from automcm_evaluation.arrival import arrival
from automcm_evaluation.framework.experiment import ExperimentSettings, Json, Values, blocks, grid
from automcm_evaluation.loss import loss_road, loss_sessions, loss_udp
from automcm_evaluation.loss.loss_tables import ROBUST, T_TIMEOUTS
from automcm_simulation.road.simulation import Simulation

TITLE = "Packet loss and time-outs (VI-C, Fig. 9, Eq. 2)"
BLOCK, ROAD_BLOCK = 2500, 20
"""Numbers of sessions and of drives in one cell."""
Percent = Annotated[int, Field(ge=0, le=100)]
TENS = tuple(range(0, 101, 10))
FINE = {0: range(0, 31, 2), 1000: range(50, 91, 2), 2000: range(60, 101, 2)}
"""For each t_timeout, the losses around the knees, %."""
UDP = (0, 30, 60)
PLACE = arrival.Settings()
"""Start and signal as in ``arrival``, so that the best class of Fig. 9 is the paper's."""


class Settings(ExperimentSettings):
    """Settings; losses in per cent, times in ms."""

    road: int = Field(default=60, ge=1, le=1000)
    """Drives at each loss and time-out (the paper: 60)."""
    road_losses: tuple[Percent, ...] = TENS
    sessions: int = Field(default=10_000, ge=10, le=100_000)
    """Sessions at each multiple of 10 %."""
    fine: int = Field(default=1000, ge=10, le=100_000)
    """Sessions at each 2 % around the knees."""
    bursts_ms: tuple[Annotated[int, Field(ge=1, le=10_000)], ...] = (200, 1000)
    """Mean lengths of bursts (``Channel.burst_ms``)."""
    in_bursts: int = Field(default=500, ge=10, le=100_000)
    """Sessions at each multiple of 10 %, for each length; and drives at ROBUST."""
    timeouts: tuple[Annotated[int, Field(ge=0, le=10_000)], ...] = (
        *(0, 100, 200, 300, 500, 700, 1000, 1500, 2000, 3000),
    )
    """The cost of time-outs."""
    cost_losses: tuple[Percent, ...] = (10, 20, 30, 40, 50, 60, 70)
    cost: int = Field(default=400, ge=10, le=100_000)
    """Sessions for each of these."""
    udp: int = Field(default=20, ge=0, le=200)
    """Sessions over real sockets at each point (0 = none)."""
    target_m: float = Field(default=PLACE.target_m, ge=200, le=2000)
    """The paper's."""


def cells(settings: Settings) -> list[Values]:
    """The longest first."""
    s, found = settings, list[Values]()
    place = PLACE.drawn_from | {"target_m": s.target_m}

    def add(trials: int, block: int, **values: Json) -> None:
        found.extend(one | each for one in grid(**values) for each in blocks(trials, block))

    for t in sorted(T_TIMEOUTS, reverse=True):
        fine = [loss for loss in FINE[t] if loss not in TENS]
        add(s.sessions, BLOCK, part="tens", t_timeout=t, loss=TENS, burst_ms=0)
        add(s.fine, BLOCK, part="fine", t_timeout=t, loss=fine, burst_ms=0)
        add(s.in_bursts, BLOCK, part="bursts", t_timeout=t, burst_ms=s.bursts_ms, loss=TENS)
        first = len(found)
        road = sorted({*s.road_losses, ROBUST})
        add(s.road, ROAD_BLOCK, part="road", t_timeout=t, loss=road)
        add(s.road, ROAD_BLOCK, part="road bursts", t_timeout=t, loss=ROBUST, burst_ms=s.bursts_ms)
        found[first:] = [one | place for one in found[first:]]
        if s.udp:
            found += grid(part="udp", t_timeout=t, loss=UDP, trials=s.udp)
    costs = sorted(s.timeouts, reverse=True)
    add(s.cost, BLOCK, part="cost", t_timeout=costs, loss=s.cost_losses, burst_ms=0)
    return found


def run(values: Values, seed: int) -> Values:
    """Run one cell.  Those over UDP run in real time, so a seed does not reproduce them."""
    match values["part"]:
        case "road" | "road bursts":
            channel = Channel(loss=values["loss"] / 100, burst_ms=values.get("burst_ms", 0))
            return loss_road.block(values, seed, partial(Simulation, channel=channel))
        case "udp":
            return loss_udp.over_udp(
                values["t_timeout"], values["loss"] / 100, values["trials"], seed
            )
    return loss_sessions.block(values, seed)
