"""``automcm trace``: all its commands, and ``explain`` and ``replay``."""

from __future__ import annotations

import shlex
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from automcm_cli.shared.adapter_options import Limit, WithCommand, command_of
from automcm_cli.shared.common import Json, Late, code_3, example, say, say_lines, write_json
from automcm_cli.trace import trace_edit, trace_html, trace_logs, trace_watch
from automcm_cli.trace.trace_logs import Logs, files_of, refuse_given
from automcm_conformance.adapter.process import LIMIT_S
from automcm_spec.support.bad_input import BadInput, at_line
from automcm_spec.support.collection import uncollected

if TYPE_CHECKING:
    from automcm_conformance.replay.replay_log import Replayed
    from automcm_traces.explain.explain import Verdict

app = typer.Typer()
LONGEST = 2_000
"""Maximum characters of a printed line, because it quotes text of the station."""


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
    logs = files_of("explain", logs, json_)
    with uncollected():
        from automcm_traces.explain import explain as explain_
        from automcm_traces.explain import lint as lint_

        found = explain_.judged_logs(logs, late)
        if len(logs) > 1:
            verdicts, system = explain_.verdicts_together(found)
        else:
            verdicts, system = explain_.verdicts(found), None
    written: list[dict[str, str]] = []
    errors, reports = [], []
    for verdict, log in zip(verdicts, logs, strict=True):
        before = [Path(one["prefix"]) for one in written if one]
        written.append(_prefix(verdict, log, out, [*logs, *before]))
        kinds = lint_.kinds_of_error(log) if verdict.verdict == "unreadable" else []
        errors.append(kinds)
        findings = [kind.as_dict() for kind in kinds[: lint_.FIRST]]
        reports.append(verdict.as_dict() | written[-1] | ({"findings": findings} if kinds else {}))
    together = None if system is None else {"logs": reports, "system": system.as_dict()}
    write_json(json_, together or reports[0])
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
    raise typer.Exit(explain_.exit_code(verdicts, system))


def _prefix(verdict: Verdict, log: Path, out: Path, taken: list[Path]) -> dict[str, str]:
    """Write the failing prefix of a log that diverges; its path and the command that replays it.

    Files in ``taken`` are not overwritten.
    """
    from automcm_traces.explain.explain import prefix, replay

    if verdict.verdict != "diverges" or not verdict.seen:
        return {}
    try:
        path = prefix(verdict, out, taken, log)
    except OSError as error:
        say(f"explain: the failing prefix could not be written: {error}", err=True)
        return {}
    again = {} if verdict.judged_from else {"replay": replay(path)}  # from the station's start only
    return {"prefix": str(path)} | again


@app.command(cls=WithCommand, epilog=example("trace replay 2002.ndjson -- automcm adapter"))
def replay(
    ctx: typer.Context,
    log: Annotated[Path, typer.Argument(help="A log in the format automcm.trace/1.")],
    out: Annotated[Path, typer.Option(help="Folder for the new log.")] = Path("runs/replay"),
    limit: Limit = LIMIT_S,
    seed: Annotated[int, typer.Option(help="Seed of the station's random numbers.", min=0)] = 1,
    json_: Json = None,
) -> None:
    """Send a log's inputs to a station and check its answers.

    The answers are checked against the specification.  The new log is written to --out, so that
    trace diff can compare it with the log.
    """
    from automcm_conformance.replay.replay_log import replay as replay_
    from automcm_conformance.report.report import visible

    command = command_of(ctx)
    refuse_given(json_ or out, [log])
    with code_3("replay", BadInput, OSError):
        try:
            result = replay_(log, command, out, limit_s=limit, seed=seed)
        except BadInput as error:
            verdict = {"verdict": "unreadable", "file": str(log), "line": error.line}
            write_json(json_, verdict | {"event": error.what, "exit_code": 3})
            raise
    if write_json(json_, result.as_dict()):
        for text in _replayed(result):
            say(visible(text, limit=LONGEST))
    raise typer.Exit(result.exit_code)


def _replayed(result: Replayed) -> list[str]:
    from automcm_traces.explain.explain import expected

    word = result.verdict.replace("_", " ").upper()
    lines = [f"{at_line(result.file, result.line)}: {word}: {result.event}"]
    if result.verdict == "allowed":
        lines = [f"{result.file}: FOLLOWS the specification, {result.inputs} inputs"]
    if result.verdict != "allowed" and result.input:
        lines.append(f"  last input, {result.inputs} of {result.total}: {result.input}")
    lines += [f"  {line}" for line in expected(result.expected)]
    lines += [f"  by {result.guard}"] if result.guard else []
    lines += [f"  standard error: {text!r}" for text in result.stderr]
    lines += [f"  note: {note}" for note in result.notes]
    if result.log:
        lines.append(f"  its log: {at_line(result.log, result.log_line)}")
        if result.verdict == "allowed":
            compare = shlex.join(["automcm", "trace", "diff", result.file, result.log])
            lines.append(f"  compare: {compare}")
        if result.verdict == "diverges" and not result.in_log:
            lines.append(
                "  the new log alone does not show the error: logs do not contain next deadlines"
            )
    return lines


app.command(
    epilog=example(
        "trace html 1001.ndjson 2002.ndjson --out page.html",
        "To compare two runs, give the logs of the second with --compare.  ",
    )
)(trace_html.html)
app.command(epilog=example("trace shrink 1001.ndjson 2002.ndjson --out small"))(trace_edit.shrink)
app.command("diff", epilog=example("trace diff run-1 run-2 --times"))(trace_edit.compare)
app.command(epilog=example("trace export 1001.ndjson 2002.ndjson --to mermaid"))(trace_edit.export)
app.command(epilog=example("trace itf 1001.ndjson --out runs"))(trace_edit.itf)
app.command(epilog=example("trace lint 1001.ndjson logs/"))(trace_logs.lint)
app.command(epilog=example("trace show 1001.ndjson 2002.ndjson --session 1001/1"))(trace_logs.show)
app.command(epilog=example("trace coverage logs/ --json coverage.json"))(trace_logs.coverage)
app.command(
    epilog=example(
        "trace watch 1001.ndjson 2002.ndjson",
        "For logs that live stations send, give an address such as udp:127.0.0.1:47200.  ",
    )
)(trace_watch.watch)
