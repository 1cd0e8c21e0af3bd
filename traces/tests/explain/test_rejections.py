"""Rejected messages: their causes, their number, what they hint at, and what they cannot change."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from merged_runs import matches_of, records, rewritten
from page_rows import CORPUS, DELIVERED, REJECTED, Json, events, fives

from automcm.security.verifier import Rejection
from automcm_spec.log_format.reader import read
from automcm_traces.explain.explain import Verdict, text, verdict_of, verdicts_of
from automcm_traces.explain.hints import CAUSES, cause_of
from automcm_traces.explain.log_table import Filter, Logs, folds
from automcm_traces.system.delivery import outcomes
from automcm_traces.system.log_merge import merge
from automcm_traces.system.properties import judge
from automcm_traces.viewer.page_data import as_dict, load

SECURED = sorted((CORPUS / "secured").glob("*.ndjson"))


def log(folder: Path, *rejected: tuple[str | None, str], heard: int = 0) -> Path:
    """The log of station 1 that rejected datagrams with this ``tx`` and reason."""
    lines: list[Json] = [
        {"rec": "header", "schema": "automcm.trace/1", "run": "r", "station": 1}
        | {"implementation": {"name": "a", "version": "1"}, "parameters": {}}
        | {"complete": ["command", "indication", "receive", "restart", "send", "timer"]}
    ]
    if heard:
        where = dict.fromkeys(("x_mm", "y_mm", "heading_mrad", "speed_mm_s", "generation_ms"), 0)
        cam = {"v": 1, "type": "CAM", "src": heard, "marks": []} | where
        lines.append({"ev": "receive", "tx": f"{heard}:99", "message": cam})
    lines += [
        {"ev": "receive", "raw": "AAAA", "rejected": reason} | ({"tx": tx} if tx else {})
        for tx, reason in rejected
    ]
    for n, line in enumerate(lines[1:], 1):
        line |= {"rec": "event", "t_ms": n}
    lines.append({"rec": "end", "reason": "clean", "lost_records": 0})
    rewritten(path := folder / "1.ndjson", lines)
    return path


def judged(folder: Path, *rejected: tuple[str | None, str], heard: int = 0) -> Verdict:
    verdict = verdict_of(log(folder, *rejected, heard=heard))
    assert verdict.verdict == "allowed"
    return verdict


def test_every_reason_of_the_reference_has_a_cause() -> None:
    assert set(CAUSES) == {reason.value for reason in Rejection}
    assert all(bool(asks) == (of not in ("replayed", "other")) for of, asks in CAUSES.values())
    assert cause_of("of a vendor") == "other"


def test_explain_counts_what_was_rejected(tmp_path: Path) -> None:
    many = [("2:1", "bad_signature")] * 5 + [("2:2", "replayed")] * 7
    verdict = judged(tmp_path, *many)
    assert "  station 1 rejected 12 messages: 7 replayed, 5 bad_signature" in text(verdict)
    assert json.dumps(verdict.as_dict()["rejected"]) == '{"replayed": 7, "bad_signature": 5}'
    assert not verdict.hint
    one = judged(tmp_path, ("2:1", "x"))
    assert "  station 1 rejected 1 message: 1 x" in text(one) and not one.hint
    assert "rejected" not in text(judged(tmp_path, heard=2))


ALL_OF_2 = "all 3 messages that name station 2 as sender were rejected"


@pytest.mark.parametrize(
    ("reasons", "hint"),
    [
        (["stale"] * 3, f"{ALL_OF_2} (3 stale): do the clocks agree?"),
        (["early", "stale", "early"], f"{ALL_OF_2} (2 early, 1 stale): do the clocks agree?"),
        (
            ["unknown_signer", "unknown_signer", "unknown_authority"],
            f"{ALL_OF_2} (2 unknown_signer, 1 unknown_authority): does this station know their "
            "authority?",
        ),
        (
            ["bad_signature"] * 3,
            f"{ALL_OF_2} (3 bad_signature): do they sign with the key of their certificate?",
        ),
        (["stale", "stale"], ""),
        (["replayed"] * 9, ""),
        (["over_budget"] * 9, ""),
        (["stale"] * 9 + ["bad_signature"], ""),
    ],
)
def test_one_cause_explains_why_nobody_answers(
    tmp_path: Path, reasons: list[str], hint: str
) -> None:
    sent = [(f"2:{n}", reason) for n, reason in enumerate(reasons, 1)]
    assert judged(tmp_path, *sent).hint == hint
    assert judged(tmp_path, *sent, heard=3).hint == hint
    assert not judged(tmp_path, *sent, heard=2).hint


def test_without_tx_the_hint_is_about_all_stations(tmp_path: Path) -> None:
    unsigned: list[tuple[str | None, str]] = [(None, "malformed")] * 4
    hint = "all 4 messages were rejected (4 malformed): do they sign their messages, with the"
    assert judged(tmp_path, *unsigned).hint.startswith(hint)
    assert not judged(tmp_path, *unsigned, heard=2).hint


def test_stations_and_reasons_of_an_attacker_are_bounded(tmp_path: Path) -> None:
    verdict = judged(tmp_path, *[(f"{n}:1", f"reason-{n}") for n in range(2, 400)])
    assert len(verdict.rejected) == 101 and sum(verdict.rejected.values()) == 398


def test_the_reference_rejects_and_both_logs_are_allowed() -> None:
    verdicts = verdicts_of(SECURED)
    assert [v.verdict for v in verdicts] == ["allowed", "allowed"]
    assert [sum(v.rejected.values()) for v in verdicts] == [12, 14]
    report = judge([read(path) for path in SECURED])
    assert report.verdict == "allowed"
    assert report.deliveries["1001-2002"]["rejected"] == 2


def test_a_rejected_datagram_is_no_input(tmp_path: Path) -> None:
    lines = records(SECURED[1])
    at = next(n for n, line in enumerate(lines) if line.get("rejected") == "stale")
    lines.insert(at + 1, lines[at] | {"ev": "timer", "op": "arm", "deadline": 9**9})
    lines[at + 1] |= {"timer": {"name": "quarantine"}}
    for name in ("raw", "rejected", "tx"):
        del lines[at + 1][name]
    rewritten(path := tmp_path / "1.ndjson", lines)
    verdict = verdict_of(path)
    assert (verdict.verdict, verdict.finding.at.line) == ("diverges", at + 2)
    assert f"the message of line {at + 1} is rejected (stale)" in verdict.finding.observed


def test_a_forged_tx_orders_nothing(tmp_path: Path) -> None:
    """An attacker names transmissions that come later: no cycle, no other clocks, no other fate of
    what was accepted."""
    before = merge([read(path) for path in SECURED])
    paths = [tmp_path / path.name for path in SECURED]
    for path, own, other in zip(paths, SECURED, SECURED[::-1], strict=True):
        lines = records(own)
        last = [line["tx"] for line in records(other) if line.get("ev") == "send"][-1]
        for line in lines:
            if "rejected" in line:
                line["tx"] = last
        rewritten(path, lines)
    merged = merge([read(path) for path in paths])
    assert not merged.cycles and matches_of(merged) == matches_of(before)
    assert merged.clocks.starts(merged.logs) == before.clocks.starts(before.logs)
    data = as_dict(load(paths))
    rows, arrows = events(data), fives(data["arrows"])
    assert sum("rejected" in rows[row + down][2] for row, _, down, *_ in arrows) == 26
    assert sum(kind == REJECTED for _, kind, *_ in arrows) == 26
    assert all(down for _, kind, down, *_ in arrows if kind == DELIVERED)


def test_what_was_accepted_too_is_delivered() -> None:
    merged = merge([read(path) for path in SECURED])
    of = {sent: outcome for sent, _, outcome in outcomes(merged)}
    named = [(a.leaves, a.reason) for a in merged.arrows() if a.leaves]
    assert {of[sent] for sent, reason in named if reason == "replayed"} == {"delivered"}
    assert {of[sent] for sent, reason in named if reason == "bad_signature"} == {"rejected"}


def test_datagrams_rejected_for_the_same_reason_fold(tmp_path: Path) -> None:
    sent = [("2:1", "stale")] * 4 + [("3:1", "stale")] + [("3:1", "early")]
    rows = Logs([log(tmp_path, *sent)]).filtered(Filter())
    told = ((fold.first.notes, fold.first.as_dict()["text"], fold.times) for fold in folds(rows))
    assert [(" ".join([*notes, text]), times) for notes, text, times in told][:-1] == [
        ("<- rejected 2 stale", 4),
        ("<- rejected 3 stale", 1),
        ("<- rejected 3 early", 1),
    ]
