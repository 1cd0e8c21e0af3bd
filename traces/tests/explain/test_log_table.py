"""Logs as a table, in an order that could have been."""

from __future__ import annotations

import json
import os
import tracemalloc
from pathlib import Path
from typing import Any

import pytest
from edits import HEADER, Line
from edits import end as end_of
from rich.cells import cell_len

from automcm_spec.log_format.event_text import fitted, safe, summary
from automcm_spec.log_format.log import RECORD, Receive, Send
from automcm_spec.support.bad_input import BadInput
from automcm_traces.explain.log_table import Filter, Logs, TableRow, columns

KINDS = ["command", "indication", "receive", "restart", "send", "timer"]


def header(station: int, run: str = "r", complete: list[str] = KINDS) -> Line:
    return HEADER | {"run": run, "station": station, "parameters": {}, "complete": complete}


def event(ev: str, t_ms: int = 0, **fields: Any) -> Line:
    return {"rec": "event", "t_ms": t_ms, "ev": ev, **fields}


def fin(src: int, dst: int, seq: int = 1, session: tuple[int, int] = (7, 1)) -> Line:
    return {"type": "Fin", "v": 1, "src": src, "dst": dst, "session": list(session), "seq": seq}


def log(folder: Path, station: int, *events: Line, end: bool = True, **head: Any) -> Path:
    """A log of these events; seq is counted here."""
    path = folder / f"{station}.ndjson"
    lines = [header(station, **head), *({**e, "seq": n} for n, e in enumerate(events, 1))]
    if end:
        lines.append(end_of(len(events)))
    path.write_text("".join(json.dumps(line) + "\n" for line in lines))
    return path


def rows(*paths: Path, **wanted: Any) -> list[TableRow]:
    return list(Logs(paths).filtered(Filter(**wanted)))


def placed(shown: list[TableRow]) -> list[tuple[int, int]]:
    return [(row.station, row.line) for row in shown if row.event is not None]


def test_what_is_received_stands_below_where_it_was_sent(tmp_path: Path) -> None:
    """Even where the receiver's clock is far behind the sender's."""
    paths = [
        log(tmp_path, 7, event("restart", 9000), event("send", 9000, tx="7:1", message=fin(7, 8))),
        log(tmp_path, 8, event("restart", 3), event("receive", 5, tx="7:1", message=fin(7, 8))),
    ]
    assert placed(rows(*paths)) == [(7, 2), (7, 3), (8, 2), (8, 3)]


def test_what_became_of_a_message_is_marked(tmp_path: Path) -> None:
    sender = [event("send", 9000 * n, tx=f"7:{n}", message=fin(7, 8, n)) for n in (1, 2, 3)]
    arrived = [event("receive", 9000 * n, tx=f"7:{n}", message=fin(7, 8, n)) for n in (2, 2, 4)]
    arrived = [event("restart"), *arrived[:2], {**arrived[2], "t_ms": 27_000}]
    shown = rows(log(tmp_path, 7, *sender), log(tmp_path, 8, *arrived))
    notes = [(row.station, row.event.seq, row.notes) for row in shown if row.event is not None]
    assert sorted(notes) == [
        (7, 1, ("x8",)),  # the log of 8 goes on for longer than t_life
        (7, 2, ()),
        (7, 3, ("?8",)),
        (8, 1, ()),
        (8, 2, ()),
        (8, 3, ("2nd",)),
        (8, 4, ("forged",)),
    ]


def test_msg_1_what_is_overheard_is_marked(tmp_path: Path) -> None:
    to: list[Any] = [8, 9, 0, -1, "all"]
    sent = [{**fin(7, 8), "dst": dst} for dst in to]
    path = log(tmp_path, 9, *(event("receive", tx=f"7:{n}", message=m) for n, m in enumerate(sent)))
    assert [row.notes for row in rows(path)[: len(to)]] == [("for 8",), (), (), (), ()]
    assert rows(path)[0].as_dict()["text"] == "<- Fin 7 7/1#1"


def test_columns_of_two_stations(tmp_path: Path) -> None:
    message = {**fin(7, 8), "type": "Prescription", "proposal": 2}
    timer = {"name": "resend", "message": {"type": "Fin", "to": 8, "session": [7, 1], "seq": 4}}
    paths = [
        log(
            tmp_path,
            7,
            event("command", 5, command={"name": "prescribe", "target": 8}, phase="PRESCRIBING"),
            event("send", 5, tx="7:1", message=message),
            event("timer", 5, op="arm", timer=timer, deadline=105),
        ),
        log(tmp_path, 8, event("receive", 9, tx="7:1", message=message), event("restart", 10)),
    ]
    logs = Logs(paths)
    assert columns((r for r in logs.rows() if r.event), logs.stations) == [
        "    t_ms   line 7                               8",
        "       5      2 command prescribe 8",
        "                = PRESCRIBING",
        "       5      3 Prescription ->8 p2 7/1#1",
        "       5      4 arm resend Fin#4 ->8 +100",
        "       9      2                                 <- Prescription 7 p2 7/1#1",
        "      10      3                                 RESTART",
    ]


def test_the_end_a_gap_and_a_line_that_cannot_be_read_are_rows(tmp_path: Path) -> None:
    path = log(tmp_path, 7, event("restart"), event("restart"), event("restart"))
    lines = path.read_text().splitlines(keepends=True)
    path.write_text("".join([*lines[:2], lines[3], "rubbish\n"]))
    logs = Logs([path])
    shown = logs.filtered(Filter())
    words = [" ".join([*row.notes, row.as_dict()["text"]]) for row in shown]
    assert words[1].startswith("-- seq: 3 after 1, expected 2: 1 missing")
    assert words[3].startswith("-- UNREADABLE: not JSON") and not logs.good


def test_filters(tmp_path: Path) -> None:
    cam = {"type": "CAM", "v": 1, "src": 7, "marks": [[7, 1]]}
    events = [
        event("send", tx="7:1", message=cam),  # line 2
        event("timer", op="arm", timer={"name": "cam"}, deadline=9),
        event("receive", tx="8:1", message=fin(8, 7)),
        event("timer", op="arm", timer={"name": "hold"}, deadline=9),
        event("receive", tx="8:2", message=fin(8, 7, session=(8, 5))),
        event("indication", indication={"name": "ended"}),
        event("receive", tx="8:3", raw="AAAA"),
        event("receive", tx="8:4", message=cam),
        event("timer", op="expire", timer={"name": "cam"}),
    ]
    path = log(tmp_path, 7, *events)

    def lines(**wanted: Any) -> list[int]:
        return [line for _, line in placed(rows(path, **wanted))]

    assert lines() == [4, 5, 6, 7, 8, 10]
    assert lines(cams=True) == list(range(2, 11))
    assert lines(timers=False) == [4, 6, 7, 8]
    assert lines(session=(7, 1)) == [4, 5]
    assert lines(session=(7, 1), cams=True) == [2, 4, 5, 9]
    assert lines(session=(8, 5)) == [6, 7]
    assert lines(types=frozenset({"Fin"})) == [4, 6]
    assert lines(from_line=7) == [7, 8, 10]
    assert lines(stations=frozenset({8})) == []
    wanted = Filter()
    list(Logs([path]).filtered(wanted))
    assert wanted.hidden_cams == 2


def test_the_last_rows_know_the_phase_before_them(tmp_path: Path) -> None:
    path = log(tmp_path, 7, event("restart", phase="WAITING"), event("restart", phase="WAITING"))
    shown = list(Logs([path]).filtered(Filter()))
    assert [(row.line, row.phase) for row in shown] == [(2, "WAITING"), (3, ""), (4, "")]
    assert [*Logs([path]).filtered(Filter(), last=2)] == shown[1:]


def test_two_logs_of_one_station_are_refused_and_two_runs_are_warned_of(tmp_path: Path) -> None:
    (tmp_path / "b").mkdir()
    one, same = log(tmp_path, 7), log(tmp_path / "b", 7)
    with pytest.raises(BadInput, match="7 is also the station of"):
        Logs([one, same])
    assert Logs([one, log(tmp_path, 8, run="s")]).warnings == [
        "the logs are of different runs: 'r' and 's'"
    ]


def test_a_pipe_is_refused_before_it_is_read(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe")
    with pytest.raises(BadInput, match="is a pipe"):
        Logs([tmp_path / "pipe"])


@pytest.mark.parametrize(
    ("text", "shown"),
    [
        ("a\x1b[31mb", "a\\x1b[31mb"),
        ("a\nb\r", "a\\nb\\r"),
        ("\u202eabc", "\\u202eabc"),
        ("\u05d0\u05d1", "\\u05d0\\u05d1"),
        ("\u6f22\u5b57", "\u6f22\u5b57"),
        ("é", "é"),
        ("x" * 1000, "x" * 300),
    ],
)
def test_no_text_moves_the_cursor_or_turns_the_line(text: str, shown: str) -> None:
    assert safe(text) == shown


@pytest.mark.parametrize("text", ["abc", "abcdefghijklmn", "\u6f22\u5b57" * 5, "e\u0301" * 9, ""])
@pytest.mark.parametrize("width", [4, 9, 10])
def test_a_cell_is_as_wide_as_its_column(text: str, width: int) -> None:
    assert cell_len(fitted(text, width)) == width


@pytest.mark.parametrize(
    "message",
    [
        {"type": "Fin"},
        {"type": "CAM", "marks": 3},
        {"type": "Ack", "of": 5, "session": {"a": 1}, "src": [1], "dst": {}},
        {"type": "\x1b[2J", "session": [1, [2]], "proposal": True, "reason": ["x" * 10_000]},
    ],
)
def test_any_message_has_words(tmp_path: Path, message: Line) -> None:
    for ev in ("send", "receive"):
        one = RECORD.validate_json(json.dumps(event(ev, seq=1, tx="7:1", message=message)))
        assert isinstance(one, Send | Receive)
        assert summary(one).isprintable() and len(summary(one)) <= 300
    both = [log(tmp_path, s, event("send", tx=f"{s}:1", message=message)) for s in (7, 8)]
    assert len(placed(rows(*both, session=(7, 1), cams=True))) in (0, 2)
    assert len(placed(rows(*both, cams=True))) == 2


@pytest.mark.slow
def test_long_logs_are_merged_in_bounded_memory(tmp_path: Path) -> None:
    said_ = {"message": fin(7, 8), "x_pad": "x" * 400}
    sent = [event("send", n, tx=f"7:{n}", **said_) for n in range(800)]
    received = [event("receive", n, tx=f"7:{n}", **said_) for n in range(800)]
    paths = [log(tmp_path, 7, *sent), log(tmp_path, 8, *received)]
    tracemalloc.start()
    assert sum(1 for _ in Logs(paths).filtered(Filter(), last=3)) == 3
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 1_000_000
