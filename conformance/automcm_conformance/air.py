"""UDP as a live station's radio: each message is a datagram of JSON (docs/messages.md)."""

from __future__ import annotations

import select
from socket import socket
from time import monotonic

LARGEST = 65_535
START_MS = 1_000
"""Where the clock begins, so that something may have been before."""


class UdpAir:
    """``own`` is the socket to send from, where stations answer; ``shared`` is where all listen,
    and ``everyone`` its address.  Both are bound, and closed by whoever made them."""

    def __init__(self, own: socket, shared: socket, everyone: tuple[str, int]) -> None:
        self._own, self._sockets, self._everyone = own, (own, shared), everyone
        self._name = own.getsockname()
        self._zero = monotonic()

    def now(self) -> int:
        """ms of the host's monotonic clock."""
        return int((monotonic() - self._zero) * 1000) + START_MS

    def send(self, data: bytes) -> None:
        """Send to all.  Raises OSError if there is no way there."""
        self._own.sendto(data, self._everyone)

    def receive(self, until: int) -> tuple[int, bytes] | None:
        """What somebody else sends, and when it came; None if nothing comes by then."""
        while True:
            left = max(0, until - self.now()) / 1000
            ready, _, _ = select.select(self._sockets, (), (), left)
            for sock in ready:
                data, where = sock.recvfrom(LARGEST)
                if where != self._name:
                    return self.now(), data
            if not ready and self.now() >= until:
                return None
