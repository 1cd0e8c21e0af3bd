"""The reference behind the adapter protocol on a WebSocket, with one station for each connection.

Each line is a text message (docs/adapter.md).

Needs the extra ``automcm[ws]``; importing this without it raises LinkError.
"""

from __future__ import annotations

import logging
from contextlib import suppress

from automcm.adapters.adapter_lines import Kit, answered
from automcm.links.link import LinkError
from automcm.links.udp_link import address, local_only

try:
    from websockets.asyncio.server import Server, ServerConnection
    from websockets.asyncio.server import serve as listening
    from websockets.exceptions import ConnectionClosed
except ModuleNotFoundError:  # pragma: no cover - as in rosbridge.py
    raise LinkError("adapter --websocket needs websockets: pip install 'automcm[ws]'") from None

MAX_IN = 2**20
"""Maximum bytes of a line."""
CLOSE_S = 1
WRONG_KIND = 1003
_SILENT_LOGGER = logging.getLogger("automcm.adapters.adapter_server.websockets")
_SILENT_LOGGER.setLevel(logging.CRITICAL)


async def serve(where: str, *, allow_remote: bool = False) -> Server:
    """Listen on ``HOST:PORT`` (0: any port); ``async with`` ends it.

    Raises LinkError for a bad address, for one that other hosts can reach unless ``allow_remote``,
    and for a port in use.
    """
    host, port = address(where)
    local_only(host, allow_remote)
    try:
        return await listening(
            _station,
            host,
            port,
            compression=None,
            max_size=MAX_IN,
            close_timeout=CLOSE_S,
            ping_interval=None,
            logger=_SILENT_LOGGER,
        )
    except OSError as error:
        raise LinkError(f"cannot listen on ws://{where}: {error.strerror or error}") from None


async def _station(connection: ServerConnection) -> None:
    """Answer each line until ``stop`` or the end of the connection."""
    kit = Kit()
    with suppress(ConnectionClosed):
        async for line in connection:
            if not isinstance(line, str):
                await connection.close(WRONG_KIND, "each line must be a text message")
                return
            answer = answered(kit, line)
            if answer is None:
                return
            await connection.send(answer, text=True)
