"""The system properties on merged logs: each seen broken by a message that nobody sent, by an
edited log, or by a counterexample of the specification."""

from __future__ import annotations

import json
from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from merged_runs import Run, plain, records, rewritten

from automcm_simulation.road.simulation import Simulation
from automcm_simulation.road.straight_lane import Straight
from automcm_spec.log_format.reader import Log, read
from automcm_spec.vocabulary import messages
from automcm_spec.vocabulary.application import Abort
from automcm_spec.vocabulary.parameters import DEFAULTS, Parameters, derived
from automcm_traces.system import duration_properties
from automcm_traces.system.log_merge import merge
from automcm_traces.system.properties import NAMES, SystemReport, judge
from automcm_traces.system.world import World

TIMES = DEFAULTS | derived(DEFAULTS)
GIVEUP, DECIDE = TIMES["t_giveup"], TIMES["t_decide"]

TRAJECTORY = Straight().trajectory()


def broken(report: SystemReport) -> set[str]:
    return {j.property for j in report.properties if j.outcome == "violated"}


def judged(report: SystemReport, name: str) -> str:
    return "\n".join(j.text() for j in report.properties if j.property == name)


def heard(run: Run, station: int, message: messages.Message, at: int) -> None:
    """A station receives, at a time, what nobody has sent."""
    service = run.simulation.services[station]
    run.simulation.clock.at(at, lambda: service.receive(messages.encode(message)) and None)


def prescription(dst: int, proposal: int, lease_ms: int = 20_000) -> messages.Prescription:
    return messages.Prescription(
        src=1,
        dst=dst,
        session=(1, 1),
        seq=9,
        proposal=proposal,
        prescribed=TRAJECTORY,
        hold_ms=0,
        lease_ms=lease_ms,
    )


def acceptance() -> messages.Acceptance:
    return messages.Acceptance(
        src=2, dst=1, session=(1, 1), seq=9, proposal=1, accepted=True, selected=TRAJECTORY
    )


def deaf(src: int, dst: int, m: Any, now: int) -> bool:
    """The Prescription does not arrive."""
    return m.type == "Prescription"


def test_every_property_of_section_7_that_a_log_can_tell_is_judged(tmp_path: Path) -> None:
    report = judge(plain(tmp_path))
    assert [j.property for j in report.properties] == list(NAMES)
    assert json.loads(json.dumps(report.as_dict()))["verdict"] == "allowed"


def test_s_3_an_acceptance_that_the_target_never_sent(tmp_path: Path) -> None:
    """The target never saw the Prescription: no one is committed while the prescriber acts."""
    run = Run(tmp_path, drop=deaf)
    heard(run, 1, acceptance(), at=3000)
    report = judge(run.logs())
    assert broken(report) == {"S-3"} and report.verdict == "violated"
    assert "never sent" in judged(report, "S-3") and "FORGED Acceptance" in report.text()
    (hazard,) = report.hazards
    assert hazard.excused and hazard.begun_by.startswith("Acceptance from 2, at ")
    assert hazard.length is not None and hazard.outcome == "cannot_tell"
    assert hazard.length.low == hazard.length.high == run.left(1) - 3000
    assert (
        "no message is forged" in hazard.why
        and "WITHOUT EXCUSE" not in report.text()
        and "never committed" in hazard.fault
    )


def test_s_3_where_the_target_s_log_stops_it_cannot_be_told(tmp_path: Path) -> None:
    run = Run(tmp_path, drop=deaf)
    heard(run, 1, acceptance(), at=3000)
    one, _, three = run.logs()
    lines = records(tmp_path / "2.ndjson")
    stopped = rewritten(tmp_path / "2.ndjson", lines[:-1])
    report = judge([one, stopped, three])
    assert "S-3" not in broken(report) and "cannot tell" in judged(report, "S-3")


def test_s_4_two_receivers_act_in_one_session(tmp_path: Path) -> None:
    run = Run(tmp_path, drop=lambda src, dst, m, now: dst == 3 and m.type == "Cancel")
    heard(run, 3, prescription(3, proposal=2), at=3000)
    report = judge(run.logs())
    assert "S-4" in broken(report)
    assert "acts in 1/1 with proposal 1" in judged(report, "S-4")


def test_s_4_one_after_the_other_is_no_breach(tmp_path: Path) -> None:
    """The same, but the bystander accepts when the others have left."""
    run = Run(tmp_path, drop=lambda src, dst, m, now: dst == 3 and m.type == "Cancel")
    heard(run, 3, prescription(3, proposal=2), at=7000)
    report = judge(run.logs(until=9000))
    assert "S-4 " not in report.text().replace("S-4,", "") and "S-4" not in broken(report)
    assert run.left(1) < 7000 < run.left(3)


def test_s_6_an_ack_of_what_was_never_received(tmp_path: Path) -> None:
    run = Run(tmp_path, drop=deaf)
    ack = messages.Ack(
        src=2, dst=1, session=(1, 1), seq=0, of=messages.MessageId(type="Prescription", seq=2)
    )
    heard(run, 1, ack, at=2900)
    report = judge(run.logs())
    assert broken(report) == {"S-6"} and "Prescription seq=2" in judged(report, "S-6")
    assert "was never received" in judged(report, "S-6")


def test_t_4_the_target_took_a_shorter_lease(tmp_path: Path) -> None:
    """What it took is not what was sent: its lease ends first, and the forgery is the excuse."""
    run = Run(tmp_path, drop=deaf, maneuver_ms=6000)
    heard(run, 2, prescription(2, proposal=1, lease_ms=2000), at=2800)
    report = judge(run.logs())
    assert broken(report) == {"T-4"} and report.verdict == "violated"
    (hazard,) = report.hazards
    assert hazard.excused and "expire lease" in hazard.fault
    assert hazard.begun_by.startswith("Prescription from 1, at ")
    assert hazard.length is not None and hazard.length.best == run.hazard()


def test_what_messages_order_needs_no_clock(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The first session of the prescriber is over before the second of its target begins."""
    run = Run(tmp_path, maneuver_ms=1000)
    run.simulation.request(1, at=7000)
    world = World(merge(run.logs(until=14_000)))
    monkeypatch.setattr(world, "elapsed", lambda *_: None)
    first, second = world.timelines[1].periods("ACTUATING", "prescriber")
    one, two = world.timelines[2].periods("ACTUATING", "receiver")
    assert world.apart(first, two) is True and world.apart(second, one) is True
    assert world.apart(first, one) is not True


def lines_of(world: World, station: int) -> list[Any]:
    return world.timelines[station].moments


def outcome(findings: Iterable[duration_properties.Checked]) -> set[bool | None]:
    return {holds for holds, _ in findings}


def test_t_1_a_session_that_lasts_too_long(tmp_path: Path) -> None:
    world = World(merge(plain(tmp_path)))
    assert outcome(duration_properties.durations(world)) == {True}
    moments = lines_of(world, 2)
    over = next(n for n, m in enumerate(moments) if n and not m.session and moments[n - 1].session)
    begun = next(m for m in moments if m.session)
    bound = GIVEUP + 3 * (TIMES["t_hold"] + DECIDE) + 20_000
    moments[over] = replace(moments[over], t_ms=begun.t_ms + bound)
    assert outcome(duration_properties.durations(world)) == {True}
    moments[over] = replace(moments[over], t_ms=begun.t_ms + bound + 1)
    assert outcome(duration_properties.durations(world)) == {True, False}
    moments[over] = replace(moments[over], late_ms=1)  # a timer was late by as much
    assert outcome(duration_properties.durations(world)) == {True}
    moments[over] = replace(moments[over], late_ms=0)
    prescriber = lines_of(world, 1)
    begun = next(m for m in prescriber if m.session)
    over = next(n for n, m in enumerate(prescriber) if m.at > begun.at and not m.session)
    bound = GIVEUP + DECIDE + 2 * (2 * GIVEUP + DECIDE + DECIDE) + 20_000
    prescriber[over] = replace(prescriber[over], t_ms=begun.t_ms + bound + 1)
    assert sum(1 for holds, _ in duration_properties.durations(world) if holds is False) == 2


def test_t_3_a_message_sent_too_often(tmp_path: Path) -> None:
    """Twenty-one times are allowed; with a header that allows twenty it is one too many."""
    Run(tmp_path, drop=lambda src, dst, m, now: m.type == "Ack").logs()
    path = tmp_path / "2.ndjson"
    assert outcome(duration_properties.sendings(read(path))) == {True}
    lines = records(path)
    lines[0]["parameters"]["t_giveup"] = 2000
    found = [
        text for holds, text in duration_properties.sendings(rewritten(path, lines)) if not holds
    ]
    assert found and "sent 21 times of 20" in found[0]
    del lines[0]["parameters"]["t_giveup"]
    assert outcome(duration_properties.sendings(rewritten(path, lines))) == {None}


def test_t_3_copies_sent_as_answers_do_not_count(tmp_path: Path) -> None:
    """The prescriber sends its Fin again for every copy of an Acceptance too (NEG-6)."""
    run = Run(tmp_path, drop=lambda src, dst, m, now: m.type in ("Ack", "Fin"), maneuver_ms=500)
    report = judge(run.logs())
    fins = [r for r in records(tmp_path / "1.ndjson") if r.get("ev") == "send"]
    assert sum(r["message"]["type"] == "Fin" for r in fins) > 21
    assert "T-3" not in broken(report)


def forgetting(tmp_path: Path) -> World:
    return World(merge(Run(tmp_path, maneuver_ms=500).logs(until=20_000)))


def test_t_5_a_session_forgotten_while_it_is_advertised(tmp_path: Path) -> None:
    world = forgetting(tmp_path)
    assert outcome(duration_properties.orders(world)) == {True}
    moments = lines_of(world, 2)
    at = next(n for n, m in enumerate(moments) if m.cause == "expire forget")
    kept = moments[at]
    moments[at] = replace(kept, t_ms=1500)  # the window is open from 500 to 2600
    assert False in outcome(duration_properties.orders(world))
    moments[at] = replace(kept, left=True)  # a Cancel to it is still being sent
    assert False in outcome(duration_properties.orders(world))


def test_adv_8_unequal_parameters_make_a_station_join_a_session_twice(tmp_path: Path) -> None:
    """It forgets after its own t_advertise + t_life, while the prescriber still advertises."""
    simulation = Simulation(logs=tmp_path)
    simulation.add(1, Straight(target=2), Parameters(t_timeout=8000))
    simulation.add(2, Straight(), Parameters(t_timeout=500))
    simulation.request(1, at=500)
    simulation.run(until=12_000)
    report = judge([read(tmp_path / f"{n}.ndjson") for n in (1, 2)])
    assert "T-5" in broken(report) and "still advertises 1/1" in judged(report, "T-5")
    assert sum(text.startswith("1/1: station 2") for text in report.as_dict()["sessions"]) == 3
    for differs in ("t_advertise differs (", "t_giveup differs (8100 at 1, 600 at 2)"):
        assert any(differs in note for note in report.notices)


def test_several_sessions_are_told_apart(tmp_path: Path) -> None:
    run = Run(tmp_path, maneuver_ms=1000)
    run.simulation.request(1, at=7000)
    run.simulation.command(2, Abort(session=(1, 2)), at=9800)
    report = judge(run.logs(until=14_000))
    assert {text.split(":")[0] for text in report.as_dict()["sessions"]} == {"1/1", "1/2"}
    assert [h.session for h in report.hazards] in ([], [(1, 2)])


def test_logs_of_two_runs_are_one_clear_line(tmp_path: Path) -> None:
    logs = Run(tmp_path / "a", seed=1).logs() + Run(tmp_path / "b", seed=2).logs()
    report = judge(logs)
    assert report.verdict == "cannot_tell" and "must be of run 'seed-1'" in report.problem
    assert report.text().startswith("together: CANNOT TELL: ") and "\n" not in report.text()


@pytest.fixture(scope="module")
def short(tmp_path_factory: pytest.TempPathFactory) -> list[Log]:
    return Run(tmp_path_factory.mktemp("short")).logs(until=3500)


CHANGES: list[dict[str, Any]] = [
    {"session": "x"},
    {"session": []},
    {"session": [1]},
    {"session": [[1], {}]},
    {"src": [1]},
    {"src": "1"},
    {"dst": {}},
    {"dst": -1},
    {"dst": True},
    {"seq": "1"},
    {"seq": [1]},
    {"proposal": [1]},
    {"type": "Nothing"},
    {"marks": 1},
]


@pytest.mark.sweep(5)
@pytest.mark.parametrize("change", CHANGES, ids=str)
@pytest.mark.parametrize("ev", ["send", "receive"])
def test_whatever_a_message_holds_there_is_a_report(
    short: list[Log], tmp_path: Path, change: dict[str, Any], ev: str
) -> None:
    """One log is bad; what the others say is still there."""
    for named in (True, False):
        lines = records(Path(short[1].file))
        for record in [r for r in lines if r.get("ev") == ev][::3]:
            record["message"] |= change
        for record in lines:
            if not named and record.get("ev") == "receive":
                del record["tx"]
        report = judge([short[0], rewritten(tmp_path / "2.ndjson", lines), short[2]])
        assert report.text() and json.dumps(report.as_dict()) and not report.problem
        assert report.verdict != "allowed" and len(report.properties) == len(NAMES)


def test_logs_that_promise_nothing_are_not_judged(tmp_path: Path) -> None:
    plain(tmp_path)
    logs = []
    for n in (1, 2, 3):
        lines = records(tmp_path / f"{n}.ndjson")
        lines[0]["complete"] = []
        logs.append(rewritten(tmp_path / f"{n}.ndjson", lines))
    report = judge(logs)
    assert report.verdict == "cannot_tell" and "in its header lacks command" in report.text()
    assert {j.outcome for j in report.properties if j.property != "T-3"} == {"cannot_tell"}


def test_the_same_logs_give_the_same_bytes(tmp_path: Path) -> None:
    logs = Run(tmp_path, drop=deaf).logs()
    assert judge(logs).text() == judge(logs).text()
    assert judge(logs).text() == judge(logs[::-1]).text()
    assert Parameters()  # the reference is the writer
