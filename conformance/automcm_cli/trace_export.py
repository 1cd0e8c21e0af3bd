"""``automcm trace export``: logs for other tools."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import typer

from automcm_cli.common import CODES, Json, say_written
from automcm_cli.trace_logs import files_of
from automcm_spec import files


def register(app: typer.Typer) -> None:
    """Add the command."""
    epilog = "Example: automcm trace export 1001.ndjson 2002.ndjson --to mermaid.  " + CODES
    app.command("export", epilog=epilog)(export)


def export(
    logs: Annotated[list[Path], typer.Argument(help="Logs, or folders with logs; or one .mcap.")],
    to: Annotated[
        Literal["mermaid", "svg", "itf", "mcap", "logs"],
        typer.Option(help="mermaid; svg; itf (of one log); mcap (extra mcap); logs, of an .mcap."),
    ] = "mermaid",
    out: Annotated[Path, typer.Option(help="Folder for what is written.")] = Path("runs/export"),
    json_: Json = None,
) -> None:
    """Logs for other tools.  A diagram, a picture, states in ITF, or MCAP for Foxglove.

    A diagram has 400 messages at most, and says how many more there are. MCAP has a channel of
    JSON for each station; --to logs makes logs of it again, byte for byte.
    """
    from automcm_spec.bad_input import BadInput
    from automcm_traces.mcap_file import McapError
    from automcm_traces.merge import MergeError
    from automcm_traces.track import CannotTell

    try:
        contents = _files(logs if to == "logs" else files_of("export", logs), to)
        out.mkdir(parents=True, exist_ok=True)
        for name, data in contents.items():
            if (out / name).resolve() in {path.resolve() for path in logs}:
                raise typer.BadParameter(f"{out / name} is what is read", param_hint="--out")
            files.write(out / name, data)
    except CannotTell as error:
        typer.echo(f"export: CANNOT TELL: {error}", err=True)
        raise typer.Exit(4) from None
    except (BadInput, McapError, MergeError, OSError) as error:
        typer.echo(f"export: {error}", err=True)
        raise typer.Exit(3) from None
    say_written(json_, [out / name for name in contents])


def _files(paths: list[Path], to: str) -> dict[str, bytes]:
    """What is to be written, by name."""
    from automcm_traces import mcap_file
    from automcm_traces.drawing import drawing
    from automcm_traces.itf_log import from_log
    from automcm_traces.merge import merge
    from automcm_traces.mermaid import diagram
    from automcm_traces.reader import read
    from automcm_traces.show import Logs

    if to == "itf":
        if len({path.stem for path in paths}) < len(paths):
            raise typer.BadParameter("two logs have one name; export each by itself")
        return {f"{path.stem}.itf.json": from_log(read(path)).encode() for path in paths}
    if to == "svg":
        merged = merge([read(path) for path in paths])
        return {f"{paths[0].stem}.svg": drawing(merged).encode()}
    if to == "mcap":
        return {f"{paths[0].stem}.mcap": mcap_file.written(paths)}
    if to == "logs":
        return {name: data for path in paths for name, data in mcap_file.logs(path).items()}
    together = Logs(paths)
    text = "\n".join(diagram(together.rows(), together.stations)) + "\n"
    return {f"{paths[0].stem}.mmd": text.encode()}
