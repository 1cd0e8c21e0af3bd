"""The mean received power between moving stations at 5.9 GHz, and the airtime of a frame.

Both radios of ``radio`` use it, so that equal seeds give equal shadowing.  docs/radio.md has the
sources of the figures.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from automcm.kernels.trajectory import Floats

TX_DBM = 23.0
FREE_DB, NEAR_SLOPE, FAR_SLOPE, BREAK_M = 47.9, 2.1, 3.8, 100.0
"""Loss at 1 m in dB, the two exponents of the log-distance loss, and where the second begins."""
SHADOW_DB, SHADOW_M = 3.0, 25.0
"""Standard deviation of the shadowing, and the way after which it has lost all but 1/e."""
BUSY_DBM = -85.0
"""The power from which a channel counts as busy."""
SENSED_DBM = -93.0
"""The power from which a frame is detected: 4 dB above the noise."""
HEADERS = {
    "802.11 MAC": 24,
    "802.11 check sum": 4,
    "LLC and SNAP": 8,
    "GeoNetworking basic": 4,
    "GeoNetworking common": 8,
    "GeoNetworking single-hop broadcast": 28,
    "BTP-B": 4,
}
"""Bytes around a payload in ITS-G5, without security and without QoS control (2 more), as ns-3
sends them; the lengths of GeoNetworking and BTP are those of ETSI EN 302 636."""
HEADER_BYTES = sum(HEADERS.values())
PREAMBLE_US, SYMBOL_US, SYMBOL_BITS, EXTRA_BITS = 40.0, 8.0, 48, 22
"""OFDM at 6 Mbit/s in 10 MHz: preamble with SIGNAL, and the bits of SERVICE and tail."""
NOWHERE_DBM = -1000.0
"""In place of a power: no station, or the same one."""


def airtime_us(size_bytes: int) -> float:
    """How long a frame with an encoded message of this size occupies the channel."""
    bits = EXTRA_BITS + 8 * (size_bytes + HEADER_BYTES)
    return PREAMBLE_US + SYMBOL_US * math.ceil(bits / SYMBOL_BITS)


def path_loss_db(distance_m: Floats) -> Floats:
    """The loss without shadowing; below 1 m as at 1 m."""
    near = np.clip(distance_m, 1.0, BREAK_M)
    far = np.maximum(distance_m, BREAK_M) / BREAK_M
    loss: Floats = FREE_DB + 10 * NEAR_SLOPE * np.log10(near) + 10 * FAR_SLOPE * np.log10(far)
    return loss


def sensed(mean_dbm: Floats) -> Floats:
    """How often a frame is detected under Rayleigh fading."""
    share: Floats = np.exp(-(10 ** ((SENSED_DBM - mean_dbm) / 10)))
    return share


class Propagation:
    """The stations, their places, and the mean power from each at each.

    A station occupies a slot as long as it is placed.  Arrays have one entry for each slot.
    """

    def __init__(self, seed: int) -> None:
        self.slots: dict[int, int] = {}
        """By station id."""
        self.ids: list[int | None] = []
        """By slot."""
        self.places: Floats = np.zeros((0, 2))
        self.mean_dbm: Floats = np.zeros((0, 0))
        """From slot i at slot j.  Shadowing is the same both ways."""
        self._shadow: Floats = np.zeros((0, 0))
        self._random = np.random.default_rng((seed, 1))

    def __len__(self) -> int:
        return len(self.ids)

    def move(self, positions: Mapping[int, tuple[float, float]]) -> list[int]:
        """As ``Radio.move``; returns the slots that got a new station."""
        for station, place in positions.items():
            if not all(map(math.isfinite, place)):
                raise ValueError(f"the position of station {station} must be finite, not {place}")
        for station in [s for s in self.slots if s not in positions]:
            self.ids[self.slots.pop(station)] = None
        new = sorted(s for s in positions if s not in self.slots)
        free = [slot for slot, station in enumerate(self.ids) if station is None]
        self._grow(len(new) - len(free))
        free += range(len(free) + len(self.slots), len(self.ids))
        for station, slot in zip(new, free, strict=False):
            self.slots[station], self.ids[slot] = slot, station
        self._place(positions, entered := [self.slots[station] for station in new])
        return entered

    def distances(self) -> Floats:
        """Between the slots, m."""
        apart = self.places[:, None, :] - self.places[None, :, :]
        return np.hypot(apart[..., 0], apart[..., 1])

    def _grow(self, by: int) -> None:
        if by > 0:
            self.ids += [None] * by
            self.places = np.pad(self.places, ((0, by), (0, 0)))
            self._shadow = np.pad(self._shadow, ((0, by), (0, by)))

    def _place(self, positions: Mapping[int, tuple[float, float]], entered: list[int]) -> None:
        before = self.places.copy()
        for station, slot in self.slots.items():
            self.places[slot] = positions[station]
        way = np.hypot(*(self.places - before).T)
        way[entered] = math.inf
        self._shade(way)
        absent = [slot for slot, station in enumerate(self.ids) if station is None]
        self.mean_dbm = TX_DBM - path_loss_db(self.distances()) - self._shadow
        np.fill_diagonal(self.mean_dbm, NOWHERE_DBM)
        self.mean_dbm[absent, :] = self.mean_dbm[:, absent] = NOWHERE_DBM

    def _shade(self, way: Floats) -> None:
        """Log-normal shadowing with an exponential correlation over the longer of two ways."""
        kept = np.exp(-np.maximum(way[:, None], way[None, :]) / SHADOW_M)
        upper = np.triu(self._random.standard_normal(kept.shape), 1)
        new = SHADOW_DB * np.sqrt(1 - kept**2) * (upper + upper.T)
        self._shadow = kept * self._shadow + new


class OfferedLoad:
    """What was sent in the last second, by slot.  It changes every ``BIN_MS``."""

    BIN_MS, BINS = 100, 10

    def __init__(self) -> None:
        self.share: Floats = np.zeros(0)
        """The airtime of the frames that a slot can hear on average, as a share; it may be over 1.
        """
        self.airtime: Floats = np.zeros(0)
        """The airtime of its own frames, as a share."""
        self.frames: Floats = np.zeros(0)
        """The number of its own frames, 1/s."""
        self._bins: Floats = np.zeros((3, self.BINS, 0))
        self._bin = 0

    def enter(self, slots: list[int], size: int) -> None:
        """Forget what the slots of new stations have heard and sent.  ``size``: all slots."""
        old, more = len(self.share), size - len(self.share)
        usual = float(np.median(self.share)) if old > len(slots) else 0.0
        self.share, self.airtime, self.frames = (
            np.pad(each, (0, more)) for each in (self.share, self.airtime, self.frames)
        )
        self._bins = np.pad(self._bins, ((0, 0), (0, 0), (0, more)))
        self._bins[:, :, slots] = 0.0
        self.share[slots] = usual
        self.airtime[slots] = self.frames[slots] = 0.0

    def add(self, slot: int, mean_dbm: Floats, airtime_us: float) -> None:
        """A frame from this slot; ``mean_dbm`` is its power at every slot."""
        heard, airtime, frames = self._bins[:, self._bin % self.BINS]
        heard[mean_dbm >= BUSY_DBM] += airtime_us
        heard[slot] += airtime_us
        airtime[slot] += airtime_us
        frames[slot] += 1

    def advance(self, now_ms: int) -> bool:
        """Whether anything has changed."""
        bin_ = now_ms // self.BIN_MS
        if bin_ == self._bin:
            return False
        for passed in range(self._bin + 1, min(bin_, self._bin + self.BINS + 1)):
            self._bins[:, passed % self.BINS] = 0.0
        counted_ms = self.BIN_MS * min(bin_, self.BINS)
        heard, airtime, frames = self._bins.sum(axis=1)
        self.share, self.airtime = heard / (1000 * counted_ms), airtime / (1000 * counted_ms)
        self.frames = 1000 * frames / counted_ms
        self._bins[:, bin_ % self.BINS] = 0.0
        self._bin = bin_
        return True
