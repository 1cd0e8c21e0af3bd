"""Success under packet loss for three time-outs (section VI-C, Fig. 9 and Eq. 2).

The parts are the paper's measurement on the road, many sessions without a road, bursts of loss,
sessions over UDP sockets, and the cost of a longer time-out.
"""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from automcm_evaluation.arrival.arrival import Arrival
from automcm_evaluation.framework.experiment import Experiment, Settings, Values
from automcm_evaluation.loss import loss_page, loss_road, loss_sessions, loss_udp
from automcm_evaluation.loss.loss_tables import ROBUST, T_TIMEOUTS, claims, summary

BLOCK, ROAD_BLOCK = 2500, 20
"""Numbers of sessions and of drives in one cell."""
Percent = Annotated[int, Field(ge=0, le=100)]
TENS = tuple(range(0, 101, 10))
FINE = {0: range(0, 31, 2), 1000: range(50, 91, 2), 2000: range(60, 101, 2)}
"""For each t_timeout, the losses around the knees, %."""
UDP = (0, 30, 60)
PLACE = Arrival()
"""Start and signal as in ``arrival``, so that the best class of Fig. 9 is the paper's."""


class Loss(Settings):
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


def cells(settings: Loss) -> list[Values]:
    """The longest first."""
    found: list[Values] = []

    def sessions(part: str, t_timeout: int, loss: int, trials: int, burst_ms: int = 0) -> None:
        for n in range(0, trials, BLOCK):
            found.append(
                {
                    "part": part,
                    "t_timeout": t_timeout,
                    "loss": loss,
                    "burst_ms": burst_ms,
                    "block": n // BLOCK,
                    "trials": min(BLOCK, trials - n),
                }
            )

    for t_timeout in sorted(T_TIMEOUTS, reverse=True):
        for loss in TENS:
            sessions("tens", t_timeout, loss, settings.sessions)
        for loss in FINE[t_timeout]:
            if loss not in TENS:
                sessions("fine", t_timeout, loss, settings.fine)
        for burst_ms in settings.bursts_ms:
            for loss in TENS:
                sessions("bursts", t_timeout, loss, settings.in_bursts, burst_ms)
        road = [{"part": "road", "loss": n} for n in sorted({*settings.road_losses, ROBUST})]
        road += [
            {"part": "road bursts", "loss": ROBUST, "burst_ms": ms} for ms in settings.bursts_ms
        ]
        found += [
            which
            | {
                "t_timeout": t_timeout,
                "block": n // ROAD_BLOCK,
                "trials": min(ROAD_BLOCK, settings.road - n),
                "target_m": settings.target_m,
                "beside_m": [PLACE.beside_m, PLACE.beside_m + PLACE.beside_span_m],
                "signal_m": [PLACE.signal_m, PLACE.signal_m + PLACE.signal_span_m],
            }
            for which in road
            for n in range(0, settings.road, ROAD_BLOCK)
        ]
        if settings.udp:
            found += [
                {"part": "udp", "t_timeout": t_timeout, "loss": loss, "trials": settings.udp}
                for loss in UDP
            ]
    for t_timeout in sorted(settings.timeouts, reverse=True):
        for loss in settings.cost_losses:
            sessions("cost", t_timeout, loss, settings.cost)
    return found


def run(values: Values, seed: int) -> Values:
    """Run one cell.  Those over UDP run in real time, so a seed does not reproduce them."""
    match values["part"]:
        case "road" | "road bursts":
            return loss_road.block(values, seed)
        case "udp":
            return loss_udp.over_udp(
                values["t_timeout"], values["loss"] / 100, values["trials"], seed
            )
    return loss_sessions.block(values, seed)


EXPERIMENT = Experiment(
    name="loss",
    title="Packet loss and time-outs (VI-C, Fig. 9, Eq. 2)",
    settings=Loss,
    profiles={
        "quick": Loss(
            road=4,
            road_losses=(0, 10, 30, 50, 60, 70, 80, 90),
            sessions=100,
            fine=40,
            bursts_ms=(1000,),
            in_bursts=40,
            timeouts=(0, 300, 1000, 2000),
            cost_losses=(20, 60),
            cost=60,
            udp=0,
        ),
        "standard": Loss(),
    },
    cells=cells,
    run=run,
    summary=summary,
    claims=claims,
    page=loss_page.page,
    figures=loss_page.plots,
)
