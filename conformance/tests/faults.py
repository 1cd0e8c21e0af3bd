"""Every system call of a station made to fail, in every phase: what its peer notices, and when.

    python conformance/tests/faults.py [--write FILE] [--only TEXT] [--jobs N]

A station (faulty_station.py) and a peer coordinate over UDP.  When the station first enters the
phase of a cell, a fault begins.  A cell says how the session ended for the peer.  Whatever fails:

* the peer is told by a message, or by the end of CAMs, at most D + t_cam_loss after the station
  has left the session (T-2), and no CAM names a session that the station has left (ACT-5);
* the station ends when it is told to, with the exit code of its fault;
* its log can be read, and is allowed, or cannot tell, or diverges where the fault says so.
"""

from __future__ import annotations

import argparse
import asyncio
import json
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from fault_cell import Cell
from fault_reasons import WHY
from faulty_station import FAULTS

from automcm_maintenance.documents import built_pages

RETRIES = 2
PHASES = (
    ("none", "STANDALONE", "prescriber"),
    ("prescriber", "ADVERTISING", "prescriber"),
    ("prescriber", "CHOOSING", "prescriber"),
    ("prescriber", "PRESCRIBING", "prescriber"),
    ("prescriber", "NEGOTIATING", "prescriber"),
    ("prescriber", "ACTUATING", "prescriber"),
    ("none", "STANDALONE", "receiver"),
    ("receiver", "INTENDING", "receiver"),
    ("receiver", "WAITING", "receiver"),
    ("receiver", "NEGOTIATING", "receiver"),
    ("receiver", "ACTUATING", "receiver"),
)
"""Role and phase in which the fault begins, and the part that the station plays later."""


async def matrix(faults: Sequence[str], jobs: int, folder: Path) -> list[Cell]:
    """All cells, some at a time."""
    places = [(fault, *phase) for fault in faults for phase in PHASES]
    cells = []
    for n, (fault, role, phase, part) in enumerate(places):
        own = folder / str(n)
        own.mkdir()
        cells.append(Cell(fault, role, phase, part, own, 48_000 + n))
    free = asyncio.Semaphore(jobs)

    async def one(cell: Cell) -> None:
        async with free:
            await cell.run()
            for _ in range(RETRIES):  # a busy machine is late, or an Ack is overtaken
                if cell.problems:
                    cell.forget()
                    await cell.run()
        if sys.stderr.isatty():
            print(f"{cell.fault}, {cell.phase}: {cell.outcome}", file=sys.stderr)

    await asyncio.gather(*(one(cell) for cell in cells))
    return cells


def results(cells: Sequence[Cell]) -> dict[str, Any]:
    """What the page shows of the matrix."""
    shown = {}
    for fault in FAULTS:
        row = [cell for cell in cells if cell.fault == fault]
        if row:
            codes = sorted({cell.code for cell in row if cell.code is not None})
            shown[fault] = {
                "outcomes": [c.outcome + (" **(!)**" if c.problems else "") for c in row],
                "codes": ", ".join(map(str, codes)),
                "log": ", ".join(sorted({cell.verdict.replace("_", " ") for cell in row})),
                "effect": WHY[fault].text,
            }
    return {
        "phases": [f"{phase} ({part})" for _, phase, part in PHASES],
        "cells": len(cells),
        "repeated": sum(cell.tries > 1 for cell in cells),
        "problems": [
            f"{c.fault}, {c.phase} ({c.part}): {text}" for c in cells for text in c.problems
        ],
        "faults": shown,
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument(
        "--write", type=Path, help="write the results here, from which the page is built"
    )
    parser.add_argument("--only", default="", help="only faults whose name has this in it")
    parser.add_argument("--jobs", type=int, default=4, help="cells at a time")
    parser.add_argument("--keep", type=Path, help="keep the logs in this new folder")
    chosen = parser.parse_args()
    faults = [fault for fault in FAULTS if chosen.only in fault]
    with tempfile.TemporaryDirectory() as temporary:
        folder = chosen.keep or Path(temporary)
        folder.mkdir(exist_ok=True, parents=True)
        cells = asyncio.run(matrix(faults, chosen.jobs, folder))
    found = results(cells)
    if chosen.write:
        chosen.write.write_text(json.dumps(found, ensure_ascii=False, indent=1) + "\n")
    print(built_pages.faults_page(found))
    passed = sum(not cell.problems for cell in cells)
    print(f"{passed} passed, {len(cells) - passed} failed")
    sys.exit(passed < len(cells))


if __name__ == "__main__":
    main()
