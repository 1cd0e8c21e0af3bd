"""Lines that are written by a thread: nothing that a reader or a disk does holds the writer."""

from __future__ import annotations

import errno
import os
import resource
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from automcm.service import line_output
from automcm.service.line_output import LineOutput, create

SOON_S = 10


@pytest.fixture
def pipe() -> Iterator[tuple[int, int]]:
    reading, writing = os.pipe()
    yield reading, writing
    for fd in (reading, writing):
        try:
            os.close(fd)
        except OSError:
            assert fd == reading  # a test closed it


def test_nothing_waits_for_a_reader_and_what_does_not_fit_is_counted(pipe: tuple[int, int]) -> None:
    told: list[str] = []
    out = LineOutput(pipe[1], trouble=told.append, waiting_bytes=10**5)
    line = b"x" * 999 + b"\n"
    for _ in range(1000):
        out.write(line)
    assert out.lost > 1000 - 100 - 2**16 // len(line) - 2
    assert len(told) == 1 and "not read" in told[0]
    out.finish(0)
    assert out.lost >= 1000 - 2**16 // len(line) - 2
    out.write(line)  # after the end: no more than lost


def test_a_descriptor_that_somebody_made_non_blocking_is_waited_for(pipe: tuple[int, int]) -> None:
    os.set_blocking(pipe[1], False)
    out = LineOutput(pipe[1])
    lines = b"y" * 999 + b"\n"
    for _ in range(200):
        out.write(lines)
    got = b""
    while len(got) < 200 * len(lines):
        got += os.read(pipe[0], 10**5)
    out.finish(SOON_S)
    assert out.lost == 0
    stuck = LineOutput(pipe[1])
    for _ in range(200):
        stuck.write(lines)
    stuck.finish(0.05)
    stuck._thread.join(SOON_S)
    assert stuck.lost > 100 and not stuck._thread.is_alive()


def test_a_pipe_that_its_reader_closed_is_no_trouble(pipe: tuple[int, int]) -> None:
    told: list[str] = []
    out = LineOutput(pipe[1], trouble=told.append)
    os.close(pipe[0])
    for _ in range(10):
        out.write(b"z\n")
    out.drain(SOON_S)
    out.write(b"z\n")
    out.finish(SOON_S)
    assert (out.lost, out.closed_by_reader, told) == (11, True, [])


@contextmanager
def no_file_beyond(size: int) -> Iterator[None]:
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))


@pytest.mark.parametrize("owned", [True, False])
def test_a_full_disk_tears_no_line_and_has_room_again(owned: bool, tmp_path: Path) -> None:
    told: list[str] = []
    fd, path = create(tmp_path / "log")
    out = LineOutput(fd, owned=owned, trouble=told.append)
    out.write(b"first\n")
    out.drain(SOON_S)
    with no_file_beyond(10):
        for _ in range(3):
            out.write(b"second\n")
        out.drain(SOON_S)
    out.write(b"third\n")
    out.finish(SOON_S)
    if not owned:
        os.close(fd)
    torn = b"" if owned else b"seco\n"  # another one may have written behind it
    assert path.read_bytes() == b"first\n" + torn + b"third\n"
    assert out.lost == 3 and told == [os.strerror(errno.EFBIG)]


def test_an_end_waits_no_longer_than_told(
    pipe: tuple[int, int], monkeypatch: pytest.MonkeyPatch
) -> None:
    go_on = threading.Event()

    def write(fd: int, data: Any) -> int:
        go_on.wait()
        raise OSError(errno.EIO, "at last")

    monkeypatch.setattr(line_output.os, "write", write)
    out = LineOutput(pipe[1])
    out.write(b"1\n")
    out.write(b"2\n")
    out.finish(0.05)
    assert out.lost == 2
    go_on.set()
    out._thread.join(SOON_S)
    assert out.lost == 2  # each once


def test_a_file_that_is_there_is_left_alone(tmp_path: Path) -> None:
    wanted = tmp_path / "a.ndjson"
    for name in ("a.ndjson", "a.2.ndjson", "a.3.ndjson"):
        fd, path = create(wanted)
        os.write(fd, name.encode())
        os.close(fd)
        assert path.name == name
    assert {p.read_text() for p in tmp_path.iterdir()} == {p.name for p in tmp_path.iterdir()}


def test_a_log_may_be_a_pipe_that_has_a_reader(tmp_path: Path) -> None:
    fifo = tmp_path / "fifo"
    os.mkfifo(fifo)
    with pytest.raises(OSError, match="fifo"):
        create(fifo)
    reading = os.open(fifo, os.O_RDONLY | os.O_NONBLOCK)
    fd, path = create(fifo)
    assert path == fifo
    for each in (reading, fd):
        os.close(each)
    with pytest.raises(IsADirectoryError):
        create(tmp_path)
