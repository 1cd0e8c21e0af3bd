"""``automcm trace watch``: files that grow, are missing, truncated or replaced; and datagrams."""

from __future__ import annotations

import json
import re
import signal
import socket
import subprocess
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
from cli_stage import LIMIT_S, automcm, automcm_process, broadcast, own_address
from forked_station import automcm_popen

CORPUS = Path(__file__).parents[3] / "traces/corpus"
PAIR = [CORPUS / f"pair/{station}.ndjson" for station in (1001, 2002)]
BAD = CORPUS / "bad/busy_accepted.ndjson"


@pytest.mark.parametrize("log", [PAIR[0], BAD, CORPUS / "bad/a_float.ndjson"], ids=lambda p: p.stem)
def test_a_complete_log_gets_the_verdict_and_exit_code_of_explain(log: Path) -> None:
    shown, explained = automcm("trace", "watch", log), automcm("trace", "explain", log)
    assert shown.exit_code == explained.exit_code
    more = r"  (prefix|replay|line \d+|all): "  # explain writes files, and adds what lint finds
    own = [line for line in explained.output.splitlines() if not re.match(more, line)]
    assert shown.output.splitlines() == own
    assert f"{log.parent} is a folder" in automcm("trace", "watch", log.parent).output


def test_as_json_each_report_is_one_line(tmp_path: Path) -> None:
    shown = automcm("trace", "watch", "--json", "-", *PAIR)
    reports = [json.loads(line) for line in shown.output.splitlines()]
    assert [r["report"] for r in reports] == ["begun"] * 2 + ["verdict"] * 2 + ["together", "end"]
    assert {r["verdict"] for r in reports[2:5]} == {"allowed"} and reports[-1]["exit"] == 0


@contextmanager
def watching(*words: object) -> Iterator[tuple[subprocess.Popen[str], Iterator[dict[str, Any]]]]:
    """A process that watches, and its reports."""
    process = automcm_popen("trace", "watch", "--json", "-", *words, stdout=subprocess.PIPE)
    assert process.stdout is not None
    try:
        yield process, (json.loads(line) for line in process.stdout)
    finally:
        process.kill()
        process.wait()
        process.stdout.close()


def test_a_file_may_come_later_be_truncated_and_be_replaced(tmp_path: Path) -> None:
    path = tmp_path / "log.ndjson"
    lines = PAIR[0].read_bytes().splitlines(keepends=True)
    with watching(path) as (process, reports):
        assert next(reports)["report"] == "waiting"
        path.write_bytes(b"".join(lines[:40]) + lines[40][:9])
        assert next(reports)["report"] == "begun"
        path.write_bytes(b"".join(lines[:20]))
        assert "truncated" in next(reports)["text"]
        first = next(reports)
        assert (first["verdict"], first["events"]) == ("allowed", 39)
        assert "incomplete" in first["warnings"][0]
        assert next(reports)["report"] == "begun"
        path.rename(tmp_path / "old")
        with (tmp_path / "old").open("ab") as out:
            out.write(b"".join(lines[20:30]))
        path.write_bytes(BAD.read_bytes())
        assert "replaced" in next(reports)["text"]
        assert next(reports)["events"] == 29
        assert next(reports)["report"] == "begun"
        assert next(reports)["verdict"] == "diverges"
        assert next(reports)["exit"] == 1 == process.wait(LIMIT_S)


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_ends_it_with_the_verdict_so_far(number: signal.Signals, tmp_path: Path) -> None:
    """Also on a file that never came."""
    path = tmp_path / "log.ndjson"
    path.write_bytes(b"".join(PAIR[0].read_bytes().splitlines(keepends=True)[:30]))
    late = path if number == signal.SIGTERM else tmp_path / "none"
    with watching(late) as (process, reports):
        assert next(reports)["report"] == ("begun" if late == path else "waiting")
        process.send_signal(number)
        verdict = next(reports)
        if late == path:
            assert (verdict["verdict"], verdict["events"]) == ("allowed", 29)
            assert "no end record" in verdict["warnings"][0]
        else:
            assert verdict["verdict"] == "unreadable" and "no such file" in verdict["event"]
        assert process.wait(LIMIT_S) == (0 if late == path else 3)


def test_datagrams_are_judged_by_sender_and_a_lost_one_leaves_no_verdict() -> None:
    where = own_address(), 4000
    logs = [path.read_bytes().splitlines(keepends=True) for path in PAIR]
    with watching(f"udp:{where[0]}:{where[1]}") as (process, reports):
        senders = [socket.socket(socket.AF_INET, socket.SOCK_DGRAM) for _ in PAIR]
        while not begun(senders[0], logs[0][0], where, process):
            pass
        assert next(reports)["station"] == 1001
        senders[1].sendto(logs[1][0].removesuffix(b"\n"), where)
        assert next(reports)["station"] == 2002
        for line in logs[0][1:]:
            senders[0].sendto(line, where)
        assert next(reports)["verdict"] == "allowed"
        for line in logs[1][1:10] + logs[1][11:]:
            senders[1].sendto(line, where)
        verdict = next(reports)
        assert verdict["verdict"] == "cannot_tell" and "missing" in verdict["event"]
        assert next(reports)["report"] == "together"
        assert process.wait(LIMIT_S) == 4
        for sender in senders:
            sender.close()


def begun(
    sender: socket.socket, line: bytes, where: tuple[str, int], process: subprocess.Popen[str]
) -> bool:
    """Send a line once somebody listens; whether it was sent."""
    assert process.poll() is None
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        try:
            probe.bind(where)
        except OSError:
            sender.sendto(line, where)
            return True
    time.sleep(0.05)
    return False


def test_a_station_sends_its_log_there(tmp_path: Path) -> None:
    where = f"{own_address()}:4000"
    with watching(f"udp:{where}") as (process, reports), broadcast() as others:
        sender = socket.socket(type=socket.SOCK_DGRAM)
        while not begun(sender, b"", (own_address(), 4000), process):
            pass
        log = tmp_path / "9.ndjson"
        words = ["--id", "9", "--first", "--listen", "0", "--for", "300", "--log", log]
        sent = automcm_process("station", *words, "--broadcast", others, "--log-to", where)
        assert sent.returncode == 0
        heard = list(reports)
        assert [r.get("station") for r in heard if r["report"] == "begun"] == [9]
        (verdict,) = (r for r in heard if r["report"] == "verdict")
        assert verdict["verdict"] == "allowed"
        assert verdict["events"] == len(log.read_bytes().splitlines()) - 2 > 0
        assert process.wait(LIMIT_S) == 0


def test_an_address_that_is_none_is_a_usage_error() -> None:
    assert automcm("trace", "watch", "udp:nowhere").exit_code == 2
    other = automcm("trace", "watch", "udp:192.0.2.1:47200")
    assert other.exit_code == 3 and "--allow-remote" in other.output
