"""The time to an agreement with a window that closes when every known neighbour has answered
(ADV-9), beside the paper's window, in virtual time: the figures do not depend on the machine."""

from __future__ import annotations

from random import Random

import pytest

from automcm.links.simulated_radio import Channel
from automcm.service.application import CloseWindow, all_answered
from automcm_evaluation.loss.loss_sessions import SessionOutcome, session
from automcm_maintenance.benches.plugin import Figure, beside

SESSIONS, T_TIMEOUT = 200, 2000
"""At each loss; the default, in ms."""
losses = pytest.mark.parametrize("loss", [0, 10, 20, 40])


def agreements(loss: int, close: CloseWindow | None) -> list[SessionOutcome]:
    """The sessions that agree, with equal seeds at a loss in per cent."""
    draw, channel = Random(1), Channel(loss=loss / 100)
    made = [session(T_TIMEOUT, channel, draw.getrandbits(31), close) for _ in range(SESSIONS)]
    return [each for each in made if each.agreed]


@losses
def bench_fixed_ms(loss: int, figure: Figure) -> None:
    """The mean time."""
    found = agreements(loss, None)
    figure(sum(each.after_ms for each in found) / len(found), "ms")


@losses
@beside("fixed_ms", 0.25)
def bench_early_ms(loss: int, figure: Figure) -> None:
    """The mean time."""
    found = agreements(loss, all_answered)
    figure(sum(each.after_ms for each in found) / len(found), "ms")


@losses
def bench_fixed_messages(loss: int, figure: Figure) -> None:
    """For each agreement."""
    found = agreements(loss, None)
    figure(sum(each.sent for each in found) / len(found), "messages")


@losses
@beside("fixed_messages", 0.5)
def bench_early_messages(loss: int, figure: Figure) -> None:
    """For each agreement."""
    found = agreements(loss, all_answered)
    figure(sum(each.sent for each in found) / len(found), "messages")
