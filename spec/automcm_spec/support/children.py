"""Child processes that end with this process, even if it is killed (SIGKILL).

Commands end with their parent only on Linux; elsewhere a killed process leaves them running.
Starting a command takes about 15 ms longer.
"""

from __future__ import annotations

import mmap
import os
import signal
import socket
import subprocess
import sys
import threading
from collections.abc import Iterable, Sequence
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from concurrent.futures import ProcessPoolExecutor

_LAUNCHER = Path(__file__).with_name("launcher.py")
_LINUX = sys.platform == "linux"
MARK = "AUTOMCM_STATION"
"""The environment variable that marks a command and all its descendants, for ``descendants``."""


def ending_with_parent(command: Sequence[str], *, link: int = -1, group: bool = False) -> list[str]:
    """The command line that runs ``command`` as a child that ends with this process.

    The kernel ends it when the *thread* that started it ends, so start it from a long-lived thread.
    With ``group``, the command gets its own session, and its whole process group ends. ``link`` is
    for ``popen``.
    """
    if not _LINUX:
        return list(command)
    words = [sys.executable, "-I", "-S", str(_LAUNCHER)]
    return [*words, str(os.getpid()), str(link), str(int(group)), *command]


def popen(command: Sequence[str], *, group: bool = False, **options: Any) -> subprocess.Popen[Any]:
    """``subprocess.Popen`` of a command that ends with its parent.

    With ``group``, it runs in its own session.

    Returns when the command runs. Raises the exceptions of Popen if it cannot be started.
    """
    if not _LINUX:
        return subprocess.Popen(command, start_new_session=group, **options)
    name = command[0]
    ours, theirs = socket.socketpair()
    with ours, theirs:  # if interrupted, the closed link makes the launcher exit
        link = theirs.fileno()
        process = subprocess.Popen(
            ending_with_parent(command, link=link, group=group), pass_fds=(link,), **options
        )
        try:
            theirs.close()
            ours.send(b"1")
            failure = ours.recv(1000).decode()
        except BaseException:
            process.kill()
            process.wait()
            raise
    if failure:
        with process:
            number, _, why = failure.partition(" ")
            raise OSError(int(number), why, name)
    return process


def descendants(process: int, name: str) -> set[int]:
    """The ids of the processes outside the group of ``process``, which must not be reaped yet,
    that descend from it or carry its mark: those that called setsid, also if their parent has
    ended. Once ``process`` has ended, only the mark shows those whose parent has ended too. Only on
    Linux; elsewhere empty."""
    wanted, parents = f"{MARK}={name}".encode(), dict[int, int]()
    group = {process, os.getpid()}
    found = set[int]()
    for folder in Path("/proc").glob("[0-9]*") if _LINUX else ():
        number = int(folder.name)
        with suppress(OSError, ValueError, IndexError):  # it has ended, or is another user's
            stat = _stat(folder)
            if stat[0] == "Z":
                continue
            parents[number] = int(stat[1])
            if int(stat[2]) == process:
                group.add(number)
            if wanted in (folder / "environ").read_bytes().split(b"\0"):
                found.add(number)
    family = {process}
    while more := {child for child, parent in parents.items() if parent in family} - family:
        family |= more
    return (found | family) - group


def resident(group: int) -> int:
    """The bytes of main memory that the processes of a group use. Only on Linux; elsewhere 0."""
    pages = 0
    for folder in Path("/proc").glob("[0-9]*") if _LINUX else ():
        with suppress(OSError):  # it has ended
            stat = _stat(folder)
            pages += int(stat[21]) if int(stat[2]) == group else 0
    return pages * mmap.PAGESIZE


def _stat(folder: Path) -> list[str]:
    """The fields of a process after its name, from the state on; the name may have blanks."""
    return (folder / "stat").read_text(errors="replace").rpartition(")")[2].split()


def opened(processes: Iterable[int]) -> dict[int, int]:
    """File descriptors of these processes, by their ids, for ``signal.pidfd_send_signal``: another
    process that gets the id later is not meant. Without those that have ended; empty before Linux
    5.3."""
    found = {}
    for number in processes:
        with suppress(OSError):
            found[number] = os.pidfd_open(number)
    return found


def pool(processes: int) -> ProcessPoolExecutor:
    """A pool of processes that end with this one.

    They are spawned, because a fork would keep the locks and pipes that another thread has just
    opened: every later run of TLC would wait for it.
    """
    import multiprocessing
    from concurrent.futures import ProcessPoolExecutor

    spawn = multiprocessing.get_context("spawn")
    return ProcessPoolExecutor(processes, spawn, initializer=end_with_parent)


def end_with_parent() -> None:
    """Call first in a process of multiprocessing: makes it end when its parent ends."""
    from multiprocessing import parent_process

    parent = parent_process()
    if parent is None:
        return

    def wait() -> None:
        parent.join()
        os.kill(os.getpid(), signal.SIGKILL)

    threading.Thread(target=wait, daemon=True).start()
