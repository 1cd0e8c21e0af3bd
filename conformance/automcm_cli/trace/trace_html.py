"""``automcm trace html``: logs as one self-contained HTML page."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from automcm_cli.shared.common import Json, Late, code_3, write_json
from automcm_cli.trace.trace_edit import station_pairs
from automcm_cli.trace.trace_logs import files_of
from automcm_spec.support import files, scratch

if TYPE_CHECKING:
    from automcm_traces.viewer.page_data import Page
    from automcm_traces.viewer.page_run import Part, Run


def html(
    logs: Annotated[
        list[Path],
        typer.Argument(
            help="Logs of one run, folders with logs, standard input (-), or one "
            "counterexample (.itf.json)."
        ),
    ],
    compare: Annotated[
        list[Path] | None,
        typer.Option(help="Logs of another run to compare with.  Repeatable."),
    ] = None,
    stations: Annotated[
        list[str] | None,
        typer.Option(
            help="A station and its counterpart in --compare, such as 1001=7.  Repeatable."
        ),
    ] = None,
    out: Annotated[Path, typer.Option(help="File for the page.")] = Path("runs/trace.html"),
    late: Late = None,
    from_line: Annotated[
        int | None, typer.Option(help="Show the first log from this line on.", min=1)
    ] = None,
    to_line: Annotated[
        int | None, typer.Option(help="Show the first log up to this line.", min=1)
    ] = None,
    json_: Json = None,
) -> None:
    """Write an HTML page that explains the logs of a run.

    The page is one file and needs no network. It shows the verdict of explain, the messages between
    the stations, the timers, the states, and the lines of Station.tla. With --compare it shows two
    runs side by side, aligned up to the first difference that diff finds. The exit code is 0 when
    the page was written, whatever the verdict.

    Logs of more than 100,000 events are refused. For a part of them, give --from-line, --to-line or
    both: the page then shows these lines of the first log, and the lines of the other logs from the
    first to the last message exchanged with them.
    """
    from automcm_spec.model_checking.tlc import TlcError
    from automcm_spec.support.bad_input import BadInput
    from automcm_traces.export.behaviour_to_log import BehaviourError
    from automcm_traces.export.itf import ItfError
    from automcm_traces.viewer.page import html as html_
    from automcm_traces.viewer.page_data import judged
    from automcm_traces.viewer.page_run import PageError

    pairs = station_pairs(stations)
    if pairs and not compare:
        raise typer.BadParameter("is only allowed with --compare", param_hint="--stations")
    part = _part(from_line, to_line)
    if part and compare:
        raise typer.BadParameter(
            "cannot be combined with --compare", param_hint="--from-line, --to-line"
        )
    logs, other = (files_of("html", paths) for paths in (logs, compare or []))
    with code_3("html", ItfError, BadInput, OSError, PageError, BehaviourError, TlcError):
        page = page_of(logs, late, other, pairs, part)
        data = html_(page)
        out.parent.mkdir(parents=True, exist_ok=True)
        files.write(out, data)
    about = {"written": str(out), "bytes": len(data), "rows": len(page.nodes)}
    if write_json(json_, about | judged(page)):
        typer.echo(f"{out}: {len(page.nodes)} events, {len(data)} bytes")


def page_of(
    paths: list[Path],
    late: int | None,
    compare: Sequence[Path] = (),
    stations: Mapping[int, int] | None = None,
    part: Part | None = None,
) -> Page:
    """The page of logs or of one counterexample; with ``compare``, of two runs.

    ``part`` is not allowed with a counterexample.

    Raises ItfError, BadInput, OSError, PageError, StoryError, TlcError.
    """
    from automcm_traces.viewer import page_data
    from automcm_traces.viewer.page_run import check_size

    if compare:
        check_size([*paths, *compare])
    a, title = _run(paths, late, part)
    if not compare:
        return page_data.of_runs(a, title=title)
    b, other = _run(list(compare), late)
    return page_data.of_runs(a, b, stations, f"{title} | {other}")


def _part(first: int | None, last: int | None) -> Part | None:
    from automcm_traces.viewer.page_run import Part

    if first is None and last is None:
        return None
    if first is not None and last is not None and last < first:
        raise typer.BadParameter(
            f"must be at least --from-line ({first}), not {last}", param_hint="--to-line"
        )
    return Part(first or 1) if last is None else Part(first or 1, last)


def _run(paths: list[Path], late: int | None, part: Part | None = None) -> tuple[Run, str]:
    """A run and its title."""
    from automcm_spec.support.bad_input import SpooledInput
    from automcm_traces.export.itf_log import behaviour
    from automcm_traces.viewer.page_run import PageError, load

    itf = [path for path in paths if path.name.endswith(".json")]
    if not itf:
        run = load(paths, late, part)
        return run, run.title
    if len(paths) > 1:
        raise PageError("a counterexample must be the only file; give it without other logs")
    if part:
        raise PageError(
            "--from-line and --to-line select lines of a log; a counterexample has none"
        )
    found = behaviour(itf[0])
    with scratch.folder("html") as folder:
        logs = []
        for station, text in found.logs().items():
            log = SpooledInput(folder, f"{station}.ndjson")
            log.given = f"{itf[0].name.removesuffix('.itf.json')}-{station}.ndjson"
            log.write_bytes(text)
            logs.append(log)
        run = load(sorted(logs), late)
        return run, f"{found.model}, counterexample found by TLC"
