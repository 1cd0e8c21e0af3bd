"""The time to an agreement with a window that closes when every known neighbour has answered
(ADV-9), beside the paper's window, in virtual time: the figures do not depend on the machine."""

from __future__ import annotations

from functools import partial
from random import Random
from statistics import fmean

import pytest

from automcm.links.simulated_radio import Channel
from automcm.service.application import CloseWindow, all_answered
from automcm.service.service import McService
from automcm_evaluation.loss.loss_sessions import session
from automcm_maintenance.benches.plugin import Figure
from automcm_simulation.road.simulation import Simulation

SESSIONS, T_TIMEOUT = 200, 2000
"""At each loss; the default, in ms."""
FIGURES = {"after_ms": ("ms", 0.25), "sent": ("messages", 0.5)}
"""Unit and bar of the mean time, and of the messages for each agreement."""
losses = pytest.mark.parametrize("loss", [0, 10, 20, 40])


def mean(loss: int, close: CloseWindow | None, of: str) -> float:
    """Of the sessions that agree, with equal seeds at a loss in per cent."""
    draw, channel = Random(1), Channel(loss=loss / 100)
    service = partial(McService, close_window=close)
    made = (
        session(Simulation(seed=draw.getrandbits(31), channel=channel, service=service), T_TIMEOUT)
        for _ in range(SESSIONS)
    )
    return fmean(getattr(each, of) for each in made if each.agreed)


@losses
@pytest.mark.parametrize("of", FIGURES)
def bench_fixed(loss: int, of: str, figure: Figure) -> None:
    """The paper's window."""
    figure(mean(loss, None, of), FIGURES[of][0])


@losses
@pytest.mark.parametrize("of", FIGURES)
def bench_early(loss: int, of: str, figure: Figure) -> None:
    """ADV-9."""
    figure(mean(loss, all_answered, of), FIGURES[of][0], beside=("fixed", FIGURES[of][1]))
