"""UDP as the radio of a live station."""

from __future__ import annotations

import select
import time
from socket import socket

LARGEST = 65_535


class UdpAir:
    """UDP as a live station's radio: each message is a datagram of JSON (docs/messages.md).

    ``own`` is the socket that sends and receives the stations' answers.  ``shared`` is the socket
    on the broadcast address ``everyone``.  The caller binds and closes both.
    """

    def __init__(self, own: socket, shared: socket, everyone: tuple[str, int]) -> None:
        self._own, self._sockets, self._everyone = own, (own, shared), everyone
        self._name = own.getsockname()
        self._zero = time.time() - time.monotonic()

    def now(self) -> int:
        """ms of UNIX time, by the host's monotonic clock since the start."""
        return int((time.monotonic() + self._zero) * 1000)

    def send(self, data: bytes) -> None:
        """Send to all stations.  Raises OSError if the network is unreachable."""
        self._own.sendto(data, self._everyone)

    def receive(self, until: int) -> tuple[int, bytes] | None:
        """The next datagram of another sender and its time in ms; None after ``until``."""
        while True:
            left = max(0, until - self.now()) / 1000
            ready, _, _ = select.select(self._sockets, (), (), left)
            for sock in ready:
                data, where = sock.recvfrom(LARGEST)
                if where != self._name:
                    return self.now(), data
            if not ready and self.now() >= until:
                return None
