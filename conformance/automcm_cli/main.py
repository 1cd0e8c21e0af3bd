"""The one console script, ``automcm``.  Imports lazily: each command only what it needs."""

from __future__ import annotations

import json
import signal
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated, Any

import typer

CODES = (
    "Exit codes: 0 as expected; 1 a verdict against; 2 usage; 3 a tool or an input could not be "
    "read or run; 4 cannot tell."
)

app = typer.Typer(
    name="automcm",
    help="Maneuver coordination: a checked specification, and what is held against it.",
    epilog=CODES,
    no_args_is_help=True,
    pretty_exceptions_enable=False,
)
trace = typer.Typer(help="Logs: what happened, and was it allowed?", epilog=CODES)
app.add_typer(trace, name="trace", no_args_is_help=True)
spec = typer.Typer(help="The specification: list its models, check one.", epilog=CODES)
app.add_typer(spec, name="spec", no_args_is_help=True)

Json = Annotated[
    Path | None,
    typer.Option("--json", help="Write the report here as JSON; - for standard output."),
]


def _write_json(target: Path | None, value: Any) -> None:
    if target is None:
        return
    text = json.dumps(value, indent=2) + "\n"
    try:
        if str(target) == "-":
            sys.stdout.write(text)
        else:
            target.write_text(text)
    except OSError as error:
        typer.echo(f"{target}: {error.strerror}", err=True)
        raise typer.Exit(3) from None


@contextmanager
def _progress() -> Iterator[Callable[[str], None]]:
    """A status line on a terminal; nothing in a pipe."""
    from rich.console import Console

    console = Console(stderr=True)
    if not console.is_terminal:
        yield lambda text: None
        return
    with console.status("") as status:
        yield lambda text: status.update(text)


@app.command(epilog="Example: automcm verify --profile full --json report.json.  " + CODES)
def verify(
    profile: Annotated[
        str, typer.Option(help="quick, or full (also the two-peer graph).")
    ] = "quick",
    json_: Json = None,
) -> None:
    """Model-check, write the oracle out, compare the reference with it; one screen."""
    if profile not in ("quick", "full"):
        raise typer.BadParameter(f"{profile!r} is neither quick nor full", param_hint="--profile")
    from rich.console import Console

    from automcm_cli import screen
    from automcm_cli import verify as verify_

    with _progress() as say:
        report = verify_.run("full" if profile == "full" else "quick", say)
    _write_json(json_, report.as_dict())
    if str(json_) != "-":
        console = Console()
        screen.show(report, console if console.is_terminal else Console(width=100))
    raise typer.Exit(report.exit_code)


@app.command(epilog="Example: automcm generate.  " + CODES)
def generate(
    two_peers: Annotated[bool, typer.Option(help="Also the two-peer graph (minutes).")] = True,
) -> None:
    """Renew the generated files: oracles, counterexamples, corpus, schema, rule table."""
    from automcm_cli import generated
    from automcm_spec.models import ModelError
    from automcm_spec.tlc import TlcError
    from automcm_spec.toolchain import ToolError

    try:
        with _progress() as say:
            changed = generated.write(say, two_peers)
    except (TlcError, ToolError, ModelError, OSError, ValueError) as error:
        typer.echo(f"generate: {error}", err=True)
        raise typer.Exit(3) from None
    for path in changed:
        typer.echo(f"renewed {path.relative_to(generated.ROOT)}")
    if not changed:
        typer.echo("everything was up to date")


@trace.command(epilog="Example: automcm trace explain 1001.ndjson 2002.ndjson.  " + CODES)
def explain(
    logs: Annotated[list[Path], typer.Argument(help="Logs in the format automcm.trace/1.")],
    json_: Json = None,
) -> None:
    """Is each log allowed by the specification?  If not: the first event that is not, and why.

    With several logs, what was received is also compared with what was sent.
    """
    from automcm_spec.oracle import OracleError
    from automcm_traces import explain as explain_

    try:
        verdicts = explain_.explain_files(logs)
    except OracleError as error:
        typer.echo(f"explain: {error}", err=True)
        raise typer.Exit(3) from None
    if len(verdicts) == 1:
        _write_json(json_, verdicts[0].as_dict())
    else:
        _write_json(json_, [verdict.as_dict() for verdict in verdicts])
    if str(json_) != "-":
        for verdict in verdicts:
            typer.echo(explain_.text(verdict))
    raise typer.Exit(explain_.exit_code(verdicts))


@spec.command("list", epilog="Example: automcm spec list.  " + CODES)
def spec_list(json_: Json = None) -> None:
    """The models: what each must show, and why it is there."""
    from automcm_cli import spec as spec_

    models = _loaded()
    _write_json(json_, [model.model_dump(exclude_none=True) for model in models])
    if str(json_) != "-":
        for model in models:
            typer.echo(spec_.described(model))


@spec.command("check", epilog="Example: automcm spec check rejoin --json -.  " + CODES)
def spec_check(
    names: Annotated[list[str], typer.Argument(help="Models, as automcm spec list names them.")],
    json_: Json = None,
) -> None:
    """Check models with TLC; a counterexample is shown as the inputs that lead to it."""
    from automcm_cli import spec as spec_

    known = {model.cfg: model for model in _loaded()}
    for name in names:
        if name not in known:
            raise typer.BadParameter(spec_.unknown(name, list(known)), param_hint="MODEL")
    verdicts = []
    for name in names:
        with _progress() as say:
            verdicts.append(spec_.check(known[name], say))
        if str(json_) != "-":
            typer.echo(spec_.shown(verdicts[-1]))
    _write_json(json_, [spec_.as_dict(verdict) for verdict in verdicts])
    raise typer.Exit(spec_.exit_code(verdicts))


def _loaded() -> list[Any]:
    from automcm_spec import models

    try:
        return list(models.load())
    except models.ModelError as error:
        typer.echo(f"spec: {error}", err=True)
        raise typer.Exit(3) from None


def main() -> None:
    """Entry point.  SIGTERM ends like Ctrl-C, so that no child is left behind."""

    def stop(*_: object) -> None:
        raise KeyboardInterrupt

    signal.signal(signal.SIGTERM, stop)
    app()
