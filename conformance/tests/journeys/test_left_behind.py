"""What a command leaves behind when it is killed, told to stop or cannot write: nothing."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from cli_stage import AUTOMCM, automcm
from test_children import until

MARK = "AUTOMCM_TEST_MARK"
"""In the environment of a command, and so in that of all that it starts."""
LIMIT_S = 30
HANGS = """
import subprocess, sys, time
subprocess.Popen([sys.executable, "-c", "import time; time.sleep(99)"], start_new_session={away})
time.sleep(99)
"""

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="processes are looked for in /proc")


@pytest.fixture
def home(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv(MARK, str(tmp_path))
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.fixture
def running(home: Path) -> Iterator[Callable[[], list[str]]]:
    """The command lines of all that was started here and runs."""

    def found() -> list[str]:
        return list(started().values())

    def started() -> dict[int, str]:
        lines = {}
        for path in Path("/proc").iterdir():
            try:
                if path.name.isdigit() and f"{MARK}={home}".encode() in read(path, "environ"):
                    lines[int(path.name)] = read(path, "cmdline").replace(b"\0", b" ").decode()
            except OSError:  # it has ended, or is another user's
                continue
        return lines

    def read(path: Path, name: str) -> bytes:
        return (path / name).read_bytes()

    yield found
    for pid in started():
        os.kill(pid, signal.SIGKILL)


def start(arguments: list[str]) -> subprocess.Popen[bytes]:
    quiet = subprocess.DEVNULL
    return subprocess.Popen([*AUTOMCM, *arguments], stdin=quiet, stdout=quiet, stderr=quiet)


COMMANDS: dict[str, tuple[list[str], str, int]] = {
    "TLC": (["spec", "check", "one_by_three"], "tlc2.TLC", 1),
    "an adapter": (
        ["conform", "run", "MUST", "--", sys.executable, "-c", HANGS.format(away=False)],
        "time.sleep(99)",
        3,  # the kit names it too
    ),
    "the demonstration": (
        ["demo", "--out", "logs", "--listen", "60000"],  # they say nothing meanwhile
        " station --first",
        4,
    ),
    "a sweep": (
        [*("experiment", "bandwidth", "--workers", "2", "--out", "out"), "--profile", "standard"],
        "spawn_main",
        2,
    ),
}


def test_a_command_that_fails_leaves_no_folder(home: Path) -> None:
    assert automcm("conform", "run", "--", "./none").exit_code == 3
    assert not list(home.glob("runs"))


@pytest.mark.sweep(1)
@pytest.mark.parametrize("what", COMMANDS)
def test_a_command_that_is_killed_leaves_no_process(
    what: str, home: Path, running: Callable[[], list[str]]
) -> None:
    arguments, child, number = COMMANDS[what]
    process = start(arguments)
    begun = until(lambda: sum(child in line for line in running()) >= number)
    lines = running()
    process.kill()
    process.wait()
    assert begun, lines
    assert until(lambda: not running()), running()


@pytest.mark.slow
def test_what_a_killed_command_left_is_removed_by_the_next(
    home: Path, running: Callable[[], list[str]]
) -> None:
    left = home / "automcm" / "scratch"
    process = start(["spec", "check", "one_by_three"])
    assert until(lambda: any("tlc2.TLC" in line for line in running()))
    process.kill()
    process.wait()
    assert list(left.iterdir())
    done = subprocess.run([*AUTOMCM, "spec", "check", "bare_ack"], capture_output=True)
    assert done.returncode == 0 and list(left.iterdir()) == []


@pytest.mark.sweep(1)
@pytest.mark.parametrize("how", [signal.SIGTERM, signal.SIGINT])
def test_a_command_that_is_told_to_stop_leaves_nothing(
    how: signal.Signals, home: Path, running: Callable[[], list[str]]
) -> None:
    process = start(["spec", "check", "one_by_three"])
    assert until(lambda: any("tlc2.TLC" in line for line in running()))
    process.send_signal(how)
    process.wait(timeout=LIMIT_S)
    assert until(lambda: not running()), running()
    assert list((home / "automcm" / "scratch").iterdir()) == []
