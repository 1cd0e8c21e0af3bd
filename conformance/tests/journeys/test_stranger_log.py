"""A log by somebody who did not read the format: what the tool says of it is enough to mend it."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

from cli_stage import automcm

Json = Any
PATH = {"t0": 0, "points": [[0, 0, 0]]}
ACK: Json = {"v": 1, "type": "Ack", "src": 1, "dst": 7, "session": [1, 1], "seq": 0}
ADVERTISED = {"scenario": "lane_change", "details": {}}
TO_1: Json = {"v": 1, "src": 7, "dst": 1, "session": [1, 1]}
FROM_1: Json = {"v": 1, "src": 1, "dst": 7, "session": [1, 1]}
OFFER = {"seq": 2, "proposal": 1, "prescribed": PATH, "hold_ms": 2000, "lease_ms": 20_000}
ANSWER = {"seq": 2, "proposal": 1, "accepted": True, "reason": None, "selected": PATH}


def event(number: int, t: float, ev: str, type_: str, **fields: Json) -> Json:
    planned = {"planned": PATH} if type_ == "Advertisement" else {}
    message = (FROM_1 if ev == "receive" else TO_1) | fields | {"type": type_}
    if type_ == "Advertisement":
        del message["dst"]
    odd = {"rssi": -71} if ev == "receive" else {"phase": None}
    return {
        "rec": "event",
        "seq": number,
        "t_ms": t,
        "ev": ev,
        **odd,
        "message": message,
        **planned,
    }


HEADER = {
    "rec": "header",
    "schema": "automcm.trace/1",
    "run": "drive-1",
    "station": "7",
    "implementation": {"name": "mine", "version": "1"},
    "parameters": {},
    "complete": ["send", "receive"],
}
STRANGER = [
    HEADER,
    event(0, 0.5, "receive", "Advertisement", seq=1, **ADVERTISED),
    event(1, 0.51, "send", "Intention", seq=1, planned=PATH),
    event(2, 0.53, "receive", "Ack", seq=0, of={"type": "Intention", "seq": 1}),
    event(3, 0.9, "receive", "Prescription", **OFFER),
    event(4, 0.905, "send", "Ack", seq=0, of={"type": "Prescription", "seq": 2}),
    event(5, 0.95, "send", "Acceptance", **ANSWER),
    event(6, 0.97, "receive", "Ack", seq=0, of={"type": "Acceptance", "seq": 2}),
    {"rec": "end", "seq": 6, "reason": "clean", "lost_records": 0},
]


def written(folder: Path, lines: list[Json]) -> Path:
    path = folder / "stranger.ndjson"
    path.write_text("".join(json.dumps(line) + "\n" for line in lines))
    return path


def mended(lines: list[Json], field: str, problem: str) -> None:
    """Do what the tool says, in all lines that have this field."""
    *outer, name = field.split(".")
    for number, line in enumerate(lines):
        within = line
        for part in outer:
            within = within.get(part, {})
        if problem.startswith("missing: the station"):
            if line.get("ev") == "send":
                line["tx"] = f"7:{number}"
        elif name not in within:
            continue
        elif "milliseconds" in problem:
            within[name] = round(within[name] * 1000)
        elif renamed := re.search(r"name it (x_\w+)", problem):
            within[renamed[1]] = within.pop(name)
        elif added := re.search(r"add (\d+) to each", problem):
            within[name] += int(added[1])
        elif listed := re.search(r"must be sorted.*: (\[.*\])", problem):
            within[name] = json.loads(listed[1])
        elif "omit" in problem:
            if within[name] is None:
                del within[name]
        else:
            assert problem.startswith("must be an integer, not"), problem
            within[name] = int(within[name])


def test_two_rounds_of_edits_that_the_tool_names_are_enough(tmp_path: Path) -> None:
    lines = json.loads(json.dumps(STRANGER))
    rounds = 0
    while True:
        answer = automcm("trace", "explain", written(tmp_path, lines), "--json", "-")
        told = json.loads(answer.output)
        if told["verdict"] != "unreadable":
            break
        assert answer.exit_code == 3 and len(told["findings"]) <= 5
        for finding in told["findings"]:
            mended(lines, finding["field"], finding["problem"])
        rounds += 1
    assert (told["verdict"], answer.exit_code) == ("allowed", 0), told
    assert rounds <= 2 and "findings" not in told


def test_the_text_has_the_first_five_kinds_of_error(tmp_path: Path) -> None:
    path = written(tmp_path, STRANGER)
    lines = automcm("trace", "explain", path).output.splitlines()
    assert lines[1:] == [
        '  line 1: station: must be an integer, not "7"',
        '  line 1: complete: must be sorted, without duplicates: ["receive", "send"]',
        "  line 2: t_ms: must be an integer number of milliseconds, not 0.5 (and 6 times more)",
        "  line 2: rssi: unknown field: name it x_rssi, or omit it (and 3 times more)",
        "  line 2: seq: must count from 1, not from 0: add 1 to each, also in the end",
        f"  3 more kinds of error; all: automcm trace lint {path}",
    ]
