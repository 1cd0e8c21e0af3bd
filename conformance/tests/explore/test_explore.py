"""Exploration: its findings, how far it shortens them, and its repeatability."""

from __future__ import annotations

import json
from functools import cache
from pathlib import Path
from typing import NamedTuple

import pytest
from cli_stage import automcm
from wrong_station import station

from automcm_conformance.adapter.adapter import Adapter
from automcm_conformance.exchange import records, results
from automcm_conformance.exchange.exchange import Mismatch
from automcm_conformance.explore import explore
from automcm_conformance.explore.walk_shrinking import FailingWalk, Shrinker
from automcm_spec.graph.oracle import Oracle
from automcm_spec.graph.oracle import load as read

LIMIT_S = 20.0
WHEN = """
def answer(command):
    out = right(command)
    if {when}:
        {change}
    return out
"""
SILENT = 'out["messages"] = []'
FIN = 'received(command, "Fin")'
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
COUNTS = """
count = 0
def answer(command):
    global count
    out = right(command)
    count += {counted}
    if {when} and received(command, "Fin"):
        out["messages"] = []
    return out
"""


class Wrong(NamedTuple):
    """A station, for how many walks it is explored, and what is found."""

    code: str
    walks: int
    verdict: str
    says: str
    """The rule, or the beginning of the reason."""
    acts: int
    """So many at the most are left of the walk."""
    limit_s: float = LIMIT_S


WRONG = {
    # Join, be told that it is over, join again, be told again.
    "the second session": Wrong(SECOND_SESSION, 400, "FAIL", "ACT-3", 5),
    "a seq after a restart": Wrong(
        AFTER_RESTART.format(change='message["seq"] += message["type"] == "Advertisement"'),
        *(60, "FAIL", "ADV-1", 3),
    ),
    "a number used again": Wrong(
        AFTER_RESTART.format(change='message["session"][1] *= message["type"] != "Advertisement"'),
        *(60, "FAIL", "ADV-1", 3),
    ),
    "a lease a millisecond late": Wrong(
        "def answer(command):\n    if received(command, 'Prescription'):\n"
        "        command['message']['lease_ms'] += 1\n    return right(command)",
        *(100, "FAIL", "deadline", 20),
    ),
    "one Fin of all is not acked": Wrong(
        COUNTS.format(counted=FIN, when="count == 9"), 200, "ERROR", results.NONDETERMINISTIC, 999
    ),
    "after some resets no Fin is acked": Wrong(
        COUNTS.format(counted='command["cmd"] == "reset"', when="count > 7"),
        *(60, "ERROR", results.KEPT, 999),
    ),
    "crashes": Wrong(
        WHEN.format(
            when='command["cmd"] == "restart" and state().number', change="sys.exit('out of luck')"
        ),
        *(200, "ERROR", "out of luck", 3),
    ),
    "hangs": Wrong(
        WHEN.format(when='command["cmd"] == "restart"', change="time.sleep(60)"),
        *(60, "ERROR", "", 99, 4.0),
    ),
    "ends on reset": Wrong(
        WHEN.format(when='command["cmd"] == "reset"', change="os._exit(3)"), 3, "ERROR", "", 0
    ),
    "refuses reset": Wrong(
        WHEN.format(when='command["cmd"] == "reset"', change='out = {"error": "no"}'),
        *(3, "ERROR", "", 0),
    ),
    "a line too many": Wrong(
        WHEN.format(when=FIN, change='return 2 * (json.dumps(out).encode() + b"\\n")'),
        *(30, "ERROR", "", 99, 4.0),
    ),
    "a line too few": Wrong(WHEN.format(when=FIN, change='return b""'), 30, "ERROR", "", 99, 4.0),
}


@cache
def load(path: Path, spec_hash: str | None = None) -> Oracle:
    """A graph, read once for all tests."""
    return read(path, spec_hash)


@pytest.fixture(autouse=True)
def read_once(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(explore, "load", load)


def explored(
    code: str, folder: Path, walks: int, *, seed: int = 1, enough: int = 1, limit_s: float = LIMIT_S
) -> results.Exploration:
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


def replays(found: results.Exploration, folder: Path, code: str) -> None:
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
@pytest.mark.parametrize("how", WRONG)
def test_what_is_wrong_is_found_shortened_and_kept(how: str, tmp_path: Path) -> None:
    wrong = WRONG[how]
    found = explored(wrong.code, tmp_path, wrong.walks, limit_s=wrong.limit_s)
    (case,) = found.cases
    assert (case.verdict, found.exit_code) == (wrong.verdict, 1 if wrong.verdict == "FAIL" else 3)
    assert case.rules == [each.rule for each in case.failures if each.rule]
    told = [*case.rules, case.reason, *(line for each in case.failures for line in each.came)]
    assert any(wrong.says in text for text in told), told
    assert found.acts[case.id] <= wrong.acts and found.problems == []
    assert case.reason.startswith(tuple(results.UNCONFIRMED)) == (wrong.says in results.UNCONFIRMED)
    if wrong.says in results.UNCONFIRMED or wrong.verdict == "FAIL":
        assert (tmp_path / case.log).stat().st_size > 0
    if wrong.verdict == "FAIL":
        replays(found, tmp_path, wrong.code)


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
    assert found.problems == ["interrupted"] and found.coverage and found.exit_code == 130


def test_the_command_line(tmp_path: Path) -> None:
    command = ["--", *station(SECOND_SESSION)]
    out = ["--out", tmp_path]
    result = automcm("conform", "explore", "60", "--enough", "1", *out, *command)
    assert result.exit_code == 1
    assert "ACT-3" in result.output and "automcm conform replay" in result.output
    report = json.loads((tmp_path / "exploration.json").read_text())
    assert report["format"] == results.EXPLORED and len(report["cases"]) == 1
    none = tmp_path / "none"
    assert automcm("conform", "explore", "1", "--out", none, "--", "no-such-thing").exit_code == 3
    assert not none.exists()
    assert automcm("conform", "explore", "1", *out).exit_code == 2
