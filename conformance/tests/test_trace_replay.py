"""``automcm trace replay``: the inputs of a log into a station, right ones and wrong ones."""

from __future__ import annotations

import base64
import json
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner
from wrong_station import station

from automcm.links.simulated import Channel
from automcm.simulation import Simulation
from automcm.straight import Straight
from automcm_cli.main import app
from automcm_conformance.log_compare import Compared
from automcm_conformance.log_names import Names
from automcm_conformance.wire import LARGE
from automcm_spec.rules import RULES
from automcm_traces.explain import explain_files
from automcm_traces.writer import LogWriter

Json = Any
AUTOMCM = [sys.executable, "-m", "automcm_cli", "adapter"]
REFERENCE = station()
"""The same, which starts faster."""
cli = CliRunner()
STATIONS = (1001, 1002, 2002, 3003)
COMPLETE = ("command", "indication", "receive", "restart", "send", "timer")


@pytest.fixture(scope="module")
def logs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Four stations, three of which request, one in five copies lost, two restarts (END-8)."""
    folder = tmp_path_factory.mktemp("logs")
    simulation = Simulation(seed=5, channel=Channel(loss=0.2), logs=folder)
    for each in STATIONS:
        simulation.add(each, Straight())
    for each, at in ((1001, 500), (1002, 700), (2002, 9_000), (1001, 13_000)):
        simulation.request(each, at=at)
    simulation.restart(3003, at=2_500)
    simulation.restart(1001, at=6_000)
    simulation.run(until=18_000)
    return folder


def replay(log: Path, command: list[str], tmp_path: Path, *more: str) -> tuple[int, Json]:
    """Exit code and report."""
    args = ["trace", "replay", str(log), "--out", str(tmp_path / "out"), "--json", "-", *more]
    done = cli.invoke(app, [*args, "--", *command])
    assert done.exception is None or isinstance(done.exception, SystemExit), done.exception
    return done.exit_code, json.loads(done.stdout)


def records(log: Path) -> list[Json]:
    return [json.loads(line) for line in log.read_text().splitlines()]


def written(path: Path, lines: list[Json]) -> Path:
    path.write_text("".join(json.dumps(line) + "\n" for line in lines))
    return path


def edited(log: Path, path: Path, edit: Callable[[Json], Json]) -> Path:
    """The log with each record as ``edit`` makes it."""
    return written(path, [edit(record) for record in records(log)])


def inputs(path: Path, *events: dict[str, Json], me: int = 7, **header: Json) -> Path:
    """A log of these inputs alone, each with its time."""
    more = {"parameters": {}, "complete": (), **header}
    with LogWriter(path, run="r", station=me, implementation="hand", version="1", **more) as log:
        for event in events:
            log.event(event.pop("ev"), event.pop("t"), **event)
    return path


def verdict(result: Json) -> str:
    """What ``automcm trace explain`` says of the new log."""
    return explain_files([Path(result["log"])])[0].verdict


# -- a station that is right


@pytest.mark.parametrize("which", STATIONS)
def test_the_reference_does_again_what_it_did(which: int, logs: Path, tmp_path: Path) -> None:
    code, result = replay(logs / f"{which}.ndjson", REFERENCE, tmp_path)
    assert (code, result["verdict"], result["same"]) == (0, "allowed", True), result
    assert result["inputs"] == result["total"] > 100 and result["notes"] == []
    assert verdict(result) == "allowed"
    kinds = ("send", "command", "restart")
    old, new = (
        [
            r
            for r in records(path)
            if r.get("ev") in kinds
            and r.get("message", r)["type" if "message" in r else "ev"] != "CAM"
        ]
        for path in (logs / f"{which}.ndjson", Path(result["log"]))
    )
    told = [
        [(r["t_ms"], r["ev"], r.get("message"), r.get("command")) for r in x] for x in (old, new)
    ]
    assert told[0] == told[1]


def test_the_same_replay_gives_the_same_bytes(logs: Path, tmp_path: Path) -> None:
    first = replay(logs / "1002.ndjson", AUTOMCM, tmp_path / "a")[1]["log"]
    again = replay(logs / "1002.ndjson", AUTOMCM, tmp_path / "b")[1]["log"]
    assert Path(first).read_bytes() == Path(again).read_bytes()


def test_a_replayed_log_can_be_replayed(logs: Path, tmp_path: Path) -> None:
    first = replay(logs / "1001.ndjson", REFERENCE, tmp_path)[1]["log"]
    code, result = replay(Path(first), REFERENCE, tmp_path)
    assert (code, result["same"]) == (0, True) and result["log"] != first


def test_own_sessions_of_the_log_are_renamed(logs: Path, tmp_path: Path) -> None:
    """The log's station numbered its sessions from 41 on."""

    def other(value: Json) -> Json:
        if isinstance(value, list):
            if len(value) == 2 and value[0] == 1001 and type(value[1]) is int:
                return [1001, value[1] + 40]
            return [other(each) for each in value]
        return {k: other(v) for k, v in value.items()} if isinstance(value, dict) else value

    log = edited(logs / "1001.ndjson", tmp_path / "1001.ndjson", other)
    assert explain_files([log])[0].verdict == "allowed"
    sessions = {
        r["message"]["session"][1]
        for r in records(log)
        if r.get("ev") == "send" and r["message"]["type"] == "Advertisement"
    }
    assert min(sessions) > 40 and len(sessions) > 1
    code, result = replay(log, REFERENCE, tmp_path)
    assert (code, result["same"]) == (0, True), result
    assert "[1001,41]" not in Path(result["log"]).read_text()


def test_a_back_off_lasts_as_long_as_in_the_log(logs: Path, tmp_path: Path) -> None:
    """END-7; without the feature ``durations`` it lasts as long as the station chooses."""
    less = """
def answer(command):
    out = right(command)
    if command["cmd"] == "hello":
        out["features"] = [f for f in out["features"] if f != "durations"]
    return out
"""

    def backoffs(log: Path) -> list[int]:
        armed = (r for r in records(log) if r.get("op") == "arm")
        return [r["deadline"] - r["t_ms"] for r in armed if r["timer"]["name"] == "backoff"]

    source = logs / "1002.ndjson"
    assert len(backoffs(source)) == 1
    for command, same in ((REFERENCE, True), (station(less), False)):
        code, result = replay(source, command, tmp_path, "--seed", "77")
        assert (code, verdict(result)) == (0, "allowed")
        assert (backoffs(Path(result["log"])) == backoffs(source)) is same


def test_names() -> None:
    names = Names(7)
    advertised = {"type": "Advertisement", "src": 7, "session": [7, 50], "seq": 1}
    names.logged(advertised)
    names.sent({**advertised, "session": [7, 3]})
    fin = {"type": "Fin", "src": 7, "dst": 8, "session": [7, 50]}
    for seq in (4, 4, 6):
        names.logged({**fin, "seq": seq})
    names.sent({**fin, "session": [7, 3], "seq": 2})
    ack = {"type": "Ack", "src": 8, "dst": 7, "session": [7, 50], "seq": 0}
    first, second = ({**ack, "of": {"type": "Fin", "seq": seq}} for seq in (4, 6))
    assert names.message(first) == {**ack, "session": [7, 3], "of": {"type": "Fin", "seq": 2}}
    assert names.message(second)["of"]["seq"] == 6, "not sent yet: it names nothing"
    other = {**ack, "of": {"type": "Fin", "seq": 2}}
    assert names.message(other)["of"]["seq"] == LARGE, "it named nothing, and must not now"
    assert names.session([7, 3]) == [7, LARGE - 3], "a stranger's, and must not be its own now"
    assert names.session([8, 50]) == [8, 50] and names.session("x") == "x"
    cam = {"type": "CAM", "src": 8, "marks": [[7, 50], [8, 50]]}
    assert names.message(cam)["marks"] == [[7, 3], [8, 50]]
    assert names.command({"name": "abort", "session": [7, 50]})["session"] == [7, 3]


# -- a log that is wrong


def test_a_log_of_a_wrong_station_shows_the_first_difference(logs: Path, tmp_path: Path) -> None:
    source = logs / "1001.ndjson"
    line = next(
        n
        for n, r in enumerate(records(source), 1)
        if r.get("message", {}).get("type") == "Prescription" and r["ev"] == "send"
    )

    def wrong(record: Json) -> Json:
        if record.get("seq") == line - 1:
            record["message"]["lease_ms"] += 1
        return record

    log = edited(source, tmp_path / "wrong.ndjson", wrong)
    code, result = replay(log, REFERENCE, tmp_path)
    assert (code, result["verdict"], result["same"]) == (0, "allowed", False)
    difference = result["difference"]
    assert difference["line"] == line and "lease_ms" in difference["log"]
    assert difference["station"].startswith("send Prescription")


def test_a_send_that_is_missing_in_the_log_is_a_difference(logs: Path, tmp_path: Path) -> None:
    lines = records(logs / "2002.ndjson")
    at = next(
        n
        for n, r in enumerate(lines)
        if r.get("ev") == "send" and r["message"]["type"] == "Intention"
    )
    del lines[at]
    for n, record in enumerate(lines[1:], 1):
        record["seq"] = n if record["rec"] == "event" else n - 1
    code, result = replay(written(tmp_path / "less.ndjson", lines), REFERENCE, tmp_path)
    assert (code, result["same"], result["difference"]["log"]) == (0, False, "")
    assert result["difference"]["station"].startswith("send Intention")


def test_the_failing_prefix_of_an_edited_log(logs: Path, tmp_path: Path) -> None:
    lines = records(logs / "2002.ndjson")
    at = next(
        n
        for n, r in enumerate(lines)
        if r.get("ev") == "send" and r["message"]["type"] == "Acceptance"
    )
    lines[at]["message"]["proposal"] += 1
    prefix = written(tmp_path / "prefix.ndjson", lines[: at + 1])
    assert explain_files([prefix])[0].line == at + 1
    code, result = replay(prefix, REFERENCE, tmp_path)
    assert (code, result["verdict"], result["same"]) == (0, "allowed", False)
    assert result["difference"]["line"] == at + 1
    assert "no end record" in result["notes"][0]


# -- a station that is wrong


MUTANTS = {
    "accepts another proposal": (
        "2002",
        "NEG-2",
        """
def answer(command):
    out = right(command)
    for m in out.get("messages", []):
        if m["type"] == "Acceptance":
            m["proposal"] += 1
    return out
""",
    ),
    "does not acknowledge a Prescription": (
        "2002",
        "NEG-1",
        """
def answer(command):
    out = right(command)
    if received(command, "Prescription"):
        out["messages"] = []
    return out
""",
    ),
    "marks nothing": (
        "2002",
        "ACT-5",
        """
def answer(command):
    out = right(command)
    for cam in out.get("cams", []):
        cam["marks"] = []
    return out
""",
    ),
}


@pytest.mark.parametrize("name", MUTANTS)
def test_a_wrong_station_diverges(name: str, logs: Path, tmp_path: Path) -> None:
    which, rule, code = MUTANTS[name]
    source = logs / f"{which}.ndjson"
    exit_code, result = replay(source, station(code), tmp_path)
    assert (exit_code, result["verdict"], result["rule"]) == (1, "diverges", rule), result
    assert rule in RULES and result["event"] and result["expected"] and result["guard"]
    assert records(source)[result["line"] - 1]["ev"] in ("receive", "command")
    assert result["input"] and result["exchange"] and result["inputs"] < result["total"]
    again = explain_files([Path(result["log"])])[0]
    assert (again.verdict, again.line) == ("diverges", result["log_line"])
    assert (again.rule, again.event, result["in_log"]) == (rule, result["event"], True)


def test_a_wrong_deadline_is_in_no_log(logs: Path, tmp_path: Path) -> None:
    late = """
def answer(command):
    out = right(command)
    if out.get("deadline"):
        out["deadline"] += 1
    return out
"""
    code, result = replay(logs / "2002.ndjson", station(late), tmp_path)
    assert (code, result["verdict"], result["in_log"]) == (1, "diverges", False)
    assert result["event"].startswith("deadline: ") and verdict(result) == "allowed"


def test_a_crash_and_a_hang_are_errors_with_what_was_logged(logs: Path, tmp_path: Path) -> None:
    for code, text in (("sys.exit('no idea')", "it ended after"), ("time.sleep(60)", "no answer")):
        broken = f"""
def answer(command):
    if received(command, "Prescription"):
        {code}
    return right(command)
"""
        exit_code, result = replay(logs / "2002.ndjson", station(broken), tmp_path, "--limit", "2")
        assert (exit_code, result["verdict"]) == (3, "error") and text in result["event"], result
        assert "Prescription" in result["input"] and result["inputs"] > 10
        assert verdict(result) == "allowed"
        assert records(Path(result["log"]))[-1]["reason"] == "crash"
    assert result["stderr"] == []


def test_no_adapter(logs: Path, tmp_path: Path) -> None:
    code, result = replay(logs / "2002.ndjson", ["/nowhere/station"], tmp_path)
    assert (code, result["verdict"], result["log"]) == (3, "error", "")
    assert "cannot be started" in result["event"]
    code, result = replay(logs / "2002.ndjson", station("def answer(c): return 5"), tmp_path)
    assert code == 3 and result["inputs"] == 0


# -- what a log may hold


REQUEST = {"ev": "command", "command": {"name": "request", "scenario": "merge", "details": {}}}


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
    assert result["notes"] == ["t_decide is 500 in the log and fixed at 400 in the station"]


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
    """It promises nothing: nothing is compared, and own sessions are those named in commands."""
    abort = {"ev": "command", "command": {"name": "abort", "session": [7, 12]}}
    log = inputs(tmp_path / "x.ndjson", {**REQUEST, "t": 900}, {**abort, "t": 1_000})
    code, result = replay(log, REFERENCE, tmp_path)
    assert (code, result["verdict"], result["same"], result["inputs"]) == (0, "allowed", None, 2)
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


def test_which_of_several_new_messages_has_the_lower_seq_is_free() -> None:
    def sent(first: int, second: int) -> list[Json]:
        new = ((8, first, "Prescription"), (9, second, "Cancel"))
        common = {"src": 7, "session": [7, 1]}
        return [{**common, "type": type_, "dst": to, "seq": seq} for to, seq, type_ in new]

    for log, own, same in ((sent(2, 3), sent(3, 2), True), (sent(2, 3), sent(2, 3)[:1], False)):
        names = Names(7)
        compared = Compared(names, late_ms=50)
        opens = {"type": "Advertisement", "src": 7, "session": [7, 1], "seq": 1}
        for m in (opens, *log):
            names.logged(m)
        for m in (opens, *own):
            names.sent(m)
        for line, m in enumerate(log, 2):
            compared.logged(line, 100, "send", m)
        compared.done(1, 100, own, [])
        compared.settle(100, ends=True)
        assert (compared.first is None) is same


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
    assert "3 of the bytes received" in result["notes"][0]
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


def test_parameters_come_from_the_header_then_from_timers(logs: Path, tmp_path: Path) -> None:
    def bare(record: Json) -> Json:
        return {**record, "parameters": {}} if record["rec"] == "header" else record

    folder = tmp_path / "slow"
    folder.mkdir()
    from automcm.parameters import Parameters

    simulation = Simulation(seed=5, logs=folder)
    for each in (1001, 2002):
        slow = Parameters(t_resend=150, t_timeout=900, t_decide=700)
        simulation.add(each, Straight(), slow)
    simulation.request(1001, at=500)
    simulation.run(until=6_000)
    log = edited(folder / "1001.ndjson", tmp_path / "bare.ndjson", bare)
    code, result = replay(log, REFERENCE, tmp_path)
    assert (code, result["same"]) == (0, True), result
    told = records(Path(result["log"]))[0]["parameters"]
    assert (told["t_resend"], told["t_decide"], told["t_giveup"]) == (150, 700, 1050)


def test_what_cannot_be_given(tmp_path: Path) -> None:
    far = 25 * 3_600_000
    empty = inputs(tmp_path / "a.ndjson")
    cases = {
        "holds no input": empty,
        "is not replayed": inputs(tmp_path / "b", {**REQUEST, "t": 1}, {**REQUEST, "t": far}),
        "more than an adapter takes": inputs(tmp_path / "c", {**REQUEST, "t": 2**53}),
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
        assert str(rubbish) in result["event"]
    assert not started.exists()
    code, result = replay(tmp_path / "none", touch, tmp_path)
    assert code == 3 and "no such file" in result["event"]


# -- the command


def test_the_text(logs: Path, tmp_path: Path) -> None:
    args = ["trace", "replay", str(logs / "2002.ndjson"), "--out", str(tmp_path)]
    done = cli.invoke(app, [*args, "--", *REFERENCE])
    assert done.exit_code == 0 and "FOLLOWS the specification" in done.stdout
    assert "as in the log" in done.stdout and "2002-replayed.ndjson" in done.stdout
    done = cli.invoke(app, [*args, "--", *station(MUTANTS["marks nothing"][2])])
    assert done.exit_code == 1 and "DIVERGES: send CAM: marks" in done.stdout
    assert "by an" not in done.stdout and "last input" in done.stdout
    bell = """
def answer(command):
    return {"error": "\\x07"} if received(command, "CAM") else right(command)
"""
    done = cli.invoke(app, [*args, "--", *station(bell)])
    assert done.exit_code == 3 and "answered with an error" in done.stdout
    assert "\x07" not in done.stdout, "what a station says does not steer a terminal"
    assert cli.invoke(app, args).exit_code == 2
    helped = cli.invoke(app, ["trace", "replay", "--help"])
    assert helped.exit_code == 0 and "Example: automcm trace replay" in helped.stdout
