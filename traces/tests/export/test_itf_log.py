"""Counterexamples as logs and back: what a station of the model is, its log says it is."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

from automcm_cli.main import app
from automcm_spec.log_format.log import Receive, Send, TimerArm
from automcm_spec.log_format.reader import read
from automcm_spec.model_checking.tla_values import Record
from automcm_traces.checker.track import INITIAL
from automcm_traces.explain.explain import explain
from automcm_traces.explain.log_table import arrow_rows
from automcm_traces.export import itf
from automcm_traces.export.behaviour_steps import NOTHING, steps_of
from automcm_traces.export.behaviour_to_log import BehaviourError, BehaviourStep
from automcm_traces.export.behaviour_to_log import _times as story_times
from automcm_traces.export.itf_log import TICK_MS, behaviour, from_log

ROOT = Path(__file__).resolve().parents[3]
COUNTEREXAMPLES = ROOT / "traces" / "counterexamples"
CORPUS = ROOT / "traces" / "corpus"
run = CliRunner()


def real(value: Any) -> Any:
    """A station of a model, with the ids of the log."""
    match value:
        case dict():
            fields = {name: real(item) for name, item in value.items()}
            for name in ("to", "target"):
                if name in fields:
                    fields[name] *= 1001
            return Record(fields)
        case frozenset() if all(isinstance(item, int) for item in value):
            return frozenset(item * 1001 for item in value)
        case frozenset():
            return frozenset(real(item) for item in value)
        case (int(station), int(number)):
            return (station * 1001, number)
    return value


@pytest.mark.parametrize("model", ["no_lease", "no_decide", "no_give_up", "any_lease_order"])
def test_each_station_of_a_counterexample_is_found_again_in_the_itf_of_its_log(model: str) -> None:
    """No station of these does what it must not; any_lease_order is reduced: more steps."""
    states = itf.from_itf(json.loads((COUNTEREXAMPLES / f"{model}.itf.json").read_text()))
    for path in sorted((CORPUS / "counterexamples" / model).iterdir()):
        station = int(path.stem) // 1001
        stations: list[Any] = [state.values["st"] for state in states]
        wanted = [real(st[station - 1]) for st in stations]
        again = itf.from_itf(json.loads(from_log(read(path))))
        rest = iter([dict(state.values) for state in again])
        changes = [w for w, before in zip(wanted, [None, *wanted], strict=False) if w != before]
        assert all(any(w == state for state in rest) for w in changes), path


def test_s_5_the_logs_of_clocks_that_drift_are_on_each_stations_own_clock(tmp_path: Path) -> None:
    """The prescriber's clock has lost a tick: its lease ends at the same time on its own clock."""
    logs = behaviour(COUNTEREXAMPLES / "drift_no_margin.itf.json").logs()
    for station, text in logs.items():
        (tmp_path / f"{station}.ndjson").write_bytes(text)
    paths = [tmp_path / "1001.ndjson", tmp_path / "2002.ndjson"]
    assert [explain(read(path)).verdict for path in paths] == ["allowed", "allowed"]
    armed = [
        event.deadline - event.t_ms
        for path in paths
        for _, event in read(path).events
        if isinstance(event, TimerArm) and event.timer.name == "lease"
    ]
    assert armed == [600, 600]


@pytest.mark.sweep(1)
@pytest.mark.parametrize(
    ("model", "types"),
    [
        ("maneuver_replayed", set()),
        ("thief_acks", {"Intention", "Ack"}),
        ("thief_cancels", {"Cancel"}),
        ("any_key_fin", {"Fin"}),
        ("cam_of_another", {"CAM"}),
        ("session_not_signed", {"Advertisement", "Intention", "Prescription", "Acceptance"}),
    ],
)
def test_what_an_attacker_forges_is_received_and_in_no_log_sent(
    model: str, types: set[str], tmp_path: Path
) -> None:
    events = []
    for station, text in behaviour(COUNTEREXAMPLES / f"{model}.itf.json").logs().items():
        path = tmp_path / f"{station}.ndjson"
        path.write_bytes(text)
        events += [event for _, event in read(path).events]
    sent = {event.tx for event in events if isinstance(event, Send)}
    received = [event for event in events if isinstance(event, Receive)]
    forged = [event.message for event in received if event.tx not in sent]
    assert received and {message["type"] for message in forged if message} == types


def test_a_slow_station_counts_its_deadlines_and_its_steps_on_its_own_clock(tmp_path: Path) -> None:
    """As if the prescriber did something after the tick that its clock has lost."""
    value = json.loads((COUNTEREXAMPLES / "drift_no_margin.itf.json").read_text())
    value["states"][-1]["#meta"] |= {"station": 1}
    path = tmp_path / "drift.itf.json"
    path.write_text(json.dumps(value))
    slow, last = behaviour(path).moves[-2:]
    assert slow.behind_ms == last.behind_ms == {1: TICK_MS, 2: 0} and slow.cams == (2,)
    assert last.at_ms is not None and last.deadlines is not None
    now = last.at_ms - TICK_MS
    assert last.deadlines["lease",] == now + TICK_MS
    happened = [
        BehaviourStep(0, INITIAL, None, NOTHING, move.at_ms, move.behind_ms)
        for move in (slow, last)
    ]
    _, times = story_times(happened, [1, 2], 600)
    assert times == {1: [now, now], 2: [last.at_ms, last.at_ms]}


def test_the_itf_of_a_log_says_by_what_each_state_was_reached() -> None:
    value = json.loads(from_log(read(CORPUS / "pair" / "2002.ndjson")))
    accepted = next(s for s in value["states"] if s["phase"] == "ACTUATING")
    meta = accepted["#meta"]
    assert meta["action"] == "OnAccept" and meta["rule"] == "NEG-2"
    assert meta["location"]["module"] == "Station" and meta["location"]["line"] > 0
    assert meta["args"]["command"]["name"] == "accept"
    assert any(s["heard"] for s in value["states"])
    assert itf.dumps(itf.to_itf(itf.from_itf(value), {})).count("\n") > len(value["states"])


def test_the_itf_of_a_log_that_diverges_ends_there_and_says_so() -> None:
    path = CORPUS / "bad" / "wrong_addressee.ndjson"
    value = json.loads(from_log(read(path)))
    assert (
        f"diverges at line {explain(read(path)).finding.at.line}" in value["#meta"]["description"]
    )
    assert len(value["states"]) == 1


@pytest.mark.sweep(1)
@pytest.mark.parametrize(
    "model",
    [
        "bare_ack",
        "plain_cams",
        pytest.param("memory_dropped", marks=pytest.mark.deep),
        pytest.param("retarget", marks=pytest.mark.deep),
    ],
)
def test_the_command_writes_the_logs_of_the_corpus(model: str, tmp_path: Path) -> None:
    """Untimed, timed, and reduced twice; TLC works out what follows."""
    source = COUNTEREXAMPLES / f"{model}.itf.json"
    answer = run.invoke(app, ["trace", "itf", str(source), "--out", str(tmp_path)])
    assert answer.exit_code == 0, answer.output
    for path in (CORPUS / "counterexamples" / model).iterdir():
        assert (tmp_path / path.name).read_bytes() == path.read_bytes()


def test_the_command_writes_the_itf_of_a_log(tmp_path: Path) -> None:
    source = CORPUS / "pair" / "1001.ndjson"
    command = ["trace", "itf", str(source), "--out", str(tmp_path), "--json", "-"]
    answer = run.invoke(app, command)
    assert answer.exit_code == 0, answer.output
    (path,) = json.loads(answer.output)["written"]
    arrows = [(row.line, arrow) for _, row in arrow_rows([source]) for arrow in row.arrows]
    assert Path(path).read_text() == from_log(read(source), arrows)


@pytest.mark.parametrize(
    ("change", "place"),
    [
        (lambda v: "[]", "must be a JSON object"),
        (lambda v: v[:-9], "not JSON"),
        (lambda v: v.replace("models.toml#", ""), "#meta: source"),
        (lambda v: "[" * 100_000, "not JSON"),
        (lambda v: v.replace('"#tup":["none"', f'"#tup":[{"[" * 190 + "]" * 190}', 1), "state 1"),
        (lambda v: v.replace('"index":2,"input":', '"index":2,"output":'), "state 2"),
        (lambda v: v.replace('"#tup":["none",0]', '"#tup":"none"', 1), "state 1"),
        (lambda v: v.replace('"states":[', '"states":{},"stated":['), "'states'"),
    ],
)
def test_a_broken_itf_is_named_with_its_place(change: Any, place: str, tmp_path: Path) -> None:
    source = tmp_path / "broken.itf.json"
    source.write_text(change((COUNTEREXAMPLES / "bare_ack.itf.json").read_text()))
    answer = run.invoke(app, ["trace", "itf", str(source), "--out", str(tmp_path)])
    assert answer.exit_code == 3, answer.output
    assert str(source) in answer.output and place in answer.output
    assert answer.output.count("\n") == 1


def test_a_counterexample_of_one_station_has_no_logs(tmp_path: Path) -> None:
    """What it receives, nobody has sent."""
    source = COUNTEREXAMPLES / "finishes_silently.itf.json"
    answer = run.invoke(app, ["trace", "itf", str(source), "--out", str(tmp_path)])
    assert answer.exit_code == 3 and "receives messages that nobody has sent" in answer.output
    assert not list(tmp_path.iterdir())
    assert not (CORPUS / "counterexamples" / "finishes_silently").exists()


def test_an_allowed_log_whose_states_are_unknown_is_4(tmp_path: Path) -> None:
    """explain allows it: the command before the Acceptance is not logged."""
    page = (Path(__file__).parents[3] / "docs" / "trace-format.md").read_text()
    (log,) = page.split("## A log of your own")[1].split("## Judge")[0].split("```\n")[1::2]
    path = tmp_path / "7.ndjson"
    path.write_text(log)
    assert explain(read(path)).verdict == "allowed"
    for command in (["trace", "itf"], ["trace", "export", "--to", "itf"]):
        answer = run.invoke(app, [*command, str(path), "--out", str(tmp_path)])
        assert answer.exit_code == 4 and f"CANNOT TELL: {path}:7: " in answer.output
        assert "does not promise command, restart, timer" in answer.output


@pytest.mark.slow
def test_a_message_received_that_nobody_sent_is_no_story() -> None:
    found = behaviour(COUNTEREXAMPLES / "bare_ack.itf.json")
    found.moves[0:1] = []  # the request, and with it the Advertisement
    with pytest.raises(BehaviourError, match="never sent"):
        found.logs()


def test_a_step_that_the_model_does_not_take_is_no_story() -> None:
    found = behaviour(COUNTEREXAMPLES / "bare_ack.itf.json")
    move = found.moves[0]
    assert move.after != move.before
    with pytest.raises(BehaviourError, match="leads to"):
        steps_of([[move]], lambda questions: dict.fromkeys(questions, NOTHING), False)


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (lambda s: s["st"]["#tup"][0].pop("phase"), "state 1: not a step of a station: st.0.phase"),
        (lambda s: s["st"]["#tup"].pop(), "state 1: not a step of a station: st: must have"),
        (lambda s: s["#meta"].pop("input"), "state 1: not a step of a station: input"),
        (lambda s: s["#meta"].update(station=9), "state 1: not a step of a station: station"),
    ],
)
def test_a_state_that_is_none_is_named_with_its_field(
    change: Any, says: str, tmp_path: Path
) -> None:
    value = json.loads((COUNTEREXAMPLES / "no_lease.itf.json").read_text())
    change(value["states"][1])
    path = tmp_path / "odd.itf.json"
    path.write_text(json.dumps(value))
    with pytest.raises(itf.ItfError, match=re.escape(f"{path}: {says}")):
        behaviour(path)
