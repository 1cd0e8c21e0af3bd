"""The adapter under test: its process is started on demand, and restarted after a failure."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from time import monotonic
from typing import TypeVar

from automcm_conformance.adapter.process import AdapterError, Process
from automcm_conformance.adapter.protocol import SAY_HELLO, HelloAnswer, ProtocolError, read_hello

T = TypeVar("T")
ENOUGH_ANSWERS, SLOW_MS = 20, 20.0
"""After so many answers, an average of so many milliseconds of real time for each is slow."""
PATIENCE = 10
"""After this many crashes and hangs the run is cut short."""


class Adapter:
    """Exchanges lines with an adapter.

    Raises AdapterError or ProtocolError if it does not answer ``hello``.
    """

    def __init__(self, command: Sequence[str], limit_s: float) -> None:
        self.command = list(command)
        self.broken = 0
        """How often the process failed."""
        self.hung = 0
        """How many of those failures were hangs."""
        self.problems: list[str] = []
        self.limit_s = limit_s
        self.answered = 0
        """How many lines the adapter has answered."""
        self.waited_s = 0.0
        """How long the kit has waited for these answers."""
        self._process: Process | None = None
        self._sent: Sequence[bytes] = ()
        self._failed: AdapterError | None = None
        self._used = False
        """The process has answered an exchange before the current one."""
        self._earlier: list[bytes] | AdapterError | None = None
        """The result of the previous ``send``, until ``answers`` returns it."""
        self.hello = self._start()

    def exchange(self, lines: Sequence[bytes], *, continued: bool = False) -> list[bytes]:
        """Send the lines; returns as many answers.  The answers to an earlier ``send`` are kept.

        ``continued``: the lines continue an exchange, even if they begin with a reset.  Raises
        AdapterError; the next call starts a new process.
        """
        earlier = self._answered() if self._sent else self._earlier
        self.send(lines, continued=continued)
        answered, self._earlier = self._answered(), earlier
        if isinstance(answered, AdapterError):
            raise answered
        return answered

    def send(self, lines: Sequence[bytes], *, continued: bool = False) -> None:
        """Begin an exchange.  ``answers`` ends it, and raises the errors of both."""
        self._sent = lines
        self._used = self._process is not None and b'"cmd":"reset"' in lines[0] and not continued
        self._failed = self._try(lambda: self._begin(lines))

    @property
    def runs(self) -> bool:
        """Whether the process that answered last is still running."""
        return self._process is not None

    @property
    def resident(self) -> int:
        """The bytes of main memory that the processes of the adapter use; 0 if unknown."""
        return 0 if self._process is None else self._process.resident

    def pump(self) -> None:
        """Write and read without waiting, so that the station works while the kit does."""
        if self._process is not None and self._sent:
            self._process.pump()

    def answers(self) -> list[bytes]:
        """The answers to the lines of ``send``; empty if none were sent.  Raises AdapterError."""
        earlier, self._earlier = self._earlier, None
        answered = self._answered() if earlier is None else earlier
        if isinstance(answered, AdapterError):
            raise answered
        return answered

    def renew(self) -> None:
        """End a process that may be out of step, and drop the answers that are still due.

        The next exchange starts a new process.
        """
        self._sent, self._earlier = (), None
        if self._process is not None:
            self._process.kill()
            self._process = None

    def _begin(self, lines: Sequence[bytes]) -> None:
        if self._process is None:
            self._start()
        assert self._process is not None
        self._process.send(lines)

    def _answered(self) -> list[bytes] | AdapterError:
        """The answers to the lines sent, or the error."""
        lines, self._sent = self._sent, ()
        if not lines:
            return []
        answered = self._failed or self._received()
        if isinstance(answered, list) or answered.answers or not self._used:
            return answered
        if answered.kind not in ("output", "crash", "closed"):
            return answered
        # The failure belongs to the time between two exchanges, so this one is repeated.
        return self._try(lambda: self._begin(lines)) or self._received()

    @property
    def slowness(self) -> str:
        """A hint if the adapter answers so slowly that the run takes long; else empty."""
        each_ms = 1000 * self.waited_s / max(1, self.answered)
        if self.answered < ENOUGH_ANSWERS or each_ms < SLOW_MS:
            return ""
        return f"the adapter is slow: {each_ms:.0f} ms an answer (does it buffer its output?)"

    def _received(self) -> list[bytes] | AdapterError:
        assert self._process is not None
        started = monotonic()
        found = self._try(self._process.answers)
        self.waited_s += monotonic() - started
        self.answered += len(found if isinstance(found, list) else found.answers)
        return found

    def _try(self, action: Callable[[], T]) -> T | AdapterError:
        """The result of the action, or the error, which is counted."""
        try:
            return action()
        except ProtocolError as error:
            self.broken += 1
            return AdapterError("start", f"after a restart of its process: {error}")
        except AdapterError as error:
            self._process = None
            self.broken += 1
            self.hung += error.kind == "hang"
            return error

    def stop(self) -> None:
        """Stop the process, and note in ``problems`` if it does not stop properly."""
        if self._process is not None:
            problem = self._process.stop()
            if problem is not None:
                self.problems.append(problem)
            self._process = None

    def _start(self) -> HelloAnswer:
        self._process = Process(self.command, limit_s=self.limit_s)
        try:
            return read_hello(self._process.exchange([SAY_HELLO])[0])
        except (AdapterError, ProtocolError):
            self._process.kill()
            self._process = None
            raise


class LineByLine:
    """One exchange with an adapter, line by line: shows which line has too many answers or none."""

    def __init__(self, adapter: Adapter) -> None:
        self._adapter = adapter
        self._continued = False

    def exchange(self, lines: Sequence[bytes]) -> list[bytes]:
        """As ``Adapter.exchange``."""
        answers: list[bytes] = []
        for line in lines:
            try:
                answers += self._adapter.exchange([line], continued=self._continued)
            except AdapterError as error:
                error.answers = [*answers, *error.answers]
                raise
            self._continued = True
        return answers
