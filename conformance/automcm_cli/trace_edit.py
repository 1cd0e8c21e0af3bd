"""``automcm trace shrink`` and ``diff``: less of a log, and two side by side."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from automcm_cli.common import CODES, Json, progress, write_json

if TYPE_CHECKING:
    from automcm_traces.shrink import Shrunk

ROWS = 100
"""Events of a shrunk log that are printed."""


def register(app: typer.Typer) -> None:
    """Add the commands."""
    epilog = "Example: automcm trace {}.  " + CODES
    app.command(epilog=epilog.format("shrink 1001.ndjson 2002.ndjson --out small"))(shrink)


def shrink(
    logs: Annotated[list[Path], typer.Argument(help="Logs in the format automcm.trace/1.")],
    out: Annotated[Path, typer.Option(help="Folder for the smallest logs.")] = Path("runs/shrink"),
    tries: Annotated[int, typer.Option(help="How many candidates may be judged.", min=1)] = 3000,
    late: Annotated[
        int | None,
        typer.Option(help="How late a timer may be, ms; t_resend / 2 unless told.", min=0),
    ] = None,
    json_: Json = None,
) -> None:
    """The smallest logs that show the same: the same event diverges, by the same rule.

    Sessions go first, then logs, then steps, then single events. The gaps are closed: later
    events come earlier, and numbers are counted anew. What is wrong only with the other logs (a
    forged message, a property of the system) is shrunk with them. Exit code 0: shrunk; 1: there
    is nothing wrong to shrink.
    """
    from automcm_spec.oracle import OracleError
    from automcm_traces import shrink as shrink_
    from automcm_traces.reader import LogError
    from automcm_traces.show import columns

    try:
        with progress() as status:
            found = shrink_.shrink(logs, late_ms=late, tries=tries, say=status)
        written = _written(found, logs, out)
    except shrink_.NothingToShrink as error:
        typer.echo(f"shrink: {error}", err=True)
        raise typer.Exit(error.code) from None
    except (LogError, OracleError, OSError) as error:
        typer.echo(f"shrink: {error}", err=True)
        raise typer.Exit(3) from None
    told = found.as_dict()
    for one, path in zip(told["logs"], written, strict=True):
        one["written"] = str(path)
    write_json(json_, told)
    if str(json_) == "-":
        return
    for line in found.text():
        typer.echo(line)
    rows = found.rows()
    if len(rows) <= ROWS:
        stations = [log.header.station for log in found.logs]
        for line in columns(rows, stations):
            typer.echo(f"  {line}".rstrip())
    typer.echo(f"automcm trace explain {' '.join(str(path) for path in written)}")


def _written(found: Shrunk, given: list[Path], out: Path) -> list[Path]:
    """The smallest logs as files, each by the name of the log it comes from.

    Raises OSError; typer.BadParameter if that would overwrite a log that was given.
    """
    paths: list[Path] = []
    for log in found.logs:
        path = out / Path(log.file).name
        if path in paths:
            path = out / f"{Path(log.file).stem}-{log.header.station}.ndjson"
        if path.resolve() in {other.resolve() for other in given}:
            raise typer.BadParameter(f"{path} is a log to be shrunk", param_hint="--out")
        paths.append(path)
    out.mkdir(parents=True, exist_ok=True)
    for path, log in zip(paths, found.logs, strict=True):
        path.write_bytes(log.text())
    return paths
