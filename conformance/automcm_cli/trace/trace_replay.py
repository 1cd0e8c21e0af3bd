"""``automcm trace replay``: sends the inputs of a log to any station."""

from __future__ import annotations

import shlex
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from automcm_cli.shared.adapter_options import Limit, command_of
from automcm_cli.shared.common import Json, code_3, say, write_json
from automcm_conformance.adapter.process import LIMIT_S

if TYPE_CHECKING:
    from automcm_conformance.replay.replay_log import Replayed

LONGEST = 2_000
"""Maximum characters of a printed line, because it quotes text of the station."""


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
    from automcm_spec.support.bad_input import BadInput

    command = command_of(ctx)
    with code_3("replay", BadInput, OSError):
        try:
            result = replay_(log, command, out, limit_s=limit, seed=seed)
        except BadInput as error:
            verdict = {"verdict": "unreadable", "file": str(log), "line": error.line}
            write_json(json_, verdict | {"event": error.what, "exit_code": 3})
            raise
    if write_json(json_, result.as_dict()):
        for text in _text(result):
            say(visible(text, limit=LONGEST))
    raise typer.Exit(result.exit_code)


def _text(result: Replayed) -> list[str]:
    from automcm_spec.support.bad_input import at_line
    from automcm_traces.explain.explain import expected

    place = at_line(result.file, result.line)
    head = {
        "allowed": f"{result.file}: FOLLOWS the specification, {result.inputs} inputs",
        "diverges": f"{place}: DIVERGES: {result.event}",
        "cannot_tell": f"{place}: CANNOT TELL: {result.event}",
        "error": f"{place}: ERROR: {result.event}",
    }
    lines = [head[result.verdict]]
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
