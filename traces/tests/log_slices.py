"""Logs that hold only some kinds of event, and the places in a log where something happens."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

from automcm_traces.explain.explain import Verdict, verdict_of

PARTS = (
    ("send",),
    ("receive", "send"),
    ("send", "timer"),
    ("receive", "send", "timer"),
    ("command", "receive", "send"),
    ("command", "indication", "send"),
    ("indication", "receive", "restart", "send"),
    ("command", "indication", "receive", "send", "timer"),
)
Records = list[dict[str, Any]]


def judged(
    records: Records,
    kinds: tuple[str, ...],
    folder: Path,
    some: Callable[[str], bool] = lambda ev: False,
) -> Verdict:
    """The log with only these kinds of event, and the promise to hold all of them; and ``some`` of
    the events of other kinds."""
    kept = [r for r in records if r["rec"] != "event" or r["ev"] in kinds or some(r["ev"])]
    lines = []
    for seq, record in enumerate(kept):
        change: dict[str, Any] = {"seq": seq} if record["rec"] == "event" else {}
        change |= {"complete": list(kinds)} if record["rec"] == "header" else {}
        change |= {"seq": seq - 1} if record["rec"] == "end" else {}
        lines.append(json.dumps(record | change))
    path = folder / "log.ndjson"
    path.write_text("\n".join(lines) + "\n")
    return verdict_of(path)


def place(records: Records, ev: str, type_: str, number: int = 0) -> int:
    """Where the log has the nth event of a kind with a message of a type."""
    found = [
        n
        for n, r in enumerate(records)
        if r.get("ev") == ev and r.get("message", {}).get("type") == type_
    ]
    return found[number]
