"""Exit codes when output cannot be written and when AutoMCM itself fails.

A full device, a closed pipe or a closed descriptor must not lead to exit code 1, which reports a
failed check.
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

from automcm_cli.shared.common import in_words
from automcm_spec.support.bad_input import BadInput, printable

UNWRITTEN, FAULT, CLOSED_PIPE = 3, 70, 141
"""Exit codes (``common.CODES``).  A shell reports 141 for a process that SIGPIPE ended."""

_INTERNAL_ERROR = (
    "internal error in automcm, not a verdict: please report it with the lines above, the "
    "command and the output of `automcm --version`"
)


class OutputLost(BaseException):
    """Standard output cannot be written.

    It is a BaseException so that neither typer, rich nor an ``except OSError`` in a command catches
    it.  A command that continues without its output (a station) writes to the descriptor itself.
    """

    def __init__(self, error: OSError) -> None:
        self.closed_pipe = error.errno == errno.EPIPE
        super().__init__(f"standard output: {error.strerror}")


class _Standard(io.FileIO):
    """Standard output.  After the first failure it drops all data, so that neither a later write
    nor the interpreter's final flush reports the failure again."""

    def __init__(self, number: int) -> None:
        super().__init__(number, "w", closefd=False)
        self._lost = False

    def write(self, data: Any, /) -> int:
        """Write all data.  Raises OutputLost.

        Under PYTHONUNBUFFERED there is no buffer that repeats a partial write to a pipe.  Empty
        data is not written: typer writes it to find the type of a stream.
        """
        view = memoryview(data).cast("B")
        at = 0
        while at < len(view) and not self._lost:
            try:
                taken = super().write(view[at:])
            except OSError as error:
                self._lost = True
                raise OutputLost(error) from None
            if taken is None:  # the descriptor is non-blocking
                select.select([], [self], [])
            at += taken or 0
        return len(view)


class _Errors(_Standard):
    """Standard error.  A failed write changes no exit code."""

    def write(self, data: Any, /) -> int:
        """Write the data; ignore a failure."""
        try:
            return super().write(data)
        except OutputLost:
            return memoryview(data).nbytes


class _Visible:
    """A text stream on which no text controls the terminal; ``say`` also keeps it to its line.

    Rich writes to ``rich_proxied_file``, for ``Terminal`` has escaped the text between its escape
    sequences.
    """

    def __init__(self, stream: io.TextIOWrapper) -> None:
        self.rich_proxied_file = stream

    def write(self, text: str) -> int:
        """Write text with escapes for unprintable characters except line feeds."""
        return self.rich_proxied_file.write(printable(text, "\n"))

    def __getattr__(self, name: str) -> Any:
        return getattr(self.rich_proxied_file, name)


def run(program: Callable[[], object]) -> int:
    """Run the program and return its exit code.  The program raises SystemExit or returns."""
    _open_closed_descriptors()
    sys.stdout = out = _text(_Standard(1), sys.stdout)
    sys.stderr = _text(_Errors(2), sys.stderr)
    try:
        code = _code_of(program)
        out.flush()
        return _report_error(_INTERNAL_ERROR, FAULT) if code == FAULT else code
    except OutputLost as lost:
        return CLOSED_PIPE if lost.closed_pipe else _report_error(str(lost), UNWRITTEN)
    except (BadInput, OSError) as error:
        return _report_error(in_words(error), UNWRITTEN)
    except Exception:
        traceback.print_exc()
        return _report_error(_INTERNAL_ERROR, FAULT)


def _code_of(program: Callable[[], object]) -> int:
    try:
        program()
    except SystemExit as end:
        return end.code if isinstance(end.code, int) else int(end.code is not None)
    return 0


def _open_closed_descriptors() -> None:
    """Open those of the descriptors 0, 1 and 2 that are closed.

    Otherwise the next file that is opened takes the number and receives the printed text.  They are
    opened for reading only, so that output fails as it does on a closed descriptor.
    """
    for number in (0, 1, 2):
        try:
            os.fstat(number)
        except OSError:
            os.open(os.devnull, os.O_RDONLY)  # takes the lowest free number


def _text(raw: _Standard, was: Any) -> Any:
    """A text stream on ``raw`` with the settings of ``was`` (None if the descriptor was closed)."""
    options: dict[str, Any] = {"encoding": "utf-8", "errors": "backslashreplace"}
    if was is not None:
        was.flush()
        names = ("encoding", "errors", "line_buffering", "write_through")
        options = {name: getattr(was, name) for name in names}
    buffered = raw if options.get("write_through") else io.BufferedWriter(raw)
    return _Visible(io.TextIOWrapper(buffered, **options))


def _report_error(text: str, code: int) -> int:
    print(f"automcm: {printable(text)}", file=sys.stderr)
    return code
