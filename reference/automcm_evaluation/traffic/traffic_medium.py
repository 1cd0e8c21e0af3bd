"""Services on a radio with positions: the links, and a radio that loses evenly."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from automcm.links.clock import Clock
from automcm.links.link import Receiver
from automcm.links.radio import LARGEST_BYTES, Radio, Reception
from automcm.links.simulated_radio import Channel
from automcm_spec.vocabulary.messages import BROADCAST

PENDING_MS = 100
"""No reception is later than this after its transmission."""


class EvenRadio:
    """Loses each copy with the same probability, wherever the stations are, and delays it as
    ``Channel`` does.  The channel is never busy."""

    def __init__(self, loss: float, seed: int) -> None:
        self._channel = Channel(loss=loss)
        self._random = np.random.default_rng(seed)
        self._stations: list[int] = []
        self._due: dict[int, list[Reception]] = {}
        self._done_ms = -1

    def move(self, positions: Mapping[int, tuple[float, float]]) -> None:
        """As ``Radio.move``."""
        self._stations = list(positions)

    def transmit(self, sender: int, size_bytes: int, now_ms: int, frame: int) -> None:
        """As ``Radio.transmit``."""
        low, high = self._channel.delay_ms
        number, due = len(self._stations), self._due
        arrives = self._random.random(number) >= self._channel.loss
        at = (now_ms + self._random.integers(low, high + 1, number)).tolist()
        for n in np.flatnonzero(arrives).tolist():
            if (station := self._stations[n]) != sender:
                due.setdefault(at[n], []).append(Reception(at[n], frame, station))

    def advance(self, until_ms: int) -> list[Reception]:
        """As ``Radio.advance``."""
        found: list[Reception] = []
        for at in range(self._done_ms + 1, until_ms + 1):
            found += sorted(self._due.pop(at, ()))
        self._done_ms = max(self._done_ms, until_ms)
        return found

    def channel_busy_ratio(self, station: int) -> float:
        """As ``Radio.channel_busy_ratio``."""
        return 0.0


class Medium:
    """The links of all stations on one radio, which is asked every millisecond in which something
    may arrive."""

    def __init__(self, radio: Radio, clock: Clock) -> None:
        self.radio = radio
        self.transmitted = self.received = 0
        """Frames, and copies of them."""
        self.too_long = 0
        """Messages that no frame holds, which count as lost."""
        self.longest_ms = 0
        """The longest delay of a copy."""
        self._clock = clock
        self._receivers: dict[int, Receiver] = {}
        self._frames: dict[int, tuple[int, bytes, int, str]] = {}
        """By frame: when it was sent, what, to whom, and its transmission id."""
        self._there: Mapping[int, tuple[float, float]] = {}
        self._oldest = 0
        self._last_ms = -PENDING_MS
        self._pumps = False

    def link(self, station_id: int) -> RadioLink:
        """The link of a station."""
        return RadioLink(self, station_id)

    def move(self, positions: Mapping[int, tuple[float, float]]) -> None:
        """Where the stations are now, m.  A station that is left out is off the air."""
        self._there = positions
        self.radio.move(positions)

    def _send(self, sender: int, data: bytes, to: int, tx: str) -> None:
        if len(data) > LARGEST_BYTES:
            self.too_long += 1
            return
        if sender not in self._there:
            return
        now = self._clock.now()
        self.transmitted += 1
        self._frames[self.transmitted] = now, data, to, tx
        self._last_ms = now
        self.radio.transmit(sender, len(data), now, self.transmitted)
        if not self._pumps:
            self._pumps = True
            self._clock.at(now + 1, self._pump)

    def _pump(self) -> None:
        now, frames, receivers = self._clock.now(), self._frames, self._receivers
        for _, frame, receiver in self.radio.advance(now):
            sent_ms, data, to, tx = frames[frame]
            if to in (BROADCAST, receiver) and (receive := receivers.get(receiver)) is not None:
                self.received += 1
                self.longest_ms = max(self.longest_ms, now - sent_ms)
                receive(data, tx)
        while self._oldest < self.transmitted and (
            self._oldest not in frames or frames[self._oldest][0] < now - PENDING_MS
        ):
            frames.pop(self._oldest, None)
            self._oldest += 1
        self._pumps = now < self._last_ms + PENDING_MS
        if self._pumps:
            self._clock.at(now + 1, self._pump)


class RadioLink:
    """One station's end of a ``Medium``.  The network layer drops what is for another station."""

    def __init__(self, medium: Medium, station_id: int) -> None:
        self._medium, self._station_id = medium, station_id

    def open(self, receive: Receiver) -> None:
        """As ``Link.open``."""
        self._medium._receivers[self._station_id] = receive

    def send(self, data: bytes, to: int, tx: str) -> None:
        """As ``Link.send``."""
        if self._station_id in self._medium._receivers:
            self._medium._send(self._station_id, data, to, tx)

    def close(self) -> None:
        """As ``Link.close``."""
        self._medium._receivers.pop(self._station_id, None)
