"""Exploration: its findings, how far it shortens them, and its repeatability."""

from __future__ import annotations

import json
from functools import cache, partial
from pathlib import Path

import pytest
from wrong_station import station

from automcm_conformance.adapter.adapter import Adapter
from automcm_conformance.exchange import records
from automcm_conformance.exchange.exchange import Mismatch
from automcm_conformance.exchange.results import EXPLORED, Exploration
from automcm_conformance.explore import explore
from automcm_conformance.explore.walk_shrinking import FailingWalk, Shrinker
from automcm_spec.graph.oracle import Oracle
from automcm_spec.graph.oracle import load as read

LIMIT_S = 20.0
LIMITS = {"max_rounds": 3, "max_participants": 2, "outbox_limit": 5, "memory_limit": 4}

SECOND_SESSION = """
sessions = set()
def answer(command):
    out = right(command)
    if command["cmd"] == "reset":
        sessions.clear()
    if received(command, "Advertisement") and state().phase == "INTENDING":
        sessions.add(state().session)
    if received(command, "Fin") and len(sessions) > 1 and state().phase == "STANDALONE":
        out["messages"] = []
    return out
"""
"""From the second session it has joined on, it does not ack a Fin (END-3; ACT-3 decides)."""

LATE_LEASE = """
def answer(command):
    if received(command, "Prescription"):
        command["message"]["lease_ms"] += 1
    return right(command)
"""
"""A lease lasts a millisecond too long (ACT-4)."""

FLAKY = """
count = 0
def answer(command):
    global count
    out = right(command)
    if received(command, "Fin"):
        count += 1
        if count == 3:
            out["messages"] = []
    return out
"""
"""One Fin of all is not acked."""

CRASHES = """
def answer(command):
    out = right(command)
    if command["cmd"] == "restart" and state().number:
        print("out of luck", file=sys.stderr, flush=True)
        os._exit(3)
    return out
"""

HANGS = """
def answer(command):
    out = right(command)
    if command["cmd"] == "restart":
        time.sleep(60)
    return out
"""


@cache
def load(path: Path, spec_hash: str | None = None) -> Oracle:
    """A graph, read once for all tests."""
    return read(path, spec_hash)


@pytest.fixture(autouse=True)
def read_once(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(explore, "load", load)


def explored(
    code: str, folder: Path, walks: int, *, seed: int = 1, enough: int = 1, limit_s: float = LIMIT_S
) -> Exploration:
    return explore.explore(
        station(code),
        folder,
        limit_s=limit_s,
        seed=seed,
        enough=enough,
        notify=lambda text: None,
        more=lambda number: number < walks,
    )


@pytest.mark.slow
def test_a_right_station_passes_and_the_same_seed_gives_the_same_bytes(tmp_path: Path) -> None:
    one, other = (explored("", tmp_path, 20).as_dict() for _ in range(2))
    assert json.dumps(one) == json.dumps(other)
    assert one["exit_code"] == 0
    assert one["walks"] == 20
    assert one["cases"] == [] and one["problems"] == []
    assert {name for name, c in one["coverage"].items() if c["refusals"][0]} >= {"two-peers"}
    assert explored("", tmp_path, 20, seed=2).as_dict()["coverage"] != one["coverage"]


@pytest.mark.slow
def test_a_station_that_numbers_its_sessions_freely_passes(tmp_path: Path) -> None:
    code = """
def answer(command):
    if command["cmd"] == "command" and command["command"]["name"] == "request":
        station._station.state = state()._replace(number=state().number + 4)
    return right(command)
"""
    found = explored(code, tmp_path, 15)
    assert found.cases == [] and found.problems == []


@pytest.mark.slow
def test_a_station_without_durations_is_walked_in_natural_time(tmp_path: Path) -> None:
    without = 'kit.HELLO["features"].remove("durations")\nkit.HELLO["features"].remove("restart")\n'
    found = explored(without, tmp_path, 25)
    assert found.cases == [] and found.problems == []
    assert found.coverage["two-peers"]["transitions"][0] > 100


def replays(found: Exploration, folder: Path, code: str) -> None:
    """The replay of the first failure goes wrong at its last line."""
    (failure,) = found.cases[0].failures
    about, steps = records.read_replay(folder / failure.replay)
    assert about["case"] == found.cases[0].id
    again = Adapter(station(code), LIMIT_S)
    try:
        with pytest.raises(Mismatch) as wrong:
            records.replayed(steps, again)
    finally:
        again.stop()
    assert len(wrong.value.steps) == len(steps)


@pytest.mark.slow
def test_a_fault_of_the_second_session_is_found_and_shortened(tmp_path: Path) -> None:
    found = explored(SECOND_SESSION, tmp_path, 400)
    (case,) = found.cases
    assert (case.verdict, case.rules) == ("FAIL", ["ACT-3"])
    assert found.exit_code == 1
    # Join, be told that it is over, join again, be told again.
    assert found.acts[case.id] <= 5
    replays(found, tmp_path, SECOND_SESSION)


AFTER_RESTART = """
back = False
def answer(command):
    global back
    back = command["cmd"] != "reset" and (back or command["cmd"] == "restart")
    out = right(command)
    for message in out["messages"] if back else ():
        {change}
    return out
"""
SEQ_AFTER_RESTART = AFTER_RESTART.format(
    change='message["seq"] += message["type"] == "Advertisement"'
)
SAME_NUMBER = AFTER_RESTART.format(
    change='message["session"][1] *= message["type"] != "Advertisement"'
)


@pytest.mark.slow
@pytest.mark.parametrize("code", [SEQ_AFTER_RESTART, SAME_NUMBER])
def test_a_wrong_choice_of_the_station_is_wrong_in_the_replay_too(
    tmp_path: Path, code: str
) -> None:
    found = explored(code, tmp_path, 60)
    (case,) = found.cases
    assert (case.verdict, case.rules, found.acts[case.id]) == ("FAIL", ["ADV-1"], 3)
    replays(found, tmp_path, code)


@pytest.mark.slow
def test_a_timer_a_millisecond_late_is_found_by_its_deadline(tmp_path: Path) -> None:
    found = explored(LATE_LEASE, tmp_path, 100)
    (case,) = found.cases
    assert case.verdict == "FAIL"
    assert "deadline" in case.reason or "lease_ms" in case.reason
    replays(found, tmp_path, LATE_LEASE)


@pytest.mark.slow
def test_a_station_that_stops_failing_is_nondeterministic_with_both_logs(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    # It never fails again, so nothing is shortened, however often that is tried.
    monkeypatch.setattr(explore, "Shrinker", partial(Shrinker, runs=12, near=12))
    found = explored(FLAKY, tmp_path, 200)
    (case,) = found.cases
    assert case.verdict == "ERROR" and case.reason.startswith("nondeterministic")
    assert found.exit_code == 3
    for name in ("first", "again"):
        (log,) = (tmp_path / "logs").glob(f"1-{name}.*")
        assert log.name in case.reason and log.stat().st_size > 0


@pytest.mark.slow
def test_a_crash_is_shortened_and_its_last_words_are_kept(tmp_path: Path) -> None:
    found = explored(CRASHES, tmp_path, 200)
    (case,) = found.cases
    assert case.verdict == "ERROR"
    assert found.acts[case.id] <= 3
    assert any("out of luck" in line for line in case.failures[0].came)


@pytest.mark.slow
def test_a_station_that_hangs_ends_in_a_report(tmp_path: Path) -> None:
    found = explored(HANGS, tmp_path, 60, limit_s=4.0)
    assert found.cases[0].verdict == "ERROR"
    assert found.exit_code == 3


NO_RESET = """
def answer(command):
    if command["cmd"] == "reset":
        os._exit(3)
    return right(command)
"""

REFUSES_RESET = """
def answer(command):
    return {"error": "no"} if command["cmd"] == "reset" else right(command)
"""

LEAKS = """
resets = 0
def answer(command):
    global resets
    out = right(command)
    resets += command["cmd"] == "reset"
    if resets > 7 and received(command, "Fin"):
        out["messages"] = []
    return out
"""
"""After some resets it acks no Fin any more."""

LINE_TOO_MANY = """
def answer(command):
    line = json.dumps(right(command)).encode() + b"\\n"
    return 2 * line if received(command, "Fin") else line
"""

LINE_TOO_FEW = """
def answer(command):
    out = right(command)
    return b"" if received(command, "Fin") else out
"""


@pytest.mark.slow
@pytest.mark.parametrize("code", [NO_RESET, REFUSES_RESET])
def test_a_station_that_never_answers_reset_is_an_error(tmp_path: Path, code: str) -> None:
    found = explored(code, tmp_path, 3)
    (case,) = found.cases
    assert case.verdict == "ERROR" and "nondeterministic" not in case.reason
    assert found.acts[case.id] == 0 and found.problems == []


@pytest.mark.slow
def test_what_is_remembered_over_reset_is_nondeterministic(tmp_path: Path) -> None:
    found = explored(LEAKS, tmp_path, 60)
    (case,) = found.cases
    assert case.verdict == "ERROR" and case.reason.startswith("nondeterministic")
    assert len(list((tmp_path / "logs").glob("1-again.*"))) == 1


@pytest.mark.slow
@pytest.mark.parametrize("code", [LINE_TOO_MANY, LINE_TOO_FEW])
def test_a_line_too_many_or_too_few_is_no_broken_rule(tmp_path: Path, code: str) -> None:
    found = explored(code, tmp_path, 30, limit_s=4.0)
    (case,) = found.cases
    assert case.verdict == "ERROR" and found.exit_code == 3
    assert not found.problems


@pytest.mark.slow
def test_an_interruption_of_shortening_keeps_the_failure(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def interrupted(shrinker: Shrinker, found: FailingWalk) -> FailingWalk:
        raise KeyboardInterrupt

    monkeypatch.setattr(Shrinker, "shrink", interrupted)
    found = explored(SECOND_SESSION, tmp_path, 400)
    (case,) = found.cases
    assert (case.verdict, found.problems) == ("FAIL", ["interrupted"])
    replays(found, tmp_path, SECOND_SESSION)


def test_limits_that_no_graph_has_are_a_problem(tmp_path: Path) -> None:
    found = explored('kit.HELLO["fixed"] = {"max_rounds": 7}\n', tmp_path, 5)
    assert found.walks == 0 and found.exit_code == 3
    assert found.problems == ["no graph has the fixed limits of the implementation"]


def test_what_was_found_survives_an_interruption(tmp_path: Path) -> None:
    def more(number: int) -> bool:
        if number == 12:
            raise KeyboardInterrupt
        return True

    stops_badly = "import atexit\natexit.register(os._exit, 1)\n"  # nobody is to look at that
    command, notify = station(stops_badly), lambda text: None
    found = explore.explore(
        command, tmp_path, limit_s=LIMIT_S, seed=1, enough=1, notify=notify, more=more
    )
    assert found.problems == ["interrupted"] and found.coverage


def test_the_command_line(tmp_path: Path) -> None:
    from typer.testing import CliRunner

    from automcm_cli.main import app

    command = ["--", *station(SECOND_SESSION)]
    out = ["--out", str(tmp_path)]
    result = CliRunner().invoke(app, ["conform", "explore", "60", "--enough", "1", *out, *command])
    assert result.exit_code == 1
    assert "ACT-3" in result.output and "automcm conform replay" in result.output
    report = json.loads((tmp_path / "exploration.json").read_text())
    assert report["format"] == EXPLORED and len(report["cases"]) == 1
    missing = CliRunner().invoke(app, ["conform", "explore", "1", *out, "--", "no-such-thing"])
    assert missing.exit_code == 3
    no_command = CliRunner().invoke(app, ["conform", "explore", "1", *out])
    assert no_command.exit_code == 2
