"""Executes a command as a child that ends with its parent (``children``).

    python -I -S launcher.py PARENT LINK GROUP COMMAND...

PARENT is the process id of the parent. LINK is a socket to it, or -1. GROUP is 1 to run the command
in its own session, end its whole process group, and make it the parent of its orphans. The parent
sends a byte over the link when the command may run; if it cannot be started, the errno and the
reason are sent back. Linux only. It is run as a file, without any package.
"""

import ctypes
import os
import select
import signal
import sys

_PR_SET_PDEATHSIG = 1
_PR_SET_CHILD_SUBREAPER = 36
_NOT_STARTED = 127


def _main() -> None:
    parent, link, group = (int(word) for word in sys.argv[1:4])
    command = sys.argv[4:]
    ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)
    watched = _opened(parent) if group else None
    if os.getppid() != parent:
        os._exit(_NOT_STARTED)  # the parent ended before prctl
    if group:
        os.setsid()
    if watched is not None:
        _watch(watched)
    if group:  # after _watch: the watcher must not become a child of the command
        ctypes.CDLL(None).prctl(_PR_SET_CHILD_SUBREAPER, 1)
    if link >= 0:
        os.set_inheritable(link, False)
        if not os.read(link, 1):
            os._exit(_NOT_STARTED)  # the parent was interrupted
    for number in (signal.SIGPIPE, signal.SIGXFSZ):
        signal.signal(number, signal.SIG_DFL)  # Python ignores them, and exec would keep that
    try:
        os.execvp(command[0], command)
    except OSError as problem:
        why = _wrong_file(problem.errno, command[0]) or problem.strerror
        if link < 0:
            print(f"{command[0]} cannot be started: {why}", file=sys.stderr)
        else:
            os.write(link, f"{problem.errno} {why}".encode())
        sys.exit(_NOT_STARTED)


def _wrong_file(number: int | None, command: str) -> str:
    """Why a file that exists cannot be executed; empty if the errno says it."""
    import errno
    import shutil

    path = shutil.which(command)
    if path is None or number not in (errno.ENOENT, errno.ENOEXEC):
        return ""
    with open(path, "rb") as file:
        first = file.readline(256)
    if first.startswith(b"\xef\xbb\xbf"):
        return "it begins with a byte order mark; write UTF-8 without one"
    if number == errno.ENOEXEC:
        return "it is neither a program of this system nor a script that begins with #!INTERPRETER"
    if not first.startswith(b"#!"):
        return "its program loader does not exist: was it built for another system?"
    interpreter = first[2:].strip(b" \t\n").replace(b"\t", b" ").split(b" ")[0]
    crlf = "; write its lines with LF, not CR LF" if interpreter.endswith(b"\r") else ""
    return f"its interpreter {interpreter.decode(errors='replace')!r} does not exist{crlf}"


def _opened(process: int) -> int | None:
    """A file descriptor of a process; None before Linux 5.3."""
    try:
        return os.pidfd_open(process)
    except OSError:
        return None


def _watch(parent: int) -> None:
    """Start a process in this group that kills the group when the parent ends.

    The kernel's signal reaches only the leader. The watcher is not a child of the command, which
    may wait for all its children, and holds none of its pipes.
    """
    child = os.fork()
    if child:
        os.waitpid(child, 0)
        return
    if os.fork():
        os._exit(0)
    os.closerange(0, parent)
    os.closerange(parent + 1, os.sysconf("SC_OPEN_MAX"))
    select.select([parent], [], [])
    os.killpg(0, signal.SIGKILL)


if __name__ == "__main__":
    _main()
