"""Rows as text: what matters is not cut, times count from the start, copies are folded."""

from __future__ import annotations

import re
from functools import cache
from pathlib import Path

import pytest
from edits import HEADER, end, write
from merged_runs import later
from rich.cells import cell_len

from automcm_spec.log_format.event_text import DAY_MS, starts, summary
from automcm_spec.log_format.log import ApplicationIndication, Event, Receive, Send
from automcm_spec.log_format.reader import LogStream, read
from automcm_spec.support.bad_input import BadInput
from automcm_traces.explain import log_table

CORPUS = Path(__file__).parents[2] / "corpus"
FOUR = sorted((CORPUS / "four-vehicles").glob("*.ndjson"))
RUNS = [sorted((CORPUS / "pair").glob("*.ndjson")), FOUR]
EPOCH = 1_732_300_000_000
MARKS = [(), ("x2002",), ("?2002",), ("2nd", "for 3003"), ("x2002", "x3003", "?4004"), ("forged",)]


@cache
def different() -> list[Event]:
    """The events of the corpus that have different summaries."""
    found: dict[str, Event] = {}
    for path in sorted(CORPUS.rglob("*.ndjson")):
        try:
            for _, event in LogStream(path, past_gaps=True):
                found.setdefault(summary(event), event)
        except BadInput:
            continue
    return list(found.values())


def matters(event: Event) -> list[str]:
    """The words that no row may lose: the type and the verdict."""
    match event:
        case Send(message=m) | Receive(message=m) if m is not None:
            verdict = ["accepts" if m["accepted"] is True else "refuses"] if "accepted" in m else []
            reason = [f"({m['reason']})"] if "reason" in m else []
            return [str(m["type"]), *verdict, *reason]
        case ApplicationIndication(indication=told):
            reason_ = (told.model_extra or {}).get("reason")
            return [told.name, *([f"({reason_})"] if reason_ else [])]
    return []


@pytest.mark.sweep(1)
@pytest.mark.parametrize("place", range(4))
def test_with_four_stations_no_row_loses_its_type_or_verdict(place: int) -> None:
    others = [1001, 2002, 3003, 4004]
    events = [event for event in different() if matters(event)]
    assert len(events) > 300
    for event in events:
        for notes in MARKS:
            row = log_table.TableRow(others[place], 9999, event, notes=notes)
            lines = [line for _, line in log_table.LogTable(others, 110).lines(row, "*20")]
            assert all(cell_len(line) <= 110 for line in lines)
            words = " ".join(lines).split()
            assert {*matters(event), "*20"} <= {*words}, lines
            assert not any(word.endswith("..") for word in words), lines
            marks = {word[0] for word in words if word[0] in "x?"}
            assert marks == {note[0] for note in notes if note[0] in "x?"}
            assert notes == ("forged",) or all(note in " ".join(words) for note in notes[1:])


def test_where_there_is_room_nothing_is_left_out() -> None:
    for event in different():
        row = log_table.TableRow(7, 1, event)
        (line, *_) = (text for _, text in log_table.LogTable([7], 300).lines(row))
        assert line.split() == [str(event.t_ms), "1", *summary(event).split()]


TIME = re.compile(r"(?!.*-- ) *(\d+) +(\d+) ")


def shown(paths: list[Path], absolute: bool, width: int = 80) -> list[tuple[int, int]]:
    """Time and line of the rows."""
    logs = log_table.Logs(paths)
    start_ms = None if absolute else starts(log_table.first_times(paths))
    lines = log_table.columns(
        logs.filtered(log_table.Filter(cams=True)), logs.stations, width, start_ms
    )
    assert all(cell_len(line) <= width for line in lines) or absolute
    return [(int(m[1]), int(m[2])) for line in lines if (m := TIME.match(line))]


@pytest.mark.parametrize("paths", RUNS, ids=["pair", "four-vehicles"])
@pytest.mark.parametrize("ahead", [0, EPOCH])
def test_times_count_from_the_start_whatever_the_epoch(
    paths: list[Path], ahead: int, tmp_path: Path
) -> None:
    moved = [tmp_path / path.name for path in paths]
    for path in paths:
        later(path, ahead, tmp_path)
    first = min(event.t_ms for path in paths for _, event in read(path))
    absolute, relative = shown(moved, True), shown(moved, False)
    assert absolute == [(t + first + ahead, line) for t, line in relative]
    assert min(relative)[0] == 0 and shown(paths, False) == relative


def test_a_clock_with_another_origin_counts_from_its_own_first_event() -> None:
    assert starts({}) == {}
    assert starts({7: 500, 8: 900}) == {7: 500, 8: 500}
    assert starts({7: 500, 8: 500 + DAY_MS}) == {7: 500, 8: 500}
    assert starts({7: 500, 8: EPOCH}) == {7: 500, 8: EPOCH}


@pytest.mark.parametrize("paths", RUNS, ids=["pair", "four-vehicles"])
def test_folded_rows_stand_for_all_rows(paths: list[Path]) -> None:
    every = list(log_table.folds(log_table.Logs(paths).filtered(log_table.Filter()), unfold=True))
    few = list(log_table.folds(log_table.Logs(paths).filtered(log_table.Filter())))
    assert {fold.times for fold in every} == {1}
    assert sum(fold.times for fold in few) == len(every) > len(few) + 10
    changes = [fold.first for fold in every if fold.first.phase]
    assert len(changes) > 4
    shown = {(fold.first.station, fold.first.line) for fold in few}
    assert {(row.station, row.line) for row in changes} <= shown, "none is folded away"


def test_a_copy_that_changes_the_phase_is_not_folded_away(tmp_path: Path) -> None:
    message = {"type": "Fin", "src": 7, "dst": 8}
    phases = ["WAITING", "WAITING", "ACTUATING"]
    events = [
        {"rec": "event", "seq": n, "t_ms": n, "ev": "receive", "message": message, "phase": phase}
        for n, phase in enumerate(phases, 1)
    ]
    path = write(tmp_path, HEADER, *events, end(3))
    shown = log_table.folds(log_table.Logs([path]).filtered(log_table.Filter()))
    assert [(fold.first.line, fold.times) for fold in shown] == [(2, 2), (4, 1), (5, 1)]
