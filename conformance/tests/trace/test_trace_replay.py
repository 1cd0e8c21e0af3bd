"""``automcm trace replay``: stations that are right, wrong or stuck, and logs that are wrong."""

from __future__ import annotations

from pathlib import Path

import pytest
from cli_stage import automcm
from replay_stage import REFERENCE, STATIONS, records, replay, same, verdict, written
from replay_stage import logs as logs
from wrong_station import station

from automcm_conformance.replay.renaming import Renaming
from automcm_spec.vocabulary.messages import LIMIT
from automcm_spec.vocabulary.rules import RULES
from automcm_traces.explain.explain import verdicts_of

# -- a station that is right


@pytest.mark.sweep(1)
@pytest.mark.parametrize("which", STATIONS)
def test_the_reference_does_again_what_it_did(which: int, logs: Path, tmp_path: Path) -> None:
    code, result = replay(logs / f"{which}.ndjson", REFERENCE, tmp_path)
    assert (code, result["verdict"], same(result)) == (0, "allowed", True), result
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


@pytest.mark.slow
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
    for command, equal in ((REFERENCE, True), (station(less), False)):
        code, result = replay(source, command, tmp_path, "--seed", "77")
        assert (code, verdict(result)) == (0, "allowed")
        assert (backoffs(Path(result["log"])) == backoffs(source)) is equal


def test_names() -> None:
    names = Renaming(7)
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
    assert names.message(other)["of"]["seq"] == LIMIT, "it named nothing, and must not now"
    assert names.session([7, 3]) == [7, LIMIT - 3], "a stranger's, and must not be its own now"
    assert names.session([8, 50]) == [8, 50] and names.session("x") == "x"
    cam = {"type": "CAM", "src": 8, "marks": [[7, 50], [8, 50]]}
    assert names.message(cam)["marks"] == [[7, 3], [8, 50]]
    assert names.command({"name": "abort", "session": [7, 50]})["session"] == [7, 3]


# -- a log that is wrong


def test_the_failing_prefix_of_an_edited_log(logs: Path, tmp_path: Path) -> None:
    lines = records(logs / "2002.ndjson")
    at = next(
        n
        for n, r in enumerate(lines)
        if r.get("ev") == "send" and r["message"]["type"] == "Acceptance"
    )
    lines[at]["message"]["proposal"] += 1
    prefix = written(tmp_path / "prefix.ndjson", lines[: at + 1])
    assert verdicts_of([prefix])[0].finding.at.line == at + 1
    code, result = replay(prefix, REFERENCE, tmp_path)
    assert (code, result["verdict"], same(result)) == (0, "allowed", False)
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


@pytest.mark.sweep(1)
@pytest.mark.parametrize("name", MUTANTS)
def test_a_wrong_station_diverges(name: str, logs: Path, tmp_path: Path) -> None:
    which, rule, code = MUTANTS[name]
    source = logs / f"{which}.ndjson"
    exit_code, result = replay(source, station(code), tmp_path)
    assert (exit_code, result["verdict"], result["rule"]) == (1, "diverges", rule), result
    assert rule in RULES and result["event"] and result["expected"] and result["guard"]
    assert records(source)[result["line"] - 1]["ev"] in ("receive", "command")
    assert result["input"] and result["exchange"] and result["inputs"] < result["total"]
    again = verdicts_of([Path(result["log"])])[0]
    assert (again.verdict, again.finding.at.line) == ("diverges", result["log_line"])
    assert (again.finding.rule, again.finding.observed, result["in_log"]) == (
        rule,
        result["event"],
        True,
    )


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


@pytest.mark.slow
def test_a_crash_and_a_hang_are_errors_with_what_was_logged(logs: Path, tmp_path: Path) -> None:
    for code, text in (
        ("sys.exit('no idea')", "exited after"),
        ("time.sleep(60)", "no answer"),
    ):
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


# -- the command


def test_the_text(logs: Path, tmp_path: Path) -> None:
    args = ["trace", "replay", str(logs / "2002.ndjson"), "--out", str(tmp_path)]
    done = automcm(*args, "--", *REFERENCE)
    assert done.exit_code == 0 and "FOLLOWS the specification" in done.stdout
    assert "automcm trace diff" in done.stdout and "2002-replayed.ndjson" in done.stdout
    done = automcm(*args, "--", *station(MUTANTS["marks nothing"][2]))
    assert done.exit_code == 1 and "DIVERGES: send CAM: marks" in done.stdout
    assert "by an" not in done.stdout and "last input" in done.stdout
    bell = """
def answer(command):
    return {"error": "\\x07"} if received(command, "CAM") else right(command)
"""
    done = automcm(*args, "--", *station(bell))
    assert done.exit_code == 3 and "answered with an error" in done.stdout
    assert "\x07" not in done.stdout, "what a station says does not steer a terminal"
    assert automcm(*args).exit_code == 2
    helped = automcm("trace", "replay", "--help")
    assert helped.exit_code == 0 and "Example: automcm trace replay" in helped.stdout
