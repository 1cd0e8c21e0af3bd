"""S-5 and T-2 on merged logs: each hazard's length against what the simulation did."""

from __future__ import annotations

import json
from pathlib import Path
from shutil import copytree
from typing import Any

import pytest
from merged_runs import Drop, Run, killed, later, plain, records, rewritten, without_tx

from automcm_spec.log_format.log import Send
from automcm_spec.log_format.reader import Log, read
from automcm_spec.vocabulary.application import Abort, Close
from automcm_spec.vocabulary.messages import Cam, Cancel, Fin, Message, encode
from automcm_traces.system.hazards import Hazard
from automcm_traces.system.hazards import hazard as hazard_of
from automcm_traces.system.log_clocks import Span
from automcm_traces.system.log_merge import merge
from automcm_traces.system.properties import SystemReport, judge
from automcm_traces.system.world import World

CUT = 4000
"""Between the acceptance and the Fin of every run, ms."""
D, L = 50, 1500


def only(report: SystemReport) -> Hazard:
    assert report.verdict == "hazard", report.text()
    assert all(j.outcome == "holds" for j in report.properties), report.text()
    (hazard,) = report.hazards
    assert hazard.excused and hazard.outcome == "within" and not hazard.open
    assert (hazard.prescriber, hazard.target, hazard.session) == (1, 2, (1, 1))
    return hazard


def measured(hazard: Hazard, run: Run) -> int:
    """The hazard's length, which is what really happened as far as the clocks tell."""
    assert hazard.length is not None
    length, truth = hazard.length, run.hazard()
    assert length.low <= truth <= length.high and length.best == truth, (str(length), truth)
    assert length.high - length.low <= 10 and not length.assumed
    assert (hazard.since_ms, hazard.until_ms) == (run.left(2), run.left(1))
    return truth


def property_of(report: SystemReport, name: str) -> str:
    return next(j.outcome for j in report.properties if j.property == name)


def logs_of(run: Run) -> list[Log]:
    return [read(run.folder / f"{station}.ndjson") for station in (1, 2, 3)]


@pytest.fixture(scope="module")
def usual(tmp_path_factory: pytest.TempPathFactory) -> Run:
    """A run without faults, with its logs."""
    run = Run(tmp_path_factory.mktemp("usual"))
    run.logs()
    return run


def test_a_run_without_faults_has_no_hazard(usual: Run) -> None:
    report = judge(logs_of(usual))
    assert report.verdict == "allowed" and not report.hazards
    assert {j.outcome for j in report.properties} == {"holds"}
    assert all(j.checked for j in report.properties if j.property not in ("T-2", "S-7", "S-8"))
    assert "ALLOWED" in report.text() and "told finished" in report.text()


def test_act_2_both_ways_cut_both_lose_the_cams(tmp_path: Path) -> None:
    """The hazard is at most the CAM interval and a delay; of seed 3 there is none."""
    for seed in (1, 3):
        run = Run(
            tmp_path / str(seed),
            seed=seed,
            drop=lambda src, dst, m, now: now >= CUT and {src, dst} == {1, 2},
            maneuver_ms=9000,
        )
        report = judge(run.logs())
        if run.hazard() <= 0:
            assert report.verdict == "allowed", report.text()
            continue
        hazard = only(report)
        assert measured(hazard, run) <= 100 + D
        assert "told fallback(cam_loss)" in hazard.ended and "loses the CAMs" in hazard.fault


def test_act_2_the_cancel_ends_the_hazard_where_the_way_back_is_whole(tmp_path: Path) -> None:
    run = Run(
        tmp_path,
        drop=lambda src, dst, m, now: now >= CUT and (src, dst) == (1, 2),
        maneuver_ms=9000,
    )
    hazard = only(judge(run.logs()))
    assert measured(hazard, run) <= D
    assert "receive Cancel" in hazard.ended and "station 2 loses the CAMs" in hazard.fault
    assert any("CAMs of 1 to 2 in the 1500 ms before: 0 arrived" in t for t in hazard.between)


def no_cancel(src: int, dst: int, m: Any, now: int) -> bool:
    return m.type == "Cancel" and (src, dst) == (2, 1)


def aborted(folder: Path, at: int = CUT, drop: Drop = no_cancel, **more: Any) -> Run:
    """A run in which the target aborts, and its Cancel is lost."""
    run = Run(folder, drop=drop, **({"maneuver_ms": 9000} | more))
    run.simulation.command(2, Abort(session=(1, 1)), at=at)
    return run


@pytest.fixture(scope="module")
def silent(tmp_path_factory: pytest.TempPathFactory) -> Run:
    """The target aborts, and no Cancel arrives."""
    run = aborted(tmp_path_factory.mktemp("silent"))
    run.logs()
    return run


def test_act_5_where_every_cancel_is_lost_the_marks_end_the_hazard(silent: Run) -> None:
    run = silent
    hazard = only(judge(logs_of(run)))
    assert L - 100 <= measured(hazard, run) <= D + L
    assert "station 2 aborts" in hazard.fault and "fallback(cam_loss)" in hazard.ended
    assert any("21 Cancels of 2 to 1 from then on: 0 arrived" in t for t in hazard.between)
    assert hazard.bound is not None and hazard.bound.ms == D + L


def test_end_8_a_restart_leaves_a_hazard_until_the_marks_are_missed(tmp_path: Path) -> None:
    run = Run(tmp_path, maneuver_ms=9000)
    run.simulation.restart(2, at=CUT)
    hazard = only(judge(run.logs()))
    assert L - 100 <= measured(hazard, run) <= D + L and "station 2 restarts" in hazard.fault


def test_act_4_a_short_lease_is_the_bound(tmp_path: Path) -> None:
    run = aborted(tmp_path, at=2800, lease_ms=1540)
    hazard = only(judge(run.logs()))
    assert hazard.bound is not None and hazard.bound.text == "lease = 1540: 1540 ms"
    assert measured(hazard, run) <= 1540


def test_a_target_may_be_gone_before_the_prescriber_acts(usual: Run, tmp_path: Path) -> None:
    """It aborts while its Acceptance is under way: the hazard begins where the prescriber acts."""

    entered = dict((phase, ms) for ms, phase in usual.phases[2])
    run = aborted(tmp_path, at=entered["ACTUATING"] + 1)
    (hazard,) = judge(run.logs()).hazards
    begin = dict((phase, ms) for ms, phase in run.phases[1])["ACTUATING"]
    assert run.left(2) + 2 < begin == hazard.since_ms and "before station 1 acts" in hazard.fault
    assert hazard.length is not None and hazard.excused and hazard.outcome == "within"
    assert hazard.length.low == hazard.length.high == run.left(1) - begin


def test_t_2_cannot_be_told_where_the_clocks_leave_the_bound_open(
    silent: Run, monkeypatch: pytest.MonkeyPatch
) -> None:
    world = World(merge(logs_of(silent)))
    elapsed = world.elapsed

    def vague(*args: int) -> Span | None:
        span = elapsed(*args)
        return span and Span(span.low - 200, span.high + 200, span.best)

    monkeypatch.setattr(world, "elapsed", vague)
    (acts,) = world.timelines[1].periods("ACTUATING", "prescriber")
    found = hazard_of(world, acts)
    assert found is not None and found.outcome == "cannot_tell" and "clocks" in found.why


def test_a_station_that_dies_leaves_a_log_that_stops(tmp_path: Path) -> None:
    run = Run(tmp_path, drop=lambda s, d, m, now: now >= CUT and 2 in (s, d), maneuver_ms=9000)
    one, _, three = run.logs()
    dead = killed(tmp_path / "2.ndjson", CUT)
    report = judge([one, dead, three])
    (hazard,) = report.hazards
    last = dead.events[-1][1].t_ms
    assert hazard.length is not None and hazard.length.best == run.left(1) - last
    assert hazard.excused and "station 2 dies" in hazard.fault and hazard.outcome == "within"
    assert "fallback(cam_loss)" in hazard.ended and report.verdict == "hazard"
    assert "ALLOWED, shows a hazard (fault)" in report.text() and "1550 ms: kept" in report.text()


def test_without_transmission_ids_the_hazard_is_the_same(silent: Run, tmp_path: Path) -> None:
    copytree(silent.folder, tmp_path, dirs_exist_ok=True)
    report = judge([without_tx(tmp_path / f"{n}.ndjson") for n in (1, 2, 3)])
    measured(only(report), silent)
    assert any("name no transmission" in notice for notice in report.notices)


@pytest.mark.parametrize("ahead", [7, 100_000])
def test_the_clocks_of_the_stations_need_not_agree(silent: Run, tmp_path: Path, ahead: int) -> None:
    one, _, three = logs_of(silent)
    two = read(later(silent.folder / "2.ndjson", ahead, tmp_path))
    report = judge([one, two, three])
    assert report.verdict == "hazard", report.text()
    (hazard,) = report.hazards
    assert hazard.length is not None and hazard.outcome == "within"
    assert hazard.length.low <= silent.hazard() <= hazard.length.high
    assert hazard.length.high - hazard.length.low <= 10


def cam_of_2(run: Run, at: int, generated: int = 0) -> None:
    """A CAM in the name of station 2 that still names the session."""
    where = dict.fromkeys(("x_mm", "y_mm", "heading_mrad", "speed_mm_s"), 0)
    cam = Cam(src=2, generation_ms=generated or at, marks=((1, 1),), **where)
    run.simulation.clock.at(at, lambda: run.simulation.services[1].receive(encode(cam)) and None)


def at_of(forged: str) -> str:
    """The place that a line of the report on a forged message begins with."""
    return forged.partition(": FORGED ")[0]


def test_t_2_a_forged_cam_makes_it_longer_than_the_bound(tmp_path: Path) -> None:
    run = aborted(tmp_path)
    cam_of_2(run, CUT + 1000)
    report = judge(run.logs())
    (hazard,) = report.hazards
    assert run.hazard() == 1000 + L and hazard.excused and not hazard.begun_by
    assert hazard.outcome == "cannot_tell" and "no message is forged" in hazard.why
    assert property_of(report, "T-2") == "cannot_tell" and property_of(report, "S-5") == "holds"
    (forged,) = report.forged
    assert hazard.prolonged_by == f"CAM from 2, at {at_of(forged)}"
    assert report.verdict == "violated" and "prolonged by forged CAM from 2" in report.text()


def test_act_5_an_old_cam_does_not_count(tmp_path: Path) -> None:
    run = aborted(tmp_path)
    cam_of_2(run, CUT + 1000, 1)
    run.simulation.command(1, Close(session=(1, 1)), at=CUT + 900)  # is refused
    (hazard,) = judge(run.logs()).hazards
    line = int(hazard.between[-1].rpartition(":")[2])
    assert dict(run.logs()[0].events)[line].t_ms < CUT + 200


def test_t_2_a_forged_cam_that_changes_nothing_is_not_named(tmp_path: Path) -> None:
    """The Cancel ends the hazard before the CAMs would be missed."""
    run = aborted(tmp_path, drop=Run.drop)
    cam_of_2(run, CUT + 1)
    report = judge(run.logs())
    (hazard,) = report.hazards
    assert len(report.forged) == 1 and hazard.outcome == "within" and not hazard.prolonged_by
    assert "hazard (fault)" in report.text()


@pytest.mark.parametrize(
    "forged",
    [
        Cancel(src=1, dst=2, session=(1, 1), seq=999, reason="abort"),
        Fin(src=1, dst=2, session=(1, 1), seq=999),
    ],
    ids=lambda message: message.type,
)
def test_s_5_a_forged_end_at_the_target_is_the_excuse(tmp_path: Path, forged: Message) -> None:
    run = Run(tmp_path, drop=no_cancel, maneuver_ms=9000)
    run.simulation.clock.at(
        CUT, lambda: run.simulation.services[2].receive(encode(forged)) and None
    )
    report = judge(run.logs())
    (hazard,) = report.hazards
    (told,) = report.forged
    assert hazard.excused and hazard.begun_by == f"{forged.type} from 1, at {at_of(told)}"
    assert hazard.since == at_of(told) and hazard.outcome == "within"
    assert property_of(report, "S-5") == property_of(report, "T-2") == "holds"
    assert "hazard (forged message)" in report.text() and "WITHOUT EXCUSE" not in report.text()
    assert report.verdict == "violated", "the forgery itself is no run of the protocol"
    assert hazard.as_dict()["begun_by"] == hazard.begun_by


def test_s_5_an_acceptance_forged_before_the_true_one_is_the_excuse(
    usual: Run, tmp_path: Path
) -> None:
    """The prescriber acts on it while the target still decides."""
    accepted = dict((phase, ms) for ms, phase in usual.phases[2])["ACTUATING"]
    run = Run(tmp_path)
    true = next(
        e.message
        for _, e in read(usual.folder / "2.ndjson").events
        if isinstance(e, Send) and e.message["type"] == "Acceptance"
    )
    data = json.dumps({**true, "seq": 999}).encode()
    early = accepted - 30
    run.simulation.clock.at(early, lambda: run.simulation.services[1].receive(data) and None)
    report = judge(run.logs())
    (hazard,) = report.hazards
    assert hazard.since_ms == early and "acts before station 2 accepts" in hazard.fault
    assert hazard.excused and hazard.begun_by.startswith("Acceptance from 2, at ")
    assert hazard.outcome == "within" and property_of(report, "S-5") == "holds"


def test_t_2_says_nothing_where_a_copy_took_too_long(tmp_path: Path) -> None:
    """A delay beyond half of t_resend is against what T-2 assumes."""
    run = Run(tmp_path, drop=no_cancel, maneuver_ms=9000)
    radio = run.simulation.radio
    deliver = radio._deliver

    def late(src: int, dst: int, data: bytes, tx: str) -> None:
        """The last CAM that names the session comes 400 ms later."""
        if src == 2 and dst == 1 and b'"marks":[[1,1]]' in data.replace(b" ", b""):
            now = run.simulation.clock.now()
            if CUT - 100 <= now < CUT:
                run.simulation.clock.at(now + 400, lambda: deliver(src, dst, data, tx))
                return
        deliver(src, dst, data, tx)

    radio._deliver = late  # type: ignore[method-assign]
    run.simulation.command(2, Abort(session=(1, 1)), at=CUT)
    report = judge(run.logs())
    (hazard,) = report.hazards
    assert hazard.outcome == "cannot_tell" and "assumes delays of at most 50 ms" in hazard.why
    assert property_of(report, "T-2") == "cannot_tell"


def test_without_the_target_s_log_the_hazard_cannot_be_told(tmp_path: Path) -> None:
    one, _, three = plain(tmp_path)
    report = judge([one, three])
    assert property_of(report, "S-5") == "cannot_tell" and report.verdict == "cannot_tell"
    assert "no log of station 2" in report.text()


def test_a_target_whose_log_diverges_is_not_judged_beyond_that(tmp_path: Path) -> None:
    one, _, three = plain(tmp_path)
    lines = records(tmp_path / "2.ndjson")
    drop = next(n for n, r in enumerate(lines) if r.get("t_ms", 0) > CUT and r.get("op") == "arm")
    del lines[drop]
    report = judge([one, rewritten(tmp_path / "2.ndjson", lines), three])
    assert property_of(report, "S-5") == "cannot_tell" and report.verdict == "cannot_tell"
    assert "2.ndjson" in report.text() and "diverges" in report.text()
