"""A way to an adapter, whatever it is: a command to start, or the address of a WebSocket."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol, Self

from automcm_conformance.adapter.process import STOP, AdapterError, Process
from automcm_conformance.adapter.protocol import PROTOCOL, HelloAnswer, read_hello
from automcm_conformance.adapter.websocket import SCHEMES, WebSocket


class Connection(Protocol):
    """What ``Process`` and ``WebSocket`` have in common; ``with`` ends it."""

    def __enter__(self) -> Self: ...

    def __exit__(self, *exc: object) -> None: ...

    def exchange(self, lines: Sequence[bytes]) -> list[bytes]:
        """Send these lines; as many answers.  Raises AdapterError."""

    def send(self, lines: Sequence[bytes]) -> None:
        """Begin an exchange, which ``answers`` ends.  Raises AdapterError."""

    def pump(self) -> None:
        """Go on with it as far as that takes no time."""

    def answers(self) -> list[bytes]:
        """The answers.  Raises AdapterError."""

    def stop(self, line: bytes = STOP) -> str | None:
        """Tell it to stop.  Returns a sentence on what was wrong, or None."""

    def kill(self) -> None:
        """End it at once.  May be called again."""


def hello(process: Connection) -> HelloAnswer:
    """Say hello.  Raises AdapterError and ProtocolError."""
    return read_hello(process.exchange([b'{"cmd":"hello","protocol":%d}\n' % PROTOCOL])[0])


def is_address(command: Sequence[str]) -> bool:
    """What stands after ``--`` is an address, and no command."""
    return bool(command) and command[0].lower().startswith(SCHEMES)


def connect(command: Sequence[str], limit_s: float) -> Connection:
    """One station: a process of this command, or a connection to this address.

    ``limit_s`` is the real time in seconds that an answer may take.  Raises AdapterError (start).
    """
    if not is_address(command):
        return Process(command, limit_s=limit_s)
    if len(command) > 1:
        raise AdapterError("start", f"{command[0]} is an address; nothing may stand behind it")
    return WebSocket(command[0], limit_s=limit_s)
