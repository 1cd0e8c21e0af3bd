"""Logs made by hand, and logs with one thing changed, for tests."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

from automcm_maintenance.corpus.corpus_bad import EditedLog as Edited

Line = dict[str, Any]
HEADER: Line = {
    "rec": "header",
    "schema": "automcm.trace/1",
    "run": "r1",
    "station": 7,
    "implementation": {"name": "acme", "version": "1.0"},
    "parameters": {"t_resend": 100},
    "complete": ["receive", "send"],
}


def end(seq: int, lost: int = 0) -> Line:
    return {"rec": "end", "seq": seq, "reason": "clean", "lost_records": lost}


def write(folder: Path, *lines: Line | bytes) -> Path:
    path = folder / "7.ndjson"
    raw = (line if isinstance(line, bytes) else json.dumps(line).encode() + b"\n" for line in lines)
    path.write_bytes(b"".join(raw))
    return path


def find(path: Path, ev: str, nth: int = 1, **wanted: Any) -> int:
    """The line of the nth event of this kind that has these fields."""
    return Edited(path.read_bytes()).find(ev, nth, **wanted)


def edited(path: Path, folder: Path, edit: Callable[[Edited], object]) -> Path:
    """A copy in a folder, its events numbered anew."""
    log = Edited(path.read_bytes())
    edit(log)
    folder.mkdir(exist_ok=True)
    (folder / path.name).write_bytes(log.text())
    return folder / path.name
