"""What the log format takes, what it refuses, and how the reader says so."""

import json
from pathlib import Path

import edits
import pytest
from edits import Line, write

from automcm_spec.log_format.log import MessageTimer, Receive, TimerArm, problems
from automcm_spec.log_format.reader import LONGEST_LINE, read
from automcm_spec.support.bad_input import BadInput

HEADER = edits.HEADER | {"spec": {"name": "Station", "hash": "abc"}}
EVENT: Line = {"rec": "event", "seq": 1, "t_ms": 5}
RESTART: Line = EVENT | {"t_ms": 0, "ev": "restart"}
MESSAGE: Line = {"v": 1, "type": "Advertisement", "src": 7, "session": [7, 1], "seq": 1}
SEND: Line = EVENT | {"ev": "send", "tx": "7:1", "message": MESSAGE}
RECEIVE: Line = SEND | {"ev": "receive"}
RAW: Line = EVENT | {"ev": "receive", "tx": "8:3", "raw": ""}
RESENT: Line = {"type": "Fin", "to": 8, "session": [7, 1], "seq": 2}
ARMED: Line = {"name": "resend", "message": RESENT}
TIMER: Line = EVENT | {"ev": "timer", "op": "arm", "timer": ARMED, "deadline": 105}
DONE: Line = {key: value for key, value in TIMER.items() if key != "deadline"}
PRESCRIBED: Line = {"t0": 0, "points": [[0, 1, 2]]}
COMMAND: Line = EVENT | {
    "ev": "command",
    "command": {"name": "prescribe", "target": 8, "prescribed": PRESCRIBED},
}
INDICATION: Line = EVENT | {"ev": "indication", "indication": {"name": "intended", "station": 8}}
END: Line = {"rec": "end", "seq": 1, "reason": "clean", "lost_records": 0}


def refused(folder: Path, *lines: Line | bytes) -> BadInput:
    """The error of reading a log of these lines; every one must be a single readable line."""
    path = write(folder, *lines)
    with pytest.raises(BadInput) as caught:
        read(path)
    text = str(caught.value)
    assert text.isprintable()
    assert text.startswith(str(path))
    return caught.value


def numbered(*events: Line) -> list[Line]:
    return [{**event, "seq": seq} for seq, event in enumerate(events, 1)]


def test_act_4_a_deadline_is_a_time_and_the_longest_lease(tmp_path: Path) -> None:
    late = TIMER | {"t_ms": 2**53 - 1, "deadline": 2**54 - 2}
    assert len(read(write(tmp_path, HEADER, late, END)).events) == 1


def test_reads_a_whole_log(tmp_path: Path) -> None:
    events = numbered(RESTART, SEND, RECEIVE, TIMER, COMMAND, INDICATION)
    log = read(write(tmp_path, HEADER, *events, {**END, "seq": 6}))
    assert log.header.station == 7
    assert log.header.complete == ("receive", "send")
    assert log.header.known["t_resend"] == 100
    assert [line for line, _ in log.events] == [2, 3, 4, 5, 6, 7]
    assert [event.ev for _, event in log.events] == [event["ev"] for event in events]
    assert (log.ended, log.truncated, log.warnings) == (True, False, [])


def test_an_event_keeps_what_it_says(tmp_path: Path) -> None:
    observed = {**RECEIVE, "planned": {"t0": 5}, "rule": "ADV-3", "phase": "WAITING"}
    log = read(write(tmp_path, HEADER, *numbered(observed, TIMER), {**END, "seq": 2}))
    received, armed = (event for _, event in log.events)
    assert isinstance(received, Receive)
    assert received.message == MESSAGE
    assert received.planned == {"t0": 5}
    assert (received.rule, received.phase, received.role) == ("ADV-3", "WAITING", None)
    assert isinstance(armed, TimerArm)
    assert armed.deadline == 105
    assert isinstance(armed.timer, MessageTimer)
    assert armed.timer.message is not None
    assert armed.timer.message.session == (7, 1)


TAKEN: list[Line] = [
    {**RECEIVE, "message": {"type": "CAM", "x_note": 1, "anything": [True, {"a": "b"}]}},
    RAW,
    {**RAW, "raw": "/wA="},
    {**RAW, "rejected": "stale"},
    {**RESTART, "rule": "END-8", "phase": "STANDALONE"},
    {**TIMER, "timer": {"name": "giveup"}},
    {**TIMER, "timer": {"name": "forget", "station": 9}},
    {**TIMER, "timer": {"name": "lease"}},
    {**DONE, "op": "stop"},
    {**DONE, "op": "expire"},
]


@pytest.mark.parametrize("line", TAKEN)
def test_takes(tmp_path: Path, line: Line) -> None:
    assert len(read(write(tmp_path, HEADER, line, END)).events) == 1


def test_vendor_fields_are_ignored(tmp_path: Path) -> None:
    header = {**HEADER, "x_build": 3, "implementation": {**HEADER["implementation"], "x_os": "b"}}
    command = {**COMMAND, "x_a": [1], "command": {**COMMAND["command"], "x_b": "c"}}
    log = read(write(tmp_path, header, command, {**END, "x_c": True}))
    plain = read(write(tmp_path, HEADER, COMMAND, END))
    assert log == plain


REFUSED: list[tuple[Line, Line, str, str]] = [
    (
        HEADER,
        {"schema": "automcm.trace/2"},
        "schema",
        "must be 'automcm.trace/1'; the version 'automcm.trace/2'",
    ),
    (HEADER, {"schema": "automcm.trace/2", "clock": 1.5}, "schema", "is not supported"),
    (HEADER, {"schema": 1}, "schema", "is not supported"),
    (HEADER, {"station": 0}, "station", "must be at least 1"),
    (HEADER, {"station": 2**32}, "station", "must be at most 4294967295"),
    (HEADER, {"station": "7"}, "station", "integer"),
    (HEADER, {"station": True}, "station", "integer"),
    (HEADER, {"run": ""}, "run", "must not be empty"),
    (HEADER, {"host": "a"}, "host", "unknown field"),
    (HEADER, {"implementation": {"name": "a"}}, "implementation.version", "missing"),
    (HEADER, {"implementation": 3}, "implementation", "not a JSON object"),
    (HEADER, {"spec": {"name": "Other", "hash": "a"}}, "spec.name", "Station"),
    (HEADER, {"spec": None}, "spec", "null"),
    (
        HEADER,
        {"parameters": {"t_resend": 0.1}},
        "parameters.t_resend",
        "must be an integer number of milliseconds, not 0.1",
    ),
    (HEADER, {"parameters": {"t_resend": -1}}, "parameters.t_resend", "must be at least 0"),
    (HEADER, {"parameters": {"t_unheard": 1}}, "parameters.t_unheard", "unknown field"),
    (HEADER, {"complete": ["send", "receive"]}, "complete", "sorted"),
    (HEADER, {"complete": ["send", "send"]}, "complete", "without duplicates"),
    (HEADER, {"complete": ["sleep"]}, "complete[0]", "'timer'"),
    (RESTART, {"rec": "evnt"}, "rec", "must be one of"),
    (RESTART, {"rec": 1}, "rec", "must be one of"),
    (RESTART, {"ev": 4}, "ev", "string"),
    (RESTART, {"seq": 0}, "seq", "must be at least 1"),
    (RESTART, {"seq": 1.0}, "seq", "must be an integer, not 1.0"),
    (RESTART, {"t_ms": -1}, "t_ms", "must be at least 0"),
    (RESTART, {"t_ms": 2**53}, "t_ms", "must be at most"),
    (RESTART, {"t_ms": None}, "t_ms", "null"),
    (RESTART, {"message": MESSAGE}, "message", "unknown field"),
    (RESTART, {"rule": 3}, "rule", "string"),
    (RESTART, {"a\nb": 3}, "a\nb", "unknown field"),
    (RESTART, {"x_load": 0.5}, "x_load", "must be an integer, not 0.5"),
    (TIMER, {"deadline": 2**54 - 1}, "deadline", "must be at most"),
    (SEND, {"tx": "7"}, "tx", 'such as "7:1"'),
    (SEND, {"tx": 7}, "tx", "string"),
    (SEND, {"message": []}, "message", "not a JSON object"),
    (SEND, {"message": {"src": 7}}, "message.type", "must have a string"),
    (SEND, {"message": {"type": 7}}, "message.type", "must have a string"),
    (
        SEND,
        {"message": {"type": "CAM", "speed": 1.5}},
        "message.speed",
        "must be an integer, not 1.5",
    ),
    (SEND, {"message": {"type": "CAM", "a": [1, {"b": None}]}}, "message.a[1].b", "null"),
    (SEND, {"raw": "AA=="}, "raw", "unknown field"),
    (RECEIVE, {"raw": "AA=="}, "message", "exactly one"),
    (RECEIVE, {"planned": [1]}, "planned", "not a JSON object"),
    (RECEIVE, {"message": {"type": "Fin"}, "planned": {}}, "planned", "only with"),
    (TIMER, {"op": "rewind"}, "op", "must be one of 'arm', 'stop', 'expire', not 'rewind'"),
    (TIMER, {"op": "stop"}, "deadline", "unknown field"),
    (TIMER, {"timer": {"name": "tea"}}, "timer.name", "must be one of"),
    (TIMER, {"timer": {}}, "timer.name", "missing"),
    (TIMER, {"timer": 3}, "timer", "not a JSON object"),
    (TIMER, {"timer": {"name": "cam", "station": 1}}, "timer.station", "unknown field"),
    (
        TIMER,
        {"timer": ARMED | {"message": RESENT | {"session": [7]}}},
        "timer.message.session[1]",
        "missing",
    ),
    (COMMAND, {"command": {"name": "dance"}}, "command.name", "'request'"),
    (COMMAND, {"command": {"name": "abort", "why": None}}, "command.why", "null"),
    (INDICATION, {"indication": {}}, "indication.name", "missing"),
    (RAW, {"raw": "A"}, "raw", "must be base64"),
    (RAW, {"rejected": ""}, "rejected", "must not be empty"),
    (RECEIVE, {"rejected": "stale"}, "rejected", "only with 'raw'"),
]


@pytest.mark.parametrize(("record", "change", "field", "problem"), REFUSED)
def test_refuses_in_a_record(
    tmp_path: Path, record: Line, change: Line, field: str, problem: str
) -> None:
    lines = [record | change] if record is HEADER else [HEADER, record | change]
    error = refused(tmp_path, *lines, RESTART, END)
    assert (error.line, error.field) == (len(lines), field)
    assert problem in error.problem


REQUIRED: list[tuple[Line, tuple[str, ...]]] = [
    (HEADER, ("schema", "run", "station", "implementation", "parameters")),
    (SEND, ("tx", "message")),
    (RECEIVE, ("message",)),
    (TIMER, ("op", "timer", "deadline")),
    (COMMAND, ("command",)),
    (RESTART, ("ev", "seq", "t_ms", "rec")),
]


@pytest.mark.parametrize(
    ("record", "fields"),
    REQUIRED,
    ids=lambda value: value.get("ev", "header") if isinstance(value, dict) else "",
)
def test_refuses_a_record_that_lacks(tmp_path: Path, record: Line, fields: tuple[str, ...]) -> None:
    for field in fields:
        rest = {name: value for name, value in record.items() if name != field}
        lines = [rest] if record is HEADER else [HEADER, rest]
        error = refused(tmp_path, *lines, END)
        assert (error.line, error.field) == (len(lines), field)
        assert record is RECEIVE or error.problem.split(":")[0] == "missing"


@pytest.mark.parametrize(
    ("lines", "line", "field", "problem"),
    [
        ((), 0, "", "empty file"),
        ((RESTART, END), 1, "rec", "the first line must be the header"),
        ((HEADER, HEADER), 2, "rec", "a second header"),
        ((HEADER, RESTART, {**RESTART, "seq": 3}), 3, "seq", "3 after 1, expected 2"),
        ((HEADER, RESTART, RESTART), 3, "seq", "1 after 1, expected 2"),
        ((HEADER, *numbered(RESTART, RESTART), RESTART), 4, "seq", "1 after 2, expected 3"),
        ((HEADER, {**RESTART, "seq": 2}), 2, "seq", "2 after 0, expected 1"),
        ((HEADER, *numbered(SEND, RESTART)), 3, "t_ms", "must not decrease, from 5 to 0"),
        ((HEADER, RESTART, {**END, "seq": 2}), 3, "seq", "2, but the last event has 1"),
        ((HEADER, RESTART, END, {**RESTART, "seq": 2}), 4, "rec", "a record after the end"),
        (
            (HEADER, RESTART, END, {**HEADER, "station": 8}),
            4,
            "rec",
            "a second header: a file contains one log",
        ),
        ((HEADER, RESTART, END, b"{"), 4, "", "not JSON"),
        ((HEADER, b"{\n", RESTART), 2, "", "not JSON"),
        ((HEADER, b"\n", RESTART), 2, "", "empty line"),
        ((HEADER, b"[1]\n"), 2, "", "not a JSON object"),
        ((HEADER, b"3\n"), 2, "", "not a JSON object"),
        ((HEADER, b"NaN\n"), 2, "", "not "),
        ((HEADER, b'{"rec":"ev\xff"}\n'), 2, "", "not UTF-8 at byte 11"),
        ((b"\x7fELF\x02\x01\x00\x00\xff",), 1, "", "not UTF-8"),
        ((b"\x00\x01\x02",), 1, "", "not JSON"),
        ((b'{"rec":"header","sch',), 1, "", "not JSON"),
        ((HEADER, b"[" * 100_000 + b"\n"), 2, "", "not JSON"),
        ((HEADER, b" " * (LONGEST_LINE + 1)), 2, "", "longer than"),
        ((HEADER, RESTART, {**END, "lost_records": -1}), 3, "lost_records", "must be at least 0"),
        ((HEADER, RESTART, {**END, "rule": "END-8"}), 3, "rule", "unknown field"),
    ],
)
def test_refuses_a_log(
    tmp_path: Path, lines: tuple[Line | bytes, ...], line: int, field: str, problem: str
) -> None:
    error = refused(tmp_path, *lines)
    assert (error.line, error.field) == (line, field)
    assert problem in error.problem


def test_the_text_of_an_error_names_file_line_and_field(tmp_path: Path) -> None:
    error = refused(tmp_path, HEADER, {**RESTART, "seq": 4})
    assert str(error) == f"{tmp_path}/7.ndjson:2: seq: 4 after 0, expected 1 [seq]"
    assert (error.path, error.line, error.rule) == (f"{tmp_path}/7.ndjson", 2, "seq")


@pytest.mark.parametrize(
    ("name", "problem"),
    [("none", "none: no such file$"), ("", "is a directory"), ("7.ndjson/log", "cannot be read")],
)
def test_refuses_what_is_no_file(tmp_path: Path, name: str, problem: str) -> None:
    write(tmp_path, HEADER)
    with pytest.raises(BadInput, match=problem):
        read(tmp_path / name)


def test_a_last_line_that_only_lacks_its_end_counts(tmp_path: Path) -> None:
    log = read(write(tmp_path, HEADER, RESTART, json.dumps(END).encode()))
    assert (log.truncated, log.ended, log.warnings) == (False, True, [])


def test_a_missing_end_is_a_warning(tmp_path: Path) -> None:
    path = write(tmp_path, HEADER, RESTART)
    log = read(path)
    assert (log.ended, log.truncated) == (False, False)
    assert log.warnings == [f"{path}:2: the log has no end record"]


def test_an_unknown_event_is_skipped_with_a_warning(tmp_path: Path) -> None:
    unknown = {"rec": "event", "seq": 1, "t_ms": 3, "ev": "so\nng", "tune": [1]}
    path = write(tmp_path, HEADER, *numbered(unknown, SEND), {**END, "seq": 2})
    log = read(path)
    assert [line for line, _ in log.events] == [3]
    assert log.warnings == [f"{path}:2: unknown event 'so\\nng', ignored"]


@pytest.mark.parametrize(
    ("change", "field"),
    [({"seq": 2}, "seq"), ({"t_ms": -1}, "t_ms"), ({"tune": 0.5}, "tune"), ({"rule": 1}, "rule")],
)
def test_an_unknown_event_still_counts(tmp_path: Path, change: Line, field: str) -> None:
    error = refused(tmp_path, HEADER, {**RESTART, "ev": "song", **change})
    assert (error.line, error.field) == (2, field)


COMMON: Line = {"v": 1, "src": 7, "dst": 8, "session": [7, 1], "seq": 1}
PATH: Line = {"t0": 0, "points": [[0, 0, 0]]}
CANCEL: Line = {**COMMON, "type": "Cancel", "reason": "abort"}
YES: Line = {**COMMON, "type": "Acceptance", "proposal": 1, "accepted": True, "selected": PATH}


@pytest.mark.parametrize(
    ("message", "found"),
    [
        (CANCEL, []),
        (YES, []),
        ({**CANCEL, "reason": "closed", "seq": 0}, []),
        ({"type": "Hello"}, [("type", "must be one of")]),
        ({**CANCEL, "colour": 1}, [("colour", "unknown field")]),
        ({**COMMON, "type": "Cancel"}, [("reason", "missing")]),
        ({n: v for n, v in CANCEL.items() if n != "v"}, [("v", "missing")]),
        ({**CANCEL, "src": 2**32}, [("src", "must be at most 4294967295")]),
        ({**CANCEL, "session": [7, True]}, [("session[1]", "must be an integer, not true")]),
        (
            {**CANCEL, "reason": "closed"},
            [("seq", "must be 0 if and only if the reason is closed")],
        ),
        ({**YES, "reason": "busy"}, [("reason", "must be present if and only if not accepted")]),
        ({**YES, "selected": {"t0": 0, "points": []}}, [("selected.points", "Tuple should have")]),
        (
            {**YES, "proposal": 0, "accepted": 1},
            [("proposal", "must be at"), ("accepted", "must be true")],
        ),
    ],
)
def test_end_5_every_field_of_a_message_that_is_wrong_is_named(
    message: Line, found: list[tuple[str, str]]
) -> None:
    for (field, problem), (wanted, begins) in zip(problems(message), found, strict=True):
        assert (field, problem[: len(begins)]) == (wanted, begins)
