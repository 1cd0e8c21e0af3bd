"""The reference passes every scenario, and each catches a station that breaks one thing."""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

from automcm_conformance.adapter.protocol import HelloAnswer
from automcm_conformance.exchange.transcript import answerable, finding
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
from automcm_conformance.scenarios.scenario_runner import Application, Outcome, Play, When, hazard
from automcm_conformance.suite import purposes
from automcm_spec.vocabulary.rules import RULES, line
from automcm_traces.checker.finding import NOTHING_WRONG
from automcm_traces.checker.track import INITIAL, Track
from automcm_traces.explain.explain import explain_files

COMMAND = [sys.executable, "-m", "automcm_cli", "adapter"]
HELLO = HelloAnswer(
    protocol=1,
    name="automcm reference",
    version="0",
    issues="none",
    features=["prescriber", "receiver", "restart", "durations", "cam"],
    scenarios=["lane_change"],
    fixed={},
)
FRAME = """
import sys
from automcm.adapters import adapter_lines as kit
from automcm.core import rules
from automcm.core.negotiating import foreign
from automcm.core.outcome import Outcome, Row, always, ignore, leave
from automcm.core.rules import RULES, gives_up
from automcm_spec.vocabulary.application import Fallback
from automcm.core.state import State
from automcm.core.station import Station

rules.require = lambda *arrow: None
edit = lambda kit, command, answer: answer

class Broken(kit.Kit):
    def answer(self, command):
        return edit(self, command, super().answer(command))

def first(key, rule, when, then=ignore):
    RULES[key] = (Row(rule, when, then), *RULES[key])

def without(key, rule):
    RULES[key] = tuple(row for row in RULES[key] if row.rule != rule)

%s

kit.Kit = Broken
for answer in kit.serve(sys.stdin.buffer):
    sys.stdout.buffer.write(answer)
    sys.stdout.flush()
"""


def broken(code: str) -> list[str]:
    """The reference with something changed."""
    return [sys.executable, "-c", FRAME % code]


REFERENCE = broken("")
"""With nothing changed; it starts faster than the command does."""


def run(
    name: str, command: list[str], folder: Path, hello: HelloAnswer = HELLO, **more: Any
) -> Outcome:
    more = {"limit_s": 10.0, "seed": 1} | more
    return scenario_cases.run(name, command, hello, folder, **more)


def test_the_suite_has_these_cases() -> None:
    cases = {p.case for p in purposes.load() if p.case.startswith("scenario ")}
    assert cases == set(NAMES)


@pytest.mark.sweep(8)
@pytest.mark.parametrize("name", NAMES)
def test_the_reference_passes(name: str, tmp_path: Path) -> None:
    outcome = run(name, REFERENCE, tmp_path)
    assert (outcome.verdict, outcome.reason, outcome.finding) == ("PASS", "", NOTHING_WRONG)
    logs = [tmp_path / log for log in outcome.log]
    plays = sum(play.seeds for play in NAMES[name])
    folders = {log.parent for log in logs}
    assert len(folders) == plays
    for folder in folders:
        verdicts = explain_files([log for log in logs if log.parent == folder])
        assert {v.verdict for v in verdicts} == {"allowed"}


def test_the_command_passes(tmp_path: Path) -> None:
    assert run("scenario all arrives", COMMAND, tmp_path).verdict == "PASS"


@dataclass(frozen=True)
class Mutant:
    scenario: str
    rule: str
    code: str


MUTANTS = {
    "marks only from ACTUATING on": Mutant(
        "all arrives",
        "ACT-5",
        """
def edit(kit, command, answer):
    for cam in answer.get("cams", []):
        cam["marks"] = cam["marks"] if answer["phase"] == "ACTUATING" else []
    return answer
""",
    ),
    "sends no CAM": Mutant(
        "all arrives",
        "ACT-2",
        """
def edit(kit, command, answer):
    answer.pop("cams", None)
    return answer
""",
    ),
    "an Acceptance is sent once": Mutant(
        "one in five lost", "REL-1", "first('expire resend', 'REL-1', gives_up('Acceptance'))"
    ),
    "the Fin is sent once": Mutant(
        "each lost once", "REL-1", "first('expire resend', 'REL-1', gives_up('Fin'))"
    ),
    "a copy of a Prescription is out of turn": Mutant(
        "each twice",
        "NEG-1",
        "rows = RULES['receive Prescription']; RULES['receive Prescription'] = rows[:4] + rows[5:]",
    ),
    "an Acceptance before the Ack is lost on it": Mutant(
        "reordered",
        "NEG-7",
        "first('receive Acceptance', 'NEG-6', lambda me, st, i: st.phase == 'PRESCRIBING')",
    ),
    "a commitment ends with its Acceptance": Mutant(
        "all Acks lost",
        "NEG-9",
        """
first("expire giveup", "NEG-9", gives_up("Acceptance"), lambda me, st, i: Outcome(leave(st)))
""",
    ),
    "it goes on by its lease alone": Mutant(
        "CAMs cut",
        "ACT-2",
        """
def edit(kit, command, answer):
    if command["cmd"] == "reset":
        kit.answer({"cmd": "durations", "durations": {"cam": 50_000}})
    return answer
""",
    ),
    "CAM loss sends no Cancel": Mutant(
        "CAMs cut one way",
        "ACT-2",
        """
then = lambda me, st, i: Outcome(leave(st), told=Fallback(session=st.session, reason="cam_loss"))
first("expire cam", "ACT-2", always, then)
""",
    ),
    "busy is not refused": Mutant(
        "two prescribers", "NEG-4", "first('receive Prescription', 'NEG-4', foreign)"
    ),
    "one station in two sessions": Mutant(
        "two prescribers",
        "ADV-4",
        """
class Broken:  # a station for the sessions of each prescriber, and all that they say is true
    def __init__(self):
        self.all = {1001: kit_(), 1002: kit_()}
    def answer(self, command):
        self.me = command.get("station") or getattr(self, "me", 0)
        default = [self.me if command["cmd"] == "command" else 0]
        session = command.get("message", command.get("command", {})).get("session", default)[0]
        if session in self.all:
            now = {"cmd": "advance", "now": command["now"]}
            each = [k.answer(command if p == session else now) for p, k in self.all.items()]
        else:
            each = [k.answer(command) for k in self.all.values()]
        if command["cmd"] == "hello":
            return each[0]
        deadlines = [a["deadline"] for a in each if a["deadline"] is not None]
        cams = each[0].get("cams", [])
        for cam, other in zip(cams, each[1].get("cams", [])):
            cam["marks"] = sorted(cam["marks"] + other["marks"])
        return {
            "messages": each[0]["messages"] + each[1]["messages"],
            "indications": each[0]["indications"] + each[1]["indications"],
            "deadline": min(deadlines, default=None),
            "cams": cams,
        }
kit_ = kit.Kit
""",
    ),
    "old numbers after a restart": Mutant(
        "prescriber restarts",
        "ADV-1",
        """
from automcm.core.state import Timer
again = Timer("quarantine"),
RULES["restart"] = Row("END-8", always, lambda *_: Outcome(State(quarantine=True), again=again)),
""",
    ),
    "a Cancel is ignored in ACTUATING": Mutant(
        "receiver aborts",
        "END-2",
        "first('receive Cancel', 'END-3', lambda me, st, i: st.phase == 'ACTUATING')",
    ),
    "it is free as soon as it has broken off": Mutant(
        "receiver aborts",
        "END-8",
        """
abort = RULES["command abort"][2].then
def free(me, st, i):
    left = abort(me, st, i)
    return left._replace(state=left.state._replace(quarantine=False))
first("command abort", "END-1", lambda me, st, i: st.bound, free)
""",
    ),
    "only one is released": Mutant(
        "three receivers",
        "PRE-2",
        """
def edit(kit, command, answer):
    if "messages" in answer:
        answer["messages"] = [
            m for m in answer["messages"] if (m["type"], m.get("dst")) != ("Cancel", 4004)
        ]
    return answer
""",
    ),
    "an old Acceptance counts": Mutant(
        "refused twice",
        "NEG-6",
        """
rows = RULES["receive Acceptance"]
old = Row("NEG-6", lambda me, st, i: not st.awaits_answer, rows[5].then)
RULES["receive Acceptance"] = (*rows[:5], old, *rows[6:])
""",
    ),
    "the commitment ends by Fin only": Mutant(
        "Fin lost",
        "ACT-4",
        """
duration = Station._duration
def lasts(self, timer, now):
    return 10**8 if timer.name == "lease" else duration(self, timer, now)
Station._duration = lasts
""",
    ),
    "a late copy opens the session again": Mutant(
        "late copies", "ADV-8", "without('receive Advertisement', 'ADV-8')"
    ),
}


@pytest.mark.sweep(9)
@pytest.mark.parametrize("name", MUTANTS)
def test_a_broken_station_fails(name: str, tmp_path: Path) -> None:
    mutant = MUTANTS[name]
    outcome = run(f"scenario {mutant.scenario}", broken(mutant.code), tmp_path)
    found = outcome.finding
    assert (outcome.verdict, found.rule) == ("FAIL", mutant.rule), outcome
    assert found.rule in RULES and int(found.at.file) in (P, Q, R, 3003, 4004)
    assert found.observed and answerable(found) and outcome.came
    assert outcome.lines and outcome.log
    assert outcome.input is None or line(found.rule, outcome.input) > 0


def test_each_scenario_is_seen_to_fail() -> None:
    assert {f"scenario {mutant.scenario}" for mutant in MUTANTS.values()} == set(NAMES)


def test_a_crash_on_the_way_is_an_error(tmp_path: Path) -> None:
    crash = """
def edit(kit, command, answer):
    if command["cmd"] == "receive" and command["message"]["type"] == "Prescription":
        raise SystemExit("no idea what to do")
    return answer
"""
    outcome = run("scenario all arrives", broken(crash), tmp_path)
    assert (outcome.verdict, outcome.finding) == ("ERROR", NOTHING_WRONG)
    assert "2002: it ended after 0 of 1 answers" in outcome.reason
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
    assert outcome.verdict == "SKIP" and "max_participants 1 would lead elsewhere" in outcome.reason
    verdicts = explain_files([tmp_path / log for log in outcome.log])
    assert {v.verdict for v in verdicts} == {"allowed"}


def crowd(stations: int) -> Play:
    """A prescriber that takes the highest of all others, in two sessions."""
    others = range(2001, 2000 + stations)
    again = When("STANDALONE", 3_000, "request", times=1)
    prescriber = Application((REQUEST, COMPLETE, again), target=others[-1])
    story = dict.fromkeys(others[:-1], ("fallback not_selected",) * 2)
    return Play(
        {P: prescriber} | dict.fromkeys(others, RECEIVER),
        story=story | {P: DONE[P] * 2, others[-1]: DONE[R] * 2},
    )


DEAF = """
first('receive Cancel', 'END-2', lambda me, st, i: (me.station_id, st.phase) == (%d, 'WAITING'))
"""
"""One station does not hear that it was not chosen."""


@pytest.mark.slow
@pytest.mark.parametrize("stations", [5, 12])
def test_any_number_of_stations_is_played_and_judged(
    stations: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(NAMES, "scenario crowd", (crowd(stations),))
    outcome = run("scenario crowd", REFERENCE, tmp_path)
    assert (outcome.verdict, outcome.reason) == ("PASS", "")
    assert len(outcome.log) == stations
    wrong = broken(DEAF % (2000 + stations - 2))
    outcome = run("scenario crowd", wrong, tmp_path)
    assert (outcome.verdict, outcome.finding.rule) == ("FAIL", "END-2")
    assert outcome.finding.at.file == str(2000 + stations - 2)


def test_a_scenario_that_fixed_parameters_lead_elsewhere_is_skipped(tmp_path: Path) -> None:
    hello = HELLO.model_copy(update={"fixed": {"max_rounds": 1}})
    outcome = run("scenario refused twice", REFERENCE, tmp_path, hello)
    assert outcome.verdict == "SKIP" and "max_rounds 1" in outcome.reason
    assert (
        "every step is allowed, but 1001 was told choose, fallback no_agreement" in outcome.reason
    )
    assert len(outcome.log) == 2


def test_one_play_of_two_is_left_out(tmp_path: Path) -> None:
    hello = HELLO.model_copy(update={"fixed": {"t_timeout": 0}})
    outcome = run("scenario Fin lost", REFERENCE, tmp_path, hello)
    assert outcome.verdict == "PASS" and "left out, 1 of 2 plays: t_timeout 0" in outcome.reason


def test_what_stands_beside_the_fields_of_an_indication_is_not_looked_at(tmp_path: Path) -> None:
    more = """
def edit(kit, command, answer):
    for told in answer.get("indications", []):
        told |= {"detail": None, "gaps": [None, 2**70]}
    return answer
"""
    assert run("scenario all arrives", broken(more), tmp_path).verdict == "PASS"


def test_a_session_without_end(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for_ever = Application(BOTH[P].whens[:1], lease_ms=10**6)
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


def acting(me: int, role: str, proposal: int = 2, phase: str = "ACTUATING") -> Track:
    state = INITIAL._replace(phase=phase, role=role, session=(P, 1), proposal=proposal)
    return Track(me, state=state._replace(target=R if role == "prescriber" else 0))


def seen(*given: Any) -> str:
    found = hazard(*given)
    return "" if found is None else finding(found)


def test_hazards() -> None:
    tracks, nobody = {P: acting(P, "prescriber")}, {P: set[Any](), R: set[Any]()}
    assert seen({**tracks, R: acting(R, "receiver")}, nobody) == ""
    assert seen({**tracks, R: acting(R, "receiver", 1)}, nobody).startswith("S-5: 1001 acts")
    left = {**tracks, R: acting(R, "receiver", 1, "STANDALONE")}
    assert seen(left, nobody).startswith("S-5: 1001 acts")
    assert seen(left, {P: set(), R: {(P, 1)}}) == ""
    tracks = {P: acting(P, "prescriber", phase="STANDALONE"), R: acting(R, "receiver")}
    third = acting(3003, "receiver")
    assert seen({**tracks, 3003: third}, {**nobody, 3003: set()}).startswith("S-4: 2002 and 3003")


def test_two_that_act_on_one_word_are_a_hazard() -> None:
    excused = {P: set[Any](), Q: set[Any](), R: {(P, 1), (Q, 1)}}
    one = acting(P, "prescriber")
    for other in (R, 3003):
        theirs = one.state._replace(session=(Q, 1), target=other)
        both = {P: one, Q: Track(Q, state=theirs), R: acting(R, "receiver", 1, "STANDALONE")}
        found = seen(both, {**excused, 3003: {(Q, 1)}})
        assert found == ("S-8: 1001 and 1002 act, both on what 2002 has agreed to" * (other == R))
    own = {P: one, R: Track(R, state=one.state._replace(session=(R, 1), target=3003))}
    assert seen(own, {**excused, 3003: {(R, 1)}}).startswith("S-8: 1001 and 2002 act, both on")
