"""What a writer writes, the reader reads; what the format refuses, the writer does not write."""

import io
from pathlib import Path
from typing import Any

import pytest

from automcm_spec.log_format.log import Send
from automcm_spec.log_format.reader import read
from automcm_spec.log_format.writer import LogWriter

ADVERTISEMENT = {"type": "Advertisement", "src": 7, "session": (7, 1), "seq": 1}


def writer(target: str | Path | io.BytesIO, **header: Any) -> LogWriter:
    return LogWriter(
        target, **{"run": "r1", "station": 7, "implementation": "ours", "version": "0", **header}
    )


def test_writes_canonical_lines() -> None:
    stream = io.BytesIO()
    with writer(
        stream, parameters={"t_life": 9, "t_resend": 1}, complete=["send", "receive"], spec_hash="a"
    ) as log:
        log.event(
            "send", 3, role="é", phase="WAITING", rule="ADV-1", message={"type": "Fin"}, tx="7:1"
        )
    assert stream.getvalue().decode().splitlines() == [
        '{"rec":"header","schema":"automcm.trace/1","run":"r1","station":7,'
        '"implementation":{"name":"ours","version":"0"},"spec":{"name":"Station","hash":"a"},'
        '"parameters":{"t_resend":1,"t_life":9},"complete":["receive","send"]}',
        '{"rec":"event","seq":1,"t_ms":3,"ev":"send","tx":"7:1","message":{"type":"Fin"},'
        '"rule":"ADV-1","phase":"WAITING","role":"é"}',
        '{"rec":"end","seq":1,"reason":"clean","lost_records":0}',
    ]


def test_the_reader_reads_what_was_written(tmp_path: Path) -> None:
    path = tmp_path / "7.ndjson"
    fin = {"type": "Fin", "to": 8, "session": (7, 1), "seq": 2}
    with writer(path, parameters={"max_rounds": 3}, complete=("timer",)) as log:
        numbers = [
            log.event("restart", 0, rule="END-8"),
            log.event("command", 1, command={"name": "request", "details": {"lane": 2}}),
            log.event("send", 1, tx="7:1", message=ADVERTISEMENT, role=None),
            log.event("receive", 2, tx="8:1", message=ADVERTISEMENT, planned={"t0": 2}),
            log.event("receive", 2, tx="8:2", raw="/wA="),
            log.event("timer", 3, op="arm", timer={"name": "resend", "message": fin}, deadline=103),
            log.event("timer", 3, op="stop", timer={"name": "forget", "station": 8}),
            log.event("indication", 3, indication={"name": "ended", "reason": "timeout"}),
        ]
    read_back = read(path)
    assert numbers == list(range(1, 9)) == [event.seq for _, event in read_back.events]
    assert read_back.warnings == []
    assert read_back.header.known["max_rounds"] == 3
    sent = read_back.events[2][1]
    assert isinstance(sent, Send)
    assert sent.message == {**ADVERTISEMENT, "session": [7, 1]}


def test_an_exception_ends_the_log_as_a_crash(tmp_path: Path) -> None:
    with pytest.raises(ZeroDivisionError), writer(tmp_path / "log"):
        raise ZeroDivisionError
    end = read(tmp_path / "log").end
    assert end is not None
    assert end.reason == "crash"


def test_every_event_is_flushed(tmp_path: Path) -> None:
    log = writer(tmp_path / "log")
    log.event("restart", 0)
    assert len(read(tmp_path / "log").events) == 1
    log.end("power off", lost_records=2)
    end = read(tmp_path / "log").end
    assert end is not None
    assert (end.seq, end.reason, end.lost_records) == (1, "power off", 2)


@pytest.mark.parametrize(
    ("ev", "t_ms", "fields", "problem"),
    [
        ("restart", 4, {}, "t_ms: must not decrease, from 5 to 4"),
        ("restart", 5.0, {}, "t_ms: must be an integer number of milliseconds, not 5.0"),
        ("restart", True, {}, "t_ms: must be an integer number"),
        ("song", 5, {}, "ev: must be one of"),
        ("restart", 5, {"tx": "7:1"}, "tx: unknown field"),
        (
            "send",
            5,
            {"tx": "7:1", "message": {"type": "CAM", "speed": 1.5}},
            "message.speed: must be",
        ),
        ("send", 5, {"tx": "7:1", "message": {"type": "CAM", "a": None}}, "message.a: null"),
        (
            "send",
            5,
            {"tx": "7:1", "message": {"type": "CAM", "a": {1}}},
            "message.a: must be a JSON value, not a Python set",
        ),
        ("send", 5, {"tx": "7:1", "message": {"type": "CAM", 1: 2}}, "message: the key 1 is not"),
        ("send", 5, {"tx": "7:1", "message": {"type": "\ud800"}}, "not JSON"),
    ],
)
def test_refuses_without_writing(ev: str, t_ms: int, fields: Any, problem: str) -> None:
    stream = io.BytesIO()
    log = writer(stream)
    log.event("restart", 5)
    before = stream.getvalue()
    with pytest.raises(ValueError, match=problem):
        log.event(ev, t_ms, **fields)
    assert stream.getvalue() == before
    assert log.event("restart", 5) == 2


def test_refuses_a_bad_header_before_it_opens_the_file(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="station: must be at least 1"):
        writer(tmp_path / "log", station=0)
    with pytest.raises(ValueError, match=r"parameters\.tea: unknown field"):
        writer(tmp_path / "log", parameters={"tea": 1})
    assert not (tmp_path / "log").exists()
