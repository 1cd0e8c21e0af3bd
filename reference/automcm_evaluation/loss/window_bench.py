"""``automcm bench window``: the time to an agreement, with the paper's advertising window and with
one that closes when every known neighbour has answered (ADV-9)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict, dataclass
from random import Random
from typing import Any

from automcm.links.simulated_radio import Channel
from automcm.service.application import CloseWindow, all_answered
from automcm_evaluation.loss.loss_sessions import SessionOutcome, session

LOSSES = (0, 10, 20, 40)
"""Loss in per cent."""
T_TIMEOUT = 2000
"""The default, in ms."""


@dataclass(frozen=True)
class Window:
    """Sessions with one kind of window: the share that agrees, mean and 95 % quantile of the time
    from request to agreement in ms, and the messages for each agreement."""

    agreed: float
    mean_ms: float
    q95_ms: int
    messages: float


@dataclass(frozen=True)
class WindowRow:
    """The same seeds with both windows at one loss, in per cent."""

    loss: int
    fixed: Window
    early: Window

    @property
    def ratio(self) -> float:
        """How many times the mean time of an early window the fixed one takes."""
        return self.fixed.mean_ms / self.early.mean_ms

    def as_dict(self) -> dict[str, Any]:
        """The row as JSON."""
        return asdict(self) | {"ratio": round(self.ratio, 2)}


def run(sessions: int, seed: int, notify: Callable[[str], None]) -> list[WindowRow]:
    """Measure in virtual time: equal arguments give equal figures on every machine."""
    rows = []
    for loss in LOSSES:
        notify(f"loss {loss}%")
        draw = Random(seed)
        seeds = [draw.getrandbits(31) for _ in range(sessions)]
        rows.append(WindowRow(loss, _window(loss, seeds, None), _window(loss, seeds, all_answered)))
    return rows


def _window(loss: int, seeds: list[int], close_window: CloseWindow | None) -> Window:
    channel = Channel(loss=loss / 100)
    outcomes: list[SessionOutcome] = [session(T_TIMEOUT, channel, s, close_window) for s in seeds]
    times = sorted(each.after_ms for each in outcomes if each.agreed)
    return Window(
        agreed=len(times) / len(seeds),
        mean_ms=sum(times) / len(times),
        q95_ms=times[int(0.95 * (len(times) - 1))],
        messages=sum(each.sent for each in outcomes) / len(times),
    )
