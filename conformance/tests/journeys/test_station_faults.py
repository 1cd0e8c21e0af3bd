"""A station whose disk is full, whose reports nobody reads, or that is told to stop."""

from __future__ import annotations

import json
import os
import resource
import signal
import socket
import subprocess
from pathlib import Path
from typing import Any

import pytest
from cli_stage import AUTOMCM, LIMIT_S, automcm_process
from station_stage import PRESCRIBER, RECEIVER, Road, Running, road

from automcm.service.station_process import STOP_MS
from automcm_spec.log_format.reader import read
from automcm_spec.vocabulary.rules import RULES
from automcm_traces.explain.explain import verdicts_of

BOTH = pytest.mark.parametrize("victim", [PRESCRIBER, RECEIVER])


def events(path: Path, **wanted: Any) -> list[dict[str, Any]]:
    """The events of a log that have these values; as far as it can be read."""
    lines = [json.loads(line) for line in path.read_text().splitlines()]
    return [line for line in lines if wanted.items() <= line.items()]


def sent(path: Path, type_: str) -> list[dict[str, Any]]:
    return [e for e in events(path, ev="send") if e["message"]["type"] == type_]


def pair(on: Road, victim: int, *args: str, **more: Any) -> tuple[Running, Running]:
    """The victim, with these options, and its peer."""
    if victim == RECEIVER:
        receiver = on.station(RECEIVER, *args, **more)
        return receiver, on.prescriber("--maneuver", "1500")
    receiver = on.station(RECEIVER)
    return on.prescriber("--maneuver", "1500", *args, **more), receiver


def test_reports_that_nobody_reads_do_not_put_off_the_end(tmp_path: Path) -> None:
    with road(tmp_path) as on:
        unread = on.station(RECEIVER, "--for", "100", full=True)
        assert unread.wait() == 0 and "reports were lost" in unread.errors()


@pytest.mark.slow
@BOTH
def test_a_log_on_a_full_disk_ends_no_session_and_goes_on_when_there_is_room(
    victim: int, tmp_path: Path
) -> None:
    with road(tmp_path) as on:
        full, peer = pair(on, victim)
        full.until(event="phase", phase="ACTUATING")
        limit(full, on.log(victim).stat().st_size + 100)  # in the midst of a line
        peer.until(event="phase", phase="ACTUATING")
        over = peer.until(event="phase", phase="STANDALONE")
        assert over["rule"] == "ACT-3"  # as if nothing had happened
        full.until(event="phase", phase="STANDALONE")
        limit(full, resource.RLIM_INFINITY)
        full.until(event="received", type="Ack") if victim == PRESCRIBER else None
        at_least = len(on.log(victim).read_bytes()) + 500
        while on.log(victim).stat().st_size < at_least and full.process.poll() is None:
            pass
        full.signal(signal.SIGTERM)
        assert full.wait() == 3
        errors = full.errors()
    lines = [json.loads(line) for line in on.log(victim).read_text().splitlines()]  # none is torn
    numbers = [line["seq"] for line in lines[1:-1]]
    missing = numbers[-1] - len(numbers)
    assert missing > 20 and lines[-1]["lost_records"] == missing
    assert errors.count(str(on.log(victim))) == 2 and str(missing) in errors
    assert verdicts_of([on.log(victim)])[0].verdict == "cannot_tell"


def limit(running: Running, size: int) -> None:
    """The process may write no file larger than this."""
    hard = resource.prlimit(running.process.pid, resource.RLIMIT_FSIZE)[1]
    resource.prlimit(running.process.pid, resource.RLIMIT_FSIZE, (size, hard))


@pytest.mark.sweep(1)
@pytest.mark.parametrize("signum", [signal.SIGTERM, signal.SIGINT, signal.SIGHUP])
@BOTH
def test_end_1_a_station_told_to_stop_cancels_its_session(
    signum: signal.Signals, victim: int, tmp_path: Path
) -> None:
    with road(tmp_path) as on:
        stopped, peer = pair(on, victim)
        peer.until(event="phase", phase="ACTUATING")
        stopped.signal(signum)
        told = peer.until(event="told")
        while told["name"] == "accepted":
            told = peer.until(event="told")
        assert (told["name"], told["reason"]) == ("fallback", "abort")
        assert stopped.wait() == 0
        peer.signal(signal.SIGTERM)
        peer.wait()
    first, second = verdicts_of([on.log(PRESCRIBER), on.log(RECEIVER)])
    assert (first.verdict, second.verdict) == ("allowed", "allowed")
    (abort,) = [e for e in events(on.log(victim), ev="command") if e["command"]["name"] == "abort"]
    assert abort["rule"] == "END-1" in RULES


@pytest.mark.slow
def test_a_station_that_is_told_to_stop_waits_for_its_ack_and_no_longer_when_told_again(
    tmp_path: Path,
) -> None:
    cancels = []
    for n, again in enumerate((False, True)):
        (tmp_path / str(n)).mkdir()
        with road(tmp_path / str(n)) as on:
            stopped, peer = pair(on, PRESCRIBER, "--set", "t_timeout=1500")
            stopped.until(event="phase", phase="ACTUATING")
            peer.signal(signal.SIGKILL)
            stopped.signal(signal.SIGTERM)
            stopped.until(event="sent", type="Cancel")
            if again:
                stopped.signal(signal.SIGTERM)
            assert stopped.wait() == 0
        cancels.append(sent(on.log(PRESCRIBER), "Cancel"))
        assert read(on.log(PRESCRIBER)).end is not None
    waited, ended = cancels
    assert len(waited) >= STOP_MS // 100 - 1 > len(ended) > 0


@pytest.mark.slow
def test_under_nohup_a_station_goes_on_when_the_terminal_is_gone(tmp_path: Path) -> None:
    log = tmp_path / "log"
    args = ["station", "--id", "9", "--listen", "0", "--for", "600", "--log", str(log)]
    process = subprocess.Popen(["nohup", *AUTOMCM, *args], stdout=subprocess.PIPE)
    assert process.stdout is not None
    with process:
        process.stdout.readline()
        process.send_signal(signal.SIGHUP)
    first, *_, last = read(log).events
    assert process.returncode == 0 and last[1].t_ms - first[1].t_ms > 300


@pytest.mark.slow
def test_two_stations_on_one_path_write_two_logs(tmp_path: Path) -> None:
    args = ["station", "--listen", "0", "--log", str(tmp_path / "log"), "--first"]
    with road(tmp_path) as on:
        both = [on.run(*args, "--id", n, "--via", on.via) for n in "12"]
        starts = [each.until(event="start") for each in both]
        for each in both:
            each.signal(signal.SIGTERM)
            assert each.wait() == 0
    assert len({start["log"] for start in starts}) == 2
    for start in starts:
        assert read(start["log"]).header.station == start["station"]


def test_a_start_that_fails_leaves_no_log(tmp_path: Path) -> None:
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        bridge = ["--bridge", str(taken.getsockname()[1])]
        log = ["--log", str(tmp_path / "log")]
        args = ["station", "--id", "1", "--listen", "0", *bridge, *log]
        done = automcm_process(*args)
    assert done.returncode == 3 and list(tmp_path.iterdir()) == []


def test_a_log_without_room_for_its_header_is_no_start(tmp_path: Path) -> None:
    log = tmp_path / "log"
    args = ["station", "--id", "1", "--listen", "0", "--for", "300", "--log", str(log)]
    done = subprocess.run(
        ["sh", "-c", 'ulimit -f 0; exec "$@"', "sh", *AUTOMCM, *args],
        capture_output=True,
        text=True,
        timeout=LIMIT_S,
    )
    assert done.returncode == 3 and f"{log}: the log cannot be written" in done.stderr
    assert done.stdout == "" and not log.exists()


def test_what_is_said_of_a_closed_standard_output_goes_nowhere_else(tmp_path: Path) -> None:
    log = tmp_path / "log"
    args = f"station --id 9 --listen 0 --first --for 100 --log {log}"
    command = [*AUTOMCM, *args.split()]
    done = subprocess.run(
        ["sh", "-c", 'exec "$@" >&-', "sh", *command], stderr=subprocess.PIPE, timeout=LIMIT_S
    )
    assert (done.returncode, done.stderr) == (0, b"")
    assert read(log).ended  # and no report is in it, though it may have the number of stdout
    assert os.path.getsize(log) > 0
