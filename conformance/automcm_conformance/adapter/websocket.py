"""An adapter that cannot be spawned: each line of the protocol is a text message of a WebSocket.

The same as process.py otherwise: lines in, as many out, and an end to it in any case.  Needs the
extra ``automcm[ws]``, and looks for it only when an address is connected to.
"""

from __future__ import annotations

import logging
import socket
from collections.abc import Sequence
from contextlib import ExitStack, suppress
from typing import TYPE_CHECKING, Any, NoReturn

from automcm_conformance.adapter.process import LIMIT_S, STOP, TOGETHER, AdapterError, Kind

if TYPE_CHECKING:
    from websockets.exceptions import ConnectionClosed
    from websockets.sync.client import ClientConnection

SCHEMES = ("ws://", "wss://")
AHEAD = 64
"""Lines that are written before the first of them is answered, at most."""
AHEAD_BYTES = 1 << 16
"""The same in bytes; the system keeps more, so that writing never waits for the other end."""
_KEPT = 4 * AHEAD_BYTES
_CLOSE_S = 1.0
"""How long the other end may take to agree to a close that it did not expect."""
_TOO_BIG = 1009
_NO_FORM = (1002, 1007)
"""What we close with if its frames or its UTF-8 are wrong."""
_GOOD = (1000, 1001, 1005)
"""Codes of a close that is no complaint."""

_QUIET = logging.getLogger("automcm.conform.websockets")
_QUIET.setLevel(logging.CRITICAL + 1)
"""What goes wrong is in the AdapterError."""


class WebSocket:
    """A connection to an adapter that is running already.  ``with`` ends it; so does ``kill``.

    ``limit_s`` is the real time in seconds that connecting, or an answer, may take, ``max_line``
    how many bytes an answer may have.  Raises AdapterError (start) if it cannot be connected to.
    """

    def __init__(self, address: str, *, limit_s: float = LIMIT_S, max_line: int = 1 << 20) -> None:
        self.limit_s = limit_s
        self.max_line = max_line
        self.stderr: list[str] = []
        """Nothing: it is not a child of ours."""
        self._lines: Sequence[bytes] = ()
        self._open = False
        self._closing = ExitStack()
        self._socket = self._connected(address)
        self._open = True

    def __enter__(self) -> WebSocket:
        return self

    def __exit__(self, *exc: object) -> None:
        self.kill()

    def exchange(self, lines: Sequence[bytes]) -> list[bytes]:
        """Send these lines, each with its line feed, which is left out; the same number of answers.

        Lines are sent before earlier ones are answered.  Raises AdapterError, which holds the
        answers that came, and ends the connection.
        """
        from websockets.exceptions import ConnectionClosed

        answers: list[bytes] = []
        if not self._open:
            raise AdapterError("closed", "the connection was ended before")
        sent = ahead = size = 0
        try:
            self._quiet("it sent a message that nobody asked for", answers)
            while len(answers) < len(lines):
                while sent < len(lines) and (
                    sent == len(answers)
                    or (sent - len(answers) < AHEAD and ahead + len(lines[sent]) <= AHEAD_BYTES)
                ):
                    with suppress(ConnectionClosed):  # first what it has answered is read
                        self._socket.send(lines[sent].rstrip(b"\n"), text=True)
                    ahead += len(lines[sent])
                    sent += 1
                ahead -= len(lines[len(answers)])
                answers.append(self._read(answers, len(lines)))
                size += len(answers[-1])
                if size > TOGETHER * self.max_line:
                    self._fail("output", f"{len(answers)} answers have {size} bytes", answers)
            self._quiet("it answered more than it was asked", answers)
        except ConnectionClosed as error:
            if len(answers) == len(lines):
                return answers  # the next exchange finds it closed
            self._fail_closed(error, answers, len(lines))
        return answers

    def send(self, lines: Sequence[bytes]) -> None:
        """Keep the lines for ``answers``: nothing is written ahead of that."""
        self._lines = lines

    def pump(self) -> None:
        """Nothing: ``answers`` does it all."""

    def answers(self) -> list[bytes]:
        """As ``exchange``, with the lines of ``send``."""
        return self.exchange(self._lines)

    def stop(self, line: bytes = STOP) -> str | None:
        """Tell it to stop, wait until it closes, and end the connection.

        An empty ``line`` only closes.  Returns a sentence on what was wrong, or None.
        """
        from websockets.exceptions import ConnectionClosed

        if not self._open or not line:
            self.kill()
            return None
        try:
            self._quiet("", [])
            self._socket.send(line.rstrip(b"\n"), text=True)
            self._socket.recv(timeout=self.limit_s)
        except TimeoutError:
            return f"it did not close the connection within {self.limit_s:g} s of stop"
        except AdapterError:
            pass
        except ConnectionClosed as error:
            code = error.rcvd.code if error.rcvd else 0
            return None if code in _GOOD else f"it ended the connection badly: {error}"
        finally:
            self.kill()
        return "it sent a message that nobody asked for"

    def kill(self) -> None:
        """Close the connection, in a second at most.  May be called again."""
        if self._open:
            self._open = False
            with suppress(OSError):
                self._closing.close()

    def _connected(self, address: str) -> ClientConnection:
        try:
            from websockets.exceptions import WebSocketException
            from websockets.sync.client import connect
        except ModuleNotFoundError:
            text = f"{address} needs websockets: pip install 'automcm[ws]'"
            raise AdapterError("start", text) from None
        try:
            connection = self._closing.enter_context(
                connect(
                    address,
                    open_timeout=self.limit_s,
                    close_timeout=min(self.limit_s, _CLOSE_S),
                    compression=None,
                    max_size=self.max_line,
                    max_queue=2 * AHEAD,
                    ping_interval=None,
                    proxy=None,
                    logger=_QUIET,
                )
            )
        except TimeoutError:
            text = f"{address} cannot be connected to: no answer within {self.limit_s:g} s"
            raise AdapterError("start", text) from None
        except (OSError, EOFError, ValueError, WebSocketException) as error:
            why = getattr(error, "strerror", None) or error
            raise AdapterError("start", f"{address} cannot be connected to: {why}") from None
        with suppress(OSError):  # it is closed already
            connection.socket.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, _KEPT)
            connection.socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        return connection

    def _read(self, answers: list[bytes], asked: int) -> bytes:
        """The next answer.  Raises AdapterError, and ConnectionClosed."""
        try:
            message: Any = self._socket.recv(timeout=self.limit_s)
        except TimeoutError:
            place = f"after {len(answers)} of {asked} answers"
            self._fail("hang", f"no answer within {self.limit_s:g} s {place}", answers)
        if not isinstance(message, str):
            self._fail("line", "it sent a binary message; each line is a text message", answers)
        return message.encode().rstrip(b"\r\n")

    def _quiet(self, text: str, answers: list[bytes]) -> None:
        """Nothing may have come.  Raises AdapterError with this text, and ConnectionClosed."""
        with suppress(TimeoutError):
            self._socket.recv(timeout=0)
            self._fail("output", text, answers)

    def _fail_closed(self, error: ConnectionClosed, answers: list[bytes], asked: int) -> NoReturn:
        ours = error.sent.code if error.sent and not error.rcvd_then_sent else 0
        if ours == _TOO_BIG:
            self._fail("line", f"a message has more than {self.max_line} bytes", answers)
        place = f"after {len(answers)} of {asked} answers"
        if ours in _NO_FORM:
            self._fail("line", f"what it sent is no text message of a WebSocket, {place}", answers)
        self._fail("closed", f"it closed the connection {place}: {error}", answers)

    def _fail(self, kind: Kind, text: str, answers: list[bytes]) -> NoReturn:
        self.kill()
        raise AdapterError(kind, text, answers=answers)
