"""How a log is streamed, what counts as missing, and that the quick way reads the same."""

import json
import tracemalloc
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any

import pytest
from edits import HEADER, Line, end, write
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from pydantic import ValidationError

from automcm_spec.log_format.log import RECORD, CamFields, record, typed
from automcm_spec.log_format.reader import MOST_WARNINGS, LogStream, read
from automcm_spec.support.bad_input import BadInput


def restart(seq: int, **fields: Any) -> Line:
    return {"rec": "event", "seq": seq, "t_ms": 0, "ev": "restart", **fields}


def test_a_stream_gives_the_header_then_the_events_then_the_end(tmp_path: Path) -> None:
    log = LogStream(write(tmp_path, HEADER, restart(1), restart(2), end(2)))
    assert (log.header.station, log.ended, log.events) == (7, False, 0)
    assert [(line, event.seq) for line, event in log] == [(2, 1), (3, 2)]
    assert log.ended and log.events == 2
    assert (log.gap, log.truncated, log.warnings) == (None, False, [])


def test_a_stream_ends_before_a_gap(tmp_path: Path) -> None:
    path = write(tmp_path, HEADER, restart(1), restart(4), end(4))
    log = LogStream(path)
    assert [line for line, _ in log] == [2]
    assert log.gap == (3, "seq: 4 after 1, expected 2: 2 missing") and not log.ended
    assert log.warnings == [f"{path}:3: {log.gap[1]}"]
    whole = LogStream(path, past_gaps=True)
    assert [line for line, _ in whole] == [2, 3]
    assert whole.gap == log.gap and whole.ended


def test_what_is_missing_before_the_first_event_is_no_gap(tmp_path: Path) -> None:
    log = LogStream(write(tmp_path, HEADER, restart(3, ev="song"), restart(4), restart(6)))
    assert not log.mid_session
    assert [line for line, _ in log] == [3]
    assert log.mid_session and not log.complete and log.gap is not None and log.gap[0] == 4


@pytest.mark.parametrize("seq", [1, 2])
def test_a_seq_that_repeats_or_goes_back_is_no_gap(tmp_path: Path, seq: int) -> None:
    path = write(tmp_path, HEADER, restart(1), restart(2), restart(seq))
    with pytest.raises(BadInput, match=rf"{seq} after 2, expected 3 \[seq\]$"):
        list(LogStream(path))


@pytest.mark.parametrize(
    ("rubbish", "problem"),
    [
        (b"\x00\xff\xfe\n", "not UTF-8 at byte 2"),
        (b"%PDF-1.4", "not JSON"),  # no line feed, and yet not a line that was cut
        (b'{"rec":"header","schema":"automcm.trace/2"}\n', "is not supported"),
        (b'{"rec":"event","seq":2,"t_ms":0,"ev":"receive"}\n', "exactly one"),
    ],
)
def test_what_is_good_before_rubbish_is_given(tmp_path: Path, rubbish: bytes, problem: str) -> None:
    log = LogStream(write(tmp_path, HEADER, restart(1), rubbish, restart(2)))
    if rubbish.startswith(b"%"):
        log = LogStream(write(tmp_path, HEADER, restart(1), rubbish))
    events = iter(log)
    assert next(events)[0] == 2
    with pytest.raises(BadInput, match=problem) as caught:
        next(events)
    assert caught.value.line == 3


@pytest.mark.parametrize("tail", [b'{"rec":"ev', b'{"rec":"\xc3', b"\0" * 512, b'{"rec"\0\0'])
def test_a_last_line_that_was_being_written_is_cut(tmp_path: Path, tail: bytes) -> None:
    log = LogStream(write(tmp_path, HEADER, restart(1), tail))
    assert [line for line, _ in log] == [2]
    assert log.truncated and not log.ended and len(log.warnings) == 2  # cut, and no end


@pytest.mark.parametrize(
    ("start", "said"),
    [
        (b"\xef\xbb\xbf" + json.dumps(HEADER).encode(), "byte order mark"),
        (json.dumps(HEADER).encode("utf-16"), "UTF-16"),
        (b"\x1f\x8b\x08\x00\x00\x00\x00\x00", "gzip"),
        (b"\x89PNG\r\n\x1a\n", "PNG"),
        (b"PK\x03\x04", "zip"),
        (b"[\n", "one JSON object per line"),
        (b'{"ts":1}\n', "must be a header of automcm.trace/1"),
    ],
)
def test_the_wrong_file_is_named_for_what_it_is(tmp_path: Path, start: bytes, said: str) -> None:
    with pytest.raises(BadInput, match=said) as caught:
        LogStream(write(tmp_path, start))
    assert caught.value.line == 1


def test_warnings_are_kept_within_bounds(tmp_path: Path) -> None:
    songs = [restart(n, ev="song") for n in range(1, 101)]
    log = LogStream(write(tmp_path, HEADER, *songs, end(100)))
    assert not list(log)
    assert len(log.warnings) == MOST_WARNINGS < 100


@pytest.mark.slow
def test_a_long_log_is_streamed_in_bounded_memory(tmp_path: Path) -> None:
    def lines() -> Iterator[bytes]:
        yield json.dumps(HEADER).encode() + b"\n"
        for n in range(1, 20_001):
            yield json.dumps(restart(n, x_padding="x" * 400)).encode() + b"\n"

    path = tmp_path / "7.ndjson"
    path.write_bytes(b"".join(lines()))
    assert path.stat().st_size > 9_000_000
    tracemalloc.start()
    assert sum(1 for _ in LogStream(path)) == 20_000
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 500_000


JSON = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=5),
    lambda inner: (
        st.lists(inner, max_size=3)
        | st.dictionaries(st.text(max_size=5) | st.just("x_y"), inner, max_size=3)
    ),
    max_leaves=8,
)
NUMBERS = ("src", "generation_ms", "x_mm", "y_mm", "heading_mrad", "speed_mm_s")
CAM: Line = {"v": 1, "type": "CAM"} | dict.fromkeys(NUMBERS, 1) | {"marks": [[7, 1]], "sigma_mm": 6}
EVENTS: list[Line] = [
    HEADER,
    restart(1),
    end(1),
    restart(1, ev="send", tx="7:1", message={"type": "CAM", "x_mm": 1}),
    restart(1, ev="receive", message=CAM),
    restart(1, ev="receive", message=CAM, rejected="stale"),
    restart(1, ev="receive", raw="AAA="),
    restart(1, ev="command", command={"name": "abort", "x_why": 1, "session": [7, 1]}),
    restart(1, ev="indication", indication={"name": "fallback", "why": [1, {"a": True}]}),
    restart(1, ev="timer", op="arm", timer={"name": "cam"}, deadline=3),
    restart(1, ev="timer", op="stop", timer={"name": "resend", "message": {"type": "Fin"}}),
]


@st.composite
def lines_(draw: st.DrawFn) -> bytes:
    line = json.loads(json.dumps(draw(st.sampled_from(EVENTS))))
    where = draw(
        st.sampled_from([line, *(inner for inner in line.values() if isinstance(inner, dict))])
    )
    key = draw(st.sampled_from([*where, "x_y", "rule", "raw", "nullable"]))
    where[key] = draw(JSON)
    if draw(st.booleans()):
        where.pop(key)
    return json.dumps(line, ensure_ascii=draw(st.booleans())).encode(errors="replace")


def only_log_errors(path: Path, content: bytes) -> None:
    path.write_bytes(content)
    try:
        log = read(path)
    except BadInput as error:
        assert str(error).isprintable()
    else:
        assert all(warning.isprintable() for warning in log.warnings)


same_folder = settings(suppress_health_check=[HealthCheck.function_scoped_fixture], deadline=None)


@same_folder
@given(lines=st.lists(lines_() | st.binary(max_size=30), max_size=3))
def test_damaged_lines_raise_nothing_but_log_errors(tmp_path: Path, lines: list[bytes]) -> None:
    first = json.dumps(HEADER).encode()
    only_log_errors(tmp_path / "log", b"\n".join([first, *lines, b""]))


def outcome(line: bytes, quick: bool) -> Any:
    try:
        return record(line) if quick else RECORD.validate_json(line)
    except ValidationError as error:
        return error.errors(include_url=False, include_input=False)


@given(line=lines_())
def test_the_quick_way_to_read_a_line_says_the_same(line: bytes) -> None:
    assert repr(outcome(line, True)) == repr(outcome(line, False))


def with_each_value(value: Any, other: Any) -> Iterator[Any]:
    """The same JSON with another value in place of one, for each that it has."""
    if isinstance(value, dict):
        for key, inner in value.items():
            yield from (value | {key: odd} for odd in with_each_value(inner, other))
    elif isinstance(value, list):
        for at, inner in enumerate(value):
            yield from (
                [*value[:at], odd, *value[at + 1 :]] for odd in with_each_value(inner, other)
            )
    yield other


BOUNDS = [0, 2, 2**32, -(2**53), 2**53, 1.0, True, "1", [], [1], [[7, 1]] * 255, [[7, 1]] * 256]
ODD = [None, 0.0, -0.0, 1.0, 2.0, 1e3, 0.5, 1, True, "1", [0.0], {"a": 1.0}]


@pytest.mark.parametrize("other", ODD)
def test_the_quick_way_takes_no_odd_value(other: Any) -> None:
    lines = [*EVENTS, restart(1, ev="send", tx="7:1", message={"type": "Fin", "a": [[1]]})]
    for line in lines:
        for changed in with_each_value(line, other):
            data = json.dumps(changed).encode()
            assert repr(outcome(data, True)) == repr(outcome(data, False)), data


@pytest.mark.parametrize("other", BOUNDS)
def test_end_5_a_cam_in_a_record_is_as_well_formed_as_its_fields(other: Any) -> None:
    def read(fields: Any) -> Any:
        return record(json.dumps(restart(1, ev="send", tx="7:1", message=fields)).encode())

    assert isinstance(read(CAM).message, CamFields)
    more = ({**CAM, name: other} for name in ("length_mm", "station_type", "x_y", "dst"))
    less = ({key: CAM[key] for key in CAM if key != name} for name in CAM if name != "type")
    for fields in [*with_each_value(CAM, other), *more, *less]:
        with suppress(ValidationError):  # a float
            assert typed(read(fields).message) == typed(fields), fields
