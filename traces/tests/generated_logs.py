"""Logs of walks through the model and of the reference, and either with one thing changed."""

from __future__ import annotations

import copy
import json
import random
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from automcm.links.simulated_radio import Channel
from automcm_maintenance.corpus.corpus_bad import renumber
from automcm_simulation.road.simulation import Simulation
from automcm_simulation.road.straight_lane import Straight
from automcm_spec.vocabulary.application import Abort
from automcm_spec.vocabulary.parameters import Parameters

Json = Any
Lines = list[str]
KINDS = ("dropped", "duplicated", "swapped", "edited", "shifted")


def of_the_corpus(number: int, seed: int) -> list[Lines]:
    """``number`` logs of walks through the closed models."""
    paths = sorted((Path(__file__).parents[1] / "corpus" / "behaviours").rglob("*.ndjson"))
    chosen = random.Random(seed).choices(paths, k=number)
    return [path.read_text().splitlines() for path in chosen]


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
    """``number`` logs that the specification allows: half of the models, half of the reference."""
    logs = of_the_corpus(number // 2, seed)
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
            pairs = [n for n in body[:-1] if inner(records[n]) != inner(records[n + 1])]
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
    renumber(records)
    return [json.dumps(each, separators=(",", ":")) for each in records], kind, at + 1


def inner(record: Json) -> Json:
    return {k: v for k, v in record.items() if k not in ("seq", "t_ms")}


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
