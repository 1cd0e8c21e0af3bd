"""What is said at a divergence: the guard in the way, the session, the failing prefix."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from edits import Edited, edited, find

from automcm_traces.explain.explain import Verdict, explain_file, prefix, replay, text

CORPUS = Path(__file__).resolve().parents[1] / "corpus" / "four-vehicles"
PRESCRIBER, TARGET = CORPUS / "1001.ndjson", CORPUS / "3003.ndjson"


def without_ack(folder: Path) -> Verdict:
    """ADV-5: an Intention that is recorded and not acked."""
    no_ack = edited(PRESCRIBER, folder, lambda log: log.drop(log.find("send", type="Ack")))
    return explain_file(no_ack)


def joins_again(folder: Path) -> Verdict:
    """ADV-4: a bound station that answers a second Advertisement with another Intention."""

    def edit(log: Edited) -> None:
        lines = range(13, len(log.records))
        second = next(
            n for n in lines if log.at(n).get("message", {}).get("type") == "Advertisement"
        )
        intention = log.at(log.find("send", type="Intention")) | {"t_ms": log.at(second)["t_ms"]}
        log.records.insert(second, intention | {"tx": "3003:999"})

    return explain_file(edited(TARGET, folder, edit))


def test_adv_4_the_nearest_allowed_and_the_guard_in_the_way(tmp_path: Path) -> None:
    verdict = joins_again(tmp_path)
    assert (verdict.verdict, verdict.finding.rule) == ("diverges", "ADV-4")
    nearest = verdict.finding.why.nearest
    assert "ADV-3 send Intention" in nearest and "Bound(st)" in nearest
    assert nearest in text(verdict)


def test_adv_5_a_missing_ack_names_the_guard_that_would_excuse_it(tmp_path: Path) -> None:
    verdict = without_ack(tmp_path)
    assert (verdict.verdict, verdict.finding.rule) == ("diverges", "ADV-5")
    assert "without send Ack" in verdict.finding.why.nearest


def test_rel_1_an_effect_without_a_step_names_what_would_have_caused_it(tmp_path: Path) -> None:
    def edit(log: Edited) -> None:
        log.drop(log.find("timer", op="expire", name="resend"))

    verdict = explain_file(edited(PRESCRIBER, tmp_path, edit))
    assert verdict.verdict == "diverges"
    assert "expire resend(Advertisement)" in verdict.finding.why.causes


def test_a_timer_that_is_not_armed_says_when_it_is(tmp_path: Path) -> None:
    def edit(log: Edited) -> None:
        cam = log.find("send", type="CAM")
        expiry = {"rec": "event", "t_ms": log.at(cam)["t_ms"], "ev": "timer", "op": "expire"}
        log.records.insert(cam, expiry | {"timer": {"name": "hold"}})

    verdict = explain_file(edited(TARGET, tmp_path, edit))
    assert verdict.verdict == "diverges" and verdict.finding.rule == "ADV-7"
    assert verdict.finding.why.causes == ("a step into WAITING",)
    assert "blocked by guard" in verdict.finding.why.nearest


def test_the_last_events_and_the_session_are_shown(tmp_path: Path) -> None:
    verdict = joins_again(tmp_path)
    shown = text(verdict)
    assert "in session 1001/1 as receiver" in shown and "Intention ->1001" in shown
    assert all(len(line) <= 80 for line in shown.splitlines() if line.startswith("   "))


@pytest.mark.parametrize("wrong", [without_ack, joins_again])
def test_the_prefix_diverges_in_the_same_way(wrong: Any, tmp_path: Path) -> None:
    verdict = wrong(tmp_path)
    path = prefix(verdict, tmp_path / "new" / "folder")
    again = explain_file(path)
    assert (again.finding.at.line, again.finding.observed, again.finding.rule) == (
        verdict.finding.at.line,
        verdict.finding.observed,
        verdict.finding.rule,
    )
    assert not again.warnings
    assert path.read_bytes().count(b"\n") < Path(verdict.file).read_bytes().count(b"\n")
    assert replay(path) == f"automcm trace replay {path} -- YOUR_ADAPTER"


def test_what_is_missing_at_the_end_is_in_the_prefix(tmp_path: Path) -> None:
    fin = find(TARGET, "receive", type="Fin")
    cut = edited(TARGET, tmp_path, lambda log: log.records.__delitem__(slice(fin, -1)))
    verdict = explain_file(cut)
    assert (verdict.verdict, verdict.finding.at.line) == ("diverges", fin)
    again = explain_file(prefix(verdict, tmp_path / "prefix"))
    assert (again.finding.at.line, again.finding.observed) == (
        verdict.finding.at.line,
        verdict.finding.observed,
    )


def test_several_sessions_of_one_log_are_told_apart() -> None:
    verdict = explain_file(PRESCRIBER)
    assert [s.session for s in verdict.sessions] == [(1001, 1)]
    session = verdict.sessions[0]
    assert session.role == "prescriber" and session.rule == "ACT-3"
    assert session.phases == ["ADVERTISING", "CHOOSING", "PRESCRIBING", "NEGOTIATING", "ACTUATING"]
    assert verdict.as_dict()["sessions"] == [session.as_dict()]


def test_what_cannot_be_read_begins_with_its_place_as_any_other_verdict(tmp_path: Path) -> None:
    log = tmp_path / "log.ndjson"
    log.write_text(PRESCRIBER.read_text().replace('"seq":2,', '"seq":1,', 1))
    assert text(explain_file(log)).startswith(f"{log}:3: UNREADABLE: seq: 1 after 1")
    assert text(explain_file(tmp_path / "none")) == f"{tmp_path / 'none'}: UNREADABLE: no such file"
