"""Connections to an adapter: a command to start, or the address of a WebSocket."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol, Self

from automcm_conformance.adapter.process import STOP, AdapterError, Process
from automcm_conformance.adapter.protocol import PROTOCOL, HelloAnswer, read_hello
from automcm_conformance.adapter.websocket import SCHEMES, WebSocket


class Connection(Protocol):
    """The common interface of ``Process`` and ``WebSocket``.  ``with`` ends the connection."""

    def __enter__(self) -> Self: ...

    def __exit__(self, *exc: object) -> None: ...

    def exchange(self, lines: Sequence[bytes]) -> list[bytes]:
        """Send the lines; returns as many answers.  Raises AdapterError."""

    def send(self, lines: Sequence[bytes]) -> None:
        """Begin an exchange; ``answers`` ends it.  Raises AdapterError."""

    def pump(self) -> None:
        """Write and read without waiting."""

    def answers(self) -> list[bytes]:
        """The answers to the lines of ``send``.  Raises AdapterError."""

    def stop(self, line: bytes = STOP) -> str | None:
        """Send stop.  Returns a sentence that describes a problem, or None."""

    def kill(self) -> None:
        """End the connection at once.  May be called again."""


def hello(process: Connection) -> HelloAnswer:
    """Send hello and read the answer.  Raises AdapterError and ProtocolError."""
    return read_hello(process.exchange([b'{"cmd":"hello","protocol":%d}\n' % PROTOCOL])[0])


def is_address(command: Sequence[str]) -> bool:
    """Whether the words after ``--`` are an address and not a command."""
    return bool(command) and command[0].lower().startswith(SCHEMES)


def connect(command: Sequence[str], limit_s: float) -> Connection:
    """A connection to one station: a process of this command, or a WebSocket to this address.

    ``limit_s`` is the real time in seconds that an answer may take.  Raises AdapterError (start).
    """
    if not is_address(command):
        return Process(command, limit_s=limit_s)
    if len(command) > 1:
        raise AdapterError("start", f"{command[0]} is an address and takes no arguments")
    return WebSocket(command[0], limit_s=limit_s)
