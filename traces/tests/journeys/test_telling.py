"""What is said at a divergence: the guard in the way, the session, the failing prefix."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path

import pytest
from edits import Edited, edited
from merged_runs import Run

from automcm_spec.vocabulary.application import Abort
from automcm_traces.explain.explain import Verdict, text, verdict_of, verdicts_of

CORPUS = Path(__file__).resolve().parents[2] / "corpus" / "four-vehicles"
PRESCRIBER, TARGET = CORPUS / "1001.ndjson", CORPUS / "3003.ndjson"


def joins_again(folder: Path) -> Verdict:
    """ADV-4: a bound station that answers a second Advertisement with another Intention."""

    def edit(log: Edited) -> None:
        lines = range(13, len(log.records))
        second = next(
            n for n in lines if log.at(n).get("message", {}).get("type") == "Advertisement"
        )
        intention = log.at(log.find("send", type="Intention")) | {"t_ms": log.at(second)["t_ms"]}
        log.records.insert(second, intention | {"tx": "3003:999"})

    return verdict_of(edited(TARGET, folder, edit))


def test_adv_4_the_nearest_allowed_and_the_guard_in_the_way(tmp_path: Path) -> None:
    verdict = joins_again(tmp_path)
    assert (verdict.verdict, verdict.finding.rule) == ("diverges", "ADV-4")
    nearest = verdict.finding.nearest
    assert "ADV-3 send Intention" in nearest and "Bound(st)" in nearest
    assert nearest in text(verdict)


def test_rel_1_an_effect_without_a_step_names_what_would_have_caused_it(tmp_path: Path) -> None:
    def edit(log: Edited) -> None:
        log.drop(log.find("timer", op="expire", name="resend"))

    verdict = verdict_of(edited(PRESCRIBER, tmp_path, edit))
    assert verdict.verdict == "diverges"
    assert "expire resend(Advertisement)" in verdict.finding.causes


def test_a_timer_that_is_not_armed_says_when_it_is(tmp_path: Path) -> None:
    def edit(log: Edited) -> None:
        cam = log.find("send", type="CAM")
        expiry = {"rec": "event", "t_ms": log.at(cam)["t_ms"], "ev": "timer", "op": "expire"}
        log.records.insert(cam, expiry | {"timer": {"name": "hold"}})

    verdict = verdict_of(edited(TARGET, tmp_path, edit))
    assert verdict.verdict == "diverges" and verdict.finding.rule == "ADV-7"
    assert verdict.finding.causes == ("a step into WAITING",)
    assert "blocked by guard" in verdict.finding.nearest


def test_the_last_events_and_the_session_are_shown(tmp_path: Path) -> None:
    verdict = joins_again(tmp_path)
    shown = text(verdict)
    assert "in session 1001/1 as receiver" in shown and "Intention ->1001" in shown
    assert all(len(line) <= 80 for line in shown.splitlines() if line.startswith("   "))


def test_several_sessions_of_one_log_are_told_apart() -> None:
    verdict = verdict_of(PRESCRIBER)
    assert [s.session for s in verdict.sessions] == [(1001, 1)]
    session = verdict.sessions[0]
    assert session.role == "prescriber" and session.rule == "ACT-3"
    assert session.phases == ["ADVERTISING", "CHOOSING", "PRESCRIBING", "NEGOTIATING", "ACTUATING"]
    assert verdict.as_dict()["sessions"] == [asdict(session)]


Edit = Callable[[Edited], None]


@pytest.fixture(scope="module")
def aborted(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run in which the target aborts at 4000 ms and is asked again; prescriber 1, target 2."""
    run = Run(tmp_path_factory.mktemp("aborted"), maneuver_ms=20_000)
    run.simulation.command(2, Abort(session=(1, 1)), at=4000)
    run.simulation.request(1, at=5000)
    run.logs(until=6000)
    return run.folder


def cams_that_count(log: Edited) -> list[int]:
    """The lines of the CAMs after the first that counted in ACTUATING."""
    acting = next(n for n in range(2, len(log.records)) if log.at(n).get("phase") == "ACTUATING")
    return [
        n
        for n in range(acting, len(log.records) - 1)
        if log.at(n).get("message", {}).get("type") == "CAM"
        and log.at(n + 1).get("timer", {}).get("name") == "cam"
        and log.at(n)["ev"] == "receive"
    ]


def cam_ahead(log: Edited) -> None:
    log.at(cams_that_count(log)[1])["message"]["generation_ms"] += 500


def cam_again(log: Edited) -> None:
    before, line, *_ = cams_that_count(log)
    again = log.at(before)["message"]["generation_ms"]
    log.at(line)["message"]["generation_ms"] = again


def no_margin(log: Edited) -> None:
    lease = log.at(log.find("timer", op="arm", name="lease"))
    lease["deadline"] = lease["t_ms"] + 20_000


def joins_in_quarantine(log: Edited) -> None:
    line = log.find("receive", type="Advertisement", session=[1, 2])
    intention = json.loads(json.dumps(log.at(log.find("send", type="Intention"))))
    intention |= {"tx": "2:99999", "t_ms": log.at(line)["t_ms"]}
    intention["message"]["session"] = [1, 2]
    log.records.insert(line, intention)


def late_timer(log: Edited) -> None:
    line = log.find("timer", op="expire", name="resend")
    for record in log.records[line - 1 :]:
        record |= {name: record[name] + 80 for name in ("t_ms", "deadline") if name in record}


def no_copy(log: Edited) -> None:
    log.records[0]["complete"] = ["receive", "send"]
    log.records = [r for r in log.records if r.get("ev", "send") in ("receive", "send")]
    for record in log.records:
        record.pop("phase", None)
    log.drop(log.find("send", 2, type="Advertisement"))


TEXTS: list[tuple[Edit, int, str, list[str]]] = [
    (cam_ahead, 1, "ACT-5", ["line 181", "134 ms more than 3232", "ACT-5.3"]),
    (cam_again, 1, "ACT-5", ["line 181", "generation_ms 2766 is not newer than that of line 178"]),
    (no_margin, 1, "PRE-2", ["by ACT-4: ", "arm lease for 19799 ms: 20000 less 1 % and 1 ms"]),
    (
        joins_in_quarantine,
        2,
        "END-8",
        ["by ACT-6: ", "in quarantine by ACT-6 since line 178, for 6300 ms"],
    ),
    (late_timer, 1, "ADV-2", ["80 ms before; due 100 ms after line 20", "50 ms late (--late)"]),
    (no_copy, 1, "ACT-5", ["is a copy missing? resend(Advertisement", "due 100 ms after line 17"]),
]


@pytest.mark.parametrize(("edit", "station", "rule", "says"), TEXTS)
def test_what_is_wrong_is_named(
    edit: Edit, station: int, rule: str, says: list[str], aborted: Path, tmp_path: Path
) -> None:
    verdict = verdict_of(edited(aborted / f"{station}.ndjson", tmp_path, edit))
    assert (verdict.verdict, verdict.finding.rule) == ("diverges", rule), text(verdict)
    assert [word for word in says if word not in text(verdict)] == [], text(verdict)


@pytest.mark.parametrize("sent", [True, False])
def test_a_forged_cam_says_what_was_sent_under_its_id(
    sent: bool, aborted: Path, tmp_path: Path
) -> None:
    def forge(log: Edited) -> None:
        cam = log.at(log.find("receive", type="CAM", src=3))
        cam["message"]["x_mm"] += 5
        cam["tx"] = cam["tx"] if sent else "3:99999"

    path = edited(aborted / "1.ndjson", tmp_path, forge)
    verdict, *_ = verdicts_of([path, aborted / "2.ndjson", aborted / "3.ndjson"])
    was = "has another message under this tx" if sent else "contains no such sent message"
    assert verdict.finding.observed.startswith("receive CAM from 3, tx 3:")
    assert verdict.finding.observed.endswith(f"forged, {aborted / '3.ndjson'} {was}")
    assert bool(verdict.finding.expected) == sent


@pytest.mark.parametrize(("later", "verdict"), [(3, "allowed"), (4, "diverges")])
def test_a_message_stands_before_its_timers_and_else_order_is_free(
    later: int, verdict: str, tmp_path: Path
) -> None:
    """After the Acceptance stand: stop decide, arm cam, lease, giveup(Acceptance)."""

    def reorder(log: Edited) -> None:
        sent = log.find("send", type="Acceptance")
        log.records.insert(sent - 1 + later, log.records.pop(sent - 1))

    assert verdict_of(edited(TARGET, tmp_path, reorder)).verdict == verdict
