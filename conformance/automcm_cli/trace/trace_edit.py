"""``automcm trace shrink``, ``diff``, ``export`` and ``itf``: shortens logs, compares two runs, and
converts logs and counterexamples for other tools."""

from __future__ import annotations

import shlex
from collections.abc import Callable, Collection, Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from automcm_cli.shared.common import Json, Late, code_3, progress, say, two_numbers, write_json
from automcm_cli.trace.trace_logs import Logs, files_of, refuse_given
from automcm_spec.support import files
from automcm_spec.support.bad_input import BadInput, name_of

if TYPE_CHECKING:
    from automcm_traces.edit.log_shrinking import Shrunk
    from automcm_traces.system.fates import Arrow

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
    from automcm_traces.explain.log_table import columns

    logs = files_of("shrink", logs, json_)
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
    from automcm_traces.edit import log_diff as diff_

    pairs = station_pairs(stations)
    logs, others = files_of("diff", [a], json_), files_of("diff", [b], json_)
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


def export(
    logs: Annotated[
        list[Path], typer.Argument(help="Logs, or folders with logs; with --to logs, .mcap files.")
    ],
    to: Annotated[
        Literal["mermaid", "svg", "itf", "mcap", "logs"],
        typer.Option(help="Target format; mcap and logs need automcm[mcap]."),
    ] = "mermaid",
    out: Annotated[Path, typer.Option(help="Folder for the files.")] = Path("runs/export"),
    all_: Annotated[
        bool, typer.Option("--all", help="In mermaid and svg: an arrow for each copy of a message.")
    ] = False,
    absolute: Annotated[
        bool, typer.Option("--absolute", help="In svg: the times of the logs, not from the start.")
    ] = False,
    json_: Json = None,
) -> None:
    """Convert logs for other tools.

    mermaid is a sequence diagram, svg a drawing, itf the states of a station in ITF, and mcap a
    recording for Foxglove. mermaid and svg draw copies of a message as one arrow with their number.
    A sequence diagram shows 400 arrows at most and gives the number of omitted messages. MCAP has
    one JSON channel for each station and one for the fates of messages; --to logs restores the logs
    from it byte for byte.
    """
    given = logs if to == "logs" else files_of("export", logs)
    _write("export", lambda: _exported(given, to, all_, absolute), out, json_, read=given)


def itf(
    file: Annotated[Path, typer.Argument(help="A counterexample in ITF, or a log.")],
    out: Annotated[Path, typer.Option(help="Folder for the files.")] = Path("."),
    json_: Json = None,
) -> None:
    """Convert a counterexample in ITF to logs, or a log to ITF.

    The counterexample must come from automcm spec check or traces/counterexamples.  TLC computes
    the messages that its stations send.  In the ITF of a log, each state is the station's state
    after a step.
    """
    if file.is_dir():
        say(f"itf: {file} is a directory; expected a log (.ndjson) or a counterexample", err=True)
        raise typer.Exit(3)
    make = _itf_of if _is_log(file) else _logs_of
    _write("itf", lambda: make(file), out, json_, read=[file])


def _is_log(file: Path) -> bool:
    """Whether the name of a file, or else its first line, is that of a log."""
    if file.suffix == ".ndjson" or not file.is_file():
        return file.suffix == ".ndjson"
    with code_3("itf", OSError), file.open("rb") as lines:
        return b'"rec"' in lines.readline(200)


def _write(
    command: str,
    make: Callable[[], dict[str, bytes]],
    out: Path,
    json_: Path | None,
    read: Collection[Path] = (),
) -> None:
    """Write files into a folder and print their paths.  None may overwrite a file in ``read``."""
    from automcm_spec.model_checking.tlc import TlcError
    from automcm_traces.checker.track import CannotTell
    from automcm_traces.export.behaviour_to_log import BehaviourError
    from automcm_traces.export.itf import ItfError
    from automcm_traces.export.mcap_file import McapError
    from automcm_traces.system.log_merge import MergeError

    try:
        with code_3(
            command, BadInput, ItfError, McapError, MergeError, OSError, BehaviourError, TlcError
        ):
            contents = {out / name: data for name, data in make().items()}
            for path in filter(None, (*contents, json_)):
                refuse_given(path, read)
            files.folder(out, named=True)
            for path, data in contents.items():
                files.write(path, data)
    except CannotTell as error:
        say(f"{command}: CANNOT TELL: {error}", err=True)
        raise typer.Exit(4) from None
    written = list(map(str, contents))
    if write_json(json_, {"written": written}):
        for name in written:
            say(name)


def _exported(paths: list[Path], to: str, unfold: bool, absolute: bool) -> dict[str, bytes]:
    """The contents of the files to write, by name."""
    from automcm_spec.log_format.reader import read
    from automcm_traces.explain.log_table import Logs
    from automcm_traces.export import mcap_file
    from automcm_traces.export.mermaid import diagram
    from automcm_traces.export.svg_drawing import drawing
    from automcm_traces.system.log_merge import merge

    paths = list(dict.fromkeys(paths))
    if to == "itf":
        return _itf_of(*paths)
    if to == "svg":
        merged = merge([read(path) for path in paths])
        return {f"{paths[0].stem}.svg": drawing(merged, absolute=absolute, unfold=unfold).encode()}
    if to == "mcap":
        return {f"{paths[0].stem}.mcap": mcap_file.written(paths)}
    if to == "logs":
        return _by_name(each for path in paths for each in mcap_file.logs(path).items())
    together = Logs(paths)
    for warning in together.warnings:
        say(f"export: warning: {warning}", err=True)
    lines = [*diagram(together.rows(), together.stations, unfold=unfold), ""]
    return {f"{paths[0].stem}.mmd": "\n".join(lines).encode()}


def _by_name(contents: Iterable[tuple[str, bytes]]) -> dict[str, bytes]:
    """Raises typer.BadParameter if two have the same name."""
    found: dict[str, bytes] = {}
    for name, data in contents:
        if name in found:
            raise typer.BadParameter(f"two results are named {name}; export each file separately")
        found[name] = data
    return found


def _logs_of(counterexample: Path) -> dict[str, bytes]:
    from automcm_traces.export.itf_log import behaviour

    logs = behaviour(counterexample).logs()
    return {f"{station}.ndjson": text for station, text in logs.items()}


def _itf_of(*paths: Path) -> dict[str, bytes]:
    from automcm_spec.log_format.reader import read
    from automcm_traces.explain.log_table import arrow_rows
    from automcm_traces.export.itf_log import from_log

    logs = {path: read(path) for path in paths}
    arrows: dict[Path, list[tuple[int, Arrow]]] = {path: [] for path in paths}
    for path, row in arrow_rows(paths):
        arrows[path] += [(row.line, arrow) for arrow in row.arrows]
    texts = ((f"{p.stem}.itf.json", from_log(log, arrows[p])) for p, log in logs.items())
    return _by_name((name, text.encode()) for name, text in texts)
