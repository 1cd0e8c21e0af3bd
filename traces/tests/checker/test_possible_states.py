"""Logs that do not hold everything: what cannot have happened unseen is still found."""

from __future__ import annotations

import json
import random
from collections.abc import Callable
from pathlib import Path
from typing import Any

import merged_runs
import pytest
from edits import HEADER
from generated_logs import of_the_reference
from log_slices import PARTS, Records, judged, place

from automcm.links.simulated_radio import Channel
from automcm_simulation.road.simulation import Simulation
from automcm_simulation.road.straight_lane import Straight
from automcm_spec.log_format.log import RECORD, PlainTimer
from automcm_spec.vocabulary.parameters import Parameters, in_header
from automcm_traces.checker.engine import Deadline
from automcm_traces.checker.finding import Supposition
from automcm_traces.checker.possible_states import _merge, _Supposing

ALL = ("command", "indication", "receive", "restart", "send", "timer")

CORPUS = Path(__file__).parents[2] / "corpus"
GOOD = sorted((CORPUS / "behaviours").rglob("*.ndjson"))


@pytest.fixture(scope="module")
def logs(tmp_path_factory: pytest.TempPathFactory) -> list[Records]:
    """A lane change of three stations; the target refuses once, and a receiver restarts. And one
    who is asked more often than its own max_rounds, and one whose cam timer expires unseen."""
    folder = tmp_path_factory.mktemp("logs")
    driver: dict[str, Any] = {"target": 3003, "refuse_first": 1, "maneuver_ms": 2000}
    run: dict[str, Any] = {"seed": 5, "loss": 0.2, "duplicate": 0.2, "restarts": {2002: 4000}}
    run |= {"until": 9_000, "parameters": Parameters(t_cam=500)}
    paths = merged_runs.simulated(folder, 1001, 2002, 3003, **run, **driver)
    folder = tmp_path_factory.mktemp("asked")
    simulation = Simulation(seed=1, channel=Channel(loss=0.3), logs=folder)
    simulation.add(1001, Straight())
    simulation.add(2002, Straight(refuse_first=2), Parameters(max_rounds=1))
    simulation.request(1001, at=500)
    simulation.run(until=5_000)
    (other,) = of_the_reference(1, 32)
    return [
        *(merged_runs.records(path) for path in [*paths, folder / "2002.ndjson"]),
        [json.loads(line) for line in other],
    ]


@pytest.mark.sweep(3)
@pytest.mark.parametrize("kinds", PARTS, ids="+".join)
def test_what_is_left_of_an_allowed_log_is_allowed(
    kinds: tuple[str, ...], logs: list[Records], tmp_path: Path
) -> None:
    """What must have happened unseen is in the log that is cut."""
    for records in logs:
        verdict = judged(records, kinds, tmp_path)
        assert verdict.verdict == "allowed", (verdict.finding.at.line, verdict.finding.observed)
        assert verdict.possible_states >= 1
        assert set(verdict.unobserved).isdisjoint(kinds)
        places = [n for n, r in enumerate(records) if r["rec"] != "event" or r["ev"] in kinds]
        for what, after, before in verdict.only_if:
            between = records[places[after - 1] + 1 : places[before - 1]]
            assert any(_happens(record, what) for record in between), (kinds, what)


@pytest.mark.sweep(1)
@pytest.mark.parametrize("seed", range(21, 121))
def test_an_event_of_a_kind_that_is_not_promised_never_makes_a_good_log_diverge(
    seed: int, tmp_path: Path
) -> None:
    """A random part of each kind that is not promised is left in the log."""
    chance = random.Random(seed)
    good = [log.read_text().splitlines() for log in GOOD[seed % 100 :: 100]] + of_the_reference(
        6, seed
    )
    assert len(good) >= 12
    for lines in good:
        records = [json.loads(line) for line in lines]
        kinds = tuple(kind for kind in ALL if kind == "send" or chance.random() < 0.5)
        part = {kind: chance.choice((0.1, 0.5, 0.9)) for kind in ALL}
        verdict = judged(records, kinds, tmp_path, lambda ev, p=part: chance.random() < p[ev])
        assert verdict.verdict == "allowed", (kinds, verdict)


def event(t_ms: int, ev: str, **fields: Any) -> dict[str, Any]:
    return {"rec": "event", "seq": 0, "t_ms": t_ms, "ev": ev, **fields}


def test_end_8_a_quarantine_that_is_logged_ends_though_timers_are_not_promised(
    tmp_path: Path,
) -> None:
    about = {"v": 1, "session": [1, 1], "seq": 1, "src": 1}
    path = {"t0": 0, "points": [[0, 0, 0]]}
    asked = about | {"type": "Advertisement", "scenario": "lane_change", "details": {}}
    records = [
        HEADER | {"station": 7, "parameters": in_header(Parameters().known)},
        event(0, "restart"),
        event(0, "timer", op="arm", timer={"name": "quarantine"}, deadline=6300),
        event(7000, "receive", message=asked, planned=path),
        event(
            7000,
            "send",
            tx="7:1",
            message=about | {"type": "Intention", "src": 7, "dst": 1, "planned": path},
        ),
        {"rec": "end", "seq": 0, "reason": "clean", "lost_records": 0},
    ]
    verdict = judged(records, ("receive", "restart", "send"), tmp_path, lambda _: True)
    assert verdict.verdict == "allowed", verdict


def _happens(record: dict[str, Any], what: str) -> bool:
    """Whether it is the restart or the expiry that a supposition names."""
    if what == "restart":
        return record.get("ev") == "restart"
    name = what.split("(")[0]
    return record.get("op") == "expire" and record["timer"]["name"] == name


@pytest.mark.parametrize("kinds", [(), ("receive", "timer"), ("command", "indication")])
def test_without_what_is_sent_nothing_can_be_told(
    kinds: tuple[str, ...], logs: list[Records], tmp_path: Path
) -> None:
    verdict = judged(logs[0], kinds, tmp_path)
    assert (
        verdict.verdict == "cannot_tell"
        and "sent messages may be missing" in verdict.finding.observed
    )


def _proposal(m: dict[str, Any]) -> None:
    m["proposal"] += 1


def _seq(m: dict[str, Any]) -> None:
    m["seq"] += 7


def _session(m: dict[str, Any]) -> None:
    m["session"] = [m["session"][0], 9]


@pytest.mark.parametrize(
    ("wrong", "why"),
    [
        (_proposal, "proposal: expected 2, got 3"),
        (_seq, "seq: a new message must take the next seq"),
        (_session, "session: expected [1001, 1], got [1001, 9]"),
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
    assert verdict.verdict == "diverges" and why in verdict.finding.observed, (
        verdict.finding.observed
    )
    assert verdict.finding.rule == "NEG-2"
    assert "proposal=2, accepted" in verdict.finding.expected[0], verdict.finding.expected


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
    assert verdict.finding.rule == "NEG-1" and verdict.finding.expected[0].startswith("send Ack")


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
    """end(0)-6: an answer has seq 0."""
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
    assert verdict.verdict == "diverges" and "Advertisement" in verdict.finding.observed


def test_rel_1_a_retransmission_left_out_is_seen_without_timers(
    logs: list[Records], tmp_path: Path
) -> None:
    records: Records = json.loads(json.dumps(logs[0]))
    del records[place(records, "send", "Advertisement", 3)]
    assert judged(records, ("command", "receive", "send"), tmp_path).verdict == "diverges"


@pytest.mark.parametrize("kinds", [("send", "timer"), ("receive", "send", "timer")], ids="+".join)
def test_a_log_that_only_an_unseen_restart_explains_says_so(
    kinds: tuple[str, ...], logs: list[Records], tmp_path: Path
) -> None:
    records = logs[1]
    kept = [r for r in records if r["rec"] == "header" or r.get("ev") in ("restart", *kinds)]
    before = next(n for n, r in enumerate(kept) if r.get("ev") == "restart")
    (found,) = judged(records, kinds, tmp_path).only_if
    assert found.what == "restart" and found.after_line <= before < found.before_line
    assert (
        kept[found.before_line]["t_ms"]
        >= kept[before]["t_ms"]
        >= kept[found.after_line - 1]["t_ms"]
    )
    assert judged(records, (*kinds, "restart"), tmp_path).only_if == ()


@pytest.mark.sweep(1)
@pytest.mark.parametrize("kinds", PARTS, ids="+".join)
def test_what_is_left_of_a_bad_log_has_a_verdict(kinds: tuple[str, ...], tmp_path: Path) -> None:
    """Also where an unseen Ack, of which nothing is known, stands before the divergence."""
    verdicts = set()
    for path in sorted((CORPUS / "bad").glob("*.ndjson"))[::2]:
        try:
            records = [json.loads(line) for line in path.read_text().splitlines()]
            readable = all(r["rec"] != "event" or "ev" in r for r in records)
        except (ValueError, KeyError, TypeError):
            continue  # no log of records
        if readable:
            verdicts.add(judged(records, kinds, tmp_path).verdict)
    assert {"allowed", "diverges"} <= verdicts


HOLD = PlainTimer(name="hold")


def one_station(*supposed: str, last: int = 50) -> _Supposing:
    """One that the log allows: in a session, with a timer that ends by ``last``."""
    engine = _Supposing(RECORD.validate_python(HEADER | {"complete": ["send"]}))
    engine.timers[HOLD] = Deadline(10, last)
    engine.supposed = tuple(Supposition(what, 2, 4) for what in supposed)
    return engine


@pytest.mark.parametrize(
    ("a", "b", "covers"),
    [
        (((), 50), ((), 50), True),
        (((), 60), ((), 50), True),
        (((), 50), ((), 60), False),
        (((), 50), (("restart",), 50), True),
        ((("restart",), 50), ((), 50), False),
    ],
    ids=["the same", "longer", "shorter", "supposes less", "supposes more"],
)
def test_a_station_that_may_do_more_and_supposes_no_more_stands_for_another(
    a: Any, b: Any, covers: bool
) -> None:
    one, other = (one_station(*supposed, last=last) for supposed, last in (a, b))
    assert one.covers(other) is covers


def test_of_two_stations_that_differ_in_times_one_remains_that_may_be_either() -> None:
    one, other = one_station("hold", "restart"), one_station("restart", last=90)
    one.timers[HOLD] = Deadline(30, 60)
    engines: dict[Any, _Supposing] = {}
    _merge(engines, one)
    _merge(engines, other)
    (left,) = engines.values()
    assert left.timers == {HOLD: Deadline(10, 90)}
    assert [s.what for s in left.supposed] == ["restart"]
