"""A ``Radio`` by ns-3's 802.11p, in step with the simulation (automcm[radio])."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import suppress
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np

from automcm_simulation.radio.propagation import (
    BUSY_DBM,
    EXTRA_BITS,
    HEADER_BYTES,
    HEADERS,
    NOWHERE_DBM,
    PREAMBLE_US,
    SYMBOL_BITS,
    SYMBOL_US,
    TX_DBM,
    Propagation,
)
from automcm_simulation.radio.radio import Arrival, Sequence
from automcm_spec.support.extras import MissingExtra, missing

NOISE_FIGURE_DB = 7.0
NEAR_M, FAR_M, FADING_M = 50.0, 150.0, (3.0, 1.5, 1.0)
"""The parameter m of Nakagami below, between and above these distances."""
CW_MIN, CW_MAX, AIFSN = 15, 1023, 6
"""Of the access category AC_BE."""
MODE = "OfdmRate6MbpsBW10MHz"
LLC_MAC_BYTES = sum(HEADERS[name] for name in ("802.11 MAC", "802.11 check sum", "LLC and SNAP"))
"""What ns-3 adds by itself."""
SEEDS = 4_294_944_443
"""A seed of ns-3 is from 1 to below this; it aborts on another one."""
NS = 1_000_000
"""In a millisecond."""


def _compiled() -> Any:
    """The namespace of ns3_channel.hpp.  It takes some 10 s the first time."""
    if (reason := missing("radio")) is not None:
        raise MissingExtra(f"ns-3 {reason}")
    import_module("ns")
    cppyy = import_module("cppyy")
    with suppress(AttributeError):
        return cppyy.gbl.automcm
    if not cppyy.cppdef(Path(__file__).with_name("ns3_channel.hpp").read_text()):
        raise RuntimeError("ns3_channel.hpp does not compile with this version of ns-3")
    return cppyy.gbl.automcm


class Ns3Radio:
    """The stations of one channel in ns-3.

    ns-3 has one simulator in a process, so there is one ``Ns3Radio`` at a time; ``close`` ends it.
    Raises MissingExtra without ns-3, and RuntimeError while another one is open.
    """

    _open = False

    def __init__(self, seed: int) -> None:
        if Ns3Radio._open:
            raise RuntimeError("ns-3 has one simulator in a process: close the other Ns3Radio")
        made = _compiled()
        Ns3Radio._open = True
        self.propagation = Propagation(seed)
        self._sequence = Sequence()
        self._offsets = np.random.default_rng((seed, 2))
        self._offset_ns: list[int] = []
        """Of each slot, within a millisecond: stations do not share a clock that exactly."""
        setting = made.Setting()
        setting.tx_power_dbm, setting.noise_figure_db = TX_DBM, NOISE_FIGURE_DB
        setting.busy_dbm, setting.near_m, setting.far_m = BUSY_DBM, NEAR_M, FAR_M
        setting.m_near, setting.m_middle, setting.m_far = FADING_M
        setting.cw_min, setting.cw_max, setting.aifsn = CW_MIN, CW_MAX, AIFSN
        setting.preamble_us, setting.symbol_us = PREAMBLE_US, SYMBOL_US
        setting.bits_per_symbol, setting.extra_bits = SYMBOL_BITS, EXTRA_BITS
        setting.seed, setting.mode = seed % SEEDS or SEEDS - 1, MODE
        self._channel = made.Channel80211p(setting)

    def close(self) -> None:
        """End ns-3's simulation."""
        if Ns3Radio._open:
            self._channel.Destroy()
            Ns3Radio._open = False

    def move(self, positions: Mapping[int, tuple[float, float]]) -> None:
        """As ``Radio.move``."""
        self.propagation.move(positions)
        size = len(self.propagation)
        while len(self._offset_ns) < size:
            self._offset_ns.append(int(self._offsets.integers(NS)))
        if size:
            losses = np.minimum(TX_DBM - self.propagation.mean_dbm, -NOWHERE_DBM)
            self._channel.Place(size, self.propagation.places.ravel(), losses.ravel())

    def transmit(self, sender: int, size_bytes: int, now_ms: int, frame: int) -> None:
        """As ``Radio.transmit``."""
        slot = self._sequence.sent(self.propagation.slots, sender, size_bytes, now_ms)
        below = size_bytes + HEADER_BYTES - LLC_MAC_BYTES
        self._channel.Send(slot, below, now_ms * NS + self._offset_ns[slot], frame)

    def advance(self, until_ms: int) -> list[Arrival]:
        """As ``Radio.advance``."""
        self._sequence.advanced(until_ms)
        self._channel.Run(until_ms * NS)
        arrived = np.zeros((self._channel.Arrivals(), 3), dtype=np.int64)
        if len(arrived):
            self._channel.Copy(arrived.ravel())
        ids = self.propagation.ids
        found: dict[tuple[int, int], list[int]] = {}
        for at, frame, slot in arrived.tolist():
            if (station := ids[slot]) is not None:
                found.setdefault((-(-at // NS), frame), []).append(station)
        return [Arrival(*key, sorted(found[key])) for key in sorted(found)]

    def channel_busy_ratio(self, station: int) -> float:
        """As ``Radio.channel_busy_ratio``, from the powers that arrive at the antenna."""
        slot = self._sequence.known(self.propagation.slots, station)
        return float(self._channel.BusyRatio(slot))
