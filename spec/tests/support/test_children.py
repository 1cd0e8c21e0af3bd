"""Children end when their parent is killed."""

import os
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from automcm_spec.support import children

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="the kernel's part is Linux's")

PARENT = """
import os, subprocess, sys
from automcm_spec.support import children
{start}
os.write(1, b"%d\\n" % child.pid)  # in one piece: a child may write beside it
input()
"""
STARTS = {
    "popen": "child = children.popen(['sleep', '60'])",
    "popen of a group": "child = children.popen(['sleep', '60'], group=True)",
    "ending with parent": "child = subprocess.Popen(children.ending_with_parent(['sleep', '60']))",
}
POOL = """
import multiprocessing, os, sys, time
from automcm_spec.support import children

def work(n):
    os.write(1, b"%d\\n" % os.getpid())
    time.sleep(60)

if __name__ == "__main__":
    context = multiprocessing.get_context(sys.argv[1])
    context.Pool(2, children.end_with_parent).map(work, range(2), 1)
"""


def alive(pid: int) -> bool:
    """Whether a process runs; a zombie that init has not reaped yet does not."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()[0] != "Z"
    except FileNotFoundError:
        return False


def until(true: Callable[[], bool]) -> bool:
    due = time.monotonic() + 20
    while not true():
        if time.monotonic() > due:
            return False
        time.sleep(0.01)
    return True


@pytest.fixture
def parent() -> Iterator[Callable[..., subprocess.Popen[str]]]:
    """Starts a parent, which is killed at the end at the latest."""
    started = []

    def start(code: str, *arguments: str) -> subprocess.Popen[str]:
        command = [sys.executable, "-c", code, *arguments]
        pipe = subprocess.PIPE
        started.append(subprocess.Popen(command, stdin=pipe, stdout=pipe, text=True))
        return started[-1]

    yield start
    for process in started:
        process.kill()
        process.communicate()


def pid_from(process: subprocess.Popen[str]) -> int:
    assert process.stdout is not None
    return int(process.stdout.readline())


@pytest.mark.parametrize("how", STARTS)
def test_a_child_ends_when_its_parent_is_killed(how: str, parent: Any) -> None:
    process = parent(PARENT.format(start=STARTS[how]))
    pid = pid_from(process)
    assert until(lambda: Path(f"/proc/{pid}/cmdline").read_bytes().startswith(b"sleep"))
    process.kill()
    process.wait()
    assert until(lambda: not alive(pid))


def test_a_group_ends_as_a_whole_and_a_watcher_with_it(parent: Any) -> None:
    """Also the child of a child that hears nothing, and after its own parent has ended."""
    shell = "['sh', '-c', '(trap \"\" HUP INT TERM; sleep 60) & echo $! && exec sleep 60']"
    process = parent(PARENT.format(start=f"child = children.popen({shell}, group=True)"))
    pids = {pid_from(process), pid_from(process)}
    group = os.getpgid(min(pids))
    members = [int(p.name) for p in Path("/proc").iterdir() if p.name.isdigit() and of(p, group)]
    assert len(members) == 3  # two sleep, one watches
    process.kill()
    process.wait()
    assert until(lambda: not any(map(alive, [*members, *pids])))


def of(path: Path, group: int) -> bool:
    try:
        return os.getpgid(int(path.name)) == group
    except ProcessLookupError:
        return False


def test_the_watcher_is_no_child_of_the_command_and_holds_no_pipe() -> None:
    """A command that waits for all of its children waits for none of ours."""
    code = "import os\ntry: os.wait()\nexcept ChildProcessError: print('none')"
    with children.popen([sys.executable, "-c", code], group=True, stdout=subprocess.PIPE) as child:
        assert child.communicate(timeout=20) == (b"none\n", None)  # to the end of the pipe
        os.killpg(child.pid, signal.SIGKILL)


def test_the_command_is_not_run_if_the_parent_has_ended_before(tmp_path: Path) -> None:
    command = children.ending_with_parent(["touch", str(tmp_path / "run")])
    at = command.index(str(os.getpid()))
    command[at] = str(os.getpid() + 1)
    assert subprocess.run(command).returncode == 127
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("start", ["fork", "spawn", "forkserver"])
def test_processes_of_a_pool_end_when_their_parent_is_killed(start: str, tmp_path: Path) -> None:
    path = tmp_path / "pool.py"
    path.write_text(POOL)
    command = [sys.executable, str(path), start]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        pids = [pid_from(process), pid_from(process)]
        process.kill()
    assert until(lambda: not any(map(alive, pids)))


@pytest.mark.parametrize(
    ("content", "error"),
    [
        (None, FileNotFoundError),
        ("#!/nowhere/at/all\n", FileNotFoundError),
        ("no program", OSError),
    ],
)
def test_what_cannot_be_started_is_the_error_that_popen_raises(
    content: str | None, error: type[OSError], tmp_path: Path
) -> None:
    path = tmp_path / "program"
    if content is not None:
        path.write_text(content)
        path.chmod(0o755)
    before = len(os.listdir("/proc/self/fd"))
    with pytest.raises(error) as ours:
        children.popen([str(path)], stdin=subprocess.PIPE, stdout=subprocess.PIPE)
    with pytest.raises(error) as theirs:
        subprocess.Popen([str(path)])
    assert (ours.value.errno, ours.value.filename) == (theirs.value.errno, str(path))
    assert len(os.listdir("/proc/self/fd")) == before


def test_an_error_without_a_pipe_is_a_line() -> None:
    done = subprocess.run(
        children.ending_with_parent(["/nowhere/at/all"]), capture_output=True, text=True
    )
    assert done.returncode == 127
    assert done.stderr == "/nowhere/at/all cannot be started: No such file or directory\n"


def test_a_child_has_the_signals_and_the_files_of_popen(tmp_path: Path) -> None:
    """Python ignores SIGPIPE, and child processes inherit that."""
    command = ["/bin/sh", "-c", "grep ^Sig[^Q] /proc/self/status; ls /proc/self/fd; exit 7"]
    plain = subprocess.run(command, capture_output=True, text=True, cwd=tmp_path)
    with children.popen(command, stdout=subprocess.PIPE, text=True, cwd=tmp_path) as child:
        out, _ = child.communicate()
    assert out == plain.stdout
    assert child.returncode == 7


@pytest.mark.parametrize("place", ["Popen", "send", "recv"])
def test_interrupted_while_a_command_is_started_it_does_not_run(
    place: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    class Popen(subprocess.Popen[bytes]):
        def __init__(self, *args: Any, **options: Any) -> None:
            super().__init__(*args, **options)
            started.append(self)
            if place == "Popen":
                raise KeyboardInterrupt

    def interrupt(*_: Any) -> int:
        raise KeyboardInterrupt

    started: list[Popen] = []
    monkeypatch.setattr(subprocess, "Popen", Popen)
    if place != "Popen":
        socket_ = type("Socket", (socket.socket,), {place: interrupt})
        monkeypatch.setattr(socket, "socket", socket_)
    with pytest.raises(KeyboardInterrupt):
        children.popen(["sleep", "60"])
    assert started[0].wait(timeout=20) != 0


def test_elsewhere_commands_are_as_given(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(children, "_LINUX", False)
    assert children.ending_with_parent(["x"], group=True) == ["x"]
    with children.popen(["sh", "-c", "ps -o sid= -p $$"], group=True, stdout=-1) as child:
        assert int(child.stdout.read()) == child.pid


def test_a_process_of_a_pool_keeps_nothing_open_of_another_thread() -> None:
    """A lock that it kept would stop TLC in all threads until the pool ends: for ever, if the work
    of the pool waits for TLC."""
    ours, theirs = os.pipe()
    os.set_blocking(ours, False)
    with children.pool(1) as pool:
        pool.submit(os.getpid).result()
        os.close(theirs)
        assert os.read(ours, 1) == b""  # BlockingIOError if another process has it open
    os.close(ours)
