"""Lines written by a thread, so that no pipe, disk or terminal can block the event loop."""

from __future__ import annotations

import errno
import os
import select
import stat
import threading
from collections import deque
from collections.abc import Callable
from pathlib import Path

WAITING_BYTES = 2**20
"""Maximum bytes that wait to be written; a line beyond this limit is lost."""
POLL_MS = 50


class LineOutput:
    """Writes complete lines to a file descriptor that may block, be full or be closed.

    ``write`` never waits and never raises.  A line that cannot be written is lost and counted; the
    next line is tried again, because a disk may have room later.  ``trouble`` is called once,
    possibly from the thread, with the reason of the first loss, but not if the reader closed its
    pipe.  A partly written line is removed from an owned regular file; elsewhere the next line
    begins after a line feed.
    """

    def __init__(
        self,
        fd: int,
        *,
        owned: bool = False,
        trouble: Callable[[str], None] = lambda why: None,
        waiting_bytes: int = WAITING_BYTES,
    ) -> None:
        """``owned``: there is no other writer, and ``finish`` closes the file."""
        self.lost = 0
        """Lines that were not written."""
        self.closed_by_reader = False
        """Whether the pipe has lost its reader or is closed; every further line is lost."""
        self._fd, self._owned, self._trouble = fd, owned, trouble
        self._limit = waiting_bytes
        self._regular = _is_regular(fd)
        self._lines: deque[bytes] = deque()
        self._bytes = 0
        self._changed = threading.Condition()
        self._ending = self._reported = self._torn = self._writing = False
        self._thread = threading.Thread(target=self._run, name="output", daemon=True)
        self._thread.start()

    def write(self, line: bytes) -> None:
        """Put one line, with its line feed, into the queue."""
        with self._changed:
            fits = self._bytes + len(line) <= self._limit
            if fits and not (self.closed_by_reader or self._ending):
                self._lines.append(line)
                self._bytes += len(line)
                self._changed.notify_all()
                return
            self.lost += 1
        if not fits:
            self._report("the reader does not read, or reads too slowly")

    def flush(self) -> None:
        """Does nothing: the thread writes as soon as it can."""

    def drain(self, within_s: float) -> None:
        """Wait until all lines are written or lost, for at most ``within_s``."""
        with self._changed:
            self._changed.wait_for(lambda: not self._bytes, within_s)

    def finish(self, within_s: float) -> None:
        """Write the waiting lines for at most ``within_s``; the remaining ones are lost."""
        self.drain(within_s)
        with self._changed:
            self._ending = True
            self.lost += len(self._lines) + self._writing
            self._lines.clear()
            self._changed.notify_all()
        if not self._writing:
            self._thread.join()
            if self._owned:
                os.close(self._fd)

    # -- the thread

    def _run(self) -> None:
        while True:
            with self._changed:
                self._changed.wait_for(lambda: self._lines or self._ending)
                if self._ending:
                    return
                line = self._lines.popleft()
                self._writing = True
            why = self._try(line)
            with self._changed:
                self._writing = False
                self._bytes -= len(line)
                if why and not self._ending:
                    self.lost += 1
                if self.closed_by_reader:
                    self.lost += len(self._lines)
                    self._lines.clear()
                    self._bytes = 0
                self._changed.notify_all()
            if why and not self.closed_by_reader:
                self._report(why)

    def _try(self, line: bytes) -> str:
        """Write the line.  Returns the reason if that fails, else an empty text."""
        try:
            self._put(line)
        except OSError as error:
            self.closed_by_reader = error.errno in (errno.EPIPE, errno.EBADF)
            return error.strerror or str(error)
        return ""

    def _put(self, line: bytes) -> None:
        data = b"\n" + line if self._torn else line
        done = 0
        try:
            while done < len(data):
                done += self._write(data[done:])
        except OSError:
            if done:
                self._torn = not (self._regular and self._owned and self._take_back(done))
            raise
        self._torn = False

    def _write(self, data: bytes) -> int:
        while True:
            try:
                return os.write(self._fd, data)
            except BlockingIOError:  # another process made the descriptor non-blocking
                if self._ending:
                    raise
                poll = select.poll()
                poll.register(self._fd, select.POLLOUT)
                poll.poll(POLL_MS)

    def _take_back(self, count: int) -> bool:
        try:
            os.ftruncate(self._fd, os.lseek(self._fd, 0, os.SEEK_CUR) - count)
            os.lseek(self._fd, -count, os.SEEK_CUR)
        except OSError:
            return False
        return True

    def _report(self, why: str) -> None:
        reported, self._reported = self._reported, True
        if not reported:
            self._trouble(why)


def _is_regular(fd: int) -> bool:
    try:
        return stat.S_ISREG(os.fstat(fd).st_mode)
    except OSError:
        return False


def create(path: Path) -> tuple[int, Path]:
    """Create a new file and open it for writing.

    If ``path`` exists, the first free name of ``name.2.suffix``, ``name.3.suffix``, ... is used, so
    that a start does not destroy the log of an earlier run.  A pipe or a device is opened as it is.
    Raises OSError.
    """
    if path.exists() and not path.is_file():
        return os.open(path, os.O_WRONLY | os.O_NONBLOCK), path  # a pipe must have a reader
    free, n = path, 1
    while True:
        try:
            return os.open(free, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o666), free
        except FileExistsError:
            n += 1
            free = path.with_name(f"{path.stem}.{n}{path.suffix}")
