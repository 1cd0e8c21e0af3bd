"""A station one of whose system calls begins to fail in a given phase; run by faults.py.

    faulty_station.py FAULT ROLE PHASE TRUTH_FD [option of automcm station] ...

What the station really does goes to TRUTH_FD as lines of JSON, past all that is made to fail.
"""

from __future__ import annotations

import errno
import io
import json
import os
import random
import resource
import selectors
import signal
import socket
import sys
import threading
import time
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

from automcm.core.state import State
from automcm.core.station import Effects
from automcm.service import line_output, service, station_process
from automcm_cli.main import app
from automcm_simulation.road.straight_lane import Straight

_write, _monotonic = os.write, time.monotonic
FOREVER = threading.Event()
JUMP_S = 10
LEFT_MB = 2
log_fds: set[int] = set()


def failing(number: int) -> Callable[..., Any]:
    """A system call that fails from now on."""

    def fail(*args: Any, **more: Any) -> Any:
        raise OSError(number, os.strerror(number))

    return fail


def writes(fds: Callable[[int], bool], do: Callable[..., Any]) -> None:
    """What becomes of a write to these descriptors."""
    os.write = lambda fd, data: do(fd, data) if fds(fd) else _write(fd, data)


def is_log(fd: int) -> bool:
    return fd in log_fds


def block(*args: Any) -> None:
    FOREVER.wait()


def torn(fd: int, data: bytes) -> int:
    """A disk that accepts half of the remaining bytes each time, and then none."""
    if len(data) < 16:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
    return _write(fd, data[: len(data) // 2])


def put(owner: Any, name: str, number: int) -> Callable[[], None]:
    return lambda: setattr(owner, name, failing(number))


def sometimes(number: int) -> Callable[[], None]:
    """Every third datagram, drawn with a seed, is refused."""

    def arm() -> None:
        chance, send = random.Random(1), socket.socket.sendto

        def sendto(self: socket.socket, *args: Any) -> int:
            if chance.random() < 1 / 3:
                raise OSError(number, os.strerror(number))
            return send(self, *args)

        socket.socket.sendto = sendto  # type: ignore[assignment,method-assign]

    return arm


def jump(seconds: float) -> Callable[[], None]:
    return lambda: setattr(time, "monotonic", lambda: _monotonic() + seconds)


def stand_still() -> None:
    now = _monotonic()
    time.monotonic = lambda: now


def suspend() -> None:
    """As if the host had slept."""
    asked = time.clock_gettime
    time.clock_gettime = lambda which: (
        asked(which) + (JUMP_S if which == time.CLOCK_BOOTTIME else 0)
    )


def no_memory() -> None:
    """Every fifth message that is encoded or decoded finds no memory."""
    chance = random.Random(1)

    def scarce(do: Callable[[Any], Any]) -> Callable[[Any], Any]:
        def may_fail(value: Any) -> Any:
            if chance.random() < 1 / 5:
                raise MemoryError
            return do(value)

        return may_fail

    service = running["service"]
    service.station._decode = scarce(service._codec.decode)
    service._codec = SimpleNamespace(encode=scarce(service._codec.encode))


def memory_limit() -> None:
    with open("/proc/self/statm") as file:
        pages = int(file.read().split()[0])
    size = pages * resource.getpagesize() + LEFT_MB * 2**20
    resource.setrlimit(resource.RLIMIT_AS, (size, resource.RLIM_INFINITY))


def no_descriptor() -> None:
    resource.setrlimit(resource.RLIMIT_NOFILE, (0, resource.getrlimit(resource.RLIMIT_NOFILE)[1]))


def no_file() -> None:
    for owner in (io, os):
        owner.open = failing(errno.EMFILE)  # type: ignore[attr-defined]


def raising(*names: str) -> Callable[[], None]:
    def bug(*args: Any) -> None:
        raise RuntimeError("a bug of the application")

    return lambda: [setattr(Straight, name, bug) for name in names] and None


def signals(*numbers: int) -> Callable[[], None]:
    return lambda: [os.kill(os.getpid(), number) for number in numbers] and None


def selecting() -> None:
    selectors.EpollSelector.select = failing(errno.EBADF)  # type: ignore[method-assign]


def nothing() -> None:
    """The control: what happens when nothing fails."""


FAULTS: dict[str, Callable[[], None]] = {
    "nothing": nothing,
    "send refused": put(socket.socket, "sendto", errno.ENETUNREACH),
    "send refused now and then": sometimes(errno.ENOBUFS),
    "receive fails": put(socket.socket, "recvfrom", errno.ENOBUFS),
    "select fails": selecting,
    "names cannot be looked up": put(socket, "getaddrinfo", errno.ENETUNREACH),
    "log: no space": lambda: writes(is_log, failing(errno.ENOSPC)),
    "log: input/output error": lambda: writes(is_log, failing(errno.EIO)),
    "log: space for half a line": lambda: writes(is_log, torn),
    "log: write blocks": lambda: writes(is_log, block),
    "standard output: no space": lambda: writes((1).__eq__, failing(errno.ENOSPC)),
    "standard output: closed": lambda: writes((1).__eq__, failing(errno.EPIPE)),
    "standard output: blocks": lambda: writes((1).__eq__, block),
    "every write blocks": lambda: writes(lambda fd: fd in log_fds | {1, 2}, block),
    "number file: no space": put(os, "fsync", errno.ENOSPC),
    "number file: rename fails": put(os, "replace", errno.EACCES),
    "no file can be opened": no_file,
    "no descriptor is free": no_descriptor,
    "memory limit": memory_limit,
    "no memory now and then": no_memory,
    "time jumps ahead": jump(JUMP_S),
    "time goes back": jump(-JUMP_S),
    "time stands still": stand_still,
    "the host sleeps": suspend,
    "the position raises": raising("kinematics"),
    "the application raises": raising("concerned", "choose", "verify", "load"),
    "SIGTERM": signals(signal.SIGTERM),
    "SIGTERM twice": signals(signal.SIGTERM, signal.SIGTERM),
    "SIGINT": signals(signal.SIGINT),
    "SIGHUP": signals(signal.SIGHUP),
    "SIGPIPE": signals(signal.SIGPIPE),
    "SIGUSR1": signals(signal.SIGUSR1),
    "SIGKILL": signals(signal.SIGKILL),
    "SIGSTOP": signals(signal.SIGSTOP),
}
running: dict[str, Any] = {}


def main() -> None:
    """Run the station; the fault begins when it is first in that phase and role."""
    signal.signal(signal.SIGHUP, signal.SIG_DFL)  # if faults.py runs under nohup
    fault, role, phase, truth = sys.argv[1], sys.argv[2], sys.argv[3], int(sys.argv[4])
    armed = False

    def tell(**fields: Any) -> None:
        _write(truth, json.dumps({"s": _monotonic()} | fields).encode() + b"\n")

    def look(st: State) -> None:
        nonlocal armed
        tell(phase=st.phase, marks=[list(mark) for mark in st.marks])
        if not armed and (st.phase, st.role) == (phase, role):
            armed = True
            tell(fault=fault)
            FAULTS[fault]()

    observe, start, create = (
        station_process.StationProcess._observe,
        service.McService.start,
        line_output.create,
    )

    def observed(self: Any, before: State, effects: Effects) -> None:
        look(effects.state)
        observe(self, before, effects)

    def started(self: service.McService) -> None:
        running["service"] = self
        start(self)
        tell(ready=True)
        look(self.state)

    def created(path: Any) -> Any:
        fd, created = create(path)
        log_fds.add(fd)
        return fd, created

    station_process.StationProcess._observe = observed  # type: ignore[method-assign]
    service.McService.start = started  # type: ignore[method-assign]
    station_process.create = created  # type: ignore[attr-defined]
    app(["station", *sys.argv[5:]])


if __name__ == "__main__":
    main()
