"""How the program ends where its output cannot be written, or where the fault is ours.

A verdict that was not written is none: a full device, a closed pipe or a closed descriptor must
not end with 1, which is a verdict against.
"""

from __future__ import annotations

import errno
import io
import os
import select
import sys
import traceback
from collections.abc import Callable
from typing import Any

from automcm_spec.support.bad_input import BadInput

UNWRITTEN, FAULT, CLOSED_PIPE = 3, 70, 141
"""Exit codes (``common.CODES``).  141 is what a shell makes of an end by SIGPIPE."""


_OURS = (
    "this is a fault of automcm, not a verdict: please report it with the lines above, the "
    "command and what `automcm --version` says"
)


class OutputLost(BaseException):
    """Standard output cannot be written.  Neither typer, rich nor an ``except OSError`` of a
    command takes it for something else; a command that goes on without its output (a station)
    writes to the descriptor itself."""

    def __init__(self, error: OSError) -> None:
        self.closed_pipe = error.errno == errno.EPIPE
        super().__init__(f"standard output: {error.strerror}")


class _Standard(io.FileIO):
    """Standard output.  After the first failure everything is dropped, so that nothing is told
    twice, nor by the interpreter when it flushes at its end."""

    def __init__(self, number: int) -> None:
        super().__init__(number, "w", closefd=False)
        self._lost = False

    def write(self, data: Any, /) -> int:
        """All of it; raises OutputLost.

        Under PYTHONUNBUFFERED there is no buffer above, which would write again what a pipe has
        not taken.  Nothing is not written: typer does that to see what a stream takes.
        """
        view = memoryview(data).cast("B")
        at = 0
        while at < len(view) and not self._lost:
            try:
                taken = super().write(view[at:])
            except OSError as error:
                self._lost = True
                raise OutputLost(error) from None
            if taken is None:  # the descriptor does not block
                select.select([], [self], [])
            at += taken or 0
        return len(view)


class _Errors(_Standard):
    """Standard error: what cannot be written there changes no verdict."""

    def write(self, data: Any, /) -> int:
        """All of it, as far as that can be."""
        try:
            return super().write(data)
        except OutputLost:
            return memoryview(data).nbytes


def run(program: Callable[[], object]) -> int:
    """Run the program; its exit code.  It ends by SystemExit, or by returning."""
    _take_up_descriptors()
    sys.stdout = out = _text(_Standard(1), sys.stdout)
    sys.stderr = _text(_Errors(2), sys.stderr)
    try:
        code = _code_of(program)
        out.flush()
        return _told(_OURS, FAULT) if code == FAULT else code
    except OutputLost as lost:
        return CLOSED_PIPE if lost.closed_pipe else _told(str(lost), UNWRITTEN)
    except BadInput as error:
        return _told(str(error), UNWRITTEN)
    except OSError as error:
        where = f"{error.filename}: " if error.filename else ""
        return _told(f"{where}{error.strerror or error}", UNWRITTEN)
    except Exception:
        traceback.print_exc()
        return _told(_OURS, FAULT)


def _code_of(program: Callable[[], object]) -> int:
    try:
        program()
    except SystemExit as end:
        return end.code if isinstance(end.code, int) else int(end.code is not None)
    return 0


def _take_up_descriptors() -> None:
    """Open what is closed of 0, 1 and 2, or the next file opened takes its place and gets what is
    printed.  Output fails there as it does on a closed descriptor: it is open for reading."""
    for number in (0, 1, 2):
        try:
            os.fstat(number)
        except OSError:
            os.open(os.devnull, os.O_RDONLY)  # the lowest that is free


def _text(raw: _Standard, was: Any) -> io.TextIOWrapper:
    """Text on ``raw``, as it was (None where the descriptor was closed)."""
    if was is None:
        return io.TextIOWrapper(io.BufferedWriter(raw), encoding="utf-8", errors="backslashreplace")
    was.flush()
    return io.TextIOWrapper(
        raw if was.write_through else io.BufferedWriter(raw),
        encoding=was.encoding,
        errors=was.errors,
        line_buffering=was.line_buffering,
        write_through=was.write_through,
    )


def _told(text: str, code: int) -> int:
    print(f"automcm: {text}", file=sys.stderr)
    return code
