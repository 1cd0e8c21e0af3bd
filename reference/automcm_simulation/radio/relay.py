"""A lossy radio between real sockets.

It forwards each datagram to all other stations, with seeded loss, duplication, delay and
reordering.  It identifies a station by its source address, from its first datagram on (an empty one
only registers it) until it has been silent for ``SILENCE_MS``.
"""

from __future__ import annotations

import asyncio
import contextlib
import itertools

from automcm.links.clock import AsyncioClock
from automcm.links.simulated_radio import Channel, Radio, SimulatedLink
from automcm.links.udp_link import LARGEST, Address, bind
from automcm_spec.vocabulary.messages import BROADCAST

STATIONS = 64
IN_FLIGHT = 10_000
SILENCE_MS = 10_000


class Relay:
    """A relay in the running event loop.  Raises LinkError if the port is in use."""

    def __init__(
        self,
        host: str = "127.0.0.1",
        port: int = 0,
        *,
        channel: Channel | None = None,
        seed: int = 0,
        allow_remote: bool = False,
    ) -> None:
        self._socket = bind(host, port, allow_remote=allow_remote)
        self.address: Address = self._socket.getsockname()
        self._clock = AsyncioClock()
        self.radio = Radio(self._clock, channel, seed, capacity=IN_FLIGHT)
        self._stations: dict[Address, tuple[int, SimulatedLink]] = {}
        self._received_ms: dict[Address, int] = {}
        self._number = itertools.count(1)
        asyncio.get_running_loop().add_reader(self._socket, self._readable)

    def close(self) -> None:
        """Stop forwarding."""
        asyncio.get_running_loop().remove_reader(self._socket)
        self._socket.close()

    def _readable(self) -> None:
        try:
            data, where = self._socket.recvfrom(LARGEST)
        except OSError:
            return
        now = self._clock.now()
        if where not in self._stations and not self._register(where, now):
            return
        self._received_ms[where] = now
        if data:
            self._stations[where][1].send(data, BROADCAST, "")

    def _register(self, where: Address, now: int) -> bool:
        """Register a new station, unless there are too many active ones."""
        for silent in [a for a, t in self._received_ms.items() if now - t > SILENCE_MS]:
            self._stations.pop(silent)[1].close()
            del self._received_ms[silent]
        if len(self._stations) >= STATIONS:
            return False
        number = next(self._number)
        link = self.radio.link(number)

        def pass_on(data: bytes, tx: str | None) -> None:
            with contextlib.suppress(OSError):
                self._socket.sendto(data, where)

        link.open(pass_on)
        self._stations[where] = number, link
        return True
