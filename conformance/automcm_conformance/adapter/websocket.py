"""An adapter behind a WebSocket: each line of the protocol is one text message.

Otherwise as process.py: one answer for each line, and a connection that always ends.  Needs the
extra ``automcm[ws]``, which is imported when a connection is made.
"""

from __future__ import annotations

import logging
import socket
from collections.abc import Sequence
from contextlib import ExitStack, suppress
from typing import TYPE_CHECKING, Any, NoReturn

from automcm_conformance.adapter.process import (
    LIMIT_S,
    STOP,
    TOO_MANY,
    TOTAL_FACTOR,
    AdapterError,
    Kind,
)

if TYPE_CHECKING:
    from websockets.exceptions import ConnectionClosed
    from websockets.sync.client import ClientConnection

SCHEMES = ("ws://", "wss://")
_UNREQUESTED = "the adapter sent a message that answers no command"
AHEAD = 64
"""At most this many lines are written before the first of them is answered."""
AHEAD_BYTES = 1 << 16
"""The same in bytes.  The send buffer is larger, so that writing never blocks."""
_SEND_BUFFER = 4 * AHEAD_BYTES
_CLOSE_S = 1.0
"""How long the other end may take to answer a close in seconds."""
_TOO_BIG = 1009
_INVALID = (1002, 1007)
"""Close codes that we send after an invalid frame or invalid UTF-8."""
_NORMAL = (1000, 1001, 1005)
"""Close codes that report no error."""

_SILENT = logging.getLogger("automcm.conform.websockets")
_SILENT.setLevel(logging.CRITICAL + 1)
"""Logs nothing, because the AdapterError reports each error."""


class WebSocket:
    """A connection to a running adapter.  ``with`` ends it; so does ``kill``.

    ``limit_s`` is the real time in seconds that the connection or an answer may take, ``max_line``
    the maximum length of an answer in bytes.  Raises AdapterError (start) if it cannot connect.
    """

    def __init__(self, address: str, *, limit_s: float = LIMIT_S, max_line: int = 1 << 20) -> None:
        self.limit_s = limit_s
        self.max_line = max_line
        self.stderr: list[str] = []
        """Always empty: the adapter is not a child process."""
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
        """Send the lines without their line feeds; returns as many answers.

        Lines are sent before earlier ones are answered.  Raises AdapterError, which has the
        answers so far, and ends the connection.
        """
        from websockets.exceptions import ConnectionClosed

        answers: list[bytes] = []
        if not self._open:
            raise AdapterError("closed", "the connection has already ended")
        sent = ahead = size = 0
        try:
            self._expect_none(_UNREQUESTED, answers)
            while len(answers) < len(lines):
                while sent < len(lines) and (
                    sent == len(answers)
                    or (sent - len(answers) < AHEAD and ahead + len(lines[sent]) <= AHEAD_BYTES)
                ):
                    with suppress(ConnectionClosed):  # the answers so far are read first
                        self._socket.send(lines[sent].rstrip(b"\n"), text=True)
                    ahead += len(lines[sent])
                    sent += 1
                ahead -= len(lines[len(answers)])
                answers.append(self._read(answers, len(lines)))
                size += len(answers[-1])
                if size > TOTAL_FACTOR * self.max_line:
                    text = f"{len(answers)} answers have {size} bytes"
                    self._fail(
                        "output", f"{text}; allowed: {TOTAL_FACTOR * self.max_line}", answers
                    )
            self._expect_none(TOO_MANY, answers)
        except ConnectionClosed as error:
            if len(answers) == len(lines):
                return answers  # the next exchange reports the close
            self._fail_closed(error, answers, len(lines))
        return answers

    def send(self, lines: Sequence[bytes]) -> None:
        """Keep the lines; ``answers`` sends them."""
        self._lines = lines

    def pump(self) -> None:
        """Does nothing: ``answers`` writes and reads."""

    def answers(self) -> list[bytes]:
        """Exchange the lines of ``send``.  Raises AdapterError."""
        return self.exchange(self._lines)

    def stop(self, line: bytes = STOP) -> str | None:
        """Send stop, wait for the adapter to close the connection, and end it.

        An empty ``line`` only closes.  Returns a sentence that describes a problem, or None.
        """
        from websockets.exceptions import ConnectionClosed

        if not self._open or not line:
            self.kill()
            return None
        try:
            self._expect_none("", [])
            self._socket.send(line.rstrip(b"\n"), text=True)
            self._socket.recv(timeout=self.limit_s)
        except TimeoutError:
            return f"the adapter did not close the connection within {self.limit_s:g} s of stop"
        except AdapterError:
            pass
        except ConnectionClosed as error:
            code = error.rcvd.code if error.rcvd else 0
            return None if code in _NORMAL else f"the adapter closed with an error: {error}"
        finally:
            self.kill()
        return _UNREQUESTED

    def kill(self) -> None:
        """Close the connection, within a second.  May be called again."""
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
                    logger=_SILENT,
                )
            )
        except TimeoutError:
            text = f"cannot connect to {address}: no answer within {self.limit_s:g} s"
            raise AdapterError("start", text) from None
        except (OSError, EOFError, ValueError, WebSocketException) as error:
            why = getattr(error, "strerror", None) or error
            raise AdapterError("start", f"cannot connect to {address}: {why}") from None
        with suppress(OSError):  # it may be closed already
            connection.socket.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, _SEND_BUFFER)
            connection.socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        return connection

    def _read(self, answers: list[bytes], expected: int) -> bytes:
        """The next answer.  Raises AdapterError, and ConnectionClosed."""
        try:
            message: Any = self._socket.recv(timeout=self.limit_s)
        except TimeoutError:
            place = f"after {len(answers)} of {expected} answers"
            self._fail("hang", f"no answer within {self.limit_s:g} s {place}", answers)
        if not isinstance(message, str):
            self._fail("line", "the adapter sent a binary message; expected text", answers)
        return message.encode().rstrip(b"\r\n")

    def _expect_none(self, text: str, answers: list[bytes]) -> None:
        """Raises AdapterError with this text if there is a message, and ConnectionClosed."""
        with suppress(TimeoutError):
            self._socket.recv(timeout=0)
            self._fail("output", text, answers)

    def _fail_closed(
        self, error: ConnectionClosed, answers: list[bytes], expected: int
    ) -> NoReturn:
        ours = error.sent.code if error.sent and not error.rcvd_then_sent else 0
        if ours == _TOO_BIG:
            text = f"the adapter sent a message of more than {self.max_line} bytes"
            self._fail("line", text, answers)
        place = f"after {len(answers)} of {expected} answers"
        if ours in _INVALID:
            self._fail("line", f"the adapter sent an invalid WebSocket message {place}", answers)
        self._fail("closed", f"the adapter closed the connection {place}: {error}", answers)

    def _fail(self, kind: Kind, text: str, answers: list[bytes]) -> NoReturn:
        self.kill()
        raise AdapterError(kind, text, answers=answers)
