"""``automcm trace html``: logs as one page that shows everything."""

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
            help="Logs of one run, folders of them, - for standard input; or one counterexample "
            "(.itf.json)."
        ),
    ],
    compare: Annotated[
        list[Path] | None,
        typer.Option(help="Logs of another run, to stand beside it; may be repeated."),
    ] = None,
    stations: Annotated[
        list[str] | None,
        typer.Option(help="A station and which of --compare it is, such as 1001=7."),
    ] = None,
    out: Annotated[Path, typer.Option(help="The page.")] = Path("runs/trace.html"),
    late: Late = None,
    from_line: Annotated[
        int | None, typer.Option(help="Only a part: the first log from this line on.", min=1)
    ] = None,
    to_line: Annotated[
        int | None, typer.Option(help="Only a part: the first log up to this line.", min=1)
    ] = None,
    json_: Json = None,
) -> None:
    """One page: what happened, what was allowed, where it went wrong.

    The page is one file and needs no network. It has what explain says, the messages between the
    stations, the timers, the states, and the lines of Station.tla. With --compare it has two runs
    side by side, aligned up to where they first differ, as diff finds it. Exit code 0: it was
    written, whatever the verdict.

    Logs of more than 100,000 events are refused, but for a part of them: with --from-line,
    --to-line or both, so many lines of the first log, and of the others what stands between the
    first and the last message exchanged with these lines.
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
        raise typer.BadParameter("only with --compare", param_hint="--stations")
    part = _part(from_line, to_line)
    if part and compare:
        raise typer.BadParameter("not with --compare", param_hint="--from-line, --to-line")
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
    """The page of logs, or of one counterexample; with ``compare``, of two runs.  ``part`` is not
    for a counterexample.

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
        raise typer.BadParameter(f"{last} is before --from-line {first}", param_hint="--to-line")
    return Part(first or 1) if last is None else Part(first or 1, last)


def _run(paths: list[Path], late: int | None, part: Part | None = None) -> tuple[Run, str]:
    """A run, and its title."""
    from automcm_spec.support.bad_input import SpooledInput
    from automcm_traces.export.itf_log import behaviour
    from automcm_traces.viewer.page_run import PageError, load

    itf = [path for path in paths if path.name.endswith(".json")]
    if not itf:
        run = load(paths, late, part)
        return run, run.title
    if len(paths) > 1:
        raise PageError("a counterexample is one run, without other logs")
    if part:
        raise PageError("a counterexample has no lines: without --from-line and --to-line")
    found = behaviour(itf[0])
    with scratch.folder("html") as folder:
        logs = []
        for station, text in found.logs().items():
            log = SpooledInput(folder, f"{station}.ndjson")
            log.given = f"{itf[0].name.removesuffix('.itf.json')}-{station}.ndjson"
            log.write_bytes(text)
            logs.append(log)
        run = load(sorted(logs), late)
        return run, f"{found.model}, as TLC found it"
