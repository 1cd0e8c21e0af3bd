"""The suite against stations that are bad in every way: each gets the verdict that it deserves, on
the case that it belongs to, and the run goes on."""

from __future__ import annotations

import importlib.util
import json
import random
import re
import resource
import sys
import time
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any

import pytest
from wrong_station import station

from automcm.kit import HELLO
from automcm_cli import cpp
from automcm_conformance import (
    opened,
    purposes,
    records,
    remainder,
    report,
    suite,
    verdicts,
    whole,
)
from automcm_conformance.adapter import PATIENCE, Adapter
from automcm_conformance.answers import differences
from automcm_conformance.exchange import Mismatch
from automcm_conformance.play import offered
from automcm_conformance.process import Process
from automcm_conformance.protocol import ProtocolError
from automcm_conformance.results import CaseResult, Report
from automcm_conformance.tally import Part
from automcm_conformance.tour import LATER_MS, LONGEST, Tours, timetable
from automcm_conformance.wire import PLAIN, STEP_MS, Expected, Wire
from automcm_spec import oracle as oracle_
from automcm_spec.generate import ONE_PEER, TIGHT, TWO_PEERS, spec_hash
from automcm_spec.oracle import Oracle, canonical, content

Json = Any
LIMIT = 20.0
SHORT = 1.0
"""For what is to be waited out."""
STATES = 200
"""Of a graph that is cut down: the first of them, in which every phase occurs."""

# -- graphs that are loaded once, and cut down


@cache
def data(path: Path) -> dict[str, Json]:
    value: dict[str, Json] = json.loads(content(path))
    return value


@cache
def graph(path: Path) -> Oracle:
    return Oracle(data(path))


@cache
def first_of(path: Path, n: int) -> Oracle:
    """The part of a graph with its first ``n`` states, which are those nearest to the initial
    one, and all that time leads to from there."""
    whole_ = data(path)
    expiries = {i for i, value in enumerate(whole_["inputs"]) if value[0] == "expire"}
    rows = [[row[k : k + 3] for k in range(0, len(row), 3)] for row in whole_["transitions"]]
    kept = set(range(n))
    left = list(kept)
    while left:
        after = {move[1] for move in rows[left.pop()] if move[0] in expiries} - kept
        kept |= after
        left += after
    place = {state: k for k, state in enumerate(sorted(kept))}
    out = dict(whole_)
    for name in ("states", "marks", "answers", "parents"):
        out[name] = [whole_[name][state] for state in place]
    out["transitions"] = [
        [x for i, to, effect in rows[state] if to in place for x in (i, place[to], effect)]
        for state in place
    ]
    return Oracle(out)


class Patient(Process):
    """A Python station takes its time to start."""

    def exchange(self, lines: Any) -> list[bytes]:
        limit, self.limit_s = self.limit_s, LIMIT
        if b'"hello"' not in lines[0]:
            self.limit_s = limit
        try:
            return super().exchange(lines)
        finally:
            self.limit_s = limit


@dataclass
class Suite:
    """Runs the suite into a folder of its own."""

    folder: Path
    patch: pytest.MonkeyPatch

    def __call__(
        self,
        command: list[str],
        *selectors: str,
        states: int = STATES,
        limit_s: float = LIMIT,
        seed: int = 1,
        expected: verdicts.Expectations | None = None,
        folder: str = "report",
    ) -> Report:
        one = graph(ONE_PEER.path)
        cut = {
            ONE_PEER.path: first_of(ONE_PEER.path, states),
            TWO_PEERS.path: graph(TIGHT.path),
            TIGHT.path: graph(TIGHT.path),
        }
        self.patch.setattr(whole, "load", lambda path, spec: cut[path])
        self.patch.setattr(
            whole,
            "Part",
            lambda name, o, third=False: Part(name, one if name == "special" else o, third),
        )
        self.patch.setattr(suite, "VALUES", (PLAIN,))  # stations here may know an id
        self.patch.setattr(remainder, "read", lambda two: [])
        self.patch.setattr(opened, "Process", Patient)
        chosen = purposes.select(purposes.load(), selectors)
        return whole.conform(
            command,
            chosen,
            self.folder / folder,
            limit_s=limit_s,
            seed=seed,
            say=lambda text: None,
            selectors=selectors,
            expected=expected or {},
        )


@pytest.fixture
def conform(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Suite:
    return Suite(tmp_path, monkeypatch)


def of(found: Report, name: str) -> CaseResult:
    (case,) = [case for case in found.cases if case.id == name]
    return case


BUSY = "AMCM/RCV/NEG/BI-04"
ACCEPTS = "AMCM/RCV/NEG/BV-03"
LATER = "AMCM/PRE/ADV/TI-02"
"""A case that no graph carries, so it comes last."""


# -- what breaks


NARROW = """
def here(command):
    "In one state alone, one input alone."
    s = state() if station._station else None
    return s and foreign(command) and command["message"]["proposal"] == 1 and (
        (s.phase, s.session, s.number, s.proposal, s.joined) == (
            "WAITING", (1702, 5), 0, 0, {1702: 5})) and not s.outbox

def answer(command):
    if here(command):
        return bad()
    return right(command)
"""
BROKEN = {
    "hangs": ("def bad(): time.sleep(60)", "no answer within 1 s"),
    "crashes": (
        "def bad():\n    print('Traceback: no more', file=sys.stderr, flush=True)\n    os._exit(7)",
        "answers, with exit code 7",
    ),
    "is killed": ("def bad(): os.abort()", "SIGABRT"),
    "rubbish": ("def bad(): return b'Hello, world\\n'", "not JSON"),
    "no UTF-8": ("def bad(): return b'\\xff\\n'", "UTF-8"),
    "half a line": (
        "def bad():\n    sys.stdout.write('{\"messages\"'); sys.stdout.flush(); os._exit(0)",
        "in the middle of a line, with exit code 0",
    ),
    "a gigabyte on one line": (
        "def bad():\n    for _ in range(1 << 14): os.write(1, b'x' * (1 << 16))",
        "more than 1048576 bytes",
    ),
    "output without end": (
        "def bad():\n    while True: os.write(1, b'{}\\n' * 1000)",
        "'messages' is missing",
    ),
    "an error": ("def bad(): return {'error': 'not today'}", "an error: not today"),
    "closes its output": ("def bad(): os.close(1); time.sleep(60)", "closed its standard output"),
}


@pytest.mark.parametrize("how", BROKEN)
def test_what_breaks_costs_its_case_alone(conform: Suite, how: str) -> None:
    bad, says = BROKEN[how]
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    limit_s = SHORT if how in ("hangs", "closes its output") else LIMIT
    found = conform(station(bad + NARROW), BUSY, ACCEPTS, LATER, states=60, limit_s=limit_s)
    case = of(found, BUSY)
    assert case.verdict == "ERROR" and says in case.reason.replace('"', "'")
    assert of(found, ACCEPTS).verdict == of(found, LATER).verdict == "PASS"
    assert case.reached == case.total, "the other pairs of the case were driven all the same"
    (failure,) = case.failures
    assert failure.rule == "NEG-4" and (conform.folder / "report" / failure.replay).exists()
    assert ("Traceback: no more" in failure.came) == (how == "crashes")
    assert found.exit_code == 3 and found.problems == []
    report.write(found, conform.folder / "report")
    assert report.load(conform.folder / "report" / "report.json") == found
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 200 << 10


def test_a_station_that_crashes_all_the_time_is_given_up(conform: Suite) -> None:
    code = f"input(); print({json.dumps(json.dumps(HELLO))}, flush=True); input(); 1 / 0"
    found = conform([sys.executable, "-S", "-E", "-c", code], BUSY, "REL-1", states=60)
    assert found.problems == [f"cut short after {PATIENCE} crashes or hangs"]
    counts = found.counts
    assert counts["ERROR"] > 1 and counts["INCONC"] > 2 and found.exit_code == 3
    assert counts["PASS"] == counts["FAIL"] == 0
    assert of(found, BUSY).verdict in ("ERROR", "INCONC"), "what was left out is not skipped"
    assert not any("forbidden" in case.reason for case in found.cases)
    came = [line for case in found.cases for failure in case.failures for line in failure.came]
    assert "ZeroDivisionError: division by zero" in came
    report.write(found, conform.folder / "report")
    assert report.load(conform.folder / "report" / "report.json") == found


def test_what_a_run_that_was_cut_short_left_out_is_open(conform: Suite) -> None:
    conform.patch.setattr(suite, "PATIENCE", 1)
    code = "def answer(c):\n    if received(c, 'Prescription'): os._exit(3)\n    return right(c)"
    found = conform(station(code), "AMCM/RCV", "AMCM/PRE/ADV", "AMCM/STA/ADV", states=60)
    assert "cut short" in found.problems[0] and of(found, LATER).verdict == "INCONC"
    assert not any("forbidden" in case.reason for case in found.cases)


def test_some_crashes_do_not_end_the_run(conform: Suite) -> None:
    """A few faults, however often each is tried again until the shortest exchange is found."""
    conform.patch.setattr(suite, "PATIENCE", 2 * suite.ENOUGH)
    code = (
        "def answer(c):\n    if station._station and foreign(c): os._exit(3)\n    return right(c)"
    )
    found = conform(station(code), BUSY, ACCEPTS, LATER, states=60)
    assert found.problems == []
    assert of(found, BUSY).verdict == "ERROR" and len(of(found, BUSY).failures) == suite.ENOUGH
    assert of(found, ACCEPTS).verdict == of(found, LATER).verdict == "PASS"


def test_it_crashes_when_it_has_answered(conform: Suite) -> None:
    code = """
def answer(c):
    out = right(c)
    if station._station and foreign(c):
        os.write(1, json.dumps(out).encode() + b"\\n")
        os._exit(3)
    return out
"""
    found = conform(station(code), BUSY, ACCEPTS, LATER, states=60)
    assert of(found, BUSY).verdict == "ERROR"
    assert of(found, ACCEPTS).verdict == of(found, LATER).verdict == "PASS"


@pytest.mark.parametrize("again", ["os._exit(5)", "print('no', flush=True)"])
def test_it_cannot_be_started_again(conform: Suite, again: str) -> None:
    file = conform.folder / "started"
    first = f"""
if os.path.exists({str(file)!r}):
    {again}
open({str(file)!r}, "w").close()
def bad(): os._exit(3)
"""
    found = conform(station(NARROW, first), BUSY, ACCEPTS, LATER, states=60)
    assert of(found, BUSY).verdict == "ERROR" and found.exit_code == 3


def gone(pid: int) -> bool:
    """Whether a process has ended; one that nobody has reaped yet has."""
    for _ in range(200):
        try:
            text = Path(f"/proc/{pid}/stat").read_text()
        except FileNotFoundError:
            return True
        if text.rsplit(")", 1)[1].split()[0] == "Z":
            return True
        time.sleep(0.01)
    return False


def test_its_children_end_with_it(conform: Suite) -> None:
    file = conform.folder / "children"
    fork = f"""
if (child := os.fork()) == 0:
    time.sleep(600)
with open({str(file)!r}, "a") as out:
    print(child, os.getpid(), file=out)
def bad(): os._exit(3)
"""
    conform(station(fork + NARROW), BUSY, states=60)
    pids = file.read_text().split()
    assert len(pids) >= 4
    assert all(gone(int(pid)) for pid in pids)


def test_stop_ignored_is_a_problem_and_no_verdict(conform: Suite) -> None:
    loop = """
for line in sys.stdin.buffer:
    command = json.loads(line)
    if command["cmd"] == "stop":
        time.sleep(60)
    sys.stdout.buffer.write(json.dumps(answer(command)).encode() + b"\\n")
    sys.stdout.buffer.flush()
"""
    found = conform(station(loop), LATER, limit_s=SHORT)
    assert of(found, LATER).verdict == "PASS" and found.exit_code == 0
    assert found.problems == ["it did not end within 1 s of stop and was killed"]


FOREIGN = """
def answer(command):
    out = right(command)
    if station._station and foreign(command):
        out = bad(command, out)
    return out
"""


def test_a_deadline_in_the_past_is_wrong(conform: Suite) -> None:
    bad = "def bad(c, out): return out | {'deadline': c['now'] - 1}"
    found = conform(station(bad + FOREIGN), BUSY, ACCEPTS, states=60)
    case = of(found, BUSY)
    assert case.verdict == "FAIL" and case.reason.startswith("deadline: ")
    assert of(found, ACCEPTS).verdict == "PASS"


@pytest.mark.parametrize("second", ["the same", "busy!"])
def test_more_answers_than_asked(conform: Suite, second: str) -> None:
    bad = """
def bad(command, out):
    line = json.dumps(out).encode() + b"\\n"
    return line + (line if SAME else b"busy!\\n")
"""
    bad = bad.replace("SAME", str(second == "the same"))
    found = conform(station(bad + FOREIGN), BUSY, ACCEPTS, LATER, states=60)
    assert of(found, BUSY).verdict in ("ERROR", "FAIL")
    assert of(found, ACCEPTS).verdict == of(found, LATER).verdict == "PASS"


# -- other answers to the same lines

OTHERWISE = {
    "the number of a session is drawn": """
import random
from dataclasses import replace
def answer(command):
    out = right(command)
    if command["cmd"] == "reset":
        station._station.state = replace(state(), number=random.randrange(1, 1 << 40))
    return out
""",
    "the number of a session grows from reset to reset": """
from dataclasses import replace
last = 0
def answer(command):
    global last
    last = max(last, station._station.state.number) if station._station else 0
    out = right(command)
    if command["cmd"] == "reset":
        station._station.state = replace(state(), number=last)
    return out
""",
}


@pytest.mark.parametrize("how", OTHERWISE)
def test_right_but_not_the_same_again(conform: Suite, how: str) -> None:
    found = conform(station(OTHERWISE[how]), "AMCM/STA/ADV/BV-01", ACCEPTS, states=60)
    case = of(found, "AMCM/STA/ADV/BV-01")
    assert case.verdict == "ERROR" and case.reason.startswith("nondeterministic")
    assert of(found, ACCEPTS).verdict == "PASS"


def test_wrong_but_not_again(conform: Suite) -> None:
    once = "seen = []\ndef bad(c, out): seen.append(1); return out | (\n"
    once += "    {'deadline': 10**9} if len(seen) == 20 else {})\n"
    found = conform(station(once + FOREIGN), BUSY, ACCEPTS, states=60)
    case = of(found, BUSY)
    assert case.verdict == "ERROR" and case.reason.startswith("nondeterministic")
    assert "1000000000" in case.reason and case.reached == case.total
    assert of(found, ACCEPTS).verdict == "PASS"


# -- what an implementation does not claim

CLAIMS = {
    "prescriber": "c['cmd'] == 'command' and c['command']['name'] in ("
    "'request', 'prescribe', 'proceed', 'complete')",
    "receiver": "'planned' in c or c['cmd'] == 'command' and c['command']['name'] in ("
    "'accept', 'refuse')",
    "restart": "c['cmd'] == 'restart'",
    "durations": "c['cmd'] == 'durations'",
    "cam": "False",
}
"""Lines that do not come without the feature."""
WITHOUT = """
def answer(c):
    if {claim}:
        return {{"error": "not without {feature}"}}
    out = right(c)
    if c["cmd"] == "hello":
        out = out | {{"features": [f for f in out["features"] if f != {feature!r}]}}
    if {feature!r} == "cam":
        out = {{name: value for name, value in out.items() if name != "cams"}}
    return out
"""
SOME = (
    *(BUSY, ACCEPTS, LATER, "NEG-5", "END-8", "AMCM/PRE/ADV", "AMCM/RCV/END/BV-01", "MEM-1"),
    *("AMCM/STA/ACT/TI-02", "AMCM/STA/ACT/BV-01", "AMCM/RCV/NEG/BI-05"),
)


@pytest.mark.parametrize("feature", CLAIMS)
def test_what_is_not_claimed_is_skipped(conform: Suite, feature: str) -> None:
    code = WITHOUT.format(feature=feature, claim=CLAIMS[feature])
    found = conform(station(code), *SOME, states=100)
    counts = found.counts
    assert counts["FAIL"] == counts["ERROR"] == counts["INCONC"] == 0, [
        (case.id, case.reason) for case in found.cases if case.failures or case.verdict == "INCONC"
    ]
    assert found.exit_code == 0 and counts["PASS"] > 5
    skipped = [case for case in found.cases if case.verdict == "SKIP" and case.total]
    wanted = {
        "prescriber": ["AMCM/PRE/ADV/BV-01", LATER],
        "receiver": [ACCEPTS, BUSY],
        "restart": ["AMCM/STA/END/BV-03"],
        "durations": [],
        "cam": ["AMCM/STA/ACT/TI-02", "AMCM/STA/ACT/BV-01"],
    }[feature]
    for name in wanted:
        assert of(found, name) in skipped
        assert feature in of(found, name).reason or "a feature that" in of(found, name).reason
    reached, total = found.coverage["transitions"]
    if feature == "cam":
        assert reached == total
    else:
        assert 0 < reached < total
        left_out = [case for case in found.cases if 0 < case.reached < case.total]
        assert left_out and all("left out of" in case.reason for case in left_out)
    if feature == "durations":
        assert any("forbidden by time" in case.reason for case in found.cases)


FIXED = """
def answer(c):
    if c["cmd"] == "hello":
        return right(c) | {{"fixed": {{{name!r}: {value}}}}}
    if c["cmd"] == "reset":
        if c["parameters"][{name!r}] != {value}:
            return {{"error": "{name} is fixed"}}
    return right(c)
"""


@pytest.mark.parametrize(
    ("name", "value", "skipped"),
    [
        ("t_resend", 50, {}),
        ("t_timeout", 500, {}),
        (
            "max_rounds",
            2,
            dict.fromkeys([BUSY, ACCEPTS, "AMCM/STA/MEM/BI-02"], "max_rounds is fixed"),
        ),
        ("outbox_limit", 64, {"AMCM/STA/MEM/BI-02": "outbox_limit is fixed"}),
    ],
)
def test_a_fixed_parameter(conform: Suite, name: str, value: int, skipped: dict[str, str]) -> None:
    found = conform(
        station(FIXED.format(name=name, value=value)),
        *(BUSY, ACCEPTS, LATER, "AMCM/STA/MEM/BI-02", "AMCM/STA/REL/TI-05", "AMCM/RCV/ADV/TI-03"),
        states=60,
    )
    assert found.exit_code == 0 and found.implementation.fixed == {name: value}
    for case in found.cases:
        wanted = "SKIP" if case.id in skipped else "PASS"
        assert case.verdict == wanted, (case.id, case.verdict, case.reason)
        assert skipped.get(case.id, "") in case.reason
    assert of(found, LATER).verdict == "PASS"


@pytest.mark.parametrize(
    "fixed",
    [
        {"t_resend": 5000},
        {"t_timeout": 0},
        {"t_decide": 20},
        {"t_cam": 1000},
        {"backoff_min": 600},
        {"backoff_min": 1000},
        {"backoff_max": 3000},
        {"max_rounds": 1},
        {"max_rounds": 10},
        {"max_participants": 32},
        {"memory_limit": 1},
    ],
    ids=str,
)
def test_no_fixed_parameter_makes_a_right_station_fail(
    conform: Suite, fixed: dict[str, int]
) -> None:
    code = f"""
def answer(c):
    return right(c) | ({{"fixed": {fixed}}} if c["cmd"] == "hello" else {{}})
"""
    found = conform(
        station(code),
        *("AMCM/STA/ACT/TI-01", "AMCM/STA/ACT/TI-02", "AMCM/STA/ACT/BV-01", "AMCM/STA/END/TI-05"),
        *("AMCM/PRE/PRE/BV-07", "AMCM/PRE/PRE/TI-08", "AMCM/RCV/ADV/TI-03", "AMCM/STA/END/TI-04"),
    )
    for case in found.cases:
        assert case.verdict in ("PASS", "SKIP"), (case.id, case.reason)
    assert found.counts["PASS"] >= 2


def test_what_fixed_times_forbid_is_counted(conform: Suite) -> None:
    code = """
def answer(c):
    return right(c) | ({"fixed": {"t_timeout": 0}} if c["cmd"] == "hello" else {})
"""
    found = conform(station(code), "AMCM/PRE/NEG/TI-02", "AMCM/STA/ACT/TI-01")
    case = of(found, "AMCM/STA/ACT/TI-01")
    assert case.verdict == "PASS" and "are forbidden by time" in case.reason
    assert case.reached < case.total


# -- wrong answers

IGNORES = "def bad(c, out): return out | {'messages': []}" + FOREIGN
"""A busy station that does not refuse."""


def test_a_wrong_answer_is_blamed_on_its_case(conform: Suite) -> None:
    found = conform(station(IGNORES), BUSY, ACCEPTS, "AMCM/RCV/ADV/BV-01", states=60)
    case = of(found, BUSY)
    assert case.verdict == "FAIL" and "not sent: Acceptance" in case.reason
    assert [c.verdict for c in found.cases if c is not case] == ["PASS", "PASS"]
    assert found.exit_code == 1 and len(case.failures) == suite.ENOUGH
    assert case.reached == suite.ENOUGH < case.total
    for failure in case.failures:
        assert (failure.rule, failure.operator) == ("NEG-4", "OnPrescription")
        assert failure.line > 0 and failure.rule_text
        assert "Acceptance" in failure.allowed[0] and "Acceptance" not in failure.came[0]
        said = [line.text for line in failure.exchange if line.who == "kit"]
        inputs = [text for text in said if not text.startswith(("reset", "timers"))]
        assert len(inputs) == 2, "an Advertisement, and a Prescription of another session"


def test_a_replay_fails_again_and_passes_on_the_reference(conform: Suite) -> None:
    found = conform(station(IGNORES), BUSY, states=60)
    file = conform.folder / "report" / of(found, BUSY).failures[0].replay
    about, steps = records.read_replay(file)
    assert about["case"] == BUSY and about["rule"] == "NEG-4"
    bad, good = Adapter(station(IGNORES), LIMIT), Adapter(station(), LIMIT)
    try:
        with pytest.raises(Mismatch, match="not sent: Acceptance"):
            records.replayed(steps, bad)
        records.replayed(records.read_replay(file)[1], good)
    finally:
        bad.stop()
        good.stop()


def test_a_way_that_goes_wrong_is_inconclusive(conform: Suite) -> None:
    acks = "def answer(c):\n    out = right(c)\n"
    acks += "    return out | {'messages': []} if received(c, 'Advertisement') else out"
    found = conform(station(acks), BUSY, ACCEPTS, LATER, states=60)
    for name in (BUSY, ACCEPTS):
        case = of(found, name)
        assert case.verdict == "INCONC" and "the way there went wrong" in case.reason
        assert "not sent: Intention" in case.reason and not case.failures
        assert case.reached < case.total
    assert of(found, LATER).verdict == "PASS"
    assert found.exit_code == 4


def test_a_refused_input_that_changes_something_is_blamed(conform: Suite) -> None:
    secret = """
poisoned = False
def answer(c):
    global poisoned
    if c["cmd"] == "reset":
        poisoned = False
    if c["cmd"] == "command":
        name, session = c["command"]["name"], c["command"].get("session")
        if name == "refuse" and state().phase == "NEGOTIATING" and (
                tuple(session) != state().session):
            poisoned = True
        if name == "accept" and poisoned:
            c = {"cmd": "advance", "now": c["now"]}
    return right(c)
"""
    culprit = "AMCM/RCV/PRE/BI-03"
    found = conform(station(secret), culprit, ACCEPTS, "AMCM/RCV/ADV/BV-01", states=60)
    case = of(found, culprit)
    assert case.verdict == "FAIL" and "an input before it, which must change nothing" in case.reason
    assert of(found, ACCEPTS).verdict == of(found, "AMCM/RCV/ADV/BV-01").verdict == "PASS"
    assert {failure.rule for failure in case.failures} == {"PRE-5"}


def test_nobody_else_is_blamed_for_what_was_changed_before(conform: Suite) -> None:
    """Once a refusal has been caught at changing something, what goes wrong after it again is not
    laid at the door of the inputs that come later."""
    secret = """
poisoned = False
def answer(c):
    global poisoned
    if c["cmd"] == "reset":
        poisoned = False
    if c["cmd"] == "command":
        if c["command"]["name"] == "refuse" and c["command"]["session"] == [999, 17]:
            poisoned = True
        if c["command"]["name"] == "accept" and poisoned:
            c = {"cmd": "advance", "now": c["now"]}
    return right(c)
"""
    culprits = ("AMCM/STA/CMD/BI-01", "AMCM/RCV/PRE/BI-03", "AMCM/RCV/CMD/BI-02")
    found = conform(station(secret), *culprits, ACCEPTS, states=60)
    assert "FAIL" in [of(found, name).verdict for name in culprits]
    assert of(found, ACCEPTS).verdict in ("PASS", "INCONC")


def test_a_timer_that_is_not_armed_is_blamed_on_its_expiry(conform: Suite) -> None:
    first = """
from automcm import station as station_
armed = station_.armed
station_.armed = lambda me, st: [t for t in armed(me, st) if t.name != "hold"]
"""
    expiry = "AMCM/RCV/ADV/TI-02"
    found = conform(station(first=first), expiry, "AMCM/RCV/ADV/BV-01", states=60)
    case = of(found, expiry)
    assert case.verdict == "FAIL" and "the timer hold is not armed" in case.reason
    assert {failure.rule for failure in case.failures} == {"ADV-7"}


# -- cases that no graph carries: each can fail

LASTS = """
from automcm import station as station_
lasts = station_.Station._duration
def other(self, t, now):
    ms = lasts(self, t, now)
    return {ms} if t.name == {name!r} else ms
station_.Station._duration = other
"""
OTHER_CAM = """
def answer(c):
    m = c.get("message", {})
    if received(c, "CAM") and state().heard_ms not in (None, m["generation_ms"]):
        m["generation_ms"] = max(m["generation_ms"], state().heard_ms + 1)
    return right(c)
"""
CAME = """
step = station_.Station._step
station_.Station.came = 0
def noted(self, i, now):
    if type(getattr(i, "message", None)).__name__ == "Prescription":
        if self.state.phase in ("INTENDING", "WAITING"):
            self.came = now
    return step(self, i, now)
station_.Station._step = noted
"""
WRONG: dict[str, tuple[str, str, str, str]] = {
    "timer": ("AMCM/RCV/ADV/TI-03", LASTS.format(name="hold", ms="ms + 1"), "", "deadline"),
    "timer, early": (
        "AMCM/PRE/NEG/TI-02",
        LASTS.format(name="answer", ms="ms - 1"),
        "",
        "deadline",
    ),
    "timer, early, and hides it": (
        "AMCM/RCV/ADV/TI-03",
        "",
        "def answer(c):\n"
        "    if c['cmd'] == 'advance' and station._station.next_deadline() == c['now'] + 1:\n"
        "        c['now'] += 1\n"
        "    return right(c)",
        "fallback",
    ),
    "sendings": (
        "AMCM/STA/REL/TI-06",
        LASTS.format(name="giveup", ms="ms + self.parameters.t_resend"),
        "",
        "deadline",
    ),
    "echoes": (
        "AMCM/STA/MSG/BI-05",
        "",
        "def answer(c):\n"
        "    out = right(c)\n"
        "    if c['cmd'] == 'receive' and c['message'].get('src') == 4711:\n"
        "        out['indications'] = [{'name': 'discarded'}]\n"
        "    return out",
        "discarded",
    ),
    "sendings, none": (
        "AMCM/STA/REL/TI-05",
        LASTS.format(name="giveup", ms="max(ms, 2 * self.parameters.t_resend)"),
        "",
        "",
    ),
    "same instant": (
        "AMCM/STA/ACT/TI-01",
        """
from automcm import station as station_
def receive(self, message, now):
    if isinstance(message, bytes):
        message = self._decode(message)
    i = message if isinstance(message, station_.Cam) else self._heard(message)
    return [self._step(i, now), *self.advance(now)]
station_.Station.receive = receive
""",
        "",
        "",
    ),
    "malformed": (
        "AMCM/STA/END/BI-19",
        "",
        "def answer(c):\n    c.get('message', {}).pop('unknown', None)\n    return right(c)",
        "discarded",
    ),
    "malformed, noticed too late": (
        "AMCM/STA/END/BI-24",
        "",
        "def answer(c):\n    m = c.get('message', {})\n"
        "    if m.get('v') in (0, 2): m['v'] = 1\n    return right(c)",
        "discarded",
    ),
    "malformed, a bad second point": (
        "AMCM/STA/END/BI-19",
        "",
        "def answer(c):\n    p = c.get('message', {}).get('planned')\n"
        "    if isinstance(p, dict) and isinstance(p.get('points'), list): p['points'][1:] = []\n"
        "    return right(c)",
        "planned {'t0': 0, 'points': [[0, 0, 0], [0, 0]",
    ),
    "malformed, a busy refusal with a seq": (
        "AMCM/STA/END/BI-21",
        "",
        "def answer(c):\n    m = c.get('message', {})\n"
        "    if m.get('reason') == 'busy': m['seq'] = 0\n    return right(c)",
        "accepted False, selected left out, reason 'busy': ",
    ),
    "bounds, a text in bytes": (
        "AMCM/STA/END/BV-06",
        "",
        "def answer(c):\n    m = c.get('message', {})\n"
        "    if len(str(m.get('scenario')).encode()) > 65507: m['v'] = 0\n    return right(c)",
        "scenario",
    ),
    "bounds, 32 bits": (
        "AMCM/STA/END/BV-10",
        "",
        "def answer(c):\n    m = c.get('message', {})\n"
        "    if type(m.get('seq')) is int: m['seq'] %= 2**32\n    return right(c)",
        "seq 9007199254740991: Ack.of",
    ),
    "bounds, a lease of a second at least": (
        "AMCM/STA/END/BV-08",
        "",
        "def answer(c):\n    m = c.get('message', {})\n"
        "    if 'lease_ms' in m: m['lease_ms'] = max(1000, m['lease_ms'])\n    return right(c)",
        "lease_ms 1: ",
    ),
    "bounds, an Ack of an Ack": (
        "AMCM/STA/END/BV-12",
        "",
        "def answer(c):\n    m = c.get('message', {})\n"
        "    if m.get('of', {}).get('type') == 'Ack': m['v'] = 0\n    return right(c)",
        "discarded",
    ),
    "bounds, 64 marks": (
        "AMCM/STA/END/BV-13",
        "",
        "def answer(c):\n    m = c.get('message', {})\n"
        "    if m.get('type') == 'CAM': m['marks'] = m['marks'][:64]\n    return right(c)",
        "marks",
    ),
    "reasons": (
        "AMCM/RCV/END/BV-08",
        "",
        "def answer(c):\n    m = c.get('message', {})\n"
        "    if m.get('reason') == 'not_needed': m['reason'] = 'abort'\n    return right(c)",
        'fallback.reason: "not_needed" is expected',
    ),
    "reasons of a refusal": (
        "AMCM/PRE/NEG/BV-08",
        "",
        "def answer(c):\n    m = c.get('message', {})\n"
        "    if m.get('reason') == 'undecided': m['reason'] = 'unsafe'\n    return right(c)",
        'propose.reason: "undecided" is expected',
    ),
    "cam older": ("AMCM/RCV/ACT/BI-03", "", OTHER_CAM, "deadline"),
    "cam older, prescriber": ("AMCM/PRE/ACT/BI-03", "", OTHER_CAM, "deadline"),
    "restart at a deadline": (
        "AMCM/STA/END/TI-06",
        "",
        "def answer(c):\n    if c['cmd'] != 'restart': return right(c)\n"
        "    before, after = right(c | {'cmd': 'advance'}), right(c)\n"
        "    return after | {n: before[n] + after[n] for n in ('messages', 'indications')}",
        "sent for no reason",
    ),
    "a lease from when the proposal came": (
        "AMCM/RCV/ACT/TI-04",
        LASTS.format(name="lease", ms="ms - (now - self.came if self.came else 0)") + CAME,
        "",
        "deadline",
    ),
    "a session after another, what was heard in quarantine": (
        "AMCM/STA/END/BV-16",
        "",
        "early = set()\n"
        "def answer(c):\n    m = c.get('message', {})\n"
        "    if c['cmd'] == 'reset': early.clear()\n"
        "    if received(c, 'Advertisement') and 'planned' in c:\n"
        "        if state().quarantine: early.add(str(m['session']))\n"
        "        if str(m['session']) in early: del c['planned']\n"
        "    return right(c)",
        "not sent: Intention",
    ),
    "a session after another, who has withdrawn": (
        "AMCM/PRE/END/BV-12",
        "",
        "gone = set()\n"
        "def answer(c):\n    m = c.get('message', {})\n"
        "    if c['cmd'] == 'reset': gone.clear()\n"
        "    if received(c, 'Cancel') and state().phase == 'ADVERTISING': gone.add(m['src'])\n"
        "    if received(c, 'Intention') and m['src'] in gone - state().withdrawn and "
        "tuple(m['session']) == state().session:\n"
        "        return right({'cmd': 'advance', 'now': c['now']})\n"
        "    return right(c)",
        "not sent: Ack",
    ),
    "a session after another, the first lease": (
        "AMCM/RCV/END/BV-09",
        "",
        "lease = []\n"
        "def answer(c):\n    m = c.get('message', {})\n"
        "    if c['cmd'] == 'reset': lease.clear()\n"
        "    if received(c, 'Prescription') and m['seq']:\n"
        "        if state().session == tuple(m['session']): lease.append(m['lease_ms'])\n"
        "        if lease: m['lease_ms'] = lease[0]\n"
        "    return right(c)",
        "deadline",
    ),
    "two receivers, one Ack for both": (
        "AMCM/PRE/PRE/BV-08",
        "",
        "def answer(c):\n    out = right(c)\n    m = c.get('message', {})\n"
        "    if received(c, 'Ack') and m['of']['type'] == 'Cancel':\n"
        "        for e in state().outbox:\n"
        "            if e.type == 'Cancel':\n"
        "                m |= {'src': e.dst, 'of': {'type': 'Cancel', 'seq': e.seq}}\n"
        "                right(c | {'message': m})\n"
        "        out['deadline'] = station._station.next_deadline()\n"
        "    return out",
        "deadline",
    ),
    "room": (
        "AMCM/STA/MEM/BI-04",
        "",
        "def answer(c):\n"
        "    if c['cmd'] == 'reset': c['parameters']['max_participants'] = 1\n"
        "    return right(c)",
        "Advertisement",
    ),
    "content, another order": (
        "AMCM/PRE/ADV/BV-02",
        "",
        "def answer(c):\n    d = c.get('command', {}).get('details', {}).get('deep')\n"
        "    if d: d['list'] = d['list'][::-1]\n    return right(c)",
        "details",
    ),
    "content, cut": (
        "AMCM/PRE/PRE/BV-07",
        "",
        "def answer(c):\n    p = c.get('command', {}).get('prescribed')\n"
        "    if p: p['points'] = p['points'][:50]\n    return right(c)",
        "prescribed",
    ),
    "content of copies": (
        "AMCM/PRE/ADV/BV-02",
        "",
        "def answer(c):\n    out = right(c)\n"
        "    if c['cmd'] == 'advance':\n"
        "        for m in out['messages']: m.get('details', {}).pop('text', None)\n    return out",
        "details",
    ),
    "cam rate": (
        "AMCM/STA/ACT/TI-02",
        "",
        "def answer(c):\n    out = right(c)\n"
        "    if c['cmd'] == 'reset': station._t_cam *= 2\n    return out",
        "a CAM every 100 ms",
    ),
    "cam rate, in fits and starts": (
        "AMCM/STA/ACT/TI-02",
        "",
        "def answer(c):\n    out = right(c)\n    for m in out.get('cams', []):\n"
        "        m['generation_ms'] += m['generation_ms'] // 100 % 2 * 60\n    return out",
        "a CAM every 100 ms",
    ),
    "cam rate, none": (
        "AMCM/STA/ACT/TI-02",
        "",
        "def answer(c):\n    return {k: v for k, v in right(c).items() if k != 'cams'}",
        "a CAM every 100 ms",
    ),
    "cam marks": (
        "AMCM/STA/ACT/BV-01",
        """
from automcm.state import State
State.marks = property(lambda st: () if st.session is None else (st.session,))
""",
        "",
        "marks",
    ),
    "back-off": ("AMCM/STA/END/TI-05", LASTS.format(name="backoff", ms=100), "", "500 to 2000"),
    "back-off, one for all seeds": (
        "AMCM/STA/END/TI-05",
        LASTS.format(name="backoff", ms=700),
        "",
        "whatever the seed is",
    ),
    "back-off, whatever the seed": (
        "AMCM/STA/END/TI-05",
        LASTS.format(name="backoff", ms="__import__('random').randint(500, 2000)"),
        "",
        "seed 1: a back-off of",
    ),
    "back-off, none": (
        "AMCM/STA/END/TI-05",
        """
from automcm import station as station_
armed = station_.armed
station_.armed = lambda me, st: [t for t in armed(me, st) if t.name != "backoff"]
""",
        "",
        "not one of -1 ms",
    ),
}


@pytest.mark.parametrize("how", WRONG)
def test_each_case_without_a_graph_can_fail(conform: Suite, how: str) -> None:
    name, first, code, says = WRONG[how]
    found = conform(station(code, first), name)
    (case,) = found.cases
    assert case.verdict == "FAIL" and says in case.reason, (case.verdict, case.reason)
    (failure,) = case.failures
    about, steps = records.read_replay(conform.folder / "report" / failure.replay)
    assert about["case"] == name and steps
    assert found.exit_code == 1


def test_the_order_of_names_is_free(conform: Suite) -> None:
    code = """
def turned(x):
    if isinstance(x, dict): return {k: turned(x[k]) for k in reversed(x)}
    return [turned(y) for y in x] if isinstance(x, list) else x
def answer(c): return turned(right(c))
"""
    names = ("AMCM/PRE/ADV/BV-02", "AMCM/PRE/PRE/BV-07", "AMCM/STA/ACT/BV-01")
    assert conform(station(code), *names).counts["PASS"] == 3


def test_wrong_marks_in_a_tour_are_blamed_on_the_marks(conform: Suite) -> None:
    marks, others = "AMCM/STA/ACT/BV-01", ("AMCM/STA/REL/TI-01", "AMCM/STA/END/BV-01")
    found = conform(station(first=WRONG["cam marks"][1]), *others, marks, states=700)
    case = of(found, marks)
    assert case.verdict == "FAIL" and len(case.failures) > 1, "not only in the case itself"
    assert all("CAM.marks" in failure.what for failure in case.failures)
    assert len(case.failures) <= suite.ENOUGH + 1
    assert {of(found, name).verdict for name in others} <= {"PASS", "INCONC"}


# -- the same again, and what is expected


def test_two_runs_give_the_same_bytes(conform: Suite) -> None:
    texts = []
    for name in ("first", "second"):
        (conform.folder / name).mkdir()
        found = conform(station(IGNORES), BUSY, ACCEPTS, LATER, states=60, folder=f"{name}/report")
        written = report.write(found, conform.folder / name / "report")
        texts.append([file.read_text().replace(f"/{name}/", "/") for file in written])
    assert texts[0] == texts[1]
    logs = [sorted((conform.folder / n / "report").rglob("*.*json")) for n in ("first", "second")]
    assert len(logs[0]) > 5
    for one, other in zip(*logs, strict=True):
        if one.name != "report.json":
            assert one.name == other.name and one.read_bytes() == other.read_bytes()


def test_another_seed_reaches_the_station(conform: Suite) -> None:
    code = "def answer(c):\n    return {'error': '!'} if c.get('seed', 7) != 7 else right(c)"
    assert conform(station(code), LATER, seed=7).exit_code == 0
    assert conform(station(code), LATER, seed=8).exit_code == 3


def test_expected_deviations(conform: Suite) -> None:
    known: verdicts.Expectations = {BUSY: ("FAIL", "ticket 12"), ACCEPTS: ("FAIL", "ticket 13")}
    found = conform(station(IGNORES), BUSY, LATER, states=60, expected=known)
    case = of(found, BUSY)
    assert case.verdict == "FAIL" and case.expected and case.because == "ticket 12"
    assert found.exit_code == 0 and found.unexpected == []
    found = conform(station(IGNORES), BUSY, ACCEPTS, LATER, states=60, expected=known)
    assert found.unexpected == [of(found, ACCEPTS)] and found.exit_code == 1
    assert of(found, ACCEPTS).verdict == "PASS"


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ('"AMCM/X" = {verdict = "FAIL", because = "x"}', "AMCM/X: there is no such case"),
        (f'"{BUSY}" = {{verdict = "FAIL"}}', f"{BUSY}: needs verdict and because"),
        (f'"{BUSY}" = {{verdict = "FAIL", because = " "}}', f"{BUSY}.because: say why"),
        (f'"{BUSY}" = {{verdict = "FAIL", because = 1}}', f"{BUSY}.because: say why"),
        (f'"{BUSY}" = {{verdict = "BAD", because = "x"}}', f"{BUSY}.verdict: one of PASS, FAIL"),
        (f'"{BUSY}" = {{verdict = "FAIL", because = "x", by = 1}}', "and nothing else"),
        (f'"{BUSY}" = "FAIL"', f"{BUSY}: needs verdict and because"),
        (f'["{BUSY}"', "known.toml: "),
    ],
)
def test_a_bad_file_of_expectations(tmp_path: Path, text: str, says: str) -> None:
    file = tmp_path / "known.toml"
    file.write_text(text)
    with pytest.raises(verdicts.ExpectError) as caught:
        verdicts.expectations(file, purposes.load())
    assert str(file) in str(caught.value) and says in str(caught.value)


def test_a_good_file_of_expectations(tmp_path: Path) -> None:
    file = tmp_path / "known.toml"
    file.write_text(f'"{BUSY}" = {{verdict = "FAIL", because = "x"}}')
    assert verdicts.expectations(file, purposes.load()) == {BUSY: ("FAIL", "x")}


# -- tours, without any station


@pytest.fixture(scope="module")
def tight() -> Oracle:
    return graph(TIGHT.path)


def every(oracle: Oracle) -> list[tuple[oracle_.Answer, str]]:
    """All pairs, each for a case named after its rule."""
    return [(a, a.effect.rule) for s in range(len(oracle.states)) for a in oracle.answers(s)]


def pairs(oracle: Oracle, tour: list[int]) -> list[tuple[int, int]]:
    """The pairs that a tour drives."""
    state, out = 0, []
    for i in tour:
        answer = oracle.answer(state, i)
        assert answer is not None
        out.append((state, i))
        state = answer.next
    return out


def test_tours_drive_each_pair_and_come_to_an_end(tight: Oracle) -> None:
    everything = every(tight)
    tours = Tours.over(tight, everything, lambda s, i: True)
    driven: Counter[tuple[int, int]] = Counter()
    count = 0
    while (tour := tours.next()) is not None:
        count += 1
        fresh = 0
        for pair in pairs(tight, tour):
            driven[pair] += 1
            fresh += tours.done(pair) is not None
        assert fresh > 0
        assert len(tour) < LONGEST + len(tight.inputs)
    assert set(driven) == {(a.state, a.input) for a, _ in everything} and not tours.left
    refused = {(a.state, a.input) for a, _ in everything if not a.changes}
    more = sum(driven[pair] - 1 for pair in refused)
    assert 0 < more < 0.2 * len(refused), "what changes nothing is driven once, and on some ways"
    assert driven.total() < 1.3 * len(everything)
    assert count < len(tight.states) * 10


def test_tours_that_are_planned_before_any_is_done(tight: Oracle) -> None:
    tours = Tours.over(tight, every(tight), lambda s, i: True)
    seen: set[tuple[int, int]] = set()
    for _ in range(5):
        tour = tours.next()
        assert tour is not None
        still = {(s, i) for s, i in pairs(tight, tour) if i not in tight.moves(s)}
        assert not seen & still, "planned twice"
        seen |= still
    assert len(seen) > 1_000


def test_done_names_the_case_once(tight: Oracle) -> None:
    (answer, case), *_ = every(tight)
    tours = Tours.over(tight, [(answer, case)], lambda s, i: True)
    pair = answer.state, answer.input
    assert tours.done((pair[0], pair[1] + 1)) is None and tours.done((9, 9)) is None
    assert tours.done(pair) == case and tours.done(pair) is None
    assert tours.left == {} and tours.next() is None


def test_avoid_finds_other_ways_as_long_as_there_are(tight: Oracle) -> None:
    tours = Tours.over(tight, every(tight), lambda s, i: True)
    target = max(range(len(tight.states)), key=lambda s: len(tours.path(s) or []))
    ways = 0
    while (way := tours.path(target)) is not None:
        ways += 1
        assert ways < 1_000
        driven = pairs(tight, way)
        assert not tours.avoided & set(driven)
        assert tight.answer(*driven[-1]).next == target  # type: ignore[union-attr]
        tours.avoid(driven[-1])
    assert ways > 1
    assert target in tours.left, "what is out of reach stays"
    while (tour := tours.next()) is not None:
        for pair in pairs(tight, tour):
            assert pair not in tours.avoided or pair in driven
            tours.done(pair)
    assert target in tours.left


def test_allowed_keeps_tours_away(tight: Oracle) -> None:
    requests = {i for i, value in enumerate(tight.inputs) if value[:2] == ["command", "request"]}
    targets = [(a, case) for a, case in every(tight) if a.input not in requests]
    tours = Tours.over(tight, targets, lambda s, i: i not in requests)
    reached = set()
    while (tour := tours.next()) is not None:
        assert not requests & set(tour)
        reached |= {state for state, _ in pairs(tight, tour)}
        for pair in pairs(tight, tour):
            tours.done(pair)
    assert reached and all(tight.states[s][1] != "prescriber" for s in reached)
    assert any(tight.states[s][1] == "prescriber" for s in tours.left)


def test_drop_leaves_the_other_cases(tight: Oracle) -> None:
    tours = Tours.over(tight, every(tight), lambda s, i: True)
    tours.drop("END-6")
    left = {case for here in tours.left.values() for case in here.values()}
    assert "END-6" not in left
    assert left == {case for _, case in every(tight)} - {"END-6"}


def walks(oracle: Oracle, count: int) -> Iterator[list[int]]:
    """Random ways through a graph, the same each time; expiries twice as likely."""
    dice = random.Random(1)
    for _ in range(count):
        state, tour = 0, []
        for _ in range(60):
            answers = list(oracle.changes(state))
            expiries = [a for a in answers if oracle.inputs[a.input][0] == "expire"]
            answer = dice.choice(answers + expiries)
            tour.append(answer.input)
            state = answer.next
        yield tour


def test_the_timetable_makes_each_expiry_due_in_turn(tight: Oracle) -> None:
    start = 5_000
    for tour in walks(tight, 200):
        slots = timetable(tight, tour, start)
        deadlines: dict[str, int] = {}
        lease, told = 0, {}
        now = start
        for i, slot in zip(tour, slots, strict=True):
            value = tight.inputs[i]
            assert slot.answer.input == i and slot.at - now in (STEP_MS, STEP_MS + STEP_MS // 2)
            now = slot.at
            assert all(ms >= 1 for ms in slot.durations.values())
            assert not slot.durations.keys() & {"lease"}
            told |= slot.durations
            if value[0] == "expire":
                timer = canonical(value[1])
                assert deadlines.pop(timer) == now
            assert all(deadline > now for deadline in deadlines.values()), "none is jumped over"
            lease = slot.lease_ms or lease
            for timer in slot.answer.effect.stop:
                del deadlines[canonical(timer)]
            for timer in slot.answer.effect.arm:
                lasts = lease if timer[0] == "lease" else told[timer[0]]
                deadlines[canonical(timer)] = now + lasts
        assert all(deadline >= now + STEP_MS for deadline in deadlines.values())


def test_what_changes_nothing_comes_a_little_later(tight: Oracle) -> None:
    refused = next(a.input for a in tight.answers(0) if not a.changes)
    moves = next(a.input for a in tight.changes(0))
    slots = timetable(tight, [refused, refused, moves], 0)
    now = STEP_MS // 2
    assert [slot.at for slot in slots] == [now + LATER_MS, now + LATER_MS, now + STEP_MS]


def test_a_timetable_of_what_is_not_offered(tight: Oracle) -> None:
    absent = next(i for i in range(len(tight.inputs)) if tight.answer(0, i) is None)
    with pytest.raises(ValueError, match="not offered"):
        timetable(tight, [absent], 0)
    assert offered(tight, [absent]) == []


# -- the remainder


@pytest.fixture(scope="module")
def two() -> Oracle:
    return graph(TWO_PEERS.path)


def test_the_remainder_is_of_this_specification(two: Oracle) -> None:
    assert remainder.spec_hash() == spec_hash() == two.spec_hash


def test_each_pair_of_the_remainder_is_offered(two: Oracle) -> None:
    written = json.loads(remainder.PATH.read_bytes())["pairs"]
    kept = REAL_READ(two)
    assert len(kept) == sum(map(len, written.values())) > 10_000
    assert len({(a.state, a.input) for a in kept}) == len(kept)


def test_a_remainder_of_another_specification(two: Oracle, tmp_path: Path) -> None:
    file = tmp_path / "remainder.json"
    file.write_text(remainder.PATH.read_text().replace(two.spec_hash, "0" * 64))
    for path in (file, tmp_path / "none.json"):
        with pytest.raises(oracle_.OracleError, match=path.name):
            REAL_READ(two, path)


def test_the_remainder_is_what_has_no_image(two: Oracle) -> None:
    """A sample: no pair of the file has an image, and of pairs that are alike the first decides."""
    one, dice = graph(ONE_PEER.path), random.Random(1)
    kept = REAL_READ(two)
    assert not any(remainder._has_image(two, one, answer) for answer in dice.sample(kept, 300))
    alike = {key(two, answer) for answer in kept}
    seen = Counter[bool]()
    for _ in range(300):
        state = dice.randrange(len(two.states))
        answer = dice.choice(list(two.answers(state)))
        either = {key(two, answer), key(two, mirror(two, answer))}
        written = bool(alike & either)
        seen[written] += 1
        if not remainder._has_image(two, one, answer) and not written:
            assert remainder._has_image(two, one, first_like(two, either))
    assert min(seen.values()) > 10


def first_like(two: Oracle, keys: set[tuple[str, int]]) -> oracle_.Answer:
    """The first pair with one of these keys."""
    for state in range(len(two.states)):
        for _, i in sorted(keys, key=lambda key: key[1]):
            answer = two.answer(state, i)
            if answer is not None and key(two, answer) in keys:
                return answer
    raise AssertionError("no such pair")


def key(two: Oracle, answer: oracle_.Answer) -> tuple[str, int]:
    """Equal for pairs that differ only in what the input cannot touch."""
    view = remainder._touches(two.inputs[answer.input])
    return canonical(remainder._view(two.states[answer.state], view)), answer.input


def mirror(two: Oracle, answer: oracle_.Answer) -> oracle_.Answer:
    """The pair with the peers exchanged."""
    state = remainder._state(two.states[answer.state], remainder._swap)
    i = remainder._input(two.inputs[answer.input], remainder._swap)
    return two.ask(state, i)


REAL_READ = remainder.read


# -- what make test-foreign needs


@pytest.fixture(scope="module")
def foreign() -> Any:
    path = Path(__file__).with_name("foreign.py")
    spec = importlib.util.spec_from_file_location("foreign", path)
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules["foreign"] = module  # dataclasses look there
    spec.loader.exec_module(module)
    return module


def test_the_mutants_are_well_formed(foreign: Any) -> None:
    found = foreign.mutants()
    assert len(found) == 27
    combined = foreign.mutants(cpp.COMBINED)
    assert len(combined) == 10
    assert all(len(mutant.edits) == len(mutant.rules) == 2 for mutant in combined)
    assert all(mutant.story.endswith(".") for mutant in [*found, *combined])


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (("int twice;", "int once;"), "a: old: 2 times, not once"),
        (("int none;", "int once;"), "a: old: 0 times, not once"),
        (("int once;", "int once;"), "a: new: changes nothing"),
        (("int once;", "int other;", "NEG-99"), "a: rules: NEG-99"),
    ],
)
def test_a_mutant_that_is_not(
    foreign: Any, tmp_path: Path, change: tuple[str, ...], says: str
) -> None:
    (tmp_path / "station.hpp").write_text("int once; int twice; int twice;")
    old, new, *rules = change
    row = f'[[mutant]]\nname = "a"\nstory = "b."\nold = "{old}"\nnew = "{new}"\n'
    (tmp_path / "mutants.toml").write_text(f"{row}rules = {rules or ['NEG-4']}\n")
    with pytest.raises(ValueError, match=re.escape(says)):
        foreign.mutants(tmp_path / "mutants.toml")


def test_a_station_without_its_toolchain_is_skipped(foreign: Any, tmp_path: Path) -> None:
    assert [each.name for each in foreign.STATIONS] == ["the station in C++", "the station in Go"]
    for each in foreign.STATIONS:
        row = foreign.check_station(replace(each, missing=lambda: "a compiler"), tmp_path)
        assert (row.skipped, row.verdict, row.failed) == (True, "", "a compiler is missing")


def test_what_foreign_takes_for_a_pass(foreign: Any) -> None:
    case = {"id": "x", "verdict": "PASS", "level": "MUST", "expected": True, "reason": ""}
    good = {"cases": [case], "problems": [], "coverage": {"transitions": [3, 3]}}
    assert foreign.wrong(0, good) == ""
    assert foreign.wrong(1, good) == "exit code 1"
    assert foreign.wrong(0, good | {"cases": [case | {"verdict": "SKIP"}]}) == "x: SKIP "
    assert foreign.wrong(0, good | {"problems": ["cut short"]}) == "cut short"
    assert "2 of 3" in foreign.wrong(0, good | {"coverage": {"transitions": [2, 3]}})
    assert "0 of 0" in foreign.wrong(0, good | {"coverage": {"transitions": [0, 0]}})
    failed = {"id": "y", "verdict": "FAIL", "failures": [{"rule": "NEG-1"}, {"rule": "END-3"}]}
    assert foreign.fitting({"cases": [case, failed]}, ("END-3",)) == ("y", "END-3")
    assert foreign.fitting({"cases": [case, failed]}, ("END-4",)) == ("", "")


# -- a run that ends early


@pytest.mark.parametrize(
    ("error", "problem", "exit_code"),
    [
        (KeyboardInterrupt(), "interrupted", 4),
        (RuntimeError("a slip"), "the kit broke: RuntimeError: a slip", 3),
    ],
)
def test_what_was_found_is_not_lost(
    conform: Suite, error: BaseException, problem: str, exit_code: int
) -> None:
    def special(*_: object) -> None:
        raise error

    conform.patch.setattr(whole.named, "special", special)
    found = conform(station(""), ACCEPTS, "AMCM/RCV/ADV/TI-03", states=60)
    assert found.problems == [problem] and found.exit_code == exit_code
    assert of(found, ACCEPTS).verdict == "PASS"
    assert of(found, "AMCM/RCV/ADV/TI-03").verdict == "INCONC"
    assert problem in of(found, "AMCM/RCV/ADV/TI-03").reason


# -- what changes something in secret


def test_a_cam_that_does_not_count_shows_at_once(conform: Suite) -> None:
    """ACT-5: the cam timer is the earliest while they arrive, so one armed anew is seen."""
    code = (
        "n = 0\n"
        "def answer(c):\n"
        "    global n\n"
        "    if received(c, 'CAM'):\n"
        "        n += 1\n"
        "        c['message']['generation_ms'] = 10_000 + n\n"
        "    return right(c)"
    )
    found = conform(station(code), "AMCM/STA/ACT/BI-02", states=600)
    wrong = [case for case in found.cases if case.verdict == "FAIL"]
    assert wrong and all("deadline" in case.reason for case in wrong)
    assert not any(case.verdict == "ERROR" for case in found.cases), "and it is no chance"


def test_an_ack_of_a_stranger_names_what_is_in_use() -> None:
    """END-6: the sender alone must keep it from counting."""
    wire = Wire()
    intention = {"type": "Intention", "dst": 1702, "session": [1702, 5], "seq": 7}
    wire.outbox[("Intention", 2, 2, 1, 1)] = intention
    ack = ["Ack", 3, 1, [2, 1], 0, 0, False, "none", ["Intention", 1]]
    assert wire.message(ack)["of"] == {"type": "Intention", "seq": 7}
    assert wire.message(ack)["src"] != intention["dst"]


@pytest.mark.parametrize(
    "part",
    [
        '"messages":0,"indications":[]',
        '"messages":[],"indications":"x"',
        '"messages":[],"indications":[{}]',
        '"messages":[],"indications":[],"cams":[7]',
        '"messages":[],"indications":[],"cams":0',
        '"messages":["\\ud800"],"indications":[]',
    ],
)
def test_an_answer_of_no_form_is_the_fault_of_the_adapter(part: str) -> None:
    expected = Expected(phase="WAITING", marks=[[], []])
    line = f'{{{part},"deadline":null,"phase":"WAITING"}}'.encode()
    with pytest.raises(ProtocolError):
        differences(expected, line)
