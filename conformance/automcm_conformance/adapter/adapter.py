"""The adapter under test: a process, started when it is needed, and again after it broke."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TypeVar

from automcm_conformance.adapter.connect import Connection, connect
from automcm_conformance.adapter.process import AdapterError
from automcm_conformance.adapter.protocol import PROTOCOL, HelloAnswer, ProtocolError, read_hello

T = TypeVar("T")
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
        self._process: Connection | None = None
        self._sent: Sequence[bytes] = ()
        self._failed: AdapterError | None = None
        self._used = False
        """The process had an exchange before the one that is under way."""
        self._before: list[bytes] | AdapterError | None = None
        """What came of the lines sent before, until somebody asks for it."""
        self.hello = self._start()

    def exchange(self, lines: Sequence[bytes], *, on: bool = False) -> list[bytes]:
        """Raises AdapterError; the next call has a fresh process.  ``on``: these lines go on with
        an exchange, even if they begin with a reset.  What was sent before is answered first."""
        before = self._answered() if self._sent else self._before
        self.send(lines, on=on)
        answered, self._before = self._answered(), before
        if isinstance(answered, AdapterError):
            raise answered
        return answered

    def send(self, lines: Sequence[bytes], *, on: bool = False) -> None:
        """Begin an exchange; ``answers`` ends it, and raises what goes wrong here."""
        self._sent = lines
        self._used = self._process is not None and b'"cmd":"reset"' in lines[0] and not on
        self._failed = self._tried(lambda: self._begin(lines))

    def pump(self) -> None:
        """Let the station go on with what was sent while the kit does something else."""
        if self._process is not None and self._sent:
            self._process.pump()

    def answers(self) -> list[bytes]:
        """The answers to what was sent, or none if nothing was.  Raises AdapterError."""
        before, self._before = self._before, None
        answered = self._answered() if before is None else before
        if isinstance(answered, AdapterError):
            raise answered
        return answered

    def renew(self) -> None:
        """It may be out of step: the next exchange has a fresh process, and what was sent before
        has no answer."""
        self._sent, self._before = (), None
        if self._process is not None:
            self._process.kill()
            self._process = None

    def _begin(self, lines: Sequence[bytes]) -> None:
        if self._process is None:
            self._start()
        assert self._process is not None
        self._process.send(lines)

    def _answered(self) -> list[bytes] | AdapterError:
        """The answers to what was sent, or why there are none."""
        lines, self._sent = self._sent, ()
        if not lines:
            return []
        answered = self._failed or self._received()
        if isinstance(answered, list) or answered.answers or not self._used:
            return answered
        if answered.kind not in ("output", "crash", "closed"):
            return answered
        # What it did between two exchanges says nothing about this one.
        return self._tried(lambda: self._begin(lines)) or self._received()

    def _received(self) -> list[bytes] | AdapterError:
        assert self._process is not None
        return self._tried(self._process.answers)

    def _tried(self, action: Callable[[], T]) -> T | AdapterError:
        """What it gives, or how the process broke, which is counted."""
        try:
            return action()
        except ProtocolError as error:
            self.broken += 1
            return AdapterError("start", f"started again: {error}")
        except AdapterError as error:
            self._process = None
            self.broken += 1
            self.hung += error.kind == "hang"
            return error

    def stop(self) -> None:
        """The end of the run."""
        if self._process is not None:
            problem = self._process.stop()
            if problem is not None:
                self.problems.append(problem)
            self._process = None

    def _start(self) -> HelloAnswer:
        self._process = connect(self.command, self.limit_s)
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
