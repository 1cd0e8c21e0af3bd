"""Everything wrong with a log, not only the first thing."""

from __future__ import annotations

import base64
import json
import tracemalloc
from pathlib import Path
from typing import Any

import edits
import pytest
from edits import Line, end, write
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from merged_runs import simulated

from automcm.security import cose
from automcm_spec.log_format.number_sets import Numbers
from automcm_spec.log_format.reader import LONGEST_LINE, read
from automcm_spec.support.bad_input import BadInput
from automcm_traces.explain.lint import CHECKS, exit_code, level, lint, report, text

HEADER = edits.HEADER | {"complete": ["send", "timer"]}
FIN: Line = {"v": 1, "type": "Fin", "src": 7, "dst": 8, "session": [7, 1], "seq": 2}
RESEND: Line = {"name": "resend", "message": {"type": "Fin", "session": [7, 1], "seq": 2, "to": 8}}


def event(seq: int, ev: str = "restart", **fields: Any) -> Line:
    return {"rec": "event", "seq": seq, "t_ms": seq, "ev": ev, **fields}


def send(seq: int, tx: str = "7:1", **fields: Any) -> Line:
    return event(seq, "send", tx=tx, message={**FIN, **fields})


def arm(seq: int, deadline: int = 900) -> Line:
    return event(seq, "timer", op="arm", timer=RESEND, deadline=deadline)


def found(folder: Path, *lines: Line | bytes) -> list[tuple[int, str, str]]:
    """Line, check and field of each finding."""
    return [(f.at.line, f.rule, f.at.field) for f in lint(write(folder, *lines))]


def test_the_logs_of_the_reference_are_clean(tmp_path: Path) -> None:
    run: dict[str, Any] = {"seed": 5, "loss": 0.2, "duplicate": 0.2, "restarts": {3003: 1500}}
    paths = simulated(tmp_path, 1001, 2002, 3003, until=6_000, target=2002, **run)
    reports = [report(path) for path in paths]
    assert len(reports) == 3 and exit_code(reports) == 0
    assert [found for r in reports for found in r.findings] == []


CASES: list[tuple[str, list[Line | bytes], list[tuple[int, str, str]]]] = [
    ("gap", [HEADER, event(1), event(4), event(5), end(5)], [(3, "seq", "seq")]),
    ("unread", [HEADER, event(1), b"rubbish\n", event(3), end(3)], [(3, "json", "")]),
    ("gap too", [HEADER, event(1), b"x\n", event(4), end(4)], [(3, "json", ""), (4, "seq", "seq")]),
    ("unread at the end", [HEADER, event(1), b"rubbish\n", end(2)], [(3, "json", "")]),
    ("from 0", [HEADER, event(0), event(1), event(2), end(2)], [(2, "seq", "seq")]),
    ("twice", [HEADER, event(1), event(1), event(2), end(2)], [(3, "seq", "seq")]),
    ("end ahead", [HEADER, event(1), end(3)], [(3, "seq", "seq")]),
    ("end behind", [HEADER, event(1), end(0)], [(3, "seq", "seq")]),
    (
        "backwards",
        [HEADER, {**event(1), "t_ms": 9}, event(2), event(3), end(3)],
        [(3, "t_ms", "t_ms")],
    ),
    ("tx again", [HEADER, send(1), arm(2), send(3), end(3)], [(4, "tx", "tx")]),
    ("tx of another", [HEADER, send(1, "8:1"), arm(2), end(2)], [(2, "tx", "tx")]),
    ("past deadline", [HEADER, arm(1, 0), send(2), end(2)], [(2, "deadline", "deadline")]),
    ("no end", [HEADER, event(1)], [(2, "end", "")]),
    ("lost", [HEADER, event(1), end(1, 3)], [(3, "end", "lost_records")]),
    ("cut", [HEADER, event(1), b'{"rec":'], [(3, "cut", ""), (3, "end", "")]),
    ("no LF", [HEADER, json.dumps(end(0)).encode()], [(2, "text", "")]),
    ("CR LF", [HEADER, json.dumps(end(0)).encode() + b"\r\n"], [(2, "text", "")]),
    ("empty line", [HEADER, b"\n", end(0)], [(2, "text", "")]),
    ("not UTF-8", [HEADER, b'"\xff"\n', end(0)], [(2, "text", "")]),
    ("not JSON", [HEADER, b"}\n", end(0)], [(2, "json", "")]),
    ("an array", [HEADER, b"[]\n", end(0)], [(2, "json", "")]),
    ("rubbish at the end", [HEADER, end(0), b"\x01\x02"], [(3, "json", "")]),
    ("unknown event", [HEADER, event(1, "song"), end(1)], [(2, "unknown", "ev")]),
    (
        "unknown hints",
        [HEADER, event(1, rule="X", phase="Y", role="Z"), end(1)],
        [(2, "unknown", "phase"), (2, "unknown", "role"), (2, "unknown", "rule")],
    ),
    ("no header", [event(1), end(1)], [(1, "order", "rec")]),
    ("two headers", [HEADER, HEADER, end(0)], [(2, "order", "rec")]),
    ("after the end", [HEADER, end(0), event(1)], [(3, "order", "rec")]),
    (
        "another version",
        [HEADER, event(1), {**HEADER, "schema": "automcm.trace/2"}, end(1)],
        [(3, "schema", "schema"), (3, "order", "rec")],
    ),
    ("float", [HEADER, {**event(1), "x_load": 0.5}, end(1)], [(2, "schema", "x_load")]),
    ("null", [HEADER, {**event(1), "rule": None}, end(1)], [(2, "schema", "rule")]),
    (
        "key twice",
        [HEADER, b'{"rec":"event","seq":1,"seq":1,"t_ms":0,"ev":"restart"}\n', end(1)],
        [(2, "key", "seq")],
    ),
    (
        "key twice within",
        [
            HEADER,
            b'{"rec":"event","seq":1,"t_ms":0,"ev":"command","command":{"name":"abort","a":1,"a":2}}\n',
            end(1),
        ],
        [(2, "key", "a")],
    ),
    (
        "two in one line",
        [HEADER, event(1, deadline=3, tx="7:1"), end(1)],
        [(2, "schema", "deadline"), (2, "schema", "tx")],
    ),
    (
        "a bad event still counts",
        [HEADER, event(1, tx="7:1"), event(2), end(2)],
        [(2, "schema", "tx")],
    ),
    (
        "private key",
        [HEADER, event(1, x_keys=["-----BEGIN PRIVATE KEY-----\nMIGH"]), end(1)],
        [(2, "private_key", "x_keys[0]")],
    ),
    (
        "private key as JWK, in an unknown field",
        [HEADER, event(1, key={"kty": "EC", "d": "AA"}), end(1)],
        [(2, "private_key", "key.d"), (2, "schema", "key")],
    ),
    ("message", [HEADER, send(1, dst=0), arm(2), end(2)], [(2, "message", "message.dst")]),
    (
        "broadcast or not",
        [
            HEADER,
            event(1, "send", tx="7:1", message={n: v for n, v in FIN.items() if n != "dst"}),
            send(2, "7:2", type="Advertisement", scenario="", details={}),
            arm(3),
            end(3),
        ],
        [(2, "message", "message.dst"), (3, "message", "message.dst")],
    ),
    ("no timer", [HEADER, send(1), end(1)], [(1, "complete", "complete")]),
    ("no send", [HEADER, arm(1), end(1)], [(1, "complete", "complete")]),
    (
        "a timer that needs no send",
        [HEADER, event(1, "timer", op="arm", timer={"name": "quarantine"}, deadline=9), end(1)],
        [],
    ),
    ("no promise", [{**HEADER, "complete": []}, send(1), end(1)], []),
]


@pytest.mark.parametrize(("lines", "wanted"), [c[1:] for c in CASES], ids=[c[0] for c in CASES])
def test_finds(
    tmp_path: Path, lines: list[Line | bytes], wanted: list[tuple[int, str, str]]
) -> None:
    assert found(tmp_path, *lines) == wanted


def cose_key(private: bool) -> bytes:
    d = {-4: bytes(range(32))} if private else {}
    return cose.encode({1: 2, -1: 1, -2: bytes(32), -3: b"\xff" * 32} | d)


PRIVATE = cose.private_pem(cose.new_key())


@pytest.mark.parametrize(
    ("data", "is_key"),
    [
        (PRIVATE, True),
        (base64.b64decode(b"".join(PRIVATE.splitlines()[1:-1])), True),
        (cose_key(True), True),
        (cose_key(False), False),
        (cose.public_pem(cose.new_key().public_key()), False),
        (bytes(range(256)), False),
    ],
)
def test_private_keys_are_found_in_bytes(tmp_path: Path, data: bytes, is_key: bool) -> None:
    wanted = [(2, "private_key", "raw")] if is_key else []
    line = event(1, "receive", raw=base64.b64encode(data).decode())
    assert found(tmp_path, HEADER, line, end(1)) == wanted
    url = {"x_key": base64.urlsafe_b64encode(data).decode().rstrip("=")}
    wanted = [(2, "private_key", "x_key")] if is_key else []
    assert found(tmp_path, HEADER, event(1, **url), end(1)) == wanted


def test_what_the_reference_rejects_has_no_private_key() -> None:
    for path in (Path(__file__).parents[2] / "corpus" / "secured").iterdir():
        assert report(path).errors == 0


def test_a_private_key_is_not_repeated(tmp_path: Path) -> None:
    path = write(tmp_path, HEADER, event(1, x_key=PRIVATE.decode()), end(1))
    body = PRIVATE.splitlines()[1].decode()
    assert body not in text(report(path)) and body not in str(report(path).as_dict())


def test_every_check_is_shown_here() -> None:
    assert {check for _, _, wanted in CASES for _, check, _ in wanted} == set(CHECKS)


def test_the_documentation_has_every_check() -> None:
    text = (Path(__file__).parents[3] / "docs/trace-format.md").read_text()
    for name, (kind, wanted) in CHECKS.items():
        assert f"| `{name}` | {kind} | {wanted} |" in text


def test_what_is_clean_can_be_read_and_what_cannot_be_read_is_not_clean(tmp_path: Path) -> None:
    """The lint is never milder than the reader."""
    for _, lines, _ in CASES:
        path = write(tmp_path, *lines)
        try:
            read(path)
        except BadInput as error:
            assert error.line in {f.at.line for f in lint(path) if level(f) == "error"}


def test_a_line_that_is_too_long_is_passed_over(tmp_path: Path) -> None:
    assert found(tmp_path, HEADER, b" " * (2 * LONGEST_LINE) + b"\n", event(1), end(1)) == [
        (2, "text", "")
    ]


@pytest.mark.parametrize(
    "content", [b"", b"\x89PNG\r\n", b"\x1f\x8b", b"[]\n", b"\n", b"\xef\xbb\xbf{}"]
)
def test_what_is_no_log_at_all_is_unreadable(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "log"
    path.write_bytes(content)
    one = report(path)
    assert (one.verdict, exit_code([one]), one.findings) == ("unreadable", 3, [])
    assert text(one).startswith((f"{path}: UNREADABLE: ", f"{path}:1: UNREADABLE: "))


def test_a_missing_file_or_a_folder_is_unreadable(tmp_path: Path) -> None:
    none = tmp_path / "a: b"
    assert text(report(none)) == f"{none}: UNREADABLE: no such file"
    assert report(none).as_dict()["unreadable"] == f"{none}: no such file"
    assert text(report(tmp_path)) == f"{tmp_path}: UNREADABLE: is a directory; name a log file"


def test_the_report_says_where_and_counts_what_it_leaves_out(tmp_path: Path) -> None:
    path = write(tmp_path, HEADER, *(event(n) for n in range(2, 40, 2)))
    one = report(path, most=1)
    assert (one.verdict, one.errors, one.warnings, len(one.findings)) == ("findings", 19, 1, 1)
    assert text(one).splitlines() == [
        f"{path}:2: seq: must count from 1, not from 2; if the log was cut here, its header needs "
        '"begins": "running" [seq]',
        f"{path}: 19 more",
        f"{path}: 19 errors, 1 warning",
    ]
    assert exit_code([one]) == 1
    assert one.as_dict()["findings"][0]["check"] == "seq"


def test_a_seq_twice_and_one_that_goes_back_are_told_apart(tmp_path: Path) -> None:
    path = write(tmp_path, HEADER, event(1), event(2), event(2), event(1), event(2), end(2))
    assert [finding.observed for finding in lint(path) if finding.rule == "seq"] == [
        "2 is repeated; expected 3",
        "must not decrease, from 2 to 1",
    ]


def test_a_log_of_a_station_that_sends_rubbish_is_a_good_log(tmp_path: Path) -> None:
    one = report(write(tmp_path, HEADER, send(1, dst=0, x=1), arm(2), end(2)))
    assert (one.verdict, one.warnings) == ("clean", 2)


def test_warnings_leave_a_log_clean(tmp_path: Path) -> None:
    one = report(write(tmp_path, HEADER, event(1)))
    assert (one.verdict, one.warnings) == ("clean", 1)
    assert text(one).endswith("7.ndjson: clean, 1 warning")


def test_numbers_are_kept_as_ranges() -> None:
    numbers = Numbers()
    assert [numbers.add(n) for n in (1, 2, 3, 7, 6, 5, 9, 4, 4, 8)] == [True] * 8 + [False, True]
    assert numbers._starts == [1] and numbers._ends == [10]
    assert 9 in numbers and 10 not in numbers and 0 not in numbers


@given(st.lists(st.integers(0, 30)))
def test_numbers_are_a_set(drawn: list[int]) -> None:
    numbers, plain = Numbers(), set[int]()
    for n in drawn:
        assert numbers.add(n) == (n not in plain)
        plain.add(n)
    assert [n for n in range(-1, 32) if n in numbers] == sorted(plain)


@pytest.mark.slow
def test_a_long_log_is_linted_in_bounded_memory(tmp_path: Path) -> None:
    sends = [send(n, f"7:{n}", x_padding="x" * 400) for n in range(1, 10_001)]
    path = write(tmp_path, {**HEADER, "complete": []}, *sends)
    tracemalloc.start()
    assert sum(1 for f in lint(path) if f.rule != "message") == 1  # no end
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 1_000_000


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture], deadline=None)
@given(
    lines=st.lists(
        st.binary(max_size=40)
        | st.sampled_from(CASES).map(
            lambda case: b"".join(
                line if isinstance(line, bytes) else json.dumps(line).encode() + b"\n"
                for line in case[1]
            )
        ),
        max_size=4,
    )
)
def test_rubbish_raises_nothing_but_log_errors(tmp_path: Path, lines: list[bytes]) -> None:
    path = tmp_path / "log"
    path.write_bytes(b"".join(lines))
    assert all(str(finding).isprintable() for finding in report(path).findings)
