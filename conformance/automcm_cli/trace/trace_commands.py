"""``automcm trace``: all its commands, and ``explain``."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from automcm_cli.shared.adapter_options import WithCommand
from automcm_cli.shared.common import Json, Late, example, say, say_lines, write_json
from automcm_cli.trace import (
    trace_edit,
    trace_export,
    trace_html,
    trace_logs,
    trace_replay,
    trace_watch,
)
from automcm_cli.trace.trace_logs import Logs, files_of
from automcm_spec.support.collection import uncollected

if TYPE_CHECKING:
    from automcm_traces.explain.explain import Verdict

app = typer.Typer()


@app.command(epilog=example("trace explain 1001.ndjson 2002.ndjson"))
def explain(
    logs: Logs,
    late: Late = None,
    out: Annotated[
        Path, typer.Option(help="Folder for the failing prefix of a log that diverges.")
    ] = Path("runs/explain"),
    absolute: Annotated[
        bool, typer.Option("--absolute", help="Show times as logged, not from the start.")
    ] = False,
    matrix: Annotated[
        bool,
        typer.Option("--matrix", help="Count the messages between each two stations, by fate."),
    ] = False,
    json_: Json = None,
) -> None:
    """Check logs against the specification.

    For each log that the specification does not allow, reports the first violation and its cause.
    Several logs of one run are also checked together: received messages against sent ones, and
    the properties of the system (S-*, T-*), with the hazards that a fault has caused.
    """
    from automcm_traces.explain import explain as explain_
    from automcm_traces.explain import lint as lint_

    logs = files_of("explain", logs)
    several = len(logs) > 1
    with uncollected():
        found = [explain_.judged_log(log, late, keep=several) for log in logs]
        if several:
            verdicts, system = explain_.verdicts_together(found)
        else:
            verdicts, system = explain_.verdicts(found), None
    written: list[dict[str, str]] = []
    for verdict, log in zip(verdicts, logs, strict=True):
        written.append(_prefix(verdict, log, out, written))
    errors = [
        lint_.kinds_of_error(log) if verdict.verdict == "unreadable" else []
        for verdict, log in zip(verdicts, logs, strict=True)
    ]
    reports = [v.as_dict() | where for v, where in zip(verdicts, written, strict=True)]
    for report, kinds in zip(reports, errors, strict=True):
        if kinds:
            report["findings"] = [kind.as_dict() for kind in kinds[: lint_.FIRST]]
    if system is None:
        write_json(json_, reports[0])
    else:
        write_json(json_, {"logs": reports, "system": system.as_dict()})
    if str(json_) != "-":
        start_ms = None if absolute else explain_.start_times(verdicts)
        for verdict, where, kinds, log in zip(verdicts, written, errors, logs, strict=True):
            say_lines(explain_.text(verdict, start_ms))
            for line in lint_.errors_text(kinds, log):
                say(f"  {line}")
            for name, value in where.items():
                say(f"  {name}: {value}")
        if system is not None:
            say_lines(system.text(start_ms, matrix))
    code = explain_.exit_code(verdicts)
    raise typer.Exit(1 if system is not None and system.verdict == "violated" else code)


def _prefix(verdict: Verdict, log: Path, out: Path, before: list[dict[str, str]]) -> dict[str, str]:
    """Write the failing prefix of a log that diverges; its path and the command that replays it.

    ``before`` holds the earlier results, whose files are not overwritten.
    """
    from automcm_traces.explain.explain import prefix, replay

    if verdict.verdict != "diverges" or not verdict.seen:
        return {}
    try:
        taken = {Path(other["prefix"]) for other in before if other}
        path = prefix(verdict, out, taken, log)
    except OSError as error:
        say(f"explain: the failing prefix could not be written: {error}", err=True)
        return {}
    again = {} if verdict.judged_from else {"replay": replay(path)}  # from the station's start only
    return {"prefix": str(path)} | again


app.command(
    epilog=example(
        "trace html 1001.ndjson 2002.ndjson --out page.html",
        "To compare two runs, give the logs of the second with --compare.  ",
    )
)(trace_html.html)
app.command(epilog=example("trace shrink 1001.ndjson 2002.ndjson --out small"))(trace_edit.shrink)
app.command("diff", epilog=example("trace diff run-1 run-2 --times"))(trace_edit.compare)
app.command(epilog=example("trace export 1001.ndjson 2002.ndjson --to mermaid"))(
    trace_export.export
)
app.command(epilog=example("trace itf 1001.ndjson --out runs"))(trace_export.itf)
app.command(epilog=example("trace lint 1001.ndjson logs/"))(trace_logs.lint)
app.command(epilog=example("trace show 1001.ndjson 2002.ndjson --session 1001/1"))(trace_logs.show)
app.command(epilog=example("trace coverage logs/ --json coverage.json"))(trace_logs.coverage)
app.command(cls=WithCommand, epilog=example("trace replay 2002.ndjson -- automcm adapter"))(
    trace_replay.replay
)
app.command(
    epilog=example(
        "trace watch 1001.ndjson 2002.ndjson",
        "For logs that live stations send, give an address such as udp:127.0.0.1:47200.  ",
    )
)(trace_watch.watch)
