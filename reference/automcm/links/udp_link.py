"""Datagrams on loopback or a LAN, each with one encoded message.

A station has two sockets.  All stations on the host share a socket on the broadcast address.  Each
sends from its own socket, and receives there the messages addressed to it.  It learns the address
of another station from that station's messages.  A message is broadcast if the address is unknown,
if messages of one station_id came from two addresses, or if the link uses a relay; receivers then
filter by MSG-1.  There is no authentication, as on any open radio.
"""

from __future__ import annotations

import asyncio
import ipaddress
import socket
from collections import OrderedDict
from collections.abc import Callable

from automcm.links.link import LinkError, Receiver, is_loopback
from automcm_spec.vocabulary.messages import BROADCAST

Address = tuple[str, int]

PORT = 47_100
BROADCAST_HOST = "127.255.255.255"
ADDRESSES = 1024
"""Maximum number of stations whose addresses are remembered."""
LARGEST = 65_535


def address(text: str) -> Address:
    """Parse ``HOST:PORT``.  Raises LinkError for a bad address."""
    host, _, port = text.rpartition(":")
    if not host or not port.isdecimal() or not 0 <= int(port) <= 65_535:
        raise LinkError(f"expected an address HOST:PORT such as 127.0.0.1:{PORT}, not {text!r}")
    return ip(host), int(port)


def ip(host: str) -> str:
    """An IPv4 address, or localhost.  Raises LinkError for anything else."""
    try:
        return str(ipaddress.IPv4Address("127.0.0.1" if host == "localhost" else host))
    except ValueError:
        raise LinkError(f"expected an IPv4 address or localhost, not {host!r}") from None


def bind(
    host: str, port: int, *, shared: bool = False, allow_remote: bool = False
) -> socket.socket:
    """A datagram socket.

    Raises LinkError for a port in use, or, unless ``allow_remote``, for an address that other hosts
    can reach.
    """
    local_only(host := ip(host), allow_remote)
    sock = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    sock.setblocking(False)
    try:
        sock.setsockopt(socket.SOL_SOCKET, socket.SO_BROADCAST, 1)
        if shared:
            sock.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        sock.bind((host, port))
    except (OSError, OverflowError) as error:
        sock.close()
        raise LinkError(f"UDP {host}:{port}: {getattr(error, 'strerror', error)}") from None
    return sock


def local_only(host: str, allow_remote: bool) -> None:
    """Raises LinkError for an address beyond loopback, unless ``allow_remote``."""
    if not (allow_remote or is_loopback(host)):
        raise LinkError(f"{host} is not a loopback address; --allow-remote permits it")


class UdpLink:
    """A station's sockets, read by the running event loop.

    ``broadcast`` is the address on which all stations listen.  With ``via``, everything goes to the
    relay at that address instead.  ``host`` is the address of the interface to send from.

    Raises LinkError for a ``host`` that cannot reach the others: any interface (0.0.0.0), or
    loopback if the others are on another host.
    """

    def __init__(
        self,
        *,
        host: str = "127.0.0.1",
        broadcast: Address = (BROADCAST_HOST, PORT),
        via: Address | None = None,
        allow_remote: bool = False,
    ) -> None:
        self.unsent = 0
        """Number of datagrams that the system refused to send; they count as lost."""
        self.unread: Callable[[bytes], None] = lambda data: None
        """Called with each datagram in which the receiver found no message."""
        self._all = via or broadcast
        self._via = via
        self._addresses: OrderedDict[int, Address | None] = OrderedDict()
        """None: messages of this station came from two addresses."""
        self._receive: Receiver = lambda data, tx: None
        local_only(self._all[0], allow_remote)
        here, there = ipaddress.IPv4Address(ip(host)), ipaddress.IPv4Address(self._all[0])
        if here.is_unspecified or here.is_loopback != there.is_loopback:
            raise LinkError(
                f"--host {here} cannot reach {there}; give this host's address in that network"
            )
        self._own = bind(host, 0, allow_remote=allow_remote)
        self.address: Address = self._own.getsockname()
        self._sockets = [self._own]
        if via is None:
            try:
                self._sockets.append(bind(*broadcast, shared=True, allow_remote=allow_remote))
            except LinkError:
                self._own.close()
                raise

    def open(self, receive: Receiver) -> None:
        """As ``Link.open``."""
        self._receive = receive
        loop = asyncio.get_running_loop()
        for sock in self._sockets:
            loop.add_reader(sock, self._readable, sock)
        if self._via is not None:
            self._put(b"", self._via)  # registers this station with the relay

    def send(self, data: bytes, to: int, tx: str) -> None:
        """As ``Link.send``."""
        known = self._addresses.get(to) if to != BROADCAST and self._via is None else None
        self._put(data, known or self._all)

    def close(self) -> None:
        """As ``Link.close``."""
        loop = asyncio.get_running_loop()
        for sock in self._sockets:
            loop.remove_reader(sock)
            sock.close()
        self._sockets = []

    def _put(self, data: bytes, where: Address) -> None:
        try:
            self._own.sendto(data, where)
        except OSError:
            self.unsent += 1

    def _readable(self, sock: socket.socket) -> None:
        """Read one datagram at a time, so that timers still run under a flood."""
        try:
            data, where = sock.recvfrom(LARGEST)
        except OSError:
            return
        if where == self.address:
            return  # own broadcast
        src = self._receive(data, None)
        if src is None:
            self.unread(data)
        else:
            known = self._addresses.get(src, where)
            self._addresses[src] = where if known == where else None
            self._addresses.move_to_end(src)
            if len(self._addresses) > ADDRESSES:
                self._addresses.popitem(last=False)
