"""A radio that loses evenly, wherever the stations are."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from automcm.links.simulated_radio import Channel
from automcm_simulation.radio.radio import Arrival


class EvenRadio:
    """Loses each copy with the same probability and delays it as ``Channel`` does.

    The channel is never busy.
    """

    def __init__(self, loss: float, seed: int) -> None:
        self._channel = Channel(loss=loss)
        self._random = np.random.default_rng(seed)
        self._stations: list[int] = []
        self._due: dict[int, dict[int, list[int]]] = {}
        """By time, ms, and frame: the receivers."""
        self._done_ms = -1

    def move(self, positions: Mapping[int, tuple[float, float]]) -> None:
        """As ``Radio.move``."""
        self._stations = list(positions)

    def transmit(self, sender: int, size_bytes: int, now_ms: int, frame: int) -> None:
        """As ``Radio.transmit``."""
        low, high = self._channel.delay_ms
        number = len(self._stations)
        arrives = self._random.random(number) >= self._channel.loss
        at = (now_ms + self._random.integers(low, high + 1, number)).tolist()
        for n in np.flatnonzero(arrives).tolist():
            if (station := self._stations[n]) != sender:
                self._due.setdefault(at[n], {}).setdefault(frame, []).append(station)

    def advance(self, until_ms: int) -> list[Arrival]:
        """As ``Radio.advance``."""
        found: list[Arrival] = []
        for at in range(self._done_ms + 1, until_ms + 1):
            frames = self._due.pop(at, {})
            found += [Arrival(at, frame, sorted(frames[frame])) for frame in sorted(frames)]
        self._done_ms = max(self._done_ms, until_ms)
        return found

    def channel_busy_ratio(self, station: int) -> float:
        """As ``Radio.channel_busy_ratio``."""
        return 0.0
