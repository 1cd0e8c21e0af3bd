"""``automcm trace replay``: logs that can be replayed, and logs that cannot."""

from __future__ import annotations

import base64
import json
import sys
from pathlib import Path
from typing import Any

import pytest
from merged_runs import simulated
from replay_stage import REFERENCE, Json, edited, inputs, records, replay, same, verdict
from replay_stage import logs as logs
from wrong_station import station

from automcm_spec.vocabulary.parameters import Parameters

# -- what a log may hold


REQUEST = {"ev": "command", "command": {"name": "request", "scenario": "merge", "details": {}}}


@pytest.mark.slow
def test_without_durations_and_cams_and_with_a_fixed_parameter(logs: Path, tmp_path: Path) -> None:
    bare = """
def answer(command):
    out = right(command)
    if command["cmd"] == "hello":
        out = json.loads(out) if isinstance(out, bytes) else out
        out["features"] = ["prescriber", "receiver", "restart"]
        out["fixed"] = {"t_decide": 400}
    out.pop("cams", None)
    return out
"""
    code, result = replay(logs / "2002.ndjson", station(bare), tmp_path)
    assert (code, result["verdict"]) == (0, "allowed"), result
    assert result["notes"] == [
        "t_decide is 500 in the log and fixed at 400 in the station",
        "clock_drift is 1 in the log and 0 in the station",
    ]


def test_what_the_header_tells_is_not_said_to_be_fixed_in_the_station(
    logs: Path, tmp_path: Path
) -> None:
    path = tmp_path / "told.ndjson"
    path.write_text((logs / "2002.ndjson").read_text().replace('"t_decide":500', '"t_decide":600'))
    assert replay(path, REFERENCE, tmp_path)[1]["notes"] == []


def test_a_feature_that_is_missing(logs: Path, tmp_path: Path) -> None:
    for feature, which in (("restart", "3003"), ("receiver", "2002"), ("prescriber", "1001")):
        less = f"""
def answer(command):
    out = right(command)
    if command["cmd"] == "hello":
        out["features"] = [f for f in out["features"] if f != {feature!r}]
    return out
"""
        code, result = replay(logs / f"{which}.ndjson", station(less), tmp_path)
        assert (code, result["verdict"]) == (4, "cannot_tell")
        assert f"{feature!r}" in result["event"] and verdict(result) == "allowed"


def test_a_log_of_inputs_alone(tmp_path: Path) -> None:
    """It promises nothing: own sessions are those named in commands."""
    abort = {"ev": "command", "command": {"name": "abort", "session": [7, 12]}}
    log = inputs(tmp_path / "x.ndjson", {**REQUEST, "t": 900}, {**abort, "t": 1_000})
    code, result = replay(log, REFERENCE, tmp_path)
    assert (code, result["verdict"], result["inputs"]) == (0, "allowed", 2)
    sent = [r["message"]["type"] for r in records(Path(result["log"])) if r.get("ev") == "send"]
    assert sent[0] == "Advertisement" and "refused" not in Path(result["log"]).read_text()


def test_a_restart_at_a_deadline(tmp_path: Path) -> None:
    """END-8: a timer due then is lost, unless the log says that it expired before."""
    asks = {"v": 1, "type": "Advertisement", "src": 9, "session": [9, 1], "seq": 1}
    asks |= {"scenario": "merge", "details": {}}
    heard = {"ev": "receive", "message": asks, "planned": {"t0": 0, "points": [[0, 0, 0]]}}
    about = {"type": "Intention", "to": 9, "session": [9, 1], "seq": 1}
    expires = {"ev": "timer", "op": "expire", "timer": {"name": "resend", "message": about}}
    for between, copies in (([], 1), ([{**expires, "t": 1_100}], 2)):
        events = [{**heard, "t": 1_000}, *between, {"ev": "restart", "t": 1_100}]
        code, result = replay(inputs(tmp_path / "x", *events), REFERENCE, tmp_path)
        assert (code, verdict(result)) == (0, "allowed")
        sent = [r["message"]["type"] for r in records(Path(result["log"])) if r.get("ev") == "send"]
        assert sent.count("Intention") == copies


def test_what_is_no_message_has_no_effect(tmp_path: Path) -> None:
    """END-5: bytes and messages that are malformed; bytes that no adapter can be given."""

    def raw(data: bytes) -> dict[str, Json]:
        return {"ev": "receive", "raw": base64.b64encode(data).decode()}

    asks = {"v": 1, "type": "Advertisement", "src": 9, "session": [9, 1], "seq": 1}
    asks |= {"scenario": "merge", "details": {}}
    planned = {"t0": 0, "points": [[0, 0, 0]]}
    half = {**asks, "v": 2}
    events = [
        {**raw(b"\xff\x00"), "t": 1},
        {**raw(json.dumps(asks).encode()), "t": 2},
        {**raw(b'{"v": 1, "type": "Fin", "seq": 1.5}'), "t": 3},
        {**raw(b'{"v": 1e999}'), "t": 4},
        {"ev": "receive", "message": half, "planned": planned, "t": 5},
    ]
    log = inputs(tmp_path / "x.ndjson", *events)
    code, result = replay(log, REFERENCE, tmp_path)
    assert (code, result["verdict"], result["inputs"], result["total"]) == (0, "allowed", 2, 5)
    assert "3 malformed messages cannot be given" in result["notes"][0]
    assert verdict(result) == "allowed"
    joins = """
def answer(command):
    if received(command, "Advertisement"):
        command["message"]["v"] = 1
        command["planned"] = {"t0": 0, "points": [[0, 0, 0]]}
    return right(command)
"""
    code, result = replay(log, station(joins), tmp_path)
    assert (code, result["rule"], result["line"]) == (1, "END-5", 6), result
    assert verdict(result) == "diverges"


def test_parameters_come_from_the_header_then_from_timers(tmp_path: Path) -> None:
    def bare(record: Json) -> Json:
        return {**record, "parameters": {}} if record["rec"] == "header" else record

    slow = Parameters(t_resend=150, t_timeout=900, t_decide=700)
    first, _ = simulated(tmp_path, 1001, 2002, parameters=slow, until=6_000)
    log = edited(first, tmp_path / "bare.ndjson", bare)
    code, result = replay(log, REFERENCE, tmp_path)
    assert (code, result["verdict"]) == (0, "allowed"), result
    told = records(Path(result["log"]))[0]["parameters"]
    assert (told["t_resend"], told["t_decide"], told["t_giveup"]) == (150, 700, 1050)


def test_act_4_the_margin_of_the_log_is_that_of_the_replay(tmp_path: Path) -> None:
    """The Fin comes after the lease, so the log holds its end."""
    run: dict[str, Any] = {"parameters": Parameters(clock_drift=9), "until": 12_000}
    log, _ = simulated(tmp_path, 1001, 2002, lease_ms=2000, maneuver_ms=9000, **run)
    assert '"reason":"lease_expired"' in log.read_text()
    code, result = replay(log, REFERENCE, tmp_path / "again")
    assert (code, same(result), result["notes"]) == (0, True, []), result


def test_what_cannot_be_given(tmp_path: Path) -> None:
    far = 25 * 3_600_000
    empty = inputs(tmp_path / "a.ndjson")
    cases = {
        "contains no input": empty,
        "are not replayed": inputs(tmp_path / "b", {**REQUEST, "t": 1}, {**REQUEST, "t": far}),
        "t_resend 0": inputs(tmp_path / "d", {**REQUEST, "t": 1}, parameters={"t_resend": 0}),
        "details": inputs(
            tmp_path / "e",
            {"ev": "command", "t": 1, "command": {"name": "request", "scenario": "merge"}},
        ),
    }
    for text, log in cases.items():
        code, result = replay(log, REFERENCE, tmp_path)
        assert (code, result["verdict"]) == (4, "cannot_tell") and text in result["event"], text


def test_rubbish(logs: Path, tmp_path: Path) -> None:
    rubbish = tmp_path / "rubbish"
    started = tmp_path / "started"
    touch = [sys.executable, "-c", f"open({str(started)!r}, 'w')"]
    whole = (logs / "2002.ndjson").read_bytes().splitlines(keepends=True)
    for data, line in (
        (b"", 0),
        (b"\x00\xff\x80", 1),
        (b"{}\n", 1),
        (b"".join([*whole[:3], b"rubbish\n", *whole[3:]]), 4),
        (b"".join([*whole[:3], *whole[4:]]), 4),
    ):
        rubbish.write_bytes(data)
        code, result = replay(rubbish, touch, tmp_path)
        assert (code, result["verdict"], result["line"]) == (3, "unreadable", line)
        assert result["file"] == str(rubbish) and str(rubbish) not in result["event"]
    assert not started.exists()
    code, result = replay(tmp_path / "none", touch, tmp_path)
    assert code == 3 and "no such file" in result["event"]
