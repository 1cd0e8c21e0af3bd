"""Every system call of a station made to fail, in every phase: what its peer notices, and when.

    python conformance/tests/faults.py [--write PAGE] [--only TEXT] [--jobs N]

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
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

from fault_cell import Cell
from fault_reasons import WHY
from faulty_station import FAULTS, JUMP_S

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


def page(cells: Sequence[Cell]) -> str:
    """The matrix in Markdown."""
    heads = [f"{phase} ({part})" for _, phase, part in PHASES]
    wide, narrow = [], []
    for fault in FAULTS:
        row = [cell for cell in cells if cell.fault == fault]
        if not row:
            continue
        codes = ", ".join(str(code) for code in sorted({c.code for c in row if c.code is not None}))
        verdicts = ", ".join(sorted({cell.verdict.replace("_", " ") for cell in row}))
        outcomes = [cell.outcome + ("" if not cell.problems else " **(!)**") for cell in row]
        if any(outcome != "Fin" for outcome in outcomes):
            wide.append([fault, *outcomes])
        narrow.append([fault, codes, verdicts, WHY[fault].text])
    wide, narrow = _alike(wide), _alike(narrow)
    lines = [PAGE, *_table(["fault", *heads], wide), "", "## Why", ""]
    lines += _table(["fault", "exit code", "log", "effect"], narrow)
    problems = [f"{c.fault}, {c.phase} ({c.part}): {text}" for c in cells for text in c.problems]
    again = sum(cell.tries > 1 for cell in cells)
    lines += ["", f"{len(cells)} cells, {again} of them repeated; unexpected: {len(problems)}."]
    lines += problems
    return "\n".join(lines).rstrip() + "\n"


def _alike(rows: list[list[str]]) -> list[list[str]]:
    """Rows that differ only in their fault as one row."""
    faults: dict[tuple[str, ...], list[str]] = {}
    for fault, *rest in rows:
        faults.setdefault(tuple(rest), []).append(fault)
    return [["; ".join(names), *rest] for rest, names in faults.items()]


def _table(heads: list[str], rows: list[list[str]]) -> list[str]:
    """A table in Markdown, line by line."""
    rule = "|---" * len(heads) + "|"
    return [f"| {' | '.join(heads)} |", rule, *(f"| {' | '.join(row)} |" for row in rows)]


PAGE = f"""# Faults of a station

`make test-faults` starts a station and a peer on UDP. When the station enters a phase, the test
injects a fault, such as a failing system call, and observes the peer. Every fault has an expected
outcome. The test also checks that:

- the peer does not act longer than D + `t_cam_loss` after the station left or last sent a CAM that
  names the session (T-2);
- no CAM names a session that the station has left (ACT-5);
- the station stops on request, and its log can be read.

The first table shows how the session ended for the peer, by the phase in which the fault began. It
omits faults after which every session ended with a Fin.

- *Fin*: as if nothing had failed;
- *Cancel(reason)*: by a Cancel of the station;
- *end of CAMs*: no CAM that names the session came for `t_cam_loss` (ACT-2);
- *timer (rule)*: by another timer of the peer, before it acted;
- *no session*: the station never answered or never asked.

*Time jumps* and *the host sleeps* last {JUMP_S} s. A log diverges where the fault delayed
a timer or lost a step.
"""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--write", type=Path, help="write the page here")
    parser.add_argument("--only", default="", help="only faults whose name has this in it")
    parser.add_argument("--jobs", type=int, default=4, help="cells at a time")
    parser.add_argument("--keep", type=Path, help="keep the logs in this new folder")
    chosen = parser.parse_args()
    faults = [fault for fault in FAULTS if chosen.only in fault]
    with tempfile.TemporaryDirectory() as temporary:
        folder = chosen.keep or Path(temporary)
        folder.mkdir(exist_ok=True, parents=True)
        cells = asyncio.run(matrix(faults, chosen.jobs, folder))
    text = page(cells)
    if chosen.write:
        chosen.write.write_text(text)
    print(text)
    passed = sum(not cell.problems for cell in cells)
    print(f"{passed} passed, {len(cells) - passed} failed")
    sys.exit(passed < len(cells))


if __name__ == "__main__":
    main()
