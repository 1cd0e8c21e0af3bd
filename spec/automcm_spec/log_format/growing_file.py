"""Lines of a log that is still being written: to a file, to a pipe, or by datagrams."""

from __future__ import annotations

import os
import select
from pathlib import Path
from typing import Literal

CHUNK = 65_536
"""The number of bytes read at once."""
Change = Literal["", "missing", "truncated", "replaced"]


class LineBuffer:
    """Complete lines from bytes that arrive in pieces. ``copy``: a file that keeps them all."""

    def __init__(self, copy: Path | None = None) -> None:
        self._copy = None if copy is None else copy.open("wb", buffering=0)
        self._bytes = bytearray()
        self._searched = 0
        self._over = False

    def put(self, data: bytes) -> None:
        """Add bytes at the end."""
        self._bytes += data
        if self._copy is not None:
            self._copy.write(data)

    def close(self) -> None:
        """Close the files."""
        if self._copy is not None:
            self._copy.close()

    def finish(self) -> None:
        """From now on, ``readline`` also returns an incomplete last line."""
        self._over = True

    def readline(self, limit: int, /) -> bytes:
        """The next complete line, or its first ``limit`` bytes; empty if there is none yet."""
        while (end := self._bytes.find(b"\n", self._searched, limit)) < 0:
            self._searched = min(len(self._bytes), limit)
            if self._searched == limit or not (data := self._more()):
                return self._take(self._searched if self._over or self._searched == limit else 0)
            self.put(data)
        return self._take(end + 1)

    def _take(self, size: int) -> bytes:
        line = bytes(self._bytes[:size])
        del self._bytes[:size]
        self._searched = 0 if size else self._searched
        return line

    def _more(self) -> bytes:
        """Further bytes; none if there are none now."""
        return b""


class GrowingFile(LineBuffer):
    """The lines of a file, which need not exist yet. ``-`` is standard input."""

    def __init__(self, path: Path, copy: Path | None = None) -> None:
        super().__init__(copy)
        self.path = path
        self.ended = False
        """Whether no more can come: the writer of a pipe has closed it."""
        self._fd: int | None = None
        self._stdin = str(path) == "-"

    def open(self) -> bool:
        """Open the file, unless it is open; whether it is. Raises OSError."""
        if self._fd is None and self._stdin:
            self._fd = os.dup(0)
        elif self._fd is None:
            try:
                self._fd = os.open(self.path, os.O_RDONLY | os.O_NONBLOCK)
            except FileNotFoundError:
                return False
        return True

    def change(self) -> Change:
        """What happened to the file since it was opened."""
        if self._fd is None or self._stdin:
            return "" if self._fd is not None else "missing"
        own = os.fstat(self._fd)
        try:
            now = self.path.stat()
        except FileNotFoundError:
            return ""  # removed, perhaps renamed: a new one may come
        if (own.st_dev, own.st_ino) != (now.st_dev, now.st_ino):
            return "replaced"
        regular = os.path.isfile(self.path)
        short = regular and own.st_size < os.lseek(self._fd, 0, os.SEEK_CUR)
        return "truncated" if short else ""

    def close(self) -> None:
        """Close the files."""
        super().close()
        if self._fd is not None:
            os.close(self._fd)
            self._fd = None

    def _more(self) -> bytes:
        if not self.open():
            return b""
        assert self._fd is not None, "it is open"
        if not select.select([self._fd], [], [], 0)[0]:
            return b""
        try:
            data = os.read(self._fd, CHUNK)
        except BlockingIOError:
            return b""
        self.ended = not data and self._stdin
        return data
