"""Shared by all commands: the exit codes, ``--json`` and the status line."""

from __future__ import annotations

import difflib
import json
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from automcm_spec.support import files
from automcm_spec.support.bad_input import printable

if TYPE_CHECKING:
    from rich.console import Console
    from rich.table import Table

CODES = (
    "Exit codes: 0 success; 1 a check failed; 2 usage error; 3 a tool could not be run, or an "
    "input or output failed; 4 cannot tell; 70 internal error; 130 interrupted; 141 the reader "
    "closed standard output."
)

Json = Annotated[
    Path | None,
    typer.Option(
        "--json", help="Write the report as JSON to this file, or to standard output (-)."
    ),
]

Late = Annotated[
    int | None,
    typer.Option(help="Tolerated delay of a timer in ms.  Default: t_resend / 2.", min=0),
]


def example(command: str, more: str = "") -> str:
    """The example of a command's help, and further text."""
    return f"Example: automcm {command}.  {more}".strip()


def say(line: object = "", *, err: bool = False) -> None:
    """Print one line, with escapes for all characters that could end it or control a terminal.

    Commands print text with it or on a ``Terminal``, since much of it is from logs, adapters,
    certificates and file names.
    """
    typer.echo(printable(str(line)), err=err)


def say_lines(text: str, *, err: bool = False) -> None:
    """Print a text whose line feeds are ours."""
    for line in text.split("\n"):
        say(line, err=err)


def in_words(error: Exception) -> str:
    """The text of an error; one of the operating system names the file first."""
    if not isinstance(error, OSError) or not error.strerror:
        return str(error)
    return f"{error.filename}: {error.strerror}" if error.filename else error.strerror


@contextmanager
def code_3(command: str, *errors: type[Exception]) -> Iterator[None]:
    """Exit with code 3 and a one-line message if one of these errors is raised.

    The message is followed by the last lines that an adapter wrote to standard error.
    """
    try:
        yield
    except errors as error:
        put = say_lines if getattr(error, "own_lines", False) else say
        put(f"{command}: {in_words(error)}", err=True)
        for line in getattr(error, "stderr", ()):
            say(f"  {line!r}", err=True)
        raise typer.Exit(3) from None


@contextmanager
def usage(*errors: type[Exception]) -> Iterator[None]:
    """Turn these errors into a usage error (code 2)."""
    try:
        yield
    except errors as error:
        raise typer.BadParameter(str(error)) from None


def unknown(name: str, known: Sequence[str], what: str = "model") -> str:
    """The message for an unknown name, with the nearest known names."""
    near = difflib.get_close_matches(name, known, n=3, cutoff=0.4)
    nearest = f"; nearest: {', '.join(near)}" if near else f"; there are: {', '.join(known)}"
    return f"there is no {what} {name!r}{nearest}"


def two_numbers(text: str, sign: str, what: str, option: str) -> tuple[int, int]:
    """The numbers on both sides of a sign.  ``what`` describes the expected text, with an example.

    Raises typer.BadParameter.
    """
    parts = text.split(sign)
    if len(parts) != 2 or not all(part.isascii() and part.isdigit() for part in parts):
        raise typer.BadParameter(f"expected {what}, not {text!r}", param_hint=option)
    return int(parts[0]), int(parts[1])


def write_json(target: Path | None, value: Any) -> bool:
    """Write a report for ``--json`` if there is a target.  Exits with code 3 on failure.

    Returns whether standard output is free for text.
    """
    if target is None:
        return True
    text = json.dumps(value, indent=2) + "\n"
    if str(target) == "-":
        sys.stdout.write(text)  # automcm_cli.exit_codes handles a failure
        return False
    with code_3("--json", OSError):
        files.write(target, text, named=True)
    return True


@contextmanager
def progress(piped: bool = False) -> Iterator[Callable[[str], None]]:
    """A status line on a terminal; no output to a pipe, or with ``piped`` lines."""
    from automcm_cli.shared.terminal import Terminal

    console = Terminal(stderr=True)
    if not console.is_terminal:
        yield lambda text: say(text, err=True) if piped else None
        return
    with console.status("") as status:
        yield lambda text: status.update(text)


def console_of(columns: int = 100) -> Console:
    """A console as wide as the terminal, or of this many columns without a terminal."""
    from automcm_cli.shared.terminal import Terminal

    console = Terminal()
    return console if console.is_terminal else Terminal(width=columns)


def table_of(*columns: str, words: int = 1) -> Table:
    """A table without lines.  The first ``words`` columns are left-aligned, the others right."""
    from rich.table import Table

    table = Table(box=None, pad_edge=False, header_style="bold")
    for n, column in enumerate(columns):
        table.add_column(column, justify="left" if n < words else "right")
    return table
