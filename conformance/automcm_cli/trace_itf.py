"""``automcm trace itf``: a counterexample as logs, or a log as ITF."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from automcm_cli.common import CODES, Json, say_written
from automcm_spec import files


def register(app: typer.Typer) -> None:
    """Add the command."""
    app.command("itf", epilog="Example: automcm trace itf 1001.ndjson --out runs.  " + CODES)(itf)


def itf(
    file: Annotated[Path, typer.Argument(help="A counterexample in ITF, or a log (.ndjson).")],
    out: Annotated[Path, typer.Option(help="Folder for what is written.")] = Path("."),
    json_: Json = None,
) -> None:
    """A counterexample in ITF as logs of its stations, a log as ITF.

    The counterexample is one of ours (automcm spec check, traces/counterexamples): TLC works out
    what its stations send.  In the ITF of a log each state is the station after a step.
    """
    from automcm_spec.bad_input import BadInput
    from automcm_spec.tlc import TlcError
    from automcm_traces import itf as itf_
    from automcm_traces.story import StoryError
    from automcm_traces.track import CannotTell

    if file.is_dir():
        typer.echo(f"itf: {file}: is a directory, neither a log nor a counterexample", err=True)
        raise typer.Exit(3)
    try:
        texts = _log_as_itf(file) if file.suffix == ".ndjson" else _itf_as_logs(file)
        out.mkdir(parents=True, exist_ok=True)
        for name, data in texts.items():
            files.write(out / name, data)
    except CannotTell as error:
        typer.echo(f"{file}: CANNOT TELL: {error}", err=True)
        raise typer.Exit(4) from None
    except (itf_.ItfError, BadInput, OSError, StoryError, TlcError) as error:
        typer.echo(f"itf: {error}", err=True)
        raise typer.Exit(3) from None
    say_written(json_, [out / name for name in texts])


def _itf_as_logs(file: Path) -> dict[str, bytes]:
    from automcm_traces.itf_log import behaviour

    return {f"{station}.ndjson": text for station, text in behaviour(file).logs().items()}


def _log_as_itf(file: Path) -> dict[str, bytes]:
    from automcm_traces.itf_log import from_log
    from automcm_traces.reader import read

    return {f"{file.stem}.itf.json": from_log(read(file)).encode()}
