"""Stations and commands as forks of this process, which has imported all that they import: to start
Python and import it again takes longer than what most tests do with them."""

from __future__ import annotations

import gc
import os
import subprocess
import sys
import traceback
from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager, nullcontext
from functools import cache, partial
from typing import Any, NoReturn

from automcm.adapters import adapter_lines
from automcm_cli.__main__ import main
from automcm_maintenance.code_mutation import faults
from automcm_spec.support import children

ADAPTER = adapter_lines.__name__
load = cache(faults.load)
popen = children.popen


def forked(command: Sequence[str], *, group: bool = False, **options: Any) -> subprocess.Popen[Any]:
    """``children.popen``, or a fork of the reference, of the reference with a fault, or of code
    that uses it.  Not of code that has something done when Python ends."""
    fault: AbstractContextManager[None] = nullcontext()
    station: Callable[[], object] = adapter_lines.main
    argv = list(command[2:])
    match command:
        case [sys.executable, "-m", module] if module == ADAPTER:
            pass
        case [sys.executable, "-m", faults.__name__, catalogue, name, module, *arguments] if (
            module == ADAPTER
        ):
            fault, argv = faults.put(load(catalogue)[name]), [module, *arguments]
        case [sys.executable, "-c", code] if "automcm.adapters" in code and "atexit" not in code:
            station = partial(exec, code, {"__name__": "__main__"})
        case _:
            return popen(command, group=group, **options)
    try:
        with fault:
            return fork(station, argv, start_new_session=group, **options)
    except faults.FaultError:  # not in a function: modules must be imported anew
        return popen(command, group=group, **options)


def automcm_popen(*words: object, **options: Any) -> subprocess.Popen[str]:
    """``automcm`` with these words."""
    return fork(main, ["automcm", *map(str, words)], text=True, **options)


def fork(program: Callable[[], object], argv: list[str], **options: Any) -> subprocess.Popen[Any]:
    """A child with the signals of Python, which ignores SIGPIPE and SIGXFSZ."""
    start = partial(run, program, argv)
    return subprocess.Popen(argv, preexec_fn=start, restore_signals=False, **options)


def run(program: Callable[[], object], argv: list[str]) -> NoReturn:
    """In the child: run it with its own standard streams and no other file, and end."""
    status = 1
    sys.argv = argv
    gc.disable()  # else a file of the parent may be closed, whose number another has here
    try:
        os.closerange(3, os.sysconf("SC_OPEN_MAX"))
        streams = (os.fdopen(n, mode, closefd=False) for n, mode in enumerate("rww"))
        sys.stdin, sys.stdout, sys.stderr = streams
        program()
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
