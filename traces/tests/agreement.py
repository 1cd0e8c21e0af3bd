"""The verdicts on generated logs, and why each is right.

The same seed gives the same logs.  ``python agreement.py 2000`` has the engine judge so many good
and so many edited ones, and counts why each verdict is right.
"""

from __future__ import annotations

import json
import sys
import tempfile
from collections import Counter
from pathlib import Path

from generated_logs import Json, Lines, good_logs, inner, mutated

from automcm_spec.vocabulary.parameters import DEFAULTS, durations, longest_delay
from automcm_traces.checker.compared import told

# -- why a verdict on an edited log is right


INPUT = ("receive", "command", "restart")
FREE = {
    "CAM": "a CAM is judged by its marks, version and sender alone",
    "time": "no rule says when, within what the timers allow",
    "order": "what follows an input has no order",
    "input": "this input changes nothing here, or is another that calls for the same",
    "content": "content that no rule judges",
    "untold": "a duration that the header does not tell",
    "restart": "the stops after a restart are not wanted",
    "end": "no input comes after that would show that the timer was due",
    "nothing": "the edit changed nothing",
}
"""Why an edited log may be allowed."""


def reason(good: Lines, edited: Lines, kind: str, line: int, verdict: str, named: int) -> str:
    """Why the verdict on an edited log is right, in words; "" if no reason is known.

    ``verdict`` and ``named`` are what an engine said, ``line`` is where the edit was made.
    """
    records = [json.loads(text) for text in edited]
    if verdict in ("diverges", "unreadable"):
        if named == line:
            return "at the line"
        if kind == "swapped" and named == line + 1:
            return "at the line swapped with it"
        first, last = _step(records, line)
        before, end = _step(records, line - 1)
        if named in (first, before) or first <= named <= end:
            return "at the input whose step it was in"
        if first <= named <= last or before <= named <= end:
            return "later in the same step"
        if named > line and kind in ("dropped", "edited", "shifted", "duplicated", "swapped"):
            return _later(records, json.loads(good[line - 1]), kind, named)
        return ""
    if verdict == "allowed":
        return _allowed([json.loads(text) for text in good], records, kind, line)
    return ""


CONTENT = {
    *("scenario", "details", "planned", "prescribed", "selected", "hold_ms", "lease_ms", "reason"),
    *("generation_ms", "x_mm", "y_mm", "heading_mrad", "speed_mm_s"),
}
"""Fields of a message that mean nothing to who receives it; a lease counts when it is armed."""


def _alone(records: list[Json], line: int) -> bool:
    """Whether nothing follows from an input."""
    first, last = _step(records, line)
    return all(_is_cam(record) for record in records[first:last])


def timely(records: list[Json]) -> bool:
    """Whether each timer expires when due, is not overtaken, and lasts as the header tells."""
    p = records[0]["parameters"]
    late, told = longest_delay(DEFAULTS | p), durations(p)
    due: dict[str, int] = {}
    for record in records[1:]:
        key = json.dumps(record.get("timer"))
        if record.get("ev") == "restart":
            due.clear()
        elif record.get("op") == "arm":
            due[key] = record["deadline"]
            lasts = told[record["timer"]["name"]]
            if lasts is not None and record["deadline"] != record["t_ms"] + lasts:
                return False
        elif record.get("op") == "stop":
            due.pop(key, None)
        elif _is_input(record):
            if any(record["t_ms"] > deadline + late for deadline in due.values()):
                return False
            if record.get("op") == "expire" and record["t_ms"] < due.pop(key):
                return False
    return True


def _is_input(record: Json) -> bool:
    return record.get("ev") in INPUT or record.get("op") == "expire"


def _is_cam(record: Json) -> bool:
    return bool(record.get("message", {}).get("type") == "CAM")


def _step(records: list[Json], line: int) -> tuple[int, int]:
    """The first and the last line of the step that a line is in."""
    first = min(line, len(records))
    while first > 2 and not _is_input(records[first - 1]):
        first -= 1
    last = first
    while last < len(records) - 1 and not _is_input(records[last]):
        last += 1
    return first, last


def _later(records: list[Json], was: Json, kind: str, named: int) -> str:
    if was.get("ev") == "timer":
        return "later, when the timer is due or missed"
    if kind == "shifted":
        return "later, when a timer is due"
    if was.get("ev") == "receive" and _is_cam(was):
        return "later, by what the CAM should have done"
    if was.get("ev") in ("receive", "command", "send"):
        return "later, by what follows from the content"
    return ""


def _allowed(good: list[Json], edited: list[Json], kind: str, line: int) -> str:
    one = good[line - 1] if kind != "duplicated" else edited[line - 1]
    two = edited[line - 1] if line <= len(edited) else {}
    if kind == "shifted":
        return FREE["time"] if timely(edited) else ""
    if kind == "swapped":
        other = edited[line]
        if _is_cam(two) or _is_cam(other):
            return FREE["CAM"]
        if not _is_input(two) and not _is_input(other):
            return FREE["order"]
        if _is_input(two) and _is_input(other):
            return FREE["input"] if _alone(edited, line) or _alone(edited, line + 1) else ""
        return ""
    at_edit = good if kind == "dropped" else edited
    if _is_cam(one) and kind != "edited":
        return FREE["CAM"] if one["ev"] == "send" or _alone(at_edit, line) else ""
    if kind == "edited" and inner(one) == inner(two):
        return FREE["nothing"]
    if kind in ("dropped", "duplicated"):
        if one["ev"] == "receive":
            return FREE["input"] if _alone(at_edit, line) else ""
        at, _ = _step(good, line)
        if one.get("op") == "stop" and good[at - 1].get("ev") == "restart":
            return FREE["restart"]
        later = filter(_is_input, good[line:])
        if one.get("timer") == {"name": "backoff"}:  # it lasts as long as it likes, and says
            later = filter(lambda r: r["ev"] == "command", later)  # something to a request alone
        if one.get("op") == "expire" and not any(later):
            return FREE["end"]
        return ""
    if one.get("op") == "arm" and one["deadline"] != two["deadline"]:
        return FREE["untold"]
    if one["ev"] == "receive" or _is_cam(one):
        message = one["message"], two["message"]
        changed = {name for name in message[0] if message[0][name] != message[1].get(name)}
        opaque = (
            changed <= CONTENT or set(one) - set(two) or one.get("planned") != two.get("planned")
        )
        alone = one["ev"] == "receive" and _alone(edited, line)
        return FREE["content"] if opaque or alone else ""
    if one["ev"] == "indication":
        content = [(i["name"], told(i["name"], i)) for i in (one["indication"], two["indication"])]
        return FREE["content"] if content[0] == content[1] else ""
    if one["ev"] == "command" and one["command"]["name"] == two["command"]["name"]:
        return FREE["content"]
    at, _ = _step(good, line)
    if one.get("op") == "stop" and good[at - 1].get("ev") == "restart":
        return FREE["restart"]
    return ""


def main(number: int) -> int:
    """Have both engines judge; returns how many verdicts have no reason, or are not the same."""
    from tlc_engine import explain_batch

    from automcm_spec.log_format.reader import read
    from automcm_traces.explain.explain import verdict_of

    counts: Counter[tuple[str, str, str]] = Counter()
    odd = 0
    logs, verdicts = [], []
    with tempfile.TemporaryDirectory() as folder:

        def judge(lines: Lines, name: str) -> tuple[str, int]:
            path = Path(folder) / f"{name}.ndjson"
            path.write_text("\n".join(lines) + "\n")
            verdict = verdict_of(path)
            if verdict.verdict != "unreadable":  # both have the same reader
                logs.append(read(path))
                verdicts.append(verdict)
            return verdict.verdict, verdict.finding.at.line

        for n, lines in enumerate(good_logs(number, 1)):
            verdict, named = judge(lines, f"{n}-good")
            counts["good", verdict, ""] += 1
            odd += verdict != "allowed"
            edited, kind, line = mutated(lines, n)
            verdict, named = judge(edited, f"{n}-{kind}-{line}")
            why = reason(lines, edited, kind, line, verdict, named)
            counts[kind, verdict, why or "no reason known"] += 1
            if not why:
                odd += 1
                print(f"log {n}, {kind} at line {line}: {verdict} at {named}")
        for key in sorted(counts):
            print(f"{counts[key]:6} {' | '.join(key)}")
        differ = 0
        for one, two in zip(verdicts, explain_batch(logs), strict=True):
            mine, theirs = one.finding, two.finding
            if (one.verdict, mine.at.line) != (two.verdict, theirs.at.line):
                differ += 1
                where = Path(one.file).name
                print(f"{where}: {one.verdict} at {mine.at.line}: {mine.observed}")
                print(f"    TLC: {two.verdict} at {theirs.at.line}: {theirs.observed}")
    print(
        f"{len(logs)} logs, {sum(len(log.events) for log in logs)} events; engines differ: {differ}"
    )
    return odd + differ


if __name__ == "__main__":
    raise SystemExit(main(int(sys.argv[1])) > 0)
