"""The child process behind the kit: lines in, as many lines out, and an end to it in any case.

Real time is looked at for one thing only: whether an answer comes within its limit.  There is no
thread.  Standard error is read while answers are awaited, so a child that writes a lot there
waits for the next exchange at worst.
"""

from __future__ import annotations

import os
import select
import signal
import subprocess
from collections import deque
from collections.abc import Sequence
from contextlib import suppress
from math import ceil
from time import monotonic
from typing import IO, Literal, NoReturn

from automcm_spec.support import children

Kind = Literal["start", "hang", "crash", "closed", "line", "output"]

STOP = b'{"cmd": "stop"}\n'
LIMIT_S = 10.0
"""The real time that an answer may take, unless another is asked for (``--limit``)."""
TAIL = 30
"""Lines of standard error that are kept."""
CUT = 2_000
"""Characters of such a line that are kept."""
TOGETHER = 64
"""All answers of one exchange have at most this many times the size of the longest line."""
_CHUNK = 1 << 16
_LAST = 32
"""Chunks of standard error that are read at the end: somebody may still be writing there."""
_LOOK_S = 0.2
"""How often it is looked whether a silent child still lives: its own may hold the pipe open."""
_EXIT_S = 1.0
"""How long a child that closed its output may take to end."""


class AdapterError(Exception):
    """The adapter broke; the text is one sentence.  The process is gone then.

    ``kind``: it could not be started (start), gave no answer in time (hang), ended (crash), closed
    an end of a pipe and lives (closed), wrote a line that is too long (line), or more lines than it
    was asked for (output).  ``exit_code`` is None unless it ended by itself; -11 means by signal
    11.
    """

    def __init__(
        self,
        kind: Kind,
        text: str,
        *,
        stderr: Sequence[str] = (),
        exit_code: int | None = None,
        answers: Sequence[bytes] = (),
    ) -> None:
        super().__init__(text)
        self.kind = kind
        self.stderr = list(stderr)
        """The last lines of standard error."""
        self.exit_code = exit_code
        self.answers = list(answers)
        """What was answered before."""


class Process:
    """A running adapter, in a process group of its own.  ``with`` ends it; so does ``kill``.

    ``limit_s`` is the real time in seconds that an answer may take, ``max_line`` how many bytes it
    may have.  Raises AdapterError (start) if the command cannot be started.
    """

    def __init__(
        self, command: Sequence[str], *, limit_s: float = LIMIT_S, max_line: int = 1 << 20
    ) -> None:
        self.limit_s = limit_s
        self.max_line = max_line
        try:
            self._process = children.popen(
                command,
                group=True,
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=subprocess.PIPE,
                bufsize=0,
            )
        except (OSError, ValueError, IndexError) as error:
            what = error.strerror if isinstance(error, OSError) else error
            name = command[0] if command else "an empty command"
            raise AdapterError("start", f"{name} cannot be started: {what}") from None
        self._in = _number(self._process.stdin)
        self._out = _number(self._process.stdout)
        self._err = _number(self._process.stderr)
        self._poll = select.poll()
        for end in (self._err, self._out):
            self._poll.register(end, select.POLLIN)
        for end in (self._in, self._out, self._err):
            os.set_blocking(end, False)
        self._open = True
        self._deaf = False
        """Its standard input is closed."""
        self._mute = False
        """Its standard output is closed."""
        self._rest = bytearray()
        """What came after the last line feed."""
        self._asked = 0
        self._answers: list[bytes] = []
        """To what was sent last, as far as they have come."""
        self._unsent = memoryview(b"")
        self._stderr: deque[str] = deque(maxlen=TAIL)
        self._stderr_rest = b""

    def __enter__(self) -> Process:
        return self

    def __exit__(self, *exc: object) -> None:
        self.kill()

    @property
    def stderr(self) -> list[str]:
        """The last lines of standard error, as far as read."""
        rest = [_shown(self._stderr_rest)] if self._stderr_rest else []
        return [*self._stderr, *rest][-TAIL:]

    def exchange(self, lines: Sequence[bytes]) -> list[bytes]:
        """Write these lines, each with its line feed; the same number of answers, without it.

        Lines are written before earlier ones are answered.  Raises AdapterError, which holds the
        answers that came, and ends the process.
        """
        self.send(lines)
        return self.answers()

    def send(self, lines: Sequence[bytes]) -> None:
        """Begin an exchange, which ``answers`` ends.  Raises AdapterError."""
        if not self._open:
            raise AdapterError("closed", "the process was ended before", stderr=self.stderr)
        if self._listen(0.0) or self._rest:
            self._fail("output", "it wrote a line that nobody asked for", [])
        self._asked, self._answers = len(lines), []
        self._unsent = self._write(memoryview(b"".join(lines)))

    def pump(self) -> None:
        """Write and read what can be without waiting, so that the process does not wait for us."""
        if self._open and len(self._answers) < self._asked:
            self._unsent = self._write(self._unsent)
            self._answers += self._listen(0.0)

    def answers(self) -> list[bytes]:
        """The answers to what was sent.  Raises AdapterError as ``exchange`` does."""
        answers, asked = self._answers, self._asked
        due = monotonic() + self.limit_s
        size, found = 0, list(answers)
        while True:
            longest = max(map(len, found), default=len(self._rest))
            size += sum(map(len, found))
            if longest > self.max_line:
                self._fail("line", f"a line has more than {self.max_line} bytes", answers)
            if size > TOGETHER * self.max_line:
                self._fail("output", f"{len(answers)} answers have {size} bytes", answers)
            if len(answers) >= asked:
                break
            if self._mute:
                self._fail_ended(answers, asked)
            self._unsent = self._write(self._unsent)
            found = self._listen(min(due - monotonic(), _LOOK_S))
            answers += found
            if found:
                due = monotonic() + self.limit_s
            elif monotonic() >= due or self._silent():
                self._fail_silent(answers, asked)
        if len(answers) > asked or self._rest or self._unsent:
            self._fail("output", "it answered more than it was asked", answers[:asked])
        return answers

    def stop(self, line: bytes = STOP) -> str | None:
        """Tell it to stop, close its standard input, wait, and end what is left of its group.

        An empty ``line`` only closes.  Returns a sentence on what was wrong, or None.
        """
        if not self._open:
            return None
        early, printed = self._exited(), bool(self._rest)
        with suppress(BlockingIOError, BrokenPipeError):
            if not self._deaf:
                os.write(self._in, line)
        self._close_in()
        due = monotonic() + self.limit_s
        while not self._exited() and monotonic() < due:
            printed |= self._discard(min(0.01, self.limit_s))
        printed |= self._discard(0.0)
        ended = self._exited()
        self.kill()
        if not ended:
            return f"it did not end within {self.limit_s:g} s of stop and was killed"
        code = self._process.returncode
        if early:
            return f"it had ended before it was told to stop, {_how(code)}"
        if code:
            return f"it ended {_how(code)} after stop, not with exit code 0"
        return "it wrote a line that nobody asked for" if printed else None

    def kill(self) -> None:
        """End the whole process group at once.  May be called again."""
        if not self._open:
            return
        self._open = False
        # The leader is not reaped before: its group cannot be another one of the same number.
        with suppress(ProcessLookupError, PermissionError):
            os.killpg(self._process.pid, signal.SIGKILL)
        with suppress(subprocess.TimeoutExpired):
            self._process.wait(timeout=_EXIT_S)
        for _ in range(_LAST):
            if not self._read_stderr():
                break
        self._close_in()
        for pipe in (self._process.stdout, self._process.stderr):
            assert pipe is not None
            pipe.close()

    def _write(self, data: memoryview) -> memoryview:
        """Write what the pipe takes; returns what is left."""
        if self._deaf or not data:
            return data
        try:
            data = data[os.write(self._in, data) :]
        except BlockingIOError:
            pass
        except BrokenPipeError:
            self._close_in()
            return data
        if data:
            self._poll.register(self._in, select.POLLOUT)
        else:
            self._forget(self._in)
        return data

    def _listen(self, timeout_s: float) -> list[bytes]:
        """Wait for output; returns the lines that are whole now."""
        for end, _ in self._poll.poll(max(0, ceil(timeout_s * 1000))):
            if end == self._err:
                self._read_stderr()
            elif end == self._out:
                chunk = os.read(end, _CHUNK)
                if not chunk:
                    self._mute = True
                    self._forget(end)
                self._rest += chunk
                if b"\n" in chunk:
                    *whole, rest = bytes(self._rest).split(b"\n")
                    self._rest = bytearray(rest)
                    return whole
        return []

    def _discard(self, timeout_s: float) -> bool:
        """Wait for output and forget it; whether there was any."""
        came = bool(self._listen(timeout_s) or self._rest)
        self._rest.clear()
        return came

    def _read_stderr(self) -> bool:
        """Read a chunk of standard error, if there is one; False if there is none."""
        try:
            chunk = os.read(self._err, _CHUNK)
        except BlockingIOError:
            return False
        if not chunk:
            self._forget(self._err)
            return False
        lines = (self._stderr_rest + chunk).rsplit(b"\n", TAIL + 1)[-TAIL - 1 :]
        self._stderr_rest = lines.pop()[: 4 * CUT]
        self._stderr.extend(map(_shown, lines))
        return True

    def _exited(self) -> bool:
        """Whether the process has ended; it is not reaped."""
        options = os.WEXITED | os.WNOHANG | os.WNOWAIT
        return os.waitid(os.P_PID, self._process.pid, options) is not None

    def _silent(self) -> bool:
        """Whether it has ended, and nothing that it wrote is left to read."""
        return self._exited() and all(end != self._out for end, _ in self._poll.poll(0))

    def _forget(self, end: int) -> None:
        with suppress(KeyError):
            self._poll.unregister(end)

    def _close_in(self) -> None:
        self._deaf = True
        self._forget(self._in)
        assert self._process.stdin is not None
        self._process.stdin.close()

    def _fail_ended(self, answers: list[bytes], asked: int) -> NoReturn:
        due = monotonic() + min(_EXIT_S, self.limit_s)
        self._forget(self._in)
        while not self._exited() and monotonic() < due:
            self._poll.poll(5)
            self._read_stderr()
        if self._exited():
            self._fail_silent(answers, asked)
        self._fail("closed", "it closed its standard output, but has not ended", answers)

    def _fail_silent(self, answers: list[bytes], asked: int) -> NoReturn:
        place = f"after {len(answers)} of {asked} answers"
        half = ", in the middle of a line" if self._rest else ""
        if self._exited():
            self._fail("crash", f"it ended {place}{half}", answers)
        if self._deaf:
            self._fail("closed", f"it closed its standard input {place}", answers)
        why = half or " (is each answer flushed?)"
        self._fail("hang", f"no answer within {self.limit_s:g} s {place}{why}", answers)

    def _fail(self, kind: Kind, text: str, answers: list[bytes]) -> NoReturn:
        ended = self._exited()
        self.kill()
        code = self._process.returncode if ended else None
        if kind == "crash":
            text += f", {_how(code)}"
        raise AdapterError(kind, text, stderr=self.stderr, exit_code=code, answers=answers)


def _number(pipe: IO[bytes] | None) -> int:
    assert pipe is not None
    return pipe.fileno()


def _shown(line: bytes) -> str:
    return line.decode(errors="replace").rstrip("\r")[:CUT]


def _how(code: int | None) -> str:
    """How a process ended, in words."""
    if code is not None and code < 0:
        with suppress(ValueError):
            return f"killed by signal {-code} ({signal.Signals(-code).name})"
    return f"with exit code {code}"
