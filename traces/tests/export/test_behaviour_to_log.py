"""Behaviours told as logs: what is made up fits together.  The logs are those of the corpus."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from automcm_spec.vocabulary.station import Command, Message, Timer
from automcm_traces.checker.track import INITIAL
from automcm_traces.export.behaviour_to_log import BehaviourStep, StepEffects, logs

CORPUS = Path(__file__).resolve().parents[2] / "corpus"
TOLD = [p for kind in ("behaviours", "counterexamples") for p in (CORPUS / kind).rglob("*.ndjson")]
STILL_RUNS = "runs_after_closing"
"""A must-fail model whose station does not stop the timer of its window."""


def events(path: Path) -> list[dict[str, Any]]:
    return [json.loads(line) for line in path.read_text().splitlines()[1:-1]]


def timers(path: Path) -> Iterator[tuple[dict[str, Any], int | None]]:
    """Each event of a timer, with the deadline that it has then."""
    deadlines: dict[str, int] = {}
    for event in events(path):
        if event["ev"] == "timer":
            key = json.dumps(event["timer"])
            if event["op"] == "arm":
                deadlines[key] = event["deadline"]
                yield event, event["deadline"]
            else:
                yield event, deadlines.pop(key, None)
        elif event["ev"] == "restart":
            continue


def test_a_timer_expires_at_its_deadline_and_is_never_overtaken() -> None:
    expiries = 0
    for path in (path for path in TOLD if path.parent.name != STILL_RUNS):
        armed: dict[str, int] = {}
        for event, deadline in timers(path):
            key = json.dumps(event["timer"])
            if event["op"] == "expire":
                assert event["t_ms"] == deadline, (path, event)
                expiries += 1
            if event["op"] == "arm":
                armed[key] = event["deadline"]
            else:
                armed.pop(key, None)
            assert all(event["t_ms"] <= d for d in armed.values()), (path, event)
    assert expiries > 1000


def test_act_4_a_lease_lasts_as_long_as_the_prescription_says() -> None:
    """At both stations, also where the behaviour lets them run for different times."""
    leases = 0
    for path in TOLD:
        told: dict[str, int] = {}
        for event in events(path):
            message = event.get("message", {})
            if message.get("type") == "Prescription":
                told[json.dumps(message["session"])] = message["lease_ms"]
            if event.get("op") == "arm" and event["timer"]["name"] == "lease":
                length = event["deadline"] - event["t_ms"]
                assert length in told.values() or path.parent.name == "lease_from_acceptance"
                leases += 1
    assert leases > 100


def test_a_copy_repeats_the_first_sending_and_new_content_counts_on() -> None:
    """Section 1, seq: in the whole corpus; who forgets a session begins anew (memory_dropped)."""
    copies = 0
    for path in TOLD:
        seen: dict[tuple[Any, ...], dict[str, Any]] = {}
        for event in events(path):
            m = event.get("message", {})
            forgets = event.get("op") == "expire" and event["timer"]["name"] == "forget"
            if forgets or event["ev"] == "restart":
                seen.clear()
            if event["ev"] != "send" or m["type"] == "CAM" or not m["seq"]:
                continue
            key = (*m["session"], m["seq"])
            copies += key in seen
            assert seen.setdefault(key, m) == m, path
    assert copies > 50
    again = [
        e["message"]["seq"]
        for e in events(CORPUS / "counterexamples" / "memory_dropped" / "2002.ndjson")
        if e["ev"] == "send" and e["message"]["type"] == "Intention"
    ]
    assert again[0] == 1 and again.count(1) >= 2


def test_every_transmission_has_its_own_id() -> None:
    for path in TOLD:
        txs = [e["tx"] for e in events(path) if e["ev"] == "send"]
        assert len(txs) == len(set(txs)), path
        assert all(tx.startswith(f"{path.stem.split('-')[-1]}:") for tx in txs), path


def test_act_5_a_cam_is_sent_whenever_the_marks_change() -> None:
    opened = INITIAL._replace(phase="ADVERTISING", role="prescriber", session=(1, 1), number=1)
    advertisement = Message("Advertisement", 1, 0, (1, 1), 1, 0, False, "none", ("none", 0))
    timers = frozenset({("advertise",)}), frozenset[Timer]()
    sent, marks = frozenset({advertisement}), frozenset({(1, 1)})
    effects = StepEffects(opened, sent, ("nothing",), "ADV-1", *timers, marks)
    step = BehaviourStep(1, INITIAL, Command("command", "request", (0, 0), 0, 0), effects)
    lines = logs("r", [step], [1], {})[1001].splitlines()
    cams = [json.loads(line) for line in lines if b'"CAM"' in line]
    assert [cam["message"]["marks"] for cam in cams] == [[[1001, 1]]]
