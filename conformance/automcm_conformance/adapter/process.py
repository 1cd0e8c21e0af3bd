"""The adapter's process: one answer line for each line written, and a process that always ends.

Real time decides one thing only: whether an answer comes within the time limit.  There is no
thread.  Standard error is read while answers are awaited, so an adapter that writes much there
blocks at most until the next exchange.
"""

from __future__ import annotations

import itertools
import os
import select
import signal
import subprocess
from collections import deque
from collections.abc import Sequence
from contextlib import suppress
from math import ceil
from time import monotonic, sleep
from typing import IO, Literal, NoReturn

from automcm_spec.support import children

Kind = Literal["start", "hang", "crash", "closed", "line", "output"]
UNREQUESTED = "the adapter wrote a line that answers no command"
TOO_MANY = "the adapter wrote more answers than commands were sent"

STOP = b'{"cmd": "stop"}\n'
LIMIT_S = 10.0
"""Default of ``--limit``: the real time in seconds that an answer may take."""
STDERR_LINES = 30
"""How many of the last lines of standard error are kept."""
QUOTED = 100
"""At most this many characters of a line are shown in a sentence."""
STDERR_LENGTH = 2_000
"""How many characters of each of these lines are kept."""
TOTAL_FACTOR = 64
"""The answers of an exchange may have this many times the size of the longest allowed line."""
_CHUNK = 1 << 16
_FINAL_CHUNKS = 32
"""At most this many chunks of standard error are read at the end: a descendant may still write."""
_POLL_S = 0.2
"""How often a silent process is checked for its end: its descendants may hold the pipe open."""
_ROUNDS, _ROUND_S = 50, 0.01
"""How often descendants are looked for, and the pause: they may start others meanwhile."""
_NUMBERS = itertools.count(1)
_EXIT_S = 1.0
"""How long a process that closed its output may take to exit."""


class AdapterError(Exception):
    """The adapter failed; the text is one sentence.  Its process has been ended.

    ``kind``: it could not be started (start), gave no answer in time (hang), exited (crash), closed
    a pipe without exiting (closed), wrote a line that is too long (line), or more lines than
    commands were sent (output).  ``exit_code`` is None unless it exited by itself; -11 means
    signal 11.
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
        """The answers before the failure."""


class Process:
    """A running adapter, in a process group of its own.  ``with`` ends it; so does ``kill``.

    ``limit_s`` is the real time in seconds that an answer may take, ``max_line`` its maximum length
    in bytes.  Raises AdapterError (start) if the command cannot be started.
    """

    def __init__(
        self, command: Sequence[str], *, limit_s: float = LIMIT_S, max_line: int = 1 << 20
    ) -> None:
        self.limit_s = limit_s
        self.max_line = max_line
        self._mark = f"{os.getpid()}-{next(_NUMBERS)}"
        """Marks the process and its descendants."""
        self.left: list[int] = []
        """Descendants that could not be ended."""
        try:
            self._process = children.popen(
                command,
                group=True,
                env={**os.environ, children.MARK: self._mark},
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=subprocess.PIPE,
                bufsize=0,
            )
        except (OSError, ValueError, IndexError) as error:
            why = error.strerror if isinstance(error, OSError) else error
            name = command[0] if command else "an empty command"
            raise AdapterError("start", f"{name} cannot be started: {why}") from None
        self._in = _number(self._process.stdin)
        self._out = _number(self._process.stdout)
        self._err = _number(self._process.stderr)
        self._poll = select.poll()
        for end in (self._err, self._out):
            self._poll.register(end, select.POLLIN)
        for end in (self._in, self._out, self._err):
            os.set_blocking(end, False)
        self._open = True
        self._stdin_closed = self._stdout_closed = False
        self._partial = bytearray()
        """The bytes after the last line feed."""
        self._expected = 0
        """The number of lines sent last."""
        self._answers: list[bytes] = []
        """The answers to these lines that have been read."""
        self._unsent = memoryview(b"")
        self._stderr: deque[str] = deque(maxlen=STDERR_LINES)
        self._stderr_rest = b""

    def __enter__(self) -> Process:
        return self

    def __exit__(self, *exc: object) -> None:
        self.kill()

    @property
    def stderr(self) -> list[str]:
        """The last lines of standard error that have been read."""
        rest = [_shown(self._stderr_rest)] if self._stderr_rest else []
        return [*self._stderr, *rest][-STDERR_LINES:]

    @property
    def resident(self) -> int:
        """The bytes of main memory that the process group uses. Only on Linux; elsewhere 0."""
        return children.resident(self._process.pid)

    def exchange(self, lines: Sequence[bytes]) -> list[bytes]:
        """Write the lines, each with its line feed; returns as many answers, without line feeds.

        Lines are written before earlier ones are answered.  Raises AdapterError, which has the
        answers so far, and ends the process.
        """
        self.send(lines)
        return self.answers()

    def send(self, lines: Sequence[bytes]) -> None:
        """Begin an exchange; ``answers`` ends it.  Raises AdapterError."""
        if not self._open:
            raise AdapterError("closed", "the process has already ended", stderr=self.stderr)
        if extra := self._extra():
            self._fail("output", f"{UNREQUESTED}{extra}", [])
        self._expected, self._answers = len(lines), []
        self._unsent = self._write(memoryview(b"".join(lines)))

    def pump(self) -> None:
        """Write and read without waiting, so that the adapter need not wait for the kit."""
        if self._open and len(self._answers) < self._expected:
            self._unsent = self._write(self._unsent)
            self._answers += self._listen(0.0)

    def answers(self) -> list[bytes]:
        """The answers to the lines of ``send``.  Raises AdapterError as ``exchange`` does."""
        answers, expected = self._answers, self._expected
        due = monotonic() + self.limit_s
        size, found = 0, list(answers)
        while True:
            longest = max(map(len, found), default=len(self._partial))
            size += sum(map(len, found))
            if longest > self.max_line:
                text = f"the adapter wrote a line of more than {self.max_line} bytes"
                self._fail("line", text, answers)
            if size > TOTAL_FACTOR * self.max_line:
                text = f"{len(answers)} answers have {size} bytes"
                self._fail("output", f"{text}; allowed: {TOTAL_FACTOR * self.max_line}", answers)
            if len(answers) >= expected:
                break
            if self._stdout_closed:
                self._fail_ended(answers, expected)
            self._unsent = self._write(self._unsent)
            found = self._listen(min(due - monotonic(), _POLL_S))
            answers += found
            if found:
                due = monotonic() + self.limit_s
            elif monotonic() >= due or self._silent():
                self._fail_silent(answers, expected)
        if len(answers) > expected or self._partial or self._unsent:
            extra = self._unexpected(answers, expected)
            self._fail("output", f"{TOO_MANY}{extra}", answers[:expected])
        return answers

    def stop(self, line: bytes = STOP) -> str | None:
        """Send stop, close standard input, wait, and end the rest of the process group.

        An empty ``line`` only closes.  Returns a sentence that describes a problem, or None.
        """
        if not self._open:
            return None
        exited_before, extra = self._exited(), self._extra()
        # While the process runs, all descendants are found by their parents.
        others = children.opened(children.descendants(self._process.pid, self._mark))
        with suppress(BlockingIOError, BrokenPipeError):
            if not self._stdin_closed:
                os.write(self._in, line)
        self._close_in()
        due = monotonic() + self.limit_s
        while not self._exited() and monotonic() < due:
            more = self._extra(min(0.01, self.limit_s))
            extra = extra or more
        extra = extra or self._extra()
        ended = self._exited()
        self.kill()
        for other, descriptor in others.items():
            try:
                signal.pidfd_send_signal(descriptor, signal.SIGKILL)
            except ProcessLookupError:
                pass  # it has ended
            except PermissionError:
                self.left = sorted({*self.left, other})
            os.close(descriptor)
        if self.left:
            return f"processes of the adapter are still running: {', '.join(map(str, self.left))}"
        if not ended:
            return f"the adapter did not exit within {self.limit_s:g} s of stop and was killed"
        code = self._process.returncode
        if exited_before:
            return f"the adapter exited before stop, with {_exit_status(code)}"
        if code:
            return f"the adapter exited on stop with {_exit_status(code)}; expected exit code 0"
        return f"{UNREQUESTED}{extra}" if extra else None

    def kill(self) -> None:
        """End the process group and all descendants at once.  May be called again."""
        if not self._open:
            return
        self._open = False
        # The leader has not been reaped, so no other group can have got its number.
        for n in range(_ROUNDS):
            sleep(_ROUND_S if n else 0.0)
            others = children.descendants(self._process.pid, self._mark)
            with suppress(ProcessLookupError, PermissionError):
                os.killpg(self._process.pid, signal.SIGKILL)
            if not others:
                break
            for other in others:  # of another session: it called setsid
                with suppress(ProcessLookupError, PermissionError):
                    os.kill(other, signal.SIGKILL)
        else:
            self.left = sorted(children.descendants(self._process.pid, self._mark))
        with suppress(subprocess.TimeoutExpired):
            self._process.wait(timeout=_EXIT_S)
        for _ in range(_FINAL_CHUNKS):
            if not self._read_stderr():
                break
        self._close_in()
        for pipe in (self._process.stdout, self._process.stderr):
            assert pipe is not None
            pipe.close()

    def _write(self, data: memoryview) -> memoryview:
        """Write as much as the pipe takes; returns the rest."""
        if self._stdin_closed or not data:
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
            self._unregister(self._in)
        return data

    def _listen(self, timeout_s: float) -> list[bytes]:
        """Wait for output; returns the complete lines."""
        for end, _ in self._poll.poll(max(0, ceil(timeout_s * 1000))):
            if end == self._err:
                self._read_stderr()
            elif end == self._out:
                chunk = os.read(end, _CHUNK)
                if not chunk:
                    self._stdout_closed = True
                    self._unregister(end)
                self._partial += chunk
                if b"\n" in chunk:
                    *lines, rest = bytes(self._partial).split(b"\n")
                    self._partial = bytearray(rest)
                    return lines
        return []

    def _extra(self, timeout_s: float = 0.0) -> str:
        """Wait for output and drop it; shows it if there was any."""
        found = self._unexpected(self._listen(timeout_s), 0)
        self._partial.clear()
        return found

    def _unexpected(self, lines: Sequence[bytes], expected: int) -> str:
        """The first line that cannot be an answer, else the first after the expected ones."""
        lines = [*lines, *filter(None, [bytes(self._partial)])]
        if len(lines) <= expected:
            return ""
        other = next((line for line in lines if not line.startswith(b"{")), None)
        line = _shown(lines[expected] if other is None else other)[:QUOTED]
        hint = "" if other is None else " (did you mean to write it to standard error?)"
        return f": {line!r}{hint}"

    def _read_stderr(self) -> bool:
        """Read a chunk of standard error, if there is one; False if there is none."""
        try:
            chunk = os.read(self._err, _CHUNK)
        except BlockingIOError:
            return False
        if not chunk:
            self._unregister(self._err)
            return False
        lines = (self._stderr_rest + chunk).rsplit(b"\n", STDERR_LINES + 1)[-STDERR_LINES - 1 :]
        self._stderr_rest = lines.pop()[: 4 * STDERR_LENGTH]
        self._stderr.extend(map(_shown, lines))
        return True

    def _exited(self) -> bool:
        """Whether the process has exited.  Does not reap it."""
        options = os.WEXITED | os.WNOHANG | os.WNOWAIT
        return os.waitid(os.P_PID, self._process.pid, options) is not None

    def _silent(self) -> bool:
        """Whether the process has exited and its output has been read."""
        return self._exited() and all(end != self._out for end, _ in self._poll.poll(0))

    def _unregister(self, end: int) -> None:
        with suppress(KeyError):
            self._poll.unregister(end)

    def _close_in(self) -> None:
        self._stdin_closed = True
        self._unregister(self._in)
        assert self._process.stdin is not None
        self._process.stdin.close()

    def _fail_ended(self, answers: list[bytes], expected: int) -> NoReturn:
        due = monotonic() + min(_EXIT_S, self.limit_s)
        self._unregister(self._in)
        while not self._exited() and monotonic() < due:
            self._poll.poll(5)
            self._read_stderr()
        if self._exited():
            self._fail_silent(answers, expected)
        self._fail("closed", "the adapter closed its standard output but did not exit", answers)

    def _fail_silent(self, answers: list[bytes], expected: int) -> NoReturn:
        place = f"after {len(answers)} of {expected} answers"
        partial = ", in the middle of a line" if self._partial else ""
        if self._exited():
            self._fail("crash", f"the adapter exited {place}{partial}", answers)
        if self._stdin_closed:
            self._fail("closed", f"the adapter closed its standard input {place}", answers)
        why = partial or " (is each answer flushed?)"
        self._fail("hang", f"no answer within {self.limit_s:g} s {place}{why}", answers)

    def _fail(self, kind: Kind, text: str, answers: list[bytes]) -> NoReturn:
        ended = self._exited()
        self.kill()
        code = self._process.returncode if ended else None
        if kind == "crash":
            text += f", with {_exit_status(code)}"
        raise AdapterError(kind, text, stderr=self.stderr, exit_code=code, answers=answers)


def _number(pipe: IO[bytes] | None) -> int:
    assert pipe is not None
    return pipe.fileno()


def _shown(line: bytes) -> str:
    return line.decode(errors="replace").rstrip("\r")[:STDERR_LENGTH]


def _exit_status(code: int | None) -> str:
    if code is not None and code < 0:
        with suppress(ValueError):
            return f"signal {-code} ({signal.Signals(-code).name})"
    return f"exit code {code}"
