"""The suite against stations that break, and runs that end early: each gets the verdict that it
deserves, on the case that it belongs to, and the run goes on."""

from __future__ import annotations

import json
import resource
import signal
import sys
from pathlib import Path
from typing import Any

import pytest
from broken_stations import broken
from suite_stage import ACCEPTS, BUSY, IGNORES, LATER, LIMIT, SHORT, Suite, graph, of
from suite_stage import conform as conform
from wrong_station import station

from automcm.adapters.adapter_lines import HELLO
from automcm_conformance.adapter.adapter import PATIENCE
from automcm_conformance.report import report
from automcm_conformance.suite import graph_cases, purposes, suite_run, verdicts
from automcm_spec.graph.oracle_generation import ONE_PEER, TIGHT
from automcm_spec.support.bad_input import BadInput

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
BROKEN = {  # of each kind one; test_process.py has more
    "crashes": (
        "def bad():\n    print('Traceback: no more', file=sys.stderr, flush=True)\n    os._exit(7)",
        "answers, with exit code 7",
    ),
    "hangs": ("def bad(): time.sleep(60)", "no answer within 1 s"),
    "rubbish": ("def bad(): return b'Hello, world\\n'", "not JSON"),
    "a gigabyte on one line": (
        "def bad():\n    for _ in range(1 << 14): os.write(1, b'x' * (1 << 16))",
        "more than 1048576 bytes",
    ),
    "closes its output": ("def bad(): os.close(1); time.sleep(60)", "closed its standard output"),
}


@pytest.mark.sweep(1)
@pytest.mark.parametrize("how", BROKEN)
def test_what_breaks_costs_its_case_alone(conform: Suite, how: str) -> None:
    bad, says = BROKEN[how]
    graph(ONE_PEER.path), graph(TIGHT.path)  # loaded once, whichever test is the first
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    limit_s = SHORT if how in ("hangs", "closes its output") else LIMIT
    found = conform(station(bad + NARROW), BUSY, ACCEPTS, LATER, states=60, limit_s=limit_s)
    case = of(found, BUSY)
    reason = case.reason.replace('"', "'")
    assert case.verdict == "ERROR" and says in reason, reason
    assert of(found, ACCEPTS).verdict == of(found, LATER).verdict == "PASS"
    assert case.reached == case.total, "the other pairs of the case were driven all the same"
    (failure,) = case.failures
    assert failure.rule == "NEG-4" and (conform.folder / "report" / failure.replay).exists()
    assert ("Traceback: no more" in failure.came) == (how == "crashes")
    assert f".json --limit {limit_s:g} -- " in failure.command
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


def test_the_rest_of_a_part_is_skipped_after_some_hangs_at_one_command(conform: Suite) -> None:
    conform.patch.setattr(graph_cases, "HANGS", 1)
    code = "def answer(c):\n    if received(c, 'Fin'): time.sleep(60)\n    return right(c)"
    found = conform(station(code), "AMCM/RCV/ACT", states=60, limit_s=0.5)
    says = f"the rest is skipped after {graph_cases.HANGS} hangs at receive Fin"
    assert f"one-peer: {says}" in found.problems
    assert found.counts["ERROR"] and found.counts["INCONC"]
    assert not any("cut short" in problem for problem in found.problems)


@pytest.mark.slow
def test_some_crashes_do_not_end_the_run(conform: Suite) -> None:
    """A few faults, however often each is tried again until the shortest exchange is found."""
    conform.patch.setattr(graph_cases, "PATIENCE", 2 * graph_cases.ENOUGH)
    code = (
        "def answer(c):\n    if station._station and foreign(c): os._exit(3)\n    return right(c)"
    )
    found = conform(station(code), BUSY, ACCEPTS, LATER, states=60)
    assert found.problems == []
    assert (
        of(found, BUSY).verdict == "ERROR" and len(of(found, BUSY).failures) == graph_cases.ENOUGH
    )
    assert of(found, ACCEPTS).verdict == of(found, LATER).verdict == "PASS"


@pytest.mark.slow
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


@pytest.mark.slow
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
    assert found.problems == ["the adapter did not exit within 1 s of stop and was killed"]


# -- the same again, and what is expected


@pytest.mark.slow
def test_two_runs_give_the_same_bytes(conform: Suite) -> None:
    texts = []
    for name in ("first", "second"):
        (conform.folder / name).mkdir()
        found = conform(station(IGNORES), BUSY, ACCEPTS, LATER, states=60, folder=f"{name}/report")
        found.case_seconds.clear()  # measured
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
    found = conform(station(IGNORES), BUSY, ACCEPTS, LATER, states=60, expected=known)
    case, passed = of(found, BUSY), of(found, ACCEPTS)
    assert case.verdict == "FAIL" and case.expected and case.because == "ticket 12"
    assert passed.verdict == "PASS" and found.unexpected == [passed] and found.exit_code == 1
    found.cases.remove(passed)
    assert found.exit_code == 0 and found.unexpected == []


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ('"AMCM/X" = {verdict = "FAIL", because = "x"}', "AMCM/X: unknown case"),
        (f'"{BUSY}" = {{verdict = "FAIL"}}', f"{BUSY}.because: Field required"),
        (
            f'"{BUSY}" = {{verdict = "FAIL", because = " "}}',
            f"{BUSY}.because: String should match",
        ),
        (f'"{BUSY}" = {{verdict = "FAIL", because = 1}}', f"{BUSY}.because: Input should be a"),
        (
            f'"{BUSY}" = {{verdict = "BAD", because = "x"}}',
            f"{BUSY}.verdict: Input should be 'PASS', 'FAIL'",
        ),
        (f'"{BUSY}" = {{verdict = "FAIL", because = "x", by = 1}}', f"{BUSY}.by: Extra inputs"),
        (f'"{BUSY}" = "FAIL"', f"{BUSY}: Input should be a valid dict"),
        (f'["{BUSY}"', "known.toml: "),
    ],
)
def test_a_bad_file_of_expectations(tmp_path: Path, text: str, says: str) -> None:
    file = tmp_path / "known.toml"
    file.write_text(text)
    with pytest.raises(BadInput) as caught:
        verdicts.expectations(file, purposes.load())
    assert str(file) in str(caught.value) and says in str(caught.value)


def test_a_good_file_of_expectations(tmp_path: Path) -> None:
    file = tmp_path / "known.toml"
    file.write_text(f'"{BUSY}" = {{verdict = "FAIL", because = "x"}}')
    assert verdicts.expectations(file, purposes.load()) == {BUSY: ("FAIL", "x")}


# -- a run that ends early


def test_a_quick_run_says_what_it_omits(conform: Suite) -> None:
    names = (BUSY, "AMCM/PRE/CMD/BI-01", "AMCM/SYS/REL/BV-01")
    found = conform(station(IGNORES), *names, states=60, quick=True)
    assert [case.verdict for case in found.cases] == ["PASS", "FAIL", "SKIP"]
    case = found.cases[0]
    assert 0 < case.reached < case.total and found.exit_code == 1
    assert f"{case.total - case.reached:,} need the whole suite" in case.reason


def test_a_run_stops_after_so_many_failed_cases(conform: Suite) -> None:
    found = conform(station(IGNORES), states=60, stop_after=1)
    assert found.counts["FAIL"] == 1 and found.counts["INCONC"] > 50
    assert found.notes == ["cut short after 1 failed case, as --stop-after says"]
    assert not found.problems


def test_a_wrong_answer_of_a_case_that_was_not_chosen_is_noted(conform: Suite) -> None:
    code = """
def answer(c):
    out = right(c)
    return out | {"messages": []} if received(c, "Fin") else out
"""
    found = conform(station(code), "AMCM/RCV/REL/TI-01", "AMCM/RCV/ACT/BV-01", states=60)
    assert any(note.startswith("a case that was not chosen fails: END-3: ") for note in found.notes)


def test_an_error_in_a_scenario_says_what_happened(conform: Suite) -> None:
    found = conform(broken("crashes_on_a_prescription"), "AMCM/SYS/ACT/BV-01")
    (((case, shown),),) = found.causes
    text = "2002: the adapter exited after 0 of 1 answers, with exit code 1"
    assert (case.verdict, report.about(shown)) == ("ERROR", [text])
    assert shown.difference == "ERROR in a scenario"


@pytest.mark.sweep(1)
@pytest.mark.parametrize(
    ("error", "problem", "exit_code"),
    [
        (KeyboardInterrupt(), "interrupted", 130),
        (RuntimeError("a slip"), "the kit broke: RuntimeError: a slip", 70),
    ],
)
def test_what_was_found_is_not_lost(
    conform: Suite, error: BaseException, problem: str, exit_code: int
) -> None:
    def special(*_: object) -> None:
        raise error

    conform.patch.setattr(suite_run.named_cases, "special", special)
    found = conform(station(""), ACCEPTS, "AMCM/RCV/ADV/TI-03", states=60)
    told = found.notes if exit_code == 130 else found.problems
    assert problem in told and found.exit_code == exit_code
    assert of(found, ACCEPTS).verdict == "PASS"
    assert of(found, "AMCM/RCV/ADV/TI-03").verdict == "INCONC"
    assert problem in of(found, "AMCM/RCV/ADV/TI-03").reason


def test_after_ctrl_c_what_was_sent_is_judged(conform: Suite) -> None:
    """The answers that came until then, also those that were not read yet."""
    judge = graph_cases.Runner._judge_sent

    def interrupted(self: Any, of: Any) -> None:
        judge(self, of)
        if not self.ended:  # the first lines are sent, and nothing is judged yet
            signal.raise_signal(signal.SIGINT)

    conform.patch.setattr(graph_cases.Runner, "_judge_sent", interrupted)
    conform.patch.setattr(graph_cases, "BULK", 1)
    code = """
def answer(c):
    return {**right(c), "phase": "WAITING"} if c["cmd"] == "command" else right(c)
"""
    before = signal.getsignal(signal.SIGINT)
    found = conform(station(code), "MUST", states=60)
    assert "interrupted" in found.notes and found.problems == []
    assert signal.getsignal(signal.SIGINT) is before
    assert found.counts["FAIL"] >= 1 and found.exit_code == 1
