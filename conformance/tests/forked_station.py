"""Stations and commands as forks of this process, which has imported all that they import: to start
Python and import it again takes longer than what most tests do with them."""

from __future__ import annotations

import gc
import os
import subprocess
import sys
import traceback
from collections.abc import Callable, Sequence
from functools import cache, partial
from typing import Any, NoReturn

from automcm.adapters import adapter_lines
from automcm_cli.__main__ import main
from automcm_maintenance.code_mutation import faults
from automcm_spec.support import children

ADAPTER = adapter_lines.__name__
load = cache(faults.load)
popen = children.popen


def program(command: Sequence[str]) -> Callable[[], object] | None:
    """What a station does once it is forked; None for other commands, and for stations that have
    something done when Python ends."""
    match command:
        case [sys.executable, "-m", module] if module == ADAPTER:
            return adapter_lines.main
        case [sys.executable, "-m", faults.__name__, catalogue, name, module, *arguments] if (
            module == ADAPTER
        ):
            return partial(broken, load(catalogue)[name], command, arguments)
        case [sys.executable, "-c", code] if "automcm.adapters" in code and "atexit" not in code:
            return partial(exec, code, {"__name__": "__main__"})
    return None


def broken(fault: faults.Fault, command: Sequence[str], arguments: Sequence[str]) -> None:
    """The reference with a fault.  If that is not in a function, modules must be imported anew."""
    sys.argv[1:] = arguments
    try:
        with faults.put(fault):
            adapter_lines.main()
    except faults.FaultError:
        os.execv(command[0], command)


def forked(command: Sequence[str], *, group: bool = False, **options: Any) -> subprocess.Popen[Any]:
    """``children.popen``, or a fork where that is possible."""
    station = program(command)
    if station is None:
        return popen(command, group=group, **options)
    run_it = partial(run, station)
    return subprocess.Popen(command, preexec_fn=run_it, start_new_session=group, **options)


def automcm_popen(*words: object, **options: Any) -> subprocess.Popen[str]:
    """``automcm`` with these words."""
    argv = ["automcm", *map(str, words)]

    def command() -> None:
        sys.argv = argv
        main()

    return subprocess.Popen(argv, preexec_fn=partial(run, command), text=True, **options)


def run(station: Callable[[], object]) -> NoReturn:
    """In the child: run it with its own standard streams and no other file, and end."""
    status = 1
    try:
        os.closerange(3, os.sysconf("SC_OPEN_MAX"))
        streams = (os.fdopen(n, mode, closefd=False) for n, mode in enumerate("rww"))
        sys.stdin, sys.stdout, sys.stderr = streams
        gc.freeze()  # no file of the parent is closed, whose number another may have here
        station()
        status = 0
    except SystemExit as end:
        status = end.code if isinstance(end.code, int) else int(end.code is not None)
        if isinstance(end.code, str):
            print(end.code, file=sys.stderr)
    except BaseException:
        traceback.print_exc()
    finally:
        try:
            sys.stdout.flush()
            sys.stderr.flush()
        finally:
            os._exit(status)
