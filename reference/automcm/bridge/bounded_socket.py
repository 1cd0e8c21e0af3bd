"""Connections of the bridge whose peer can neither block the loop nor fill the memory.

Needs the extra ``automcm[ws]``; importing this without it raises LinkError.
"""

from __future__ import annotations

import asyncio
import socket
from collections import deque

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

MAX_SOCKETS = 64
"""Maximum number of connections, including those before their WebSocket handshake."""
CHUNK = 2**12
"""Bytes read from a socket at a time."""
KERNEL = 2**16
"""Size of the system's send buffer for one client, in bytes."""
PONGS = 2**16
"""Maximum bytes of answers to pings that wait for one client."""


class BoundedSocket(ServerConnection):
    """A connection whose peer can neither block the loop with one read nor fill the memory."""

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Bound the buffers; drop the connection if there are too many."""
        if hasattr(transport, "max_size"):  # asyncio reads 256 KiB at a time: 40,000 pings
            transport.max_size = CHUNK
        super().connection_made(transport)
        plain: socket.socket = transport.get_extra_info("socket")
        plain.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, KERNEL)
        if len(self.server.handler_tasks) > MAX_SOCKETS:
            self.transport.abort()

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
