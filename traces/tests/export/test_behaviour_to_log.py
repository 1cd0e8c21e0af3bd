"""Behaviours told as logs: what is made up fits together.  The logs are those of the corpus."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from automcm_spec.vocabulary.station import Command, Message, Outcome, Timer
from automcm_traces.checker.track import INITIAL
from automcm_traces.export.behaviour_to_log import BehaviourStep, StepEffects, logs

CORPUS = Path(__file__).resolve().parents[2] / "corpus"
TOLD = [p for kind in ("behaviours", "counterexamples") for p in (CORPUS / kind).rglob("*.ndjson")]


def events(path: Path) -> list[dict[str, Any]]:
    return [json.loads(line) for line in path.read_text().splitlines()[1:-1]]


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
    effects = StepEffects(Outcome(opened, sent, ("nothing",), "ADV-1", *timers), marks)
    step = BehaviourStep(1, INITIAL, Command("command", "request", (0, 0), 0, 0), effects)
    lines = logs("r", [step], [1], {})[1001].splitlines()
    cams = [json.loads(line) for line in lines if b'"CAM"' in line]
    assert [cam["message"]["marks"] for cam in cams] == [[[1001, 1]]]
