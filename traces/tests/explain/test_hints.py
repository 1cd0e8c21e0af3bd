"""Hints: they appear where the log is to blame, and not where the station is."""

from __future__ import annotations

import random
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from merged_runs import records, rewritten, simulated

from automcm_spec.vocabulary.parameters import Parameters
from automcm_traces.explain.explain import Verdict, text, verdict_of

Json = Any


def judged(folder: Path, lines: list[Json]) -> Verdict:
    """The verdict on these records, numbered anew."""
    return verdict_of(Path(rewritten(folder / "edited.ndjson", lines).file))


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    """A session of two stations, without loss, CAMs included."""
    folder = tmp_path_factory.mktemp("run")
    return simulated(folder, 1001, 2002, until=12_000, maneuver_ms=4000)


def only(lines: list[Json], *kinds: str) -> list[Json]:
    kept = [{**r} for r in lines if r.get("ev", kinds[0]) in kinds]
    return [kept[0] | {"complete": sorted(kinds)}, *kept[1:]]


def is_message(record: Json, ev: str, type_: str) -> bool:
    return bool(record.get("ev") == ev and record.get("message", {}).get("type") == type_)


def test_an_advertisement_without_planned(run: list[Path], tmp_path: Path) -> None:
    lines = records(run[1])
    for record in lines:
        record.pop("planned", None)
    verdict = judged(tmp_path, lines)
    wanted = "the Advertisement of session 1001/1 has no `planned`: with it, it concerns the"
    assert verdict.verdict == "diverges" and verdict.hint.startswith(wanted), text(verdict)
    assert f"  hint: {verdict.hint}" in text(verdict).splitlines()
    assert verdict.as_dict()["hint"] == verdict.hint
    logger = judged(tmp_path, only(lines, "receive", "send"))
    assert logger.verdict == "diverges" and logger.hint == verdict.hint


def test_a_log_of_another_station(run: list[Path], tmp_path: Path) -> None:
    header, *lines = records(run[1])
    verdict = judged(tmp_path, [header | {"station": 3003}, *lines])
    assert verdict.verdict == "diverges"
    assert verdict.hint == "is this the log of station 3003? 2002 sent the message"


def without_cams(lines: list[Json]) -> list[Json]:
    return [r for r in lines if not is_message(r, "receive", "CAM")]


@pytest.mark.parametrize("station", [0, 1])
def test_a_log_without_cams(station: int, run: list[Path], tmp_path: Path) -> None:
    lines = records(run[station])
    for part in (lines, only(lines, "command", "receive", "restart", "send")):
        verdict = judged(tmp_path, without_cams(part))
        assert verdict.verdict == "diverges", text(verdict)
        assert verdict.hint.startswith("the log has no received CAM"), text(verdict)
    part = without_cams(only(lines, "receive", "send"))
    part[0]["complete"] = ["send"]
    assert judged(tmp_path, part).verdict == "allowed"


@pytest.mark.parametrize("station", [0, 1])
def test_a_station_that_ignores_the_loss_of_cams(
    station: int, run: list[Path], tmp_path: Path
) -> None:
    lines = records(run[station])
    acts = next(n for n, r in enumerate(lines) if r.get("phase") == "ACTUATING")
    part = only(
        [*lines[:acts], *without_cams(lines[acts:])], "command", "receive", "restart", "send"
    )
    verdict = judged(tmp_path, part)
    assert verdict.verdict == "diverges" and verdict.finding.rule == "ACT-2"
    assert verdict.hint == "", text(verdict)


def jumped(lines: list[Json], at: int, by: int) -> list[Json]:
    """The log of a station whose clock jumps before an event."""
    moved = [{**record} for record in lines]
    for record in moved[at:]:
        for name in {"t_ms", "deadline"} & record.keys():
            record[name] += by
    return moved


def inputs(lines: list[Json]) -> list[int]:
    ends = ("receive", "command")
    return [n for n, r in enumerate(lines) if r.get("ev") in ends or r.get("op") == "expire"]


@pytest.mark.sweep(1)
@pytest.mark.parametrize("by", [700, 2000, 60_000])
def test_a_clock_that_jumps(by: int, run: list[Path], tmp_path: Path) -> None:
    """Wherever it diverges because timers seem overdue, the hint names the amount."""
    told = missed = 0
    for path in run:
        lines = records(path)
        for at in random.Random(by).sample(inputs(lines)[10:-10], 12):
            verdict = judged(tmp_path, jumped(lines, at, by))
            if verdict.verdict == "diverges":
                found = verdict.hint.partition("jump by ")[2].partition(" ms")[0].replace(",", "")
                told += bool(found) and abs(int(found) - by) <= 20
                missed += not found
                assert not found or abs(int(found) - by) <= 20, text(verdict)
    assert told and told >= 9 * missed


@pytest.mark.sweep(1)
@pytest.mark.parametrize("ms", [200, 700, 2000])
def test_one_timer_that_is_late_is_no_jump_of_the_clock(ms: int, tmp_path: Path) -> None:
    """The station resends too late, while all else keeps its time."""
    parameters = Parameters(t_timeout=4000, t_resend=100)
    paths = simulated(tmp_path, 1001, 2002, until=9000, loss=0.6, seed=5, parameters=parameters)
    number = 0
    for path in paths:
        lines = records(path)
        late = [n for n, r in enumerate(lines) if r.get("op") == "expire"]
        for at in random.Random(ms).sample(late, min(12, len(late))):
            rest = [
                n for n in range(at + 1, len(lines)) if lines[n].get("t_ms", 0) > lines[at]["t_ms"]
            ]
            end = next((n for n in rest if n in inputs(lines)), len(lines) - 1)
            step, later = lines[at:end], lines[end:]
            due = step[0]["t_ms"] + ms
            place = next((n for n, r in enumerate(later) if r.get("t_ms", due) >= due), 0)
            moved = [r | {"t_ms": due} for r in step]
            verdict = judged(tmp_path, [*lines[:at], *later[:place], *moved, *later[place:]])
            number += verdict.verdict == "diverges"
            assert verdict.verdict != "diverges" or "jump" not in verdict.hint, text(verdict)
    assert number > 5


def test_a_tx_that_is_used_twice(run: list[Path], tmp_path: Path) -> None:
    lines = records(run[0])
    sent = [n for n, r in enumerate(lines) if r.get("ev") == "send"]
    lines[sent[3]]["tx"] = lines[sent[1]]["tx"]
    verdict = judged(tmp_path, lines)
    tx = lines[sent[1]]["tx"]
    assert verdict.verdict == "allowed"
    assert verdict.hint.startswith(f"line {sent[3] + 1} uses tx {tx} a second time"), verdict.hint
    lines[sent[3]]["tx"] = f"9{tx}"  # not of this station
    assert judged(tmp_path, lines).hint == judged(tmp_path, records(run[0])).hint == ""


CUTS: list[Callable[[Json], bool]] = [
    lambda r: is_message(r, "send", "Acceptance"),
    lambda r: is_message(r, "receive", "Prescription"),
    lambda r: is_message(r, "receive", "Ack"),
    lambda r: bool(r.get("ev") == "command" and r["command"]["name"] == "accept"),
]


@pytest.mark.parametrize("cut", CUTS)
def test_a_log_that_begins_in_mid_session(
    cut: Callable[[Json], bool], run: list[Path], tmp_path: Path
) -> None:
    lines = records(run[1])
    at = next(n for n, r in enumerate(lines) if cut(r))
    for kept in (lines, only(lines, "receive", "send")):
        begin = [r for r in kept if r["rec"] != "event" or r["t_ms"] >= lines[at]["t_ms"]]
        verdict = judged(tmp_path, begin)
        assert verdict.verdict == "diverges"
        assert 'mid-session? Then its header needs "begins": "running"' in verdict.hint
        marked = judged(tmp_path, [begin[0] | {"begins": "running"}, *begin[1:]])
        assert marked.verdict == "cannot_tell" and marked.hint == ""
        assert marked.first_ms == begin[1]["t_ms"]


@pytest.mark.parametrize("type_", ["Acceptance", "Prescription", "Fin"])
def test_a_station_in_no_session_that_sends_is_to_blame(
    type_: str, run: list[Path], tmp_path: Path
) -> None:
    """The log shows before that the station is in no session."""
    lines = records(run[type_ == "Acceptance"])
    sent = next(r for r in lines if is_message(r, "send", type_))
    first = next(n for n, r in enumerate(lines) if is_message(r, "send", "CAM"))
    early = {k: v for k, v in sent.items() if k not in ("phase", "role")}
    early["t_ms"] = lines[first]["t_ms"]
    verdict = judged(tmp_path, [*lines[: first + 1], early, *lines[first + 1 :]])
    assert verdict.verdict == "diverges" and verdict.finding.at.line == first + 2
    assert "mid-session" not in verdict.hint
