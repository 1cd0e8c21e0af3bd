"""``automcm trace html``: logs as one self-contained HTML page."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from sys import maxsize
from typing import TYPE_CHECKING, Annotated

import typer

from automcm_cli.shared.common import Json, Late, code_3, say, two_numbers, write_json
from automcm_cli.trace.trace_edit import station_pairs
from automcm_cli.trace.trace_logs import files_of, refuse_given
from automcm_spec.support import files, scratch
from automcm_spec.support.bad_input import BadInput, SpooledInput

if TYPE_CHECKING:
    from automcm_traces.viewer.page_data import Page
    from automcm_traces.viewer.page_part import PagePart
    from automcm_traces.viewer.page_run import PageRun


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
    session: Annotated[str, typer.Option(help="Show only this session, such as 1001/3.")] = "",
    from_ms: Annotated[
        int | None,
        typer.Option(help="Show the first log from this time after its start on.", min=0),
    ] = None,
    to_ms: Annotated[
        int | None, typer.Option(help="Show the first log up to this time after its start.", min=0)
    ] = None,
    traffic: Annotated[
        Path | None,
        typer.Option(help="Positions of all road users, as written by simulate traffic."),
    ] = None,
    json_: Json = None,
) -> None:
    """Write an HTML page that explains the logs of a run.

    The page is one file and needs no network. It shows the verdict of explain, the messages between
    the stations, the timers, the states, and the lines of Station.tla. With --compare it shows two
    runs side by side, aligned up to the first difference that diff finds. The exit code is 0 when
    the page was written, whatever the verdict.

    Of more than 100,000 events, the page shows a part: around the first divergence, or from the
    start. --session, --from-ms and --to-ms, or --from-line and --to-line choose another: lines of
    the first log (of the first that has the session), and the lines of the other logs from the
    first to the last message exchanged with them.
    """
    from automcm_traces.viewer.page import html as html_
    from automcm_traces.viewer.page_data import judged
    from automcm_traces.viewer.page_part import PageError

    pairs = station_pairs(stations)
    if pairs and not compare:
        raise typer.BadParameter("is only allowed with --compare", param_hint="--stations")
    part = _part((from_line, to_line), (from_ms, to_ms), session)
    if part and compare:
        raise typer.BadParameter("a part cannot be combined with --compare", param_hint="--compare")
    logs, other = (files_of("html", paths, out, json_) for paths in (logs, compare or []))
    for path in filter(None, (out, json_)):
        refuse_given(path, filter(None, [traffic]))
    with code_3("html", BadInput, OSError, PageError):
        page = page_of(logs, late, other, pairs, part)
        page.traffic = traffic
        data = html_(page)
        files.folder(out.parent, named=True)
        files.write(out, data, named=True)
    about = {"written": str(out), "bytes": len(data), "rows": len(page.nodes)}
    if write_json(json_, about | judged(page)):
        say(f"{out}: {len(page.nodes)} events, {len(data)} bytes")


def page_of(
    paths: list[Path],
    late: int | None,
    compare: Sequence[Path] = (),
    stations: Mapping[int, int] | None = None,
    part: PagePart | None = None,
) -> Page:
    """The page of logs or of one counterexample; with ``compare``, of two runs.

    ``part`` is not allowed with a counterexample.

    Raises BadInput, OSError, PageError.
    """
    from automcm_traces.viewer import page_data
    from automcm_traces.viewer.page_run import check_size

    if compare:
        check_size([*paths, *compare])
    a = _run(paths, late, part)
    b = _run(list(compare), late) if compare else None
    return page_data.of_runs(a, b, stations)


def _part(
    lines: tuple[int | None, int | None], times: tuple[int | None, int | None], session: str
) -> PagePart | None:
    from automcm_traces.viewer.page_part import PagePart

    chosen = {"--from-line, --to-line": lines != (None, None)}
    chosen |= {"--from-ms, --to-ms": times != (None, None), "--session": bool(session)}
    given = [option for option, is_given in chosen.items() if is_given]
    if not given:
        return None
    if given[1:]:
        raise typer.BadParameter(f"cannot be combined with {given[0]}", param_hint=given[1])
    if session:
        named = two_numbers(session, "/", "a session, such as 1001/1", "--session")
        return PagePart(session=named)
    (first, last), unit = (lines, "line") if given[0].endswith("line") else (times, "ms")
    if first is not None and last is not None and last < first:
        raise typer.BadParameter(
            f"must be at least --from-{unit} ({first}), not {last}", param_hint=f"--to-{unit}"
        )
    last = maxsize if last is None else last
    return (
        PagePart(first or 1, last) if unit == "line" else PagePart(from_ms=first or 0, to_ms=last)
    )


def _run(paths: list[Path], late: int | None, part: PagePart | None = None) -> PageRun:
    from automcm_traces.viewer.page_part import PageError
    from automcm_traces.viewer.page_run import load

    itf = [path for path in paths if path.name.endswith(".json")]
    if not itf:
        return load(paths, late, part)
    if len(paths) > 1:
        raise PageError("a counterexample must be the only file; give it without other logs")
    if part:
        raise PageError(
            "--session, --from-ms, --to-ms, --from-line and --to-line choose a part of a log; a "
            "counterexample has none"
        )
    return _counterexample(itf[0], late)


def _counterexample(path: Path, late: int | None) -> PageRun:
    from automcm_spec.model_checking.tlc import TlcError
    from automcm_traces.export.behaviour_to_log import BehaviourError
    from automcm_traces.export.itf import ItfError
    from automcm_traces.export.itf_log import behaviour
    from automcm_traces.viewer.page_counterexample import shown
    from automcm_traces.viewer.page_part import PageError
    from automcm_traces.viewer.page_run import load

    try:
        found = behaviour(path)
        texts = found.logs()
    except (BehaviourError, ItfError, TlcError) as error:
        raise PageError(str(error)) from None
    with scratch.folder("html") as folder:
        logs = []
        for station, text in texts.items():
            log = SpooledInput(folder, f"{station}.ndjson")
            log.given = f"{path.name.removesuffix('.itf.json')}-{station}.ndjson"
            log.write_bytes(text)
            logs.append(log)
        run = load(sorted(logs), late)
        run.counterexample = shown(found.model, len(found.moves) + 1)
        return run
