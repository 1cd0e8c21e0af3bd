"""``automcm trace``: what a log means."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from automcm_cli.common import CODES, Json, write_json

app = typer.Typer(help="Logs: what happened, and was it allowed?", epilog=CODES)


@app.command(epilog="Example: automcm trace explain 1001.ndjson 2002.ndjson.  " + CODES)
def explain(
    logs: Annotated[list[Path], typer.Argument(help="Logs in the format automcm.trace/1.")],
    late: Annotated[
        int | None,
        typer.Option(help="How late a timer may be, ms; t_resend / 2 unless told.", min=0),
    ] = None,
    json_: Json = None,
) -> None:
    """Is each log allowed by the specification?  If not: the first event that is not, and why.

    With several logs, what was received is also compared with what was sent.
    """
    from automcm_spec.oracle import OracleError
    from automcm_traces import explain as explain_

    try:
        verdicts = explain_.explain_files(logs, late)
    except OracleError as error:
        typer.echo(f"explain: {error}", err=True)
        raise typer.Exit(3) from None
    if len(verdicts) == 1:
        write_json(json_, verdicts[0].as_dict())
    else:
        write_json(json_, [verdict.as_dict() for verdict in verdicts])
    if str(json_) != "-":
        for verdict in verdicts:
            typer.echo(explain_.text(verdict))
    raise typer.Exit(explain_.exit_code(verdicts))


from automcm_cli import trace_itf as _itf  # noqa: E402

_itf.register(app)
