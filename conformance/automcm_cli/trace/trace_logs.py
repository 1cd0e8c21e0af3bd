"""``automcm trace lint``, ``show`` and ``coverage``: the contents of logs."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterable, Iterator, Sequence
from os.path import realpath
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from automcm_cli.shared import common
from automcm_spec.support import files
from automcm_spec.support.bad_input import BadInput, SpooledInput

if TYPE_CHECKING:
    from automcm_traces.explain.log_table import TableRow

Logs = Annotated[
    list[Path],
    typer.Argument(readable=False, help="Logs (*.ndjson), folders with logs, standard input (-)."),
]


def files_of(command: str, logs: list[Path], *written: Path | None) -> list[Path]:
    """The log files in these paths.  Exits with code 3 if a path has none, and with 2 if one is
    ``written`` by the command.

    Standard input and pipes are copied to files, because a log is read more than once.
    """
    from automcm_spec.log_format.reader import logs_below

    with common.code_3(command, BadInput, OSError):
        found = logs_below([_kept(log) for log in logs])
    for path in filter(None, written):
        refuse_given(path, found)
    return found


def refuse_given(path: Path, given: Iterable[Path]) -> None:
    """Raises typer.BadParameter if writing this file would overwrite a given one."""
    if realpath(path) in set(map(realpath, given)):
        raise typer.BadParameter(f"{path} is an input and would be overwritten; choose another")


def _kept(log: Path) -> Path:
    stdin = str(log) == "-"
    if not stdin and not log.is_fifo():
        return log
    import atexit
    from contextlib import ExitStack, nullcontext
    from shutil import copyfileobj

    from automcm_spec.support import scratch

    kept = ExitStack()
    atexit.register(kept.close)
    folder = kept.enter_context(scratch.folder("logs"))
    path = SpooledInput(folder, "standard-input.ndjson" if stdin else f"pipe-{log.name}.ndjson")
    path.given = str(log)
    with path.open("wb") as out, nullcontext(sys.stdin.buffer) if stdin else log.open("rb") as pipe:
        copyfileobj(pipe, out)
    return path


def lint(
    logs: Logs,
    most: Annotated[
        int, typer.Option(help="Maximum findings to report for each file (0 = all).", min=0)
    ] = 100,
    json_: common.Json = None,
) -> None:
    """Check files against the log format.

    Reports all errors of each file, and what to write.  Warnings (a missing end, an event of an
    unknown kind) do not change the exit code.
    """
    from automcm_traces.explain import lint as lint_

    reports = []
    for path in files_of("lint", logs, json_):
        reports.append(lint_.report(path, most))
        if str(json_) != "-":
            common.say_lines(lint_.text(reports[-1]))
    code = lint_.exit_code(reports)
    common.write_json(json_, {"exit": code, "files": [report.as_dict() for report in reports]})
    raise typer.Exit(code)


STYLES = {
    "send": "green",
    "receive": "cyan",
    "timer": "dim",
    "command": "bold",
    "indication": "yellow",
    "restart": "bold red",
    "note": "dim",
    "phase": "magenta",
}


def show(
    logs: Logs,
    station: Annotated[
        list[int] | None, typer.Option(help="Only this station.  Repeatable.")
    ] = None,
    session: Annotated[str, typer.Option(help="Only this session, such as 1001/1.")] = "",
    type_: Annotated[
        list[str] | None,
        typer.Option("--type", help="Only messages of this type.  Repeatable."),
    ] = None,
    cams: Annotated[bool, typer.Option(help="Show CAMs and the timers that they restart.")] = False,
    timers: Annotated[bool, typer.Option(help="Show timers.")] = True,
    from_line: Annotated[int, typer.Option(help="Show each log from this line on.", min=0)] = 0,
    last: Annotated[int, typer.Option(help="Show only this many last rows (0 = all).", min=0)] = 0,
    width: Annotated[
        int,
        typer.Option(help="Columns of the table (0 = width of the terminal, or 80).", min=0),
    ] = 0,
    absolute: Annotated[
        bool, typer.Option("--absolute", help="Show times as logged, not from the start.")
    ] = False,
    all_: Annotated[
        bool, typer.Option("--all", help="Show every copy of a message as a row of its own.")
    ] = False,
    json_: common.Json = None,
) -> None:
    """Show logs as a table of events.

    Times count from the first event. Copies of a message are one row with their number (x20).

    Each event is a row and each station a column. A received message stands below its sending.
    CAMs are hidden by default. With several logs, a mark before a message shows its delivery:
    x2002: lost on the way to 2002; ?2002: not yet received when the log of 2002 ends; !2002:
    rejected by the secured link of 2002; 2nd: a second copy; forged: its sender's log shows that it
    was not sent.
    """
    from automcm_traces.explain import log_table as show_

    wanted = show_.Filter(
        stations=frozenset(station or ()),
        session=common.two_numbers(session, "/", "a session, such as 1001/1", "--session")
        if session
        else None,
        types=frozenset(type_ or ()),
        cams=cams or "CAM" in (type_ or ()),
        timers=timers,
        from_line=from_line,
    )
    with common.code_3("show", BadInput):
        paths = files_of("show", logs, json_)
        together = show_.Logs(paths)
    for warning in together.warnings:
        common.say(f"show: warning: {warning}", err=True)
    for missing in sorted(wanted.stations - set(together.stations)):
        common.say(f"show: warning: no log of station {missing}", err=True)
    shown = together.filtered(wanted, last)
    if json_ is not None:
        common.write_json(json_, {"rows": [row.as_dict() for row in shown]})
    else:
        stations = sorted(wanted.stations & {*together.stations}) or together.stations
        _print(shown, stations, width, paths, absolute, all_)
        if wanted.hidden_cams:
            common.say(f"CAMs not shown: {wanted.hidden_cams} (--cams shows them)")
    raise typer.Exit(0 if together.good else 3)


def _print(
    shown: Iterable[TableRow],
    stations: Sequence[int],
    width: int,
    logs: Sequence[Path],
    absolute: bool,
    all_: bool,
) -> None:
    from rich.text import Text

    from automcm_cli.shared.terminal import Terminal
    from automcm_spec.log_format.event_text import starts
    from automcm_traces.explain.log_table import LogTable, first_times, folds

    console = Terminal(highlight=False)
    first_ms = first_times(logs)
    table = LogTable(
        stations,
        width or (console.width if console.is_terminal else 80),
        None if absolute else starts(first_ms),
        max(first_ms.values(), default=0) if absolute else 0,
    )

    def put(kind: str, line: str) -> None:
        if console.is_terminal and not console.no_color:
            console.print(Text(line, STYLES[kind]), soft_wrap=True)
        else:
            common.say(line)

    for line in table.head():
        put("note", line)
    for fold in folds(shown, all_):
        for kind, line in table.lines(fold.first, fold.mark):
            put(kind, line)


def coverage(
    logs: Logs,
    annotate: Annotated[
        bool,
        typer.Option("--annotate", help="Print the text of Station.tla with a mark on each line."),
    ] = False,
    out: Annotated[
        Path | None,
        typer.Option(help="File for a page: the text of Station.tla, lines taken green and red."),
    ] = None,
    late: common.Late = None,
    json_: common.Json = None,
) -> None:
    """Measure which parts of the specification the logs cover.

    A log is counted up to the first event that diverges, that cannot be decided, or that cannot be
    read.
    """
    from automcm_spec.vocabulary.condition_coverage import annotated
    from automcm_traces.explain import coverage as coverage_

    paths = files_of("coverage", logs, json_, out)
    with common.progress() as status:
        found = coverage_.measure(_with_progress(paths, status), late)
    if out is not None:
        from automcm_traces.explain.coverage_page import page

        with common.code_3("coverage", OSError):
            files.folder(out.parent, named=True)
            files.write(out, page(found), named=True)
    if common.write_json(json_, found.as_dict()):
        for line in annotated(found.conditions) if annotate else coverage_.text(found):
            common.say(line)
    raise typer.Exit(coverage_.exit_code(found))


def _with_progress(files: Sequence[Path], status: Callable[[str], None]) -> Iterator[Path]:
    for n, path in enumerate(files, 1):
        status(f"{n} of {len(files)}")
        yield path
