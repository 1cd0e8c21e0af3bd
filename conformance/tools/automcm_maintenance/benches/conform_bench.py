"""``automcm bench conform``: the figures as a table."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path
from time import perf_counter
from typing import TYPE_CHECKING, Annotated

import typer

from automcm_cli.shared.adapter_options import purposes_of
from automcm_cli.shared.common import Json, code_3, console_of, progress, table_of, write_json
from automcm_maintenance.code_mutation.cpp_station import SOURCE, build, missing
from automcm_spec.support import children, scratch

if TYPE_CHECKING:
    from automcm_maintenance.benches.adapter_bench import AdapterRow


def conform(
    selector: Annotated[
        list[str] | None,
        typer.Option(help="Cases to run; a selector as in conform run.  Repeatable."),
    ] = None,
    cpp: Annotated[
        Path | None, typer.Option(help="Folder with the built C++ station and echo adapter.")
    ] = None,
    must: Annotated[
        bool, typer.Option(help="Measure all MUST cases on the C++ station, too (a minute).")
    ] = False,
    json_: Json = None,
) -> None:
    """Measure the kit's steps per second.

    Each adapter is compared with an echo adapter in the same language.  There is no verdict: the
    figures depend on the machine, the ratios less so.
    """
    from automcm_conformance.adapter.process import AdapterError
    from automcm_conformance.adapter.protocol import ProtocolError
    from automcm_maintenance.benches import adapter_bench
    from automcm_spec.graph.oracle import OracleError, load
    from automcm_spec.graph.oracle_generation import ONE_PEER, spec_hash

    chosen = purposes_of(selector or ["AMCM/RCV/NEG", "AMCM/PRE/END"])
    rows, notes = [], []
    with (
        code_3("bench", AdapterError, ProtocolError, OracleError, OSError),
        progress() as notify,
        scratch.folder("bench") as folder,
    ):
        oracle = load(ONE_PEER.path, spec_hash())
        python = [sys.executable, "-m", "automcm_cli", "adapter"]
        echo = [sys.executable, "-m", "automcm_maintenance.benches.echo_adapter"]
        rows.append(adapter_bench.measure("Python", python, echo, oracle, chosen, notify))
        notify("building the C++ station")
        built = cpp or _build(folder)
        if built is None:
            notes.append("C++ left out: it needs g++, cmake and nlohmann-json3-dev")
        else:
            station, floor = [str(built / "station")], [str(built / "echo")]
            rows.append(adapter_bench.measure("C++", station, floor, oracle, chosen, notify))
            if must:
                seconds = _all_must(station, folder)
                notes.append(f"all MUST cases on the C++ station: {seconds:.1f} s")
    notes.append(f"memory of the kit: {adapter_bench.memory_mb()} MB at most")
    if write_json(json_, {"rows": [row.as_dict() for row in rows], "notes": notes}):
        _show(rows, notes)


def _build(folder: Path) -> Path | None:
    """Build the C++ station and its echo adapter; None if the tools are missing."""
    if not SOURCE.is_dir() or missing():
        return None
    try:
        return build(folder, "echo").parent
    except subprocess.CalledProcessError:
        return None


def _all_must(command: list[str], folder: Path) -> float:
    """The time in seconds of a run of all MUST cases, including loading and reports."""
    words = [sys.executable, "-m", "automcm_cli", "conform", "run", "MUST", "--out"]
    start = perf_counter()
    words += [str(folder / "run"), "--", *command]
    subprocess.run(children.ending_with_parent(words), capture_output=True, check=False)
    return perf_counter() - start


def _show(rows: list[AdapterRow], notes: list[str]) -> None:
    table = table_of(
        *("", "lines", "steps/s", "checked"),
        *("/ unchecked", "/ echo", "/ echo singly", "wrong"),
    )
    for row in rows:
        out = row.as_dict()
        table.add_row(
            row.language,
            f"{row.lines:,}",
            f"{row.steps_per_s:,.0f}",
            f"{row.checked_s:.1f} s",
            f"{out['checked_over_unchecked']:.2f}",
            f"{out['checked_over_echo']:.2f}",
            f"{out['checked_over_single']:.2f}",
            str(row.faults),
        )
    console = console_of()
    console.print(table)
    for note in notes:
        console.print(note, highlight=False)
