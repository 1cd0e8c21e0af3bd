"""The reference passes every scenario, and each catches a station that breaks one thing."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import pytest
from broken_stations import BREAKS, REFERENCE, broken

from automcm_conformance.adapter.protocol import HelloAnswer
from automcm_conformance.exchange.transcript import answerable
from automcm_conformance.scenarios import scenario_cases
from automcm_conformance.scenarios.scenario_cases import (
    BOTH,
    COMPLETE,
    DONE,
    NAMES,
    RECEIVER,
    REQUEST,
    P,
    Q,
    R,
)
from automcm_conformance.scenarios.scenario_runner import (
    Play,
    PlayRun,
    ScenarioOutcome,
    ScriptedDriver,
    When,
)
from automcm_conformance.suite import purposes
from automcm_spec.vocabulary.rules import RULES, line
from automcm_traces.checker.finding import NOTHING_WRONG
from automcm_traces.explain.explain import verdicts_of

HELLO = HelloAnswer(
    protocol=1,
    name="automcm reference",
    version="0",
    issues="none",
    features=["prescriber", "receiver", "restart", "durations", "cam"],
    scenarios=["lane_change"],
    fixed={},
)
QUICK = "marks_only_from_actuating_on", "only_one_is_released"


def run(
    name: str, command: list[str], folder: Path, hello: HelloAnswer = HELLO, **more: Any
) -> ScenarioOutcome:
    more = {"limit_s": 10.0, "seed": 1} | more
    return scenario_cases.run(name, command, hello, folder, **more)


def test_the_suite_has_these_cases() -> None:
    cases = {p.case for p in purposes.load() if p.case.startswith("scenario ")}
    assert cases == set(NAMES)


@pytest.mark.sweep(1)
@pytest.mark.parametrize("name", NAMES)
def test_the_reference_passes(name: str, tmp_path: Path) -> None:
    outcome = run(name, REFERENCE, tmp_path)
    assert (outcome.verdict, outcome.reason, outcome.finding) == ("PASS", "", NOTHING_WRONG)
    logs = [tmp_path / log for log in outcome.log]
    plays = sum(play.seeds for play in NAMES[name])
    folders = {log.parent for log in logs}
    assert len(folders) == plays
    for folder in folders:
        verdicts = verdicts_of([log for log in logs if log.parent == folder])
        assert {v.verdict for v in verdicts} == {"allowed"}


@pytest.mark.parametrize(
    "name", [pytest.param(n, marks=[pytest.mark.slow] * (n not in QUICK)) for n in BREAKS]
)
def test_a_broken_station_fails(name: str, tmp_path: Path) -> None:
    scenario, rule = BREAKS[name].values()
    outcome = run(scenario, broken(name), tmp_path)
    found = outcome.finding
    assert (outcome.verdict, found.rule) == ("FAIL", rule), outcome
    assert found.rule in RULES and int(found.at.file) in (P, Q, R, 3003, 4004)
    assert found.observed and answerable(found) and outcome.came
    assert outcome.lines and outcome.log
    assert outcome.input is None or line(found.rule, outcome.input) > 0


def test_each_scenario_is_seen_to_fail() -> None:
    assert {notice["scenario"] for notice in BREAKS.values()} == set(NAMES)


def test_a_crash_on_the_way_is_an_error(tmp_path: Path) -> None:
    outcome = run("scenario all arrives", broken("crashes_on_a_prescription"), tmp_path)
    assert (outcome.verdict, outcome.finding) == ("ERROR", NOTHING_WRONG)
    assert "2002: the adapter exited after 0 of 1 answers" in outcome.reason
    assert outcome.came == ["no idea what to do"]
    assert "receive from 1001: Prescription" in outcome.lines[-1].text
    outcome = run("scenario all arrives", [sys.executable, "-c", "print('hi')"], tmp_path)
    assert (outcome.verdict, outcome.log) == ("ERROR", [])


def test_what_it_cannot_do_is_skipped(tmp_path: Path) -> None:
    def skipped(name: str, **change: Any) -> str:
        outcome = run(name, ["nothing is started"], tmp_path, HELLO.model_copy(update=change))
        assert outcome.verdict == "SKIP"
        return outcome.reason

    assert skipped("scenario all arrives", features=["prescriber"]) == "needs receiver, cam"
    features = ["prescriber", "receiver", "cam"]
    assert skipped("scenario prescriber restarts", features=features) == "needs restart"


@pytest.mark.slow
def test_limits_are_followed_and_lead_elsewhere(tmp_path: Path) -> None:
    """MEM-1: the only participant is not the target."""
    hello = HELLO.model_copy(update={"fixed": {"max_participants": 1}})
    outcome = run("scenario three receivers", REFERENCE, tmp_path, hello)
    assert outcome.verdict == "SKIP" and "not applicable with max_participants 1" in outcome.reason
    verdicts = verdicts_of([tmp_path / log for log in outcome.log])
    assert {v.verdict for v in verdicts} == {"allowed"}


def crowd(stations: int) -> Play:
    """A prescriber that takes the highest of all others, in two sessions."""
    others = range(2001, 2000 + stations)
    again = When("STANDALONE", 3_000, "request", times=1)
    prescriber = ScriptedDriver((REQUEST, COMPLETE, again), target=others[-1])
    expected = dict.fromkeys(others[:-1], ("fallback not_selected",) * 2)
    return Play(
        {P: prescriber} | dict.fromkeys(others, RECEIVER),
        expected=expected | {P: DONE[P] * 2, others[-1]: DONE[R] * 2},
    )


@pytest.mark.slow
@pytest.mark.parametrize("stations", [5, 12])
def test_any_number_of_stations_is_played_and_judged(
    stations: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(NAMES, "scenario crowd", (crowd(stations),))
    outcome = run("scenario crowd", REFERENCE, tmp_path)
    assert (outcome.verdict, outcome.reason) == ("PASS", "")
    assert len(outcome.log) == stations
    deaf = 2000 + stations - 2
    wrong = broken("one_does_not_hear_that_it_was_not_chosen", deaf)
    outcome = run("scenario crowd", wrong, tmp_path)
    assert (outcome.verdict, outcome.finding.rule) == ("FAIL", "END-2")
    assert outcome.finding.at.file == str(deaf)


def test_a_scenario_that_fixed_parameters_lead_elsewhere_is_skipped(tmp_path: Path) -> None:
    hello = HELLO.model_copy(update={"fixed": {"max_rounds": 1}})
    outcome = run("scenario refused twice", REFERENCE, tmp_path, hello)
    assert outcome.verdict == "SKIP" and "max_rounds 1" in outcome.reason
    assert "every step is allowed, but 1001 indicated choose, fallback no_ag" in outcome.reason
    assert len(outcome.log) == 2


def test_one_play_of_two_is_left_out(tmp_path: Path) -> None:
    hello = HELLO.model_copy(update={"fixed": {"t_timeout": 0}})
    outcome = run("scenario Fin lost", REFERENCE, tmp_path, hello)
    assert (
        outcome.verdict == "PASS"
        and "skipped 1 of 2 plays: not applicable with t_timeout 0" in outcome.reason
    )


def test_what_stands_beside_the_fields_of_an_indication_is_not_looked_at(tmp_path: Path) -> None:
    more = broken("says_more_than_an_indication_has")
    assert run("scenario all arrives", more, tmp_path).verdict == "PASS"


@pytest.mark.slow
def test_a_session_without_end(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for_ever = ScriptedDriver(BOTH[P].actions[:1], lease_ms=10**6)
    monkeypatch.setitem(NAMES, "scenario all arrives", (Play({**BOTH, P: for_ever}),))
    outcome = run("scenario all arrives", REFERENCE, tmp_path)
    assert (outcome.verdict, outcome.finding.property) == ("FAIL", "L-1")
    assert "1001 is still in ACTUATING" in outcome.finding.observed


@pytest.mark.slow
def test_the_same_seed_gives_the_same_bytes(tmp_path: Path) -> None:
    name = "scenario one in five lost"
    one, other = (run(name, REFERENCE, tmp_path / n) for n in ("one", "other"))
    assert one == other
    for log in one.log:
        assert (tmp_path / "one" / log).read_bytes() == (tmp_path / "other" / log).read_bytes()


def test_a_property_of_the_system_does_not_hold(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The radio makes an acceptance of a refusal; every step is allowed."""

    def send(play: PlayRun, station: int, tx: str, m: dict[str, Any]) -> None:
        if m["type"] == "Acceptance":
            m = {n: v for n, v in m.items() if n != "reason"} | {"accepted": True}
            m["selected"] = {"t0": 0, "points": [[0, 0, 0]]}
        right(play, station, tx, m)

    right = PlayRun._send
    monkeypatch.setattr(PlayRun, "_send", send)
    play = Play({P: BOTH[P], R: ScriptedDriver(joins=True, refuses=1)})
    monkeypatch.setitem(NAMES, "scenario all arrives", (play,))
    outcome = run("scenario all arrives", REFERENCE, tmp_path)
    assert (outcome.verdict, outcome.finding.property) == ("FAIL", "S-3")
    assert "scenarios/all-arrives/1-1/1001.ndjson" in outcome.finding.observed
    assert str(tmp_path) not in outcome.finding.observed
