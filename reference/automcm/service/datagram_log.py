"""A log sent as datagrams, for ``automcm trace watch udp:HOST:PORT``."""

from __future__ import annotations

from typing import NamedTuple

from automcm.links.udp_link import Address, bind, local_only
from automcm_spec.log_format.writer import Sink


class DatagramLog:
    """Sends each line of a log as one datagram.

    ``write`` never waits and never raises. A line that is lost is missing at the receiver, where
    ``seq`` shows it. Raises LinkError for an address that other hosts can reach, unless
    ``allow_remote``.
    """

    def __init__(self, to: Address, *, allow_remote: bool = False) -> None:
        local_only(to[0], allow_remote)
        self.unsent = 0
        """Lines that the system refused to send."""
        self._to = to
        self._socket = bind("0.0.0.0" if allow_remote else "127.0.0.1", 0, allow_remote=True)

    def write(self, line: bytes, /) -> None:
        """Send one line."""
        try:
            self._socket.sendto(line, self._to)
        except OSError:
            self.unsent += 1

    def flush(self) -> None:
        """Does nothing: a datagram is sent at once."""

    def close(self) -> None:
        """Close the socket."""
        self._socket.close()


class Both(NamedTuple):
    """A sink that passes each line to two others."""

    first: Sink
    second: Sink

    def write(self, line: bytes, /) -> None:
        """Pass the line on."""
        self.first.write(line)
        self.second.write(line)

    def flush(self) -> None:
        """Write out the lines of both."""
        self.first.flush()
        self.second.flush()
