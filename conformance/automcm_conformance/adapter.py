"""The adapter under test: a process, started when it is needed, and again after it broke."""

from __future__ import annotations

from collections.abc import Sequence

from automcm_conformance.opened import Opened, opened
from automcm_conformance.process import AdapterError
from automcm_conformance.protocol import PROTOCOL, HelloAnswer, ProtocolError, read_hello

PATIENCE = 10
"""Crashes and hangs after which the run is cut short."""


class Adapter:
    """Its ``hello``, and lines to it.  Raises AdapterError or ProtocolError if there is no
    ``hello``."""

    def __init__(self, command: Sequence[str], limit_s: float) -> None:
        self.command = list(command)
        self.broken = 0
        self.hung = 0
        """Of those how often by a hang."""
        self.problems: list[str] = []
        self.limit_s = limit_s
        self._process: Opened | None = None
        self.hello = self._start()

    def exchange(self, lines: Sequence[bytes], *, on: bool = False) -> list[bytes]:
        """Raises AdapterError; the next call has a fresh process.  ``on``: these lines go on with
        an exchange, even if they begin with a reset."""
        used = self._process is not None and b'"cmd":"reset"' in lines[0] and not on
        try:
            return self._exchange(lines)
        except AdapterError as error:
            if not used or error.answers or error.kind not in ("output", "crash", "closed"):
                raise
        # What it did between two exchanges says nothing about this one.
        return self._exchange(lines)

    def renew(self) -> None:
        """It may be out of step: the next exchange has a fresh process."""
        if self._process is not None:
            self._process.kill()
            self._process = None

    def _exchange(self, lines: Sequence[bytes]) -> list[bytes]:
        try:
            if self._process is None:
                self._start()
            assert self._process is not None
            return self._process.exchange(lines)
        except ProtocolError as error:
            self.broken += 1
            raise AdapterError("start", f"started again: {error}") from None
        except AdapterError as error:
            self._process = None
            self.broken += 1
            self.hung += error.kind == "hang"
            raise

    def stop(self) -> None:
        """The end of the run."""
        if self._process is not None:
            problem = self._process.stop()
            if problem is not None:
                self.problems.append(problem)
            self._process = None

    def _start(self) -> HelloAnswer:
        self._process = opened(self.command, self.limit_s)
        try:
            line = b'{"cmd":"hello","protocol":%d}\n' % PROTOCOL
            return read_hello(self._process.exchange([line])[0])
        except (AdapterError, ProtocolError):
            self._process.kill()
            self._process = None
            raise


class Singly:
    """One exchange with an adapter, whose lines go one by one: a line too many or too few shows
    where it belongs."""

    def __init__(self, adapter: Adapter) -> None:
        self._adapter = adapter
        self._on = False

    def exchange(self, lines: Sequence[bytes]) -> list[bytes]:
        """As that of an adapter."""
        answers: list[bytes] = []
        for line in lines:
            try:
                answers += self._adapter.exchange([line], on=self._on)
            except AdapterError as error:
                error.answers = [*answers, *error.answers]
                raise
            self._on = True
        return answers
