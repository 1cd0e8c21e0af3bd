"""Stations as processes of their own, and a relay between them, for tests that harm one of them."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import threading
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from typing import Any

from cli_stage import LIMIT_S
from forked_station import automcm_popen

PRESCRIBER, RECEIVER = 1, 2
QUICK = ("--set", "t_timeout=400", "--listen", "0", "--first")
"""A session that begins within a second."""


class Running:
    """A process and its reports on a pipe, which we read or not."""

    def __init__(self, *args: str, full: bool = False) -> None:
        self.reading, writing = os.pipe()
        if full:
            os.set_blocking(writing, False)
            with suppress(BlockingIOError):
                while True:
                    os.write(writing, b"\n" * 4096)
            os.set_blocking(writing, True)
        ignored = signal.signal(signal.SIGHUP, signal.SIG_DFL)  # if the tests run under nohup
        self.process = automcm_popen(*args, stdout=writing, stderr=subprocess.PIPE)
        signal.signal(signal.SIGHUP, ignored)
        os.close(writing)
        self.lines = os.fdopen(self.reading)
        self._limit = threading.Timer(LIMIT_S, self.process.kill)  # else a test waits for ever
        self._limit.start()

    def report(self) -> dict[str, Any]:
        """The next report; {} at the end."""
        line = self.lines.readline()
        found: dict[str, Any] = json.loads(line) if line else {}
        return found

    def until(self, **wanted: Any) -> dict[str, Any]:
        """Read reports until one has these values."""
        while found := self.report():
            if wanted.items() <= found.items():
                return found
        raise AssertionError(f"ended without {wanted}: {self.errors()}")

    def signal(self, signum: int) -> None:
        self.process.send_signal(signum)

    def complains(self, words: str) -> str:
        """Read standard error until a line has these words."""
        assert self.process.stderr is not None
        for line in self.process.stderr:
            if words in line:
                return line
        raise AssertionError(f"ended without {words!r}")

    def errors(self) -> str:
        """What it said on standard error; waits for its end."""
        assert self.process.stderr is not None
        return self.process.stderr.read()

    def wait(self) -> int:
        return self.process.wait(LIMIT_S)

    def close(self) -> None:
        self._limit.cancel()
        if self.process.poll() is None:
            self.process.send_signal(signal.SIGCONT)
            self.process.kill()
            self.process.wait()
        self.lines.close()
        if self.process.stderr is not None:
            self.process.stderr.close()


class Road:
    """A relay, and stations that send through it."""

    def __init__(self, folder: Path, stack: ExitStack) -> None:
        self._folder, self._stack = folder, stack
        self._relay = self.run("link", "relay", "--port", "0")
        self.via = f"127.0.0.1:{self._relay.report()['port']}"

    def run(self, *args: str, **more: Any) -> Running:
        running = Running(*args, **more)
        self._stack.callback(running.close)
        return running

    def log(self, station_id: int) -> Path:
        return self._folder / f"{station_id}.ndjson"

    def station(self, station_id: int, *args: str, **more: Any) -> Running:
        """A station that is on the air."""
        where = ("--id", str(station_id), "--via", self.via, "--log", str(self.log(station_id)))
        running = self.run("station", *where, *QUICK, *args, **more)
        while not self.log(station_id).exists() and running.process.poll() is None:
            time.sleep(0.02)
        return running

    def prescriber(self, *args: str, **more: Any) -> Running:
        asks = ("--request-after", "300", "--target", str(RECEIVER), "--no-concerned")
        return self.station(PRESCRIBER, *asks, *args, **more)


@contextmanager
def road(folder: Path) -> Iterator[Road]:
    with ExitStack() as stack:
        yield Road(folder, stack)
