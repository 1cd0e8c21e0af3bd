"""The interface of a radio channel between moving stations, in virtual time.

``table_radio.TableRadio`` draws from a table fitted to ns-3 and needs only numpy;
``ns3_radio.Ns3Radio`` runs ns-3's 802.11p in step with the simulation (automcm[radio]).
docs/radio.md has the parameters and the fit.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple, Protocol

LARGEST_BYTES = 2304 - 52
"""The largest message: a frame of IEEE 802.11 holds 2304 bytes with LLC (8), GeoNetworking (40)
and BTP (4)."""


class Arrival(NamedTuple):
    """A frame that arrived.  The order is that of ``RadioModel.advance``."""

    at_ms: int
    frame: int
    receivers: list[int]
    """Those that it reached at this time, by id."""


class RadioModel(Protocol):
    """A broadcast channel.  A station is known by its id, from ``move`` on.

    Time never goes back: ``now_ms`` and ``until_ms`` are at least the last ``until_ms``.
    Two runs with the same seed and the same calls give the same arrivals.
    """

    def move(self, positions: Mapping[int, tuple[float, float]]) -> None:
        """Place all stations, in m, from the time of the last ``advance`` on.

        A station that is missing leaves the channel: it neither sends nor receives.
        Raises ValueError for a position that is not finite.
        """

    def transmit(self, sender: int, size_bytes: int, now_ms: int, frame: int) -> None:
        """Hand a frame to the sender's radio, which broadcasts it when the channel is free.

        ``size_bytes`` is that of the encoded message; the radio adds the headers below it.
        ``frame`` is the caller's number for it.  Raises ValueError for a sender that has no
        position, a size that no frame holds, and a time before the last ``advance``.
        """

    def advance(self, until_ms: int) -> list[Arrival]:
        """The arrivals up to and including this time that were not returned before, sorted.

        A frame arrives at least 1 ms after it was handed over.
        Raises ValueError for a time before the last one.
        """

    def channel_busy_ratio(self, station: int) -> float:
        """The share of the last second in which this station sensed a busy channel, 0 to 1.

        Raises ValueError for a station that has no position.
        """


class Sequence:
    """Checks the calls of a ``RadioModel`` against its rules; each raises ValueError."""

    def __init__(self) -> None:
        self.now_ms = 0

    def known(self, slots: Mapping[int, int], station: int) -> int:
        """The slot of a station."""
        if station not in slots:
            raise ValueError(f"station {station} has no position: call move first")
        return slots[station]

    def sent(self, slots: Mapping[int, int], sender: int, size_bytes: int, now_ms: int) -> int:
        """The slot of a sender, whose frame is valid."""
        if not 0 < size_bytes <= LARGEST_BYTES:
            raise ValueError(f"size_bytes must be from 1 to {LARGEST_BYTES}, not {size_bytes}")
        if now_ms < self.now_ms:
            raise ValueError(f"now_ms must be at least {self.now_ms}, not {now_ms}")
        return self.known(slots, sender)

    def advanced(self, until_ms: int) -> None:
        """The time advances."""
        if until_ms < self.now_ms:
            raise ValueError(f"until_ms must be at least {self.now_ms}, not {until_ms}")
        self.now_ms = until_ms
