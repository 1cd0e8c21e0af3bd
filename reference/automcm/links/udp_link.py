"""Datagrams on loopback or a LAN: one encoded message each, nothing around it.

A station has two sockets: one that listens to the broadcast address, shared by all stations on
the host, and one of its own, from which it sends everything and where it gets what is addressed
to it.  Where another station is it learns from what that one sends; until then, once messages of
one station_id came from two addresses, and if the link goes through a relay, everything is
broadcast (MSG-1 sorts it out).  There is no authentication, as on any open radio.
"""

from __future__ import annotations

import asyncio
import ipaddress
import socket
from collections import OrderedDict

from automcm.links.link import LinkError, Receiver
from automcm_spec.vocabulary.messages import BROADCAST

Address = tuple[str, int]

PORT = 47_100
BROADCAST_HOST = "127.255.255.255"
ADDRESSES = 1024
"""How many stations' addresses are remembered."""
LARGEST = 65_535


def address(text: str) -> Address:
    """``HOST:PORT``.  Raises LinkError, naming what is wrong."""
    host, _, port = text.rpartition(":")
    if not host or not port.isdecimal() or not 0 <= int(port) <= 65_535:
        raise LinkError(f"{text}: an address is HOST:PORT, such as 127.0.0.1:{PORT}")
    return ip(host), int(port)


def ip(host: str) -> str:
    """An IPv4 address, or localhost.  Raises LinkError for anything else."""
    try:
        return str(ipaddress.IPv4Address("127.0.0.1" if host == "localhost" else host))
    except ValueError:
        raise LinkError(f"{host}: no IPv4 address") from None


def bind(
    host: str, port: int, *, shared: bool = False, allow_remote: bool = False
) -> socket.socket:
    """A datagram socket.  Raises LinkError for a port in use, or, unless ``allow_remote``, for
    an address that other hosts reach."""
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
    if not allow_remote and not ipaddress.IPv4Address(host).is_loopback:
        raise LinkError(f"{host}: not a loopback address; allow remote addresses to use it")


class UdpLink:
    """A station's sockets, read by the running event loop.

    ``broadcast`` is where all listen; with ``via`` there is no broadcast, and everything goes to
    the relay at that address.  ``host`` is the address of the interface to send from.

    Raises LinkError for a ``host`` that cannot reach the others: any interface (0.0.0.0), or
    loopback when they are elsewhere.
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
        """Datagrams that the system refused to send; to the protocol they are lost."""
        self._all = via or broadcast
        self._via = via
        self._addresses: OrderedDict[int, Address | None] = OrderedDict()
        """None: messages of this station came from two addresses."""
        self._receive: Receiver = lambda data, tx: None
        local_only(self._all[0], allow_remote)
        here, there = ipaddress.IPv4Address(ip(host)), ipaddress.IPv4Address(self._all[0])
        if here.is_unspecified or here.is_loopback != there.is_loopback:
            raise LinkError(f"host: {here} does not reach {there}; name this host's address there")
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
            self._put(b"", self._via)  # tells the relay where we are

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
        """One datagram at a time, so that a flood leaves the loop its timers."""
        try:
            data, where = sock.recvfrom(LARGEST)
        except OSError:
            return
        if where == self.address:
            return  # our own broadcast
        src = self._receive(data, None)
        if src is not None:
            known = self._addresses.get(src, where)
            self._addresses[src] = where if known == where else None
            self._addresses.move_to_end(src)
            if len(self._addresses) > ADDRESSES:
                self._addresses.popitem(last=False)
