"""What a link is: it carries encoded messages from one service to others."""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

Receiver = Callable[[bytes, str | None], int | None]
"""What a link calls with each datagram, and with its transmission id if it knows it.  The
result is the station that the message in it is from, or None if it is no message."""


class LinkError(Exception):
    """A link that cannot be opened; the text names the address or the port."""


class Link(Protocol):
    """A lossy link: what is sent may be lost, repeated, delayed or overtaken."""

    def open(self, receive: Receiver) -> None:
        """Begin to receive."""

    def send(self, data: bytes, to: int, tx: str) -> None:
        """Send to one station, or to all (``BROADCAST``).  ``tx`` names the transmission."""

    def close(self) -> None:
        """Receive and send nothing more."""
