"""``automcm trace html``: logs as one page that shows everything."""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from automcm_cli.common import CODES, Json, write_json

if TYPE_CHECKING:
    from automcm_traces.page_data import Page

EPILOG = "Example: automcm trace html 1001.ndjson 2002.ndjson --out page.html.  " + CODES


def register(app: typer.Typer) -> None:
    """Add the command of this module to ``automcm trace``."""
    app.command(epilog=EPILOG)(html)


def html(
    logs: Annotated[
        list[Path],
        typer.Argument(help="Logs of one run, folders of them, or one counterexample (.itf.json)."),
    ],
    out: Annotated[Path, typer.Option(help="The page.")] = Path("runs/trace.html"),
    late: Annotated[
        int | None,
        typer.Option(help="How late a timer may be, ms; t_resend / 2 unless told.", min=0),
    ] = None,
    json_: Json = None,
) -> None:
    """One page that shows what happened, what was allowed, and where it first went wrong.

    The page is one file and needs no network. It has what explain says, the messages between the
    stations, the timers, the states, and the lines of Station.tla. Exit code 0: it was written,
    whatever the verdict.
    """
    from automcm_spec.oracle import OracleError
    from automcm_spec.tlc import TlcError
    from automcm_traces.itf import ItfError
    from automcm_traces.page import html as html_
    from automcm_traces.page_data import PageError, judged
    from automcm_traces.reader import LogError
    from automcm_traces.story import StoryError

    try:
        page = page_of(logs, late)
        data = html_(page)
        out.parent.mkdir(parents=True, exist_ok=True)
        out.write_bytes(data)
    except (ItfError, LogError, OracleError, OSError, PageError, StoryError, TlcError) as error:
        typer.echo(f"html: {error}", err=True)
        raise typer.Exit(3) from None
    about = {"written": str(out), "bytes": len(data), "rows": len(page.nodes)}
    write_json(json_, about | judged(page))
    if str(json_) != "-":
        typer.echo(f"{out}: {len(page.nodes)} events, {len(data)} bytes")


def page_of(paths: list[Path], late: int | None) -> Page:
    """The page of logs, or of one counterexample.

    Raises ItfError, LogError, OracleError, OSError, PageError, StoryError, TlcError.
    """
    from automcm_traces.itf_log import behaviour
    from automcm_traces.page_data import PageError, load
    from automcm_traces.reader import logs_below

    itf = [path for path in paths if path.name.endswith(".json")]
    if not itf:
        return load(logs_below(paths), late_ms=late)
    if len(paths) > 1:
        raise PageError("a counterexample is shown alone")
    found = behaviour(itf[0])
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for station, text in found.logs().items():
            (folder / f"{station}.ndjson").write_bytes(text)
        page = load(sorted(folder.iterdir()), f"{found.model}, as TLC found it", late)
        page.renamed = f"{folder}/", f"{itf[0].name.removesuffix('.itf.json')}-"
        return page
