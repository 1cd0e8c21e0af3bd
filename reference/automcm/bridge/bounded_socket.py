"""Connections of the bridge whose peer can neither block the loop nor fill the memory.

Needs the extra ``automcm[ws]``; importing this without it raises LinkError.
"""

from __future__ import annotations

import asyncio
import socket
from collections import deque
from typing import Any

from automcm.bridge import rosbridge as ros
from automcm.links.link import LinkError

try:
    from websockets.asyncio.connection import Connection
    from websockets.asyncio.server import ServerConnection
    from websockets.exceptions import ConnectionClosed
except ModuleNotFoundError as error:  # pragma: no cover - a test runs this in a process of its own
    if (error.name or "").split(".")[0] != "websockets":
        raise
    raise LinkError("the WebSocket bridge needs websockets: pip install 'automcm[ws]'") from None

MAX_HALF_OPEN = 56
"""Maximum number of connections before the end of their WebSocket handshake."""
MAX_OF_ADDRESS = 8
"""Maximum number of them from one address."""
CHUNK = 2**12
"""Bytes read from a socket at a time."""
KERNEL = 2**16
"""Size of the system's send buffer for one client, in bytes."""
PONGS = 2**16
"""Maximum bytes of answers to pings that wait for one client."""


class BoundedSocket(ServerConnection):
    """A connection whose peer can neither block the loop with one read nor fill the memory.

    ``half_open``: the connections of the server before the end of their handshake, the oldest
    first, with their addresses.  Whoever cannot finish it, for want of the token for example,
    displaces the oldest connection of the own address, so that nobody else is locked out.
    """

    def __init__(self, *args: Any, half_open: dict[BoundedSocket, str], **more: Any) -> None:
        super().__init__(*args, **more)
        self._half_open = half_open

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Bound the buffers; drop the oldest connection if there are too many."""
        if hasattr(transport, "max_size"):  # asyncio reads 256 KiB at a time: 40,000 pings
            transport.max_size = CHUNK
        super().connection_made(transport)
        plain: socket.socket = transport.get_extra_info("socket")
        plain.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, KERNEL)
        address = transport.get_extra_info("peername")[0]
        self._half_open[self] = address
        same = [each for each, of in self._half_open.items() if of == address]
        if len(same) > MAX_OF_ADDRESS or len(self._half_open) > MAX_HALF_OPEN:
            oldest = (same if len(same) > MAX_OF_ADDRESS else [*self._half_open])[0]
            oldest.finished()
            oldest.transport.abort()

    def finished(self) -> None:
        """The handshake is over."""
        self._half_open.pop(self, None)

    def connection_lost(self, exc: Exception | None) -> None:
        """No longer half-open either."""
        self.finished()
        super().connection_lost(exc)

    def data_received(self, data: bytes) -> None:
        """Drop the connection if it does not read the answers to its pings."""
        super().data_received(data)
        if self.transport.get_write_buffer_size() > ros.MAX_OUT + PONGS:
            self.transport.abort()


class Outbox:
    """The queue of messages for a socket.  A peer that does not read is disconnected."""

    def __init__(self, socket: Connection, messages: int, size: int) -> None:
        self._socket, self._messages, self._size = socket, messages, size
        self._texts: deque[str] = deque()
        self._bytes = 0
        self._wake = asyncio.Event()
        self._cut = False

    def put(self, text: str) -> None:
        """Append a message; disconnect if the queue is full."""
        if self._cut:
            return
        self._texts.append(text)
        self._bytes += len(text)
        if len(self._texts) > self._messages or self._bytes > self._size:
            self._cut = True
            self._texts.clear()
            self._socket.transport.abort()
        self._wake.set()

    async def send(self) -> None:
        """Send the queue until the connection ends or the task is cancelled."""
        try:
            while not self._cut:
                await self._wake.wait()
                self._wake.clear()
                while self._texts:
                    text = self._texts.popleft()
                    self._bytes -= len(text)
                    await self._socket.send(text)
        except ConnectionClosed:
            self._cut = True
            self._texts.clear()
