"""``automcm trace lint``, ``show`` and ``coverage``: what logs hold."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from automcm_cli.common import CODES, Json, write_json

Logs = Annotated[
    list[Path], typer.Argument(help="Logs, or folders with logs (*.ndjson) below them.")
]


def register(app: typer.Typer) -> None:
    """Add the commands of this module to ``automcm trace``."""
    epilog = "Example: automcm trace {}.  " + CODES
    app.command(epilog=epilog.format("lint 1001.ndjson logs/"))(lint)


def _files(command: str, logs: list[Path]) -> list[Path]:
    from automcm_traces.reader import LogError, logs_below

    try:
        return logs_below(logs)
    except LogError as error:
        typer.echo(f"{command}: {error}", err=True)
        raise typer.Exit(3) from None


def lint(
    logs: Logs,
    most: Annotated[
        int, typer.Option(help="How many findings to tell of each file; 0 for all.", min=0)
    ] = 100,
    json_: Json = None,
) -> None:
    """Is each file a log in the format?  If not: everything wrong with it.

    Warnings (a missing end, an event of an unknown kind) do not count against a log.
    """
    from automcm_traces import lint as lint_

    reports = []
    for path in _files("lint", logs):
        report = lint_.report(path, most)
        reports.append(report)
        if str(json_) != "-":
            typer.echo(lint_.text(report))
    code = lint_.exit_code(reports)
    write_json(json_, {"exit": code, "files": [report.as_dict() for report in reports]})
    raise typer.Exit(code)
