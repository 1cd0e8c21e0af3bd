"""``automcm trace``: what a log means."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import typer

from automcm_cli import trace_logs
from automcm_cli.common import CODES, Json, write_json

app = typer.Typer(help="Logs: what happened, and was it allowed?", epilog=CODES)


@app.command(epilog="Example: automcm trace explain 1001.ndjson 2002.ndjson.  " + CODES)
def explain(
    logs: Annotated[list[Path], typer.Argument(help="Logs in the format automcm.trace/1.")],
    late: Annotated[
        int | None,
        typer.Option(help="How late a timer may be, ms; t_resend / 2 unless told.", min=0),
    ] = None,
    engine: Annotated[
        Literal["oracle", "tlc"],
        typer.Option(help="Who judges: the oracle, or TLC on the specification itself."),
    ] = "oracle",
    json_: Json = None,
) -> None:
    """Is each log allowed by the specification?  If not: the first event that is not, and why.

    With several logs, what was received is also compared with what was sent.
    """
    from automcm_spec.oracle import OracleError
    from automcm_spec.tlc import TlcError
    from automcm_traces import explain as explain_
    from automcm_traces import tlc_engine

    judge = tlc_engine.explain_files if engine == "tlc" else explain_.explain_files
    try:
        verdicts = judge(logs, late)
    except (OracleError, TlcError) as error:
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


trace_logs.register(app)
