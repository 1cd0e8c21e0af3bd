"""What all commands share: the exit codes, ``--json`` and the status line."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated, Any

import typer

CODES = (
    "Exit codes: 0 as expected; 1 a verdict against; 2 usage; 3 a tool or an input could not be "
    "read or run; 4 cannot tell."
)

Json = Annotated[
    Path | None,
    typer.Option("--json", help="Write the report here as JSON; - for standard output."),
]


def write_json(target: Path | None, value: Any) -> None:
    if target is None:
        return
    text = json.dumps(value, indent=2) + "\n"
    try:
        if str(target) == "-":
            sys.stdout.write(text)
        else:
            target.write_text(text)
    except OSError as error:
        typer.echo(f"{target}: {error.strerror}", err=True)
        raise typer.Exit(3) from None


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


def markdown_table(
    heads: Sequence[str], rows: Sequence[Sequence[object]], left: Sequence[str] = ("what",)
) -> list[str]:
    """A table of Markdown; the first column and those named are texts, the others figures."""
    ruler = ["---" if n == 0 or head in left else "---:" for n, head in enumerate(heads)]
    cells = [[str(value).replace("|", "\\|") for value in row] for row in rows]
    return [f"| {' | '.join(row)} |" for row in [list(heads), ruler, *cells]]
