"""Generated logs for tests: good ones, of models and of the reference, and edits of them.

The same seed gives the same logs.  ``python agreement.py 2000`` has the engine judge so many good
and so many edited ones, and counts why each verdict is right.
"""

from __future__ import annotations

import copy
import json
import random
import re
import sys
import tempfile
from collections import Counter
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from automcm.links.simulated_radio import Channel
from automcm.scenarios.simulation import Simulation
from automcm.scenarios.straight_lane import Straight
from automcm_spec.model_checking import tlc_simulation
from automcm_spec.vocabulary.application import Abort
from automcm_spec.vocabulary.parameters import DEFAULTS, Parameters, durations, longest_delay
from automcm_traces.checker.track import INITIAL
from automcm_traces.export import behaviour_to_log
from automcm_traces.export.behaviour_effects import Question, ask
from automcm_traces.export.behaviour_steps import Move, happenings

Json = Any
Lines = list[str]
STATIONS = (1, 2, 3, 4)
KINDS = ("dropped", "duplicated", "swapped", "edited", "shifted")


def of_the_model(number: int, seed: int, depth: int = 60) -> list[Lines]:
    """``number`` logs of random behaviours of four stations (TLC), or a few less; none is empty."""
    logs: list[Lines] = []
    count = -(-number // 4) + 4
    for lively in (False, True):
        found = tlc_simulation.behaviours(count // 2 + 1, depth, seed, lively=lively)
        logs += _told(found, f"model-{seed}")
    return logs[:number] if len(logs) >= number else logs


def _told(found: Sequence[Any], run: str) -> list[Lines]:
    cfg = tlc_simulation.CONFIG.format(spec="AnySpec")
    cfg = re.sub(r"(?m)^(SPECIFICATION|INVARIANTS|CHECK).*\n", "", cfg)
    stories = [_moves(behaviour) for behaviour in found]
    effects: dict[Question, behaviour_to_log.Effects] = {}

    def asker(questions: Any) -> dict[Question, behaviour_to_log.Effects]:
        missing = [q for q in questions if q not in effects]
        for first in range(0, len(missing), 1500):
            effects.update(ask("Simulation", cfg, missing[first : first + 1500]))
        return effects

    happenings([move for moves in stories for move in moves], asker, False)
    logs = []
    for n, moves in enumerate(stories):
        told = happenings(moves, asker, False)
        written = behaviour_to_log.logs(f"{run}-{n}", told, STATIONS, {"max_rounds": 3})
        logs += [text.decode().splitlines() for text in written.values()]
    return [lines for lines in logs if len(lines) > 2]


def _moves(behaviour: tlc_simulation.Behaviour) -> list[Move]:
    at = {s: INITIAL for s in STATIONS}
    moves = []
    for who, value, after in behaviour:
        following = at | {who: after}
        moves.append(Move(who, value, at, following))
        at = following
    return moves


def of_the_reference(number: int, seed: int) -> list[Lines]:
    """``number`` logs of simulations: parameters, loss, duplicates, restarts and aborts vary."""
    chance = random.Random(seed)
    logs: list[Lines] = []
    while len(logs) < number:
        logs += _simulated(chance)
    return logs[:number]


def _simulated(chance: random.Random) -> list[Lines]:
    t_timeout, t_resend = chance.choice([0, 200, 400, 700]), chance.choice([100, 150, 200])
    parameters = Parameters(
        t_timeout=t_timeout, t_resend=t_resend, max_rounds=chance.randint(1, 4), t_cam=1000
    )
    channel = Channel(loss=chance.choice([0, 0.1, 0.3]), duplicate=chance.choice([0, 0.2]))
    seed = chance.randrange(10**6)
    with tempfile.TemporaryDirectory() as folder:
        simulation = Simulation(seed=seed, channel=channel, logs=Path(folder))
        stations = [1001, 2002, 3003, 4004][: chance.randint(2, 4)]
        for station in stations:
            driver = Straight(refuse_first=chance.choice([0, 0, 1, 2]), maneuver_ms=600)
            simulation.add(station, driver, parameters)
        for _ in range(chance.randint(1, 2)):
            simulation.request(chance.choice(stations), at=chance.randrange(1500))
        if chance.random() < 0.3:
            simulation.restart(chance.choice(stations), at=chance.randrange(500, 3000))
        if chance.random() < 0.3:
            abort = Abort(session=(chance.choice(stations), 1))
            simulation.command(chance.choice(stations), abort, at=chance.randrange(500, 3000))
        simulation.run(until=chance.randrange(1500, 5000))
        texts = [path.read_text() for path in sorted(Path(folder).iterdir())]
    logs = [text.splitlines() for text in texts]
    return [lines for lines in logs if len(lines) > 2]


def good_logs(number: int, seed: int) -> list[Lines]:
    """``number`` logs that the specification allows: half of the model, half of the reference."""
    half = number // 2
    logs = of_the_model(half, seed)
    return logs + of_the_reference(number - len(logs), seed)


def mutated(lines: Lines, seed: int) -> tuple[Lines, str, int]:
    """A log with one edit, still readable: its lines, the kind, and the line edited.

    What is dropped, duplicated or swapped is renumbered; times are made to go forward.
    """
    chance = random.Random(seed)
    records = [json.loads(line) for line in lines]
    body = [n for n, record in enumerate(records) if record["rec"] == "event"]
    kind = chance.choice(KINDS)
    at = chance.choice(body)
    match kind:
        case "dropped":
            del records[at]
        case "duplicated":
            records.insert(at + 1, copy.deepcopy(records[at]))
            at += 1
        case "swapped":
            pairs = [n for n in body[:-1] if _inner(records[n]) != _inner(records[n + 1])]
            at = chance.choice(pairs) if pairs else body[0]
            if pairs:
                records[at], records[at + 1] = records[at + 1], records[at]
                times = sorted((records[at]["t_ms"], records[at + 1]["t_ms"]))
                records[at]["t_ms"], records[at + 1]["t_ms"] = times
        case "edited":
            _edit(records[at], chance)
        case "shifted" if chance.random() < 0.5:
            late = chance.choice([30, 120, 900])
            for record in records[at:]:
                for name in ("t_ms", "deadline"):
                    if name in record:
                        record[name] += late
        case "shifted":
            room = records[at + 1]["t_ms"] if at + 1 in body else records[at]["t_ms"] + 500
            first = records[at - 1]["t_ms"] if at - 1 in body else 0
            choices = [t for t in (first, room, records[at]["t_ms"] + 1) if first <= t <= room]
            records[at]["t_ms"] = chance.choice(choices)
    return _numbered(records), kind, at + 1


def _inner(record: Json) -> Json:
    return {k: v for k, v in record.items() if k not in ("seq", "t_ms")}


def _numbered(records: list[Json]) -> Lines:
    number = 0
    for record in records:
        if record["rec"] == "event":
            number += 1
            record["seq"] = number
        elif record["rec"] == "end":
            record["seq"] = number
    return [json.dumps(record, separators=(",", ":")) for record in records]


def _edit(record: Json, chance: random.Random) -> None:
    """Change one field of what the event carries, not its hints."""
    places = list(
        _places(
            record,
            [n for n in ("message", "command", "indication", "timer", "deadline") if n in record],
        )
    )
    if not places:
        record["t_ms"] += 0
        return
    holder, key = chance.choice(places)
    holder[key] = _other(key, holder[key], chance)


def _places(holder: Json, keys: Sequence[Any]) -> Iterator[tuple[Json, Any]]:
    for key in keys:
        value = holder[key]
        if isinstance(value, dict):
            yield from _places(value, sorted(value))
        elif isinstance(value, list):
            yield from _places(value, range(len(value)))
        else:
            yield holder, key


_NAMES = {
    "type": ("Intention", "Prescription", "Acceptance", "Fin", "Cancel", "Ack"),
    "reason": ("timeout", "abort", "cam_loss", "unsafe", "busy", "closed"),
    "name": (),
}


def _other(key: Any, value: Json, chance: random.Random) -> Json:
    if isinstance(value, bool):
        return not value
    if isinstance(value, int):
        less = chance.random() < 0.3 and value > 0
        return value - 1 if less else value + chance.choice([1, 2, 1000])
    others = [name for name in _NAMES.get(str(key), ()) if name != value]
    return chance.choice(others) if others else value + "x"


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
    if kind == "edited" and _inner(one) == _inner(two):
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
    if one["ev"] == "indication" and one["indication"]["name"] == two["indication"]["name"]:
        return FREE["content"]
    if one["ev"] == "command" and one["command"]["name"] == two["command"]["name"]:
        return FREE["content"]
    at, _ = _step(good, line)
    if one.get("op") == "stop" and good[at - 1].get("ev") == "restart":
        return FREE["restart"]
    return ""


def main(number: int) -> int:
    """Have both engines judge; returns how many verdicts have no reason, or are not the same."""
    from automcm_traces.explain.explain import explain_file
    from automcm_traces.explain.tlc_engine import explain_batch
    from automcm_traces.format.reader import read

    counts: Counter[tuple[str, str, str]] = Counter()
    odd = 0
    logs, verdicts = [], []
    with tempfile.TemporaryDirectory() as folder:

        def judge(lines: Lines, name: str) -> tuple[str, int]:
            path = Path(folder) / f"{name}.ndjson"
            path.write_text("\n".join(lines) + "\n")
            verdict = explain_file(path)
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
