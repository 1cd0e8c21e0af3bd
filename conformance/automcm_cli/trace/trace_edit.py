"""``automcm trace shrink`` and ``diff``: less of a log, and two side by side."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from automcm_cli.shared.common import Json, Late, code_3, progress, write_json
from automcm_cli.trace.trace_logs import Logs, files_of, two_numbers
from automcm_spec.support import files

if TYPE_CHECKING:
    from automcm_traces.edit.log_shrinking import Shrunk

ROWS = 100
"""Events of a shrunk log that are printed."""


def shrink(
    logs: Logs,
    out: Annotated[Path, typer.Option(help="Folder for the smallest logs.")] = Path("runs/shrink"),
    tries: Annotated[int, typer.Option(help="How many candidates may be judged.", min=1)] = 3000,
    late: Late = None,
    json_: Json = None,
) -> None:
    """The smallest logs that show the same.  The same event diverges, by the same rule.

    Sessions go first, then logs, then steps, then single events. The gaps are closed: later
    events come earlier, and numbers are counted anew. What is wrong only with the other logs (a
    forged message, a property of the system) is shrunk with them. Exit code 0: shrunk; 1: there
    is nothing wrong to shrink.
    """
    from automcm_traces.edit import log_shrinking as shrink_
    from automcm_traces.explain.log_table import columns

    logs = files_of("shrink", logs)
    try:
        with code_3("shrink", OSError), progress() as status:
            found = shrink_.shrink(logs, late_ms=late, tries=tries, on_progress=status)
            written = _written(found, logs, out)
    except shrink_.NothingToShrink as error:
        typer.echo(f"shrink: {error}", err=True)
        raise typer.Exit(error.code) from None
    told = found.as_dict()
    for one, path in zip(told["logs"], written, strict=True):
        one["written"] = str(path)
    if not write_json(json_, told):
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
    from automcm_spec.support.bad_input import name_of

    by_name = {name_of(path): path for path in given}
    paths: list[Path] = []
    for log in found.logs:
        path = out / by_name[log.file].name
        if path in paths:
            path = out / f"{path.stem}-{log.header.station}.ndjson"
        if path.resolve() in {other.resolve() for other in given}:
            raise typer.BadParameter(f"{path} is a log to be shrunk", param_hint="--out")
        paths.append(path)
    out.mkdir(parents=True, exist_ok=True)
    for path, log in zip(paths, found.logs, strict=True):
        files.write(path, log.text())
    return paths


def compare(
    a: Annotated[Path, typer.Argument(help="A log, or a folder with logs (*.ndjson).")],
    b: Annotated[Path, typer.Argument(help="The one to compare it with.")],
    stations: Annotated[
        list[str] | None,
        typer.Option(help="A station of A and which of B it is, such as 1001=7; may be repeated."),
    ] = None,
    times: Annotated[bool, typer.Option(help="With how far times are apart.")] = False,
    width: Annotated[int, typer.Option(help="Columns of the table.", min=40)] = 80,
    json_: Json = None,
) -> None:
    """Two runs, or two implementations: where do they first differ?

    Logs are compared by station, a step (an input with its effects) at a time. What a station is
    free to choose is not compared: numbers of sessions, transmission ids, the order of the effects
    of a step, times, CAMs. Exit code 0: the same; 1: they differ.
    """
    from automcm_spec.support.bad_input import BadInput
    from automcm_traces.edit import log_diff as diff_

    pairs = station_pairs(stations)
    logs, others = files_of("diff", [a]), files_of("diff", [b])
    with code_3("diff", BadInput):
        found = diff_.diff(logs, others, pairs)
    if write_json(json_, found.as_dict()):
        for line in diff_.text(found, times, width):
            typer.echo(line)
    raise typer.Exit(0 if found.same else 1)


def station_pairs(texts: list[str] | None) -> dict[int, int]:
    """``--stations``: which station of B each of A is.  Raises typer.BadParameter."""
    pairs = dict(two_numbers(text, "=", "pair; 1001=7", "--stations") for text in texts or ())
    if len(set(pairs.values())) < len(texts or ()):
        raise typer.BadParameter("a station is named twice", param_hint="--stations")
    return pairs
