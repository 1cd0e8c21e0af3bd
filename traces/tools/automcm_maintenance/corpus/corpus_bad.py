"""Logs with one defect, made from good ones by a small edit, with their correct verdicts: bad.toml.

The line of the verdict follows from the edit.  A missing effect is reported at the input of its
step; every other defect at the edited line.
"""

from __future__ import annotations

import copy
import json
import tomllib
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

Json = Any
INPUTS = ("receive", "command", "restart")
SEEDS = Path(__file__).with_name("bad.toml")


class EditedLog:
    """The records of a good log, for editing.  Lines count from 1."""

    def __init__(self, text: bytes) -> None:
        self.records: list[Json] = [json.loads(line) for line in text.splitlines()]

    def find(self, ev: str, nth: int = 1, **wanted: Json) -> int:
        """The line of the nth event of this kind whose message or payload has these fields."""
        for number, record in enumerate(self.records, 1):
            inner = dict(record)
            for part in ("message", "command", "indication", "timer"):
                inner |= record.get(part, {})
            if record.get("ev") == ev and wanted.items() <= inner.items():
                nth -= 1
                if not nth:
                    return number
        raise LookupError(f"the good log has no event {ev} with {wanted}")

    def input_of(self, line: int) -> int:
        """The line of the input of a line's step."""
        while (record := self.at(line))["ev"] not in INPUTS and record.get("op") != "expire":
            line -= 1
        return line

    def at(self, line: int) -> Json:
        """The record of a line."""
        return self.records[line - 1]

    def drop(self, line: int) -> None:
        """Remove a line."""
        del self.records[line - 1]

    def text(self) -> bytes:
        """The log with renumbered events."""
        renumber(self.records)
        return self.as_it_is()

    def as_it_is(self) -> bytes:
        """The log with its present numbers."""
        return b"".join(_line(record) for record in self.records)


def renumber(records: list[Json]) -> None:
    """Number the events of a log anew; its end has the last number."""
    seq = 0
    for record in records:
        if record["rec"] != "header":
            seq += record["rec"] == "event"
            record["seq"] = seq


def _line(record: Json) -> bytes:
    return json.dumps(record, ensure_ascii=False, separators=(",", ":")).encode() + b"\n"


def _edit(log: EditedLog, seed: Json) -> int:
    """Edit an event, as bad.toml says; returns the line of the verdict."""
    line = log.find(nth=seed.get("nth", 1), **seed["event"])
    record = log.at(line)
    match seed["edit"]:
        case "set":
            for name, value in seed["change"].items():
                holder = record
                *path, last = name.split(".")
                for part in path:
                    holder = holder[part]
                added = isinstance(value, dict) and value.keys() == {"add"}
                holder[last] = holder[last] + value["add"] if added else value
        case "drop":
            named = log.input_of(line)
            log.drop(line)
            return named
        case "drop_input":
            log.drop(line)
        case "twice":
            log.records.insert(line, copy.deepcopy(record))
            return line + 1
        case "later":
            now = record["t_ms"]
            for later in log.records[line - 1 :]:
                if later.get("t_ms") == now:
                    later["t_ms"] += seed["ms"]
                    if "deadline" in later:
                        later["deadline"] += seed["ms"]
        case other:
            raise ValueError(f"there is no edit {other!r}")
    return line


def _busy_accepted(log: EditedLog) -> tuple[int, bytes]:
    line = log.find("send", type="Acceptance", reason="busy")
    message = log.at(line)["message"]
    del message["reason"]
    message |= {"accepted": True, "selected": {"t0": 0, "points": [[0, 0, 0]]}}
    return line, log.text()


def _malformed_acked(log: EditedLog) -> tuple[int, bytes]:
    line = log.find("receive", type="Prescription")
    record = log.at(line)
    record["message"]["v"] = 2
    for hint in ("rule", "phase", "role"):
        del record[hint]
    return line + 1, log.text()


def _forged_content(log: EditedLog) -> tuple[int, bytes]:
    line = log.find("receive", type="Prescription")
    told = log.at(log.find("indication", name="verify"))["indication"]["prescription"]
    for prescription in (log.at(line)["message"], told):
        prescription["hold_ms"] = 1
    return line, log.text()


def _changed(n: int, line: int = 0, **change: Json) -> Callable[[EditedLog], tuple[int, bytes]]:
    """Change fields of the nth record; a number is added.  ``line`` is that of the verdict."""

    def edit(log: EditedLog) -> tuple[int, bytes]:
        for name, value in change.items():
            added = isinstance(value, int)
            log.records[n][name] = log.records[n][name] + value if added else value
        return line, log.as_it_is()

    return edit


def _raw(
    change: Callable[[list[bytes]], list[bytes]], line: int = 0
) -> Callable[[EditedLog], tuple[int, bytes]]:
    """Edit the lines as bytes.  ``line`` is that of the verdict."""
    return lambda log: (line, b"".join(change([_line(record) for record in log.records])))


END = {"rec": "end", "seq": 0, "reason": "clean", "lost_records": 0}
SPECIAL: Mapping[str, Callable[[EditedLog], tuple[int, bytes]]] = {
    "busy_accepted": _busy_accepted,
    "forged_content": _forged_content,
    "malformed_acked": _malformed_acked,
    "another_version": _changed(0, 1, schema="automcm.trace/2"),
    "no_timers_promised": _changed(0, complete=["command", "receive", "restart", "send"]),
    "lost_records": _changed(-1, lost_records=5),
    "seq_twice": _changed(9, 10, seq=-1),
    "seq_gap": _changed(9, 10, seq=1),
    "time_backwards": _changed(20, 21, t_ms=-101),  # from 700 ms, after 600 ms
    "empty": _raw(lambda lines: []),
    "rubbish": _raw(lambda lines: [bytes(range(256))], 1),
    "rubbish_inside": _raw(lambda lines: [*lines[:7], b"\xff\xfe\x00\n", *lines[8:]], 8),
    "no_header": _raw(lambda lines: lines[1:], 1),
    "header_again": _raw(lambda lines: [*lines[:10], lines[0], *lines[10:]], 11),
    "mixed_versions": _raw(
        lambda lines: [*lines[:10], lines[0].replace(b"trace/1", b"trace/2"), *lines[10:]], 11
    ),
    "after_the_end": lambda log: _raw(lambda lines: [*lines, lines[1]], len(log.records) + 1)(log),
    "a_float": _raw(
        lambda lines: [*lines[:4], lines[4].replace(b'"t_ms":300', b'"t_ms":300.5'), *lines[5:]], 5
    ),
    "no_events": _raw(lambda lines: [lines[0], _line(END)]),
    "cut": _raw(lambda lines: [*lines[:-1], lines[-1][:20]]),
}
"""The edits that are not of one event, by the name of the log."""


def bad_logs(bases: Mapping[str, bytes]) -> Iterator[tuple[str, Json, int, bytes]]:
    """Every bad log: its name, its table in bad.toml, the line of the verdict, and its text.

    ``bases`` are the good ones by name: "pair-1001" and so on.  Raises LookupError if a base does
    not contain the line to edit.
    """
    for name, seed in tomllib.loads(SEEDS.read_text(encoding="utf-8")).items():
        log = EditedLog(bases[seed["base"]])
        if seed["edit"] == "special":
            line, text = SPECIAL[name](log)
        else:
            line = _edit(log, seed)
            text = log.text()
        yield name, seed, line, text


#: Further good logs that are needed, and the events that each must contain.
WANTED: Mapping[str, tuple[str, Mapping[str, Json]]] = {
    "busy": ("send", {"type": "Acceptance", "reason": "busy"}),
    "abort": ("send", {"type": "Cancel", "reason": "abort"}),
    "closed": ("send", {"type": "Cancel", "reason": "closed"}),
    "restart": ("restart", {}),
}


def bases_among(logs: Sequence[bytes]) -> dict[str, bytes]:
    """The first of the shortest of these logs with the events of ``WANTED``."""
    found: dict[str, bytes] = {}
    for text in sorted(logs, key=len):
        for name, (ev, fields) in WANTED.items():
            with suppress(LookupError):
                if name not in found and EditedLog(text).find(ev, **fields):
                    found[name] = text
    return found
