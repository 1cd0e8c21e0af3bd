"""A page as a browser finds it: its data, rows and events."""

from __future__ import annotations

import json
import re
import sys
from pathlib import Path
from typing import Any

from automcm_spec.log_format.reader import Log
from automcm_traces.checker.follow import Check
from automcm_traces.system.fates import FATES
from automcm_traces.viewer.page_follow import StateHistory, States

Json = Any
DELIVERED, LOST, DUPLICATE, UNOBSERVED, IN_FLIGHT, SENDER_UNOBSERVED, FORGED, OVERHEARD = range(8)
REJECTED = FATES.index("rejected")
CORPUS = Path(__file__).parents[1] / "corpus"
FOUR = sorted((CORPUS / "four-vehicles").glob("*.ndjson"))


def data_of(page: bytes) -> Json:
    """The data as a browser finds it."""
    found = re.search(rb'<script type="application/json" id="data">(.*?)</script>', page, re.S)
    assert found is not None
    return json.loads(found[1])


def column(rows: Json, name: str) -> list[int]:
    value = rows[name]
    return value if isinstance(value, list) else [value] * len(rows["kinds"])


def referred(rows: Json, name: str) -> list[int]:
    found, new = [], 0
    for back in column(rows, name):
        found.append(new - back if back else new)
        new += not back
    return found


def unpacked(shapes: Json, value: Json) -> Json:
    if not isinstance(value, list):
        return value
    items = [unpacked(shapes, item) for item in value[1:]]
    return items if value[0] == -1 else dict(zip(shapes[value[0]], items, strict=True))


def events(data: Json) -> list[tuple[int, int, Json]]:
    """What viewer/data.js makes of the rows: station, line and event."""
    rows = data["rows"]
    kinds = {"s": "send", "r": "receive", "t": "timer", "c": "command", "i": "indication"}
    lines, found, t_ms = [1] * len(data["logs"]), [], 0
    bodies, hints = referred(rows, "body"), column(rows, "hint")
    for row, (log, line, t) in enumerate(
        zip(column(rows, "log"), column(rows, "line"), column(rows, "t"), strict=True)
    ):
        lines[log] += line + 1
        t_ms += t
        event = {
            "rec": "event",
            "seq": lines[log] - 1,
            "t_ms": t_ms,
            "ev": kinds.get(rows["kinds"][row], "restart"),
            **unpacked(data["shapes"], rows["bodies"][bodies[row]]),
        }
        if "deadline" in event:
            event["deadline"] += t_ms
        hint = data["strings"][hints[row]]
        event |= {n: v for n, v in zip(("rule", "phase", "role"), hint, strict=True) if v}
        found.append((data["logs"][log]["station"], lines[log], event))
    return found


def number(value: Json) -> int:
    return int(value["#bigint"]) if isinstance(value, dict) else int(value)


def followed_by(log: Log) -> StateHistory:
    states = States(range(sys.maxsize))
    Check(log, watchers=[states]).read()
    return states.history(log)


def fives(numbers: list[int]) -> list[tuple[int, ...]]:
    found, row = [], 0
    for n in range(0, len(numbers), 5):
        row += numbers[n]
        found.append((row, *numbers[n + 1 : n + 5]))
    return found
