"""What all commands share: the exit codes, ``--json`` and the status line."""

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

if TYPE_CHECKING:
    from rich.console import Console
    from rich.table import Table

CODES = (
    "Exit codes: 0 as expected; 1 a verdict against; 2 usage; 3 a tool, an input or an output "
    "could not be run, read or written; 4 cannot tell; 70 a fault of automcm; 130 interrupted; "
    "141 the reader of standard output closed it."
)

Json = Annotated[
    Path | None,
    typer.Option("--json", help="Write the report here as JSON; - for standard output."),
]

Late = Annotated[
    int | None, typer.Option(help="How late a timer may be, ms; t_resend / 2 unless told.", min=0)
]


def example(command: str, more: str = "") -> str:
    """The end of the help of a command: an example, what else there is to say, the exit codes."""
    return f"Example: automcm {command}.  {more}{CODES}"


@contextmanager
def code_3(command: str, *errors: type[Exception]) -> Iterator[None]:
    """Ends ``command`` with code 3 and one line if one of these errors is raised, and what an
    adapter said last on standard error."""
    try:
        yield
    except errors as error:
        typer.echo(f"{command}: {error}", err=True)
        for line in getattr(error, "stderr", ()):
            typer.echo(f"  {line!r}", err=True)
        raise typer.Exit(3) from None


@contextmanager
def usage(*errors: type[Exception]) -> Iterator[None]:
    """Makes a usage error (code 2) of these errors."""
    try:
        yield
    except errors as error:
        raise typer.BadParameter(str(error)) from None


def unknown(name: str, known: Sequence[str], what: str = "model") -> str:
    """That there is no such thing, and which come nearest."""
    near = difflib.get_close_matches(name, known, n=3, cutoff=0.4)
    nearest = f"; nearest: {', '.join(near)}" if near else f"; there are: {', '.join(known)}"
    return f"there is no {what} {name!r}{nearest}"


def write_json(target: Path | None, value: Any) -> bool:
    """Write a report for ``--json``, if there is a target; whether standard output is left for
    text.  Ends with code 3 on failure."""
    if target is None:
        return True
    text = json.dumps(value, indent=2) + "\n"
    if str(target) == "-":
        sys.stdout.write(text)  # what fails there is for automcm_cli.exit_codes
        return False
    with code_3("--json", OSError):
        files.write(target, text)
    return True


@contextmanager
def progress() -> Iterator[Callable[[str], None]]:
    """A status line on a terminal; nothing in a pipe."""
    from rich.console import Console

    console = Console(stderr=True)
    if not console.is_terminal:
        yield lambda text: None
        return
    with console.status("") as status:
        yield lambda text: status.update(text)


def console_of(columns: int = 100) -> Console:
    """The terminal, or so many columns where there is none."""
    from rich.console import Console

    console = Console()
    return console if console.is_terminal else Console(width=columns)


def table_of(*columns: str, words: int = 1) -> Table:
    """Without lines; so many columns hold words, and those behind them figures."""
    from rich.table import Table

    table = Table(box=None, pad_edge=False, header_style="bold")
    for n, column in enumerate(columns):
        table.add_column(column, justify="left" if n < words else "right")
    return table
