"""Logs that do not hold everything: what cannot have happened unseen is still found."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from automcm.links.simulated import Channel
from automcm.parameters import Parameters
from automcm.simulation import Simulation
from automcm.straight import Straight
from automcm_traces.explain import Verdict, explain_file

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


@pytest.fixture(scope="module")
def logs(tmp_path_factory: pytest.TempPathFactory) -> list[Records]:
    """A lane change of three stations; the target refuses once, and a receiver restarts."""
    folder = tmp_path_factory.mktemp("logs")
    simulation = Simulation(seed=5, channel=Channel(loss=0.2, duplicate=0.2), logs=folder)
    for station in (1001, 2002, 3003):
        driver = Straight(target=3003, refuse_first=1, maneuver_ms=2000)
        simulation.add(station, driver, Parameters(t_cam=500))
    simulation.request(1001, at=500)
    simulation.restart(2002, at=4000)
    simulation.run(until=9_000)
    return [
        [json.loads(line) for line in path.read_text().splitlines()]
        for path in sorted(folder.iterdir())
    ]


def judged(records: Records, kinds: tuple[str, ...], folder: Path) -> Verdict:
    """The log with only these kinds of event, and the promise to hold all of them."""
    kept = [r for r in records if r["rec"] != "event" or r["ev"] in kinds]
    lines = []
    for seq, record in enumerate(kept):
        change: dict[str, Any] = {"seq": seq} if record["rec"] == "event" else {}
        change |= {"complete": list(kinds)} if record["rec"] == "header" else {}
        change |= {"seq": seq - 1} if record["rec"] == "end" else {}
        lines.append(json.dumps(record | change))
    path = folder / "log.ndjson"
    path.write_text("\n".join(lines) + "\n")
    return explain_file(path)


def place(records: Records, ev: str, type_: str, number: int = 0) -> int:
    """Where the log has the nth event of a kind with a message of a type."""
    found = [
        n
        for n, r in enumerate(records)
        if r.get("ev") == ev and r.get("message", {}).get("type") == type_
    ]
    return found[number]


@pytest.mark.parametrize("kinds", PARTS, ids="+".join)
def test_what_is_left_of_an_allowed_log_is_allowed(
    kinds: tuple[str, ...], logs: list[Records], tmp_path: Path
) -> None:
    for records in logs:
        verdict = judged(records, kinds, tmp_path)
        assert verdict.verdict == "allowed", (verdict.line, verdict.event)
        assert verdict.possible_states >= 1
        assert set(verdict.unobserved).isdisjoint(kinds)


@pytest.mark.parametrize("kinds", [(), ("receive", "timer"), ("command", "indication")])
def test_without_what_is_sent_nothing_can_be_told(
    kinds: tuple[str, ...], logs: list[Records], tmp_path: Path
) -> None:
    verdict = judged(logs[0], kinds, tmp_path)
    assert verdict.verdict == "cannot_tell" and "sends" in verdict.event


def _proposal(m: dict[str, Any]) -> None:
    m["proposal"] += 1


def _seq(m: dict[str, Any]) -> None:
    m["seq"] += 7


def _session(m: dict[str, Any]) -> None:
    m["session"] = [m["session"][0], 9]


@pytest.mark.parametrize(
    ("wrong", "why"),
    [
        (_proposal, "proposal: 2 is expected, not 3"),
        (_seq, "seq: new content takes the next seq"),
        (_session, "session: [1001, 1] is expected, not [1001, 9]"),
    ],
)
def test_of_a_message_in_another_form_the_field_is_named(
    wrong: Callable[[dict[str, Any]], None], why: str, logs: list[Records], tmp_path: Path
) -> None:
    """The command that the Acceptance follows is not in the log; the answer is still its form."""
    records = json.loads(json.dumps(logs[2]))
    first = next(r for r in records if r.get("message", {}).get("accepted") and r["ev"] == "send")
    wrong(first["message"])
    verdict = judged(records, ("receive", "send"), tmp_path)
    assert verdict.verdict == "diverges" and why in verdict.event, verdict.event
    assert verdict.rule == "NEG-2"
    assert "proposal=2, accepted" in verdict.expected[0], verdict.expected


def test_what_is_still_missing_is_told_before_what_could_be_unseen(
    logs: list[Records], tmp_path: Path
) -> None:
    records = json.loads(json.dumps(logs[2]))
    ack = next(
        n
        for n, r in enumerate(records)
        if r.get("ev") == "send" and r["message"].get("of", {}).get("type") == "Prescription"
    )
    del records[ack]
    verdict = judged(records, ("receive", "send"), tmp_path)
    assert verdict.rule == "NEG-1" and verdict.expected[0].startswith("send Ack")


def _no_ack(records: Records) -> None:
    """NEG-1: a Prescription is not acked."""
    del records[place(records, "send", "Ack")]


def _wrong_mark(records: Records) -> None:
    """ACT-5: the CAM names no session while it acts."""
    acts = place(records, "send", "Acceptance", -1)
    cam = next(r for r in records[acts:] if r.get("ev") == "send" and r["message"]["type"] == "CAM")
    cam["message"]["marks"] = []


def _too_often(records: Records) -> None:
    """REL-1: a copy that no timer called for."""
    at = place(records, "send", "Acceptance", -1)
    copy = json.loads(json.dumps(records[at]))
    copy["tx"] = "3003:999999"
    records.insert(at + 1, copy)


def _other_content(records: Records) -> None:
    """END-6: an answer has seq 0."""
    records[place(records, "send", "Ack")]["message"]["seq"] = 7


def _phase(records: Records) -> None:
    records[place(records, "receive", "CAM")]["phase"] = "ACTUATING"


@pytest.mark.parametrize(
    ("wrong", "kinds"),
    [
        (_no_ack, ("receive", "send")),
        (_wrong_mark, ("send",)),
        (_wrong_mark, ("receive", "send")),
        (_too_often, ("send",)),
        (_too_often, ("receive", "send")),
        (_other_content, ("send",)),
        (_phase, ("receive", "send")),
        (_phase, ("command", "indication", "receive", "restart", "send", "timer")),
    ],
    ids=lambda x: x.__name__[1:] if callable(x) else "+".join(x),
)
def test_what_nothing_unseen_explains_diverges(
    wrong: Callable[[Records], None], kinds: tuple[str, ...], logs: list[Records], tmp_path: Path
) -> None:
    records: Records = json.loads(json.dumps(logs[2]))
    wrong(records)
    assert judged(records, kinds, tmp_path).verdict == "diverges"


def test_what_something_unseen_explains_is_allowed(logs: list[Records], tmp_path: Path) -> None:
    """A copy that was not acked is a divergence only where the log shows that it arrived."""
    records: Records = json.loads(json.dumps(logs[2]))
    acks = [r["message"]["of"] for r in records if r.get("ev") == "send" and "of" in r["message"]]
    again = next(n for n, of in enumerate(acks) if of in acks[:n])
    del records[place(records, "send", "Ack", again)]
    assert judged(records, ("receive", "send"), tmp_path).verdict == "diverges"
    assert judged(records, ("command", "send"), tmp_path).verdict == "allowed"


def test_rel_1_a_retransmission_too_early_is_seen_without_timers(
    logs: list[Records], tmp_path: Path
) -> None:
    """REL-1: the header's t_resend tells when a copy may go."""
    records: Records = json.loads(json.dumps(logs[0]))
    first, second = (place(records, "send", "Advertisement", n) for n in (0, 1))
    early = records.pop(second)
    early["t_ms"] = records[first]["t_ms"] + 40
    later = (n for n, r in enumerate(records) if r.get("t_ms", 0) > early["t_ms"])
    records.insert(next(later), early)
    verdict = judged(records, ("receive", "send"), tmp_path)
    assert verdict.verdict == "diverges" and "Advertisement" in verdict.event


def test_rel_1_a_retransmission_left_out_is_seen_without_timers(
    logs: list[Records], tmp_path: Path
) -> None:
    records: Records = json.loads(json.dumps(logs[0]))
    del records[place(records, "send", "Advertisement", 3)]
    assert judged(records, ("command", "receive", "send"), tmp_path).verdict == "diverges"
