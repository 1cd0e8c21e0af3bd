"""What ``check-adapter`` says of a good adapter, and of one with each of the usual mistakes."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

from automcm_conformance.adapter.check_adapter import Checked, check

GOOD = """
import json, sys, time

ABOUT = {"protocol": 1, "name": "toy", "version": "1", "issues": "nowhere", "scenarios": ["merge"],
         "features": ["prescriber", "receiver", "restart", "durations"], "fixed": {"t_cam": 50}}
known = {"reset", "receive", "command", "advance", "restart", "durations"}
number, me, window, resend, deadline = 0, 0, 300, 100, None

def answer(line):
    global number, me, window, resend, deadline
    cmd, messages, told = line["cmd"], [], []
    if cmd == "hello":
        return ABOUT
    if cmd not in known:
        raise ValueError("unknown")
    if cmd == "durations":
        window = line["durations"]["advertise"]
    now = line.get("now")
    if now is not None and deadline is not None and deadline <= now:
        deadline = None
    if cmd == "reset":
        assert line["parameters"]["t_cam"] == 50
        number, me, window, deadline = 0, line["station"], 300, None
    elif cmd == "receive":
        message, planned = line["message"], line.get("planned")
        if message.get("type") == "Advertisement" and planned:
            messages.append({"type": "Intention", "planned": planned})
    elif cmd == "command" and line["command"]["name"] == "request":
        assert line["command"]["scenario"] == "merge"
        number += 1
        deadline = now + window
        messages.append({"type": "Advertisement", "session": [me, number], "seq": 1})
    elif cmd == "command":
        told.append({"name": "refused", "rule": "CMD-1"})
    return {"messages": messages, "indications": told, "deadline": deadline}

for line in sys.stdin:
    try:
        command = json.loads(line)
        if command["cmd"] == "stop":
            break
        out = answer(command)
    except (ValueError, KeyError, TypeError) as error:
        out = {"error": repr(error)}
    print(json.dumps(out), flush=True)
"""
KEPT = 'deadline = 0, line["station"], window, None'
LOOP = "for line in sys.stdin:\n"
AT_ONCE = """
import os
os.set_blocking(0, False)
def lines():
    import select
    while select.select([0], [], []) and (data := os.read(0, 1 << 20)):
        all_ = data.decode().splitlines()
        yield from all_[:1] + all_[:0:-1]
for line in lines():
"""


def found(code: str) -> list[Checked]:
    said: list[str] = []
    limit_s = 0.5 if "sleep" in code else 5
    findings = check([sys.executable, "-c", code], limit_s, said.append)
    assert said
    return findings


def test_a_good_adapter() -> None:
    assert [finding.level for finding in found(GOOD)] == ["ok"] * 5


SEND = "    print(json.dumps(out), flush=True)"
MISTAKES = [
    # hello
    ('"issues": "nowhere", ', "", 'error: hello: the field "issues" is missing'),
    ('"restart", "durations"]', '"restarts"]', 'did you mean "restart"?'),
    (
        '["prescriber", "receiver", "restart", "durations"]',
        "[]",
        "warning: the features name",
    ),
    # the form of an answer
    ('"deadline": deadline}', '"dead_line": deadline}', 'did you mean "deadline"?'),
    (
        '"messages": messages',
        '"messages": [json.dumps(m) for m in messages]',
        "do not encode",
    ),
    ('{"name": "refused"', '{"name": "refuse"', 'did you mean "refused"?'),
    (SEND, "    print(out, flush=True)", "write names and strings in double quotes"),
    (SEND, SEND + "\n    print('done', flush=True)", "error: "),
    (SEND, "    print(json.dumps(out, indent=1), flush=True)", "error: "),
    # what it says
    ("now + window", "window", "error: 'deadline' is the time at which a timer expires"),
    ("deadline <= now", "deadline < now", "error: 'deadline' has passed"),
    ('"seq": 1}', '"seq": 0}', "must have seq 1"),
    ('window = line["durations"]["advertise"]', "pass", "error: durations has no effect"),
    (
        '"Advertisement" and planned',
        '"Fin" and planned',
        "warning: an Advertisement is",
    ),
    # what it refuses
    ('"advance", "restart"', '"advance"', "answered with an error: ValueError('unknown')"),
    ('message.get("type")', 'message["type"]', "error: a malformed message must be"),
    ('raise ValueError("unknown")', "pass", "error: an unknown command must be answered"),
    ("ValueError, KeyError, TypeError", "KeyError", "error: the adapter exited after 0 of"),
    # the same once more
    ('deadline = 0, line["station"], 300, None', KEPT, "error: reset does not clear all state"),
    ("now + window", "now + window + __import__('os').getpid()", "error: a new process gives"),
    ("number += 1", "number += time.time_ns()", "warning: a new session has another"),
    (LOOP, AT_ONCE, "error: the answer differs when several commands are written"),
    # the end
    ("            break", "            time.sleep(9)", "error: stop: the adapter did not exit"),
    (
        "            break",
        "            sys.exit(1)",
        "error: stop: the adapter exited on",
    ),
    ("            break", "            print(1)", "error: stop: the adapter wrote a line"),
    (SEND, SEND + "\nsys.exit(command['cmd'] != 'stop')", "error: end of input: the adapter"),
]


@pytest.mark.sweep(3)
@pytest.mark.parametrize(("old", "new", "what"), MISTAKES)
def test_the_usual_mistakes(old: str, new: str, what: str) -> None:
    assert old in GOOD
    findings = [f for f in found(GOOD.replace(old, new, 1)) if f.level != "ok"]
    assert any(what in f"{f.level}: {f.what}" for f in findings), findings
    assert all(f.level == "warning" for f in findings) == what.startswith("warning")


def test_a_finding_shows_the_line_and_its_answer() -> None:
    findings = found(GOOD.replace('"seq": 1}', '"seq": 0}'))
    [finding] = [f for f in findings if f.level == "error"]
    assert '"request"' in finding.sent
    assert '"seq": 0' in finding.answered


def test_an_adapter_that_cannot_be_started(tmp_path: Path) -> None:
    [finding] = check([str(tmp_path / "none")], 0.5, lambda text: None)
    assert (finding.level, finding.stderr) == ("error", [])
    assert "cannot be started" in finding.what


def test_an_adapter_that_dies_at_once() -> None:
    [finding] = found("import sys\nsys.exit('no such table')")
    assert "exit code 1" in finding.what
    assert finding.stderr == ["no such table"]


def test_an_adapter_that_says_nothing() -> None:
    [finding] = found("import time\ntime.sleep(9)")
    assert finding.what.startswith("no answer within 0.5 s")
    assert '"hello"' in finding.sent
