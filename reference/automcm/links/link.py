"""The interface of a link, which carries encoded messages from one service to others."""

from __future__ import annotations

import ipaddress
from collections.abc import Callable
from typing import Protocol

Receiver = Callable[[bytes, str | None], int | None]
"""A link calls it with each datagram, and with its transmission id if known.

The result is the sender of the message, or None for an invalid message."""


class LinkError(Exception):
    """A link cannot be opened; the text names the address or the port."""


def is_loopback(host: str) -> bool:
    """Whether only this host can reach ``host``; of names, this is known of localhost alone."""
    try:
        return host == "localhost" or ipaddress.ip_address(host).is_loopback
    except ValueError:
        return False


class Link(Protocol):
    """A lossy link: a message may be lost, repeated, delayed or overtaken."""

    def open(self, receive: Receiver) -> None:
        """Begin to receive."""

    def send(self, data: bytes, to: int, tx: str) -> None:
        """Send to one station, or to all (``BROADCAST``).  ``tx`` names the transmission."""

    def close(self) -> None:
        """Stop receiving and sending."""
