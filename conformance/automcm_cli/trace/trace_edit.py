"""``automcm trace shrink`` and ``diff``: shortens logs, and compares two runs."""

from __future__ import annotations

import shlex
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from automcm_cli.shared.common import Json, Late, code_3, progress, say, two_numbers, write_json
from automcm_cli.trace.trace_logs import Logs, files_of, refuse_given
from automcm_spec.support import files

if TYPE_CHECKING:
    from automcm_traces.edit.log_shrinking import Shrunk

ROWS = 100
"""Maximum number of events of a shrunk log that are printed."""


def shrink(
    logs: Logs,
    out: Annotated[Path, typer.Option(help="Folder for the shrunk logs.")] = Path("runs/shrink"),
    tries: Annotated[
        int, typer.Option(help="Maximum number of candidates to check.", min=1)
    ] = 3000,
    late: Late = None,
    json_: Json = None,
) -> None:
    """Find the smallest logs with the same violation.

    The same event diverges by the same rule. The command removes sessions first, then logs, then
    steps, then single events. It moves later events to earlier times and renumbers the messages. A
    violation that involves several logs (a forged message, a property of the system) is kept in
    all of them. Exit code 0: shrunk; 1: the logs have no violation.
    """
    from automcm_spec.log_format.event_text import starts
    from automcm_traces.edit import log_shrinking as shrink_
    from automcm_traces.explain.log_columns import columns

    logs = files_of("shrink", logs)
    try:
        with code_3("shrink", OSError), progress() as status:
            found = shrink_.shrink(logs, late_ms=late, tries=tries, on_progress=status)
            written = _written(found, logs, out)
    except shrink_.NothingToShrink as error:
        say(f"shrink: {error}", err=True)
        raise typer.Exit(error.code) from None
    report = found.as_dict()
    for one, path in zip(report["logs"], written, strict=True):
        one["written"] = str(path)
    if not write_json(json_, report):
        return
    for line in found.text():
        say(line)
    rows = found.rows()
    if len(rows) <= ROWS:
        stations = [log.header.station for log in found.logs]
        first = {row.station: row.event.t_ms for row in reversed(rows) if row.event is not None}
        for line in columns(rows, stations, start_ms=starts(first)):
            say(f"  {line}".rstrip())
    with_late = [] if late is None else ["--late", str(late)]
    say(shlex.join(["automcm", "trace", "explain", *with_late, *map(str, written)]))


def _written(found: Shrunk, given: list[Path], out: Path) -> list[Path]:
    """Write the shrunk logs, each under the name of its original log, and return the paths.

    Raises OSError; typer.BadParameter if a file would overwrite a given log.
    """
    from automcm_spec.support.bad_input import name_of

    by_name = {name_of(path): path for path in given}
    paths: list[Path] = []
    for log in found.logs:
        path = out / by_name[log.file].name
        if path in paths:
            path = out / f"{path.stem}-{log.header.station}.ndjson"
        refuse_given(path, given)
        paths.append(path)
    files.folder(out, named=True)
    for path, log in zip(paths, found.logs, strict=True):
        files.write(path, log.text())
    return paths


def compare(
    a: Annotated[Path, typer.Argument(help="A log, or a folder with logs (*.ndjson).")],
    b: Annotated[Path, typer.Argument(help="The log or folder to compare with A.")],
    stations: Annotated[
        list[str] | None,
        typer.Option(help="A station of A and its counterpart in B, such as 1001=7.  Repeatable."),
    ] = None,
    times: Annotated[bool, typer.Option(help="Show the differences of times.")] = False,
    width: Annotated[int, typer.Option(help="Columns of the table.", min=40)] = 80,
    json_: Json = None,
) -> None:
    """Find the first difference between two runs.

    The runs may come from two implementations. Logs are compared for each station, one step (an
    input with its effects) at a time. A station's free choices are not compared: session numbers,
    transmission ids, the order of the effects of a step, times, CAMs. Exit code 0: the runs are
    equal; 1: they differ.
    """
    from automcm_spec.support.bad_input import BadInput
    from automcm_traces.edit import log_diff as diff_

    pairs = station_pairs(stations)
    logs, others = files_of("diff", [a]), files_of("diff", [b])
    with code_3("diff", BadInput):
        found = diff_.diff(logs, others, pairs)
    if write_json(json_, found.as_dict()):
        for line in diff_.text(found, times, width):
            say(line)
    raise typer.Exit(0 if found.same else 1)


def station_pairs(texts: list[str] | None) -> dict[int, int]:
    """``--stations``: for stations of A, the station of B.  Raises typer.BadParameter."""
    pairs = dict(
        two_numbers(text, "=", "a pair of stations, such as 1001=7", "--stations")
        for text in texts or ()
    )
    if len(set(pairs.values())) < len(texts or ()):
        raise typer.BadParameter(
            "a station occurs in two pairs; each may occur in one only", param_hint="--stations"
        )
    return pairs
