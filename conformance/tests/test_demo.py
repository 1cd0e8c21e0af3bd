"""``automcm demo``, ``station`` and ``link relay``: real processes on real UDP sockets."""

from __future__ import annotations

import asyncio
import json
import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from automcm.links.udp import bind
from automcm_cli.demo import Demo, Vehicle
from automcm_traces.reader import read

COMMAND = [sys.executable, "-m", "automcm_cli"]
LIMIT_S = 60


def automcm(*args: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run([*COMMAND, *args], capture_output=True, text=True, timeout=LIMIT_S)


@contextmanager
def running(*args: str) -> Iterator[subprocess.Popen[str]]:
    """A process that is stopped by SIGTERM at the end; its end is left to the caller to read."""
    with subprocess.Popen([*COMMAND, *args], stdout=subprocess.PIPE, text=True) as process:
        try:
            yield process
        finally:
            process.send_signal(signal.SIGTERM)
            process.wait(timeout=LIMIT_S)


def report(process: subprocess.Popen[str]) -> dict[str, Any]:
    assert process.stdout is not None
    value = json.loads(process.stdout.readline())
    assert isinstance(value, dict)
    return value


@pytest.mark.parametrize(
    ("options", "story"),
    [
        ([], {"prescriber": "ACT-3", "B": "finished"}),
        (["--loss", "0.3"], {"prescriber": "ACT-3", "B": "finished"}),
        (["--kill", "B"], {"prescriber": "fallback(cam_loss)"}),
        (["--second-prescriber"], {"B": "busy", "second prescriber": "fallback(no_agreement)"}),
    ],
    ids=["plain", "loss", "kill", "second"],
)
def test_the_demonstration_ends_as_described(
    options: list[str], story: dict[str, str], tmp_path: Path
) -> None:
    done = automcm("demo", "--logs", str(tmp_path), "--listen", "0", "--json", "-", *options)
    assert (done.returncode, done.stderr) == (0, "")
    found = json.loads(done.stdout)
    assert found["ok"] and found["problems"] == []
    for vehicle in found["vehicles"]:
        if vehicle["name"] in story:
            assert story[vehicle["name"]] in json.dumps(vehicle)
    assert (found["lost"] > 0) == ("--loss" in options)
    assert [log["verdict"] for log in found["logs"]] == ["allowed"] * len(found["vehicles"])
    for vehicle in found["vehicles"]:
        assert len(read(tmp_path / f"{vehicle['station']}.ndjson").events) > 50


def shown(folder: Path, **options: list[str]) -> Demo:
    """A demonstration in which vehicles get further options."""
    demo = Demo(folder, listen_ms=0)
    for vehicle in demo.vehicles:
        vehicle.options += options.get(vehicle.name, [])
    asyncio.run(demo.run())
    return demo


def test_another_end_than_described_is_a_problem(tmp_path: Path) -> None:
    demo = shown(tmp_path, B=["--refuse-first", "3"])
    assert "not as described: B accepts" in demo.problems
    assert not demo.as_dict()["ok"]
    assert {v.verdict for v in demo.verdicts} == {"allowed"}  # but no rule was broken


def test_a_station_that_cannot_start_is_a_problem(tmp_path: Path) -> None:
    demo = shown(tmp_path, C=["--host", "198.51.100.1"])
    assert any(p.startswith("C: ") and "198.51.100.1" in p for p in demo.problems)


def test_a_log_that_the_oracle_does_not_allow_is_a_problem(tmp_path: Path) -> None:
    demo = shown(tmp_path)
    assert demo.problems == []
    path = tmp_path / "3.ndjson"
    path.write_text(path.read_text().replace('"accepted":true', '"accepted":false', 1))
    demo._judge()
    assert any("3.ndjson" in problem for problem in demo.problems)


def test_a_vehicle_is_idle_only_after_a_session() -> None:
    vehicle = Vehicle("A", 2)
    assert not vehicle.idle
    bound = {"phase": "INTENDING", "role": "receiver"}
    vehicle.take({"event": "phase", "rule": "ADV-3"} | bound | REST)
    assert not vehicle.idle and not vehicle.went("STANDALONE END-2")
    vehicle.take({"event": "phase", "rule": "END-2", "phase": "STANDALONE", "role": "none"} | REST)
    assert vehicle.idle and vehicle.went("INTENDING ADV-3", "STANDALONE END-2")
    assert not vehicle.went("STANDALONE END-2", "INTENDING ADV-3")
    vehicle.sending = 1
    assert not vehicle.idle


REST: dict[str, Any] = {"session": None, "sending": 0}


@pytest.mark.parametrize(
    ("args", "error"),
    [
        (["demo", "--kill", "A"], "only B"),
        (["demo", "--kill", "B", "--second-prescriber"], "two demonstrations"),
        (["demo", "--loss", "2"], "loss"),
        (["station", "--id", "0"], "id"),
        (["station", "--id", "1", "--set", "t_cam_loss=900"], "t_cam_loss"),
        (["station", "--id", "1", "--set", "t_resend=-1"], "t_resend"),
        (["station", "--id", "1", "--set", "speed=1"], "speed: no such parameter"),
        (["station", "--id", "1", "--set", "t_decide=x"], "t_decide: an integer"),
        (["station", "--id", "1", "--codec", "xml"], "xml"),
        (["station", "--id", "1", "--via", "nowhere"], "HOST:PORT"),
        (["link", "relay", "--delay", "9:1"], "MIN:MAX"),
    ],
)
def test_wrong_usage_is_exit_code_2_and_names_it(args: list[str], error: str) -> None:
    done = automcm(*args)
    assert done.returncode == 2 and error in done.stderr


@pytest.mark.parametrize("args", [["demo"], ["station"], ["link", "relay"]])
def test_help_has_an_example_and_exit_codes(args: list[str]) -> None:
    done = subprocess.run(
        [*COMMAND, *args, "--help"],
        capture_output=True,
        text=True,
        env=os.environ | {"COLUMNS": "200"},
    )
    assert done.returncode == 0
    assert "Example: automcm " + " ".join(args) in done.stdout and "Exit codes" in done.stdout


def test_a_port_in_use_is_exit_code_3_and_names_it() -> None:
    with bind("127.0.0.1", 0) as taken:
        port = taken.getsockname()[1]
        done = automcm("link", "relay", "--port", str(port))
    assert done.returncode == 3 and f"UDP 127.0.0.1:{port}" in done.stderr


def test_an_address_beyond_loopback_is_exit_code_3() -> None:
    done = automcm("station", "--id", "1", "--broadcast", "192.0.2.255:47100")
    assert done.returncode == 3 and "192.0.2.255: not a loopback address" in done.stderr


def test_a_station_id_that_is_on_the_air_is_refused() -> None:
    with running("link", "relay", "--port", "0") as relay:
        via = ["--via", f"127.0.0.1:{report(relay)['port']}", "--id", "7"]
        with running("station", "--listen", "0", *via) as first:
            report(first)
            done = automcm("station", "--for", "1", *via)
    assert done.returncode == 3 and "station_id: 7 is on the air already" in done.stderr


def test_end_8_the_number_file_makes_the_next_start_a_restart(tmp_path: Path) -> None:
    kept = tmp_path / "number"
    args = ["station", "--id", "9", "--listen", "0", "--number-file", str(kept)]
    with running("link", "relay", "--port", "0") as relay:
        args += ["--via", f"127.0.0.1:{report(relay)['port']}"]
        first = automcm(*args, "--request-after", "1", "--for", "300")
        again = automcm(*args, "--log", str(tmp_path / "log"), "--for", "1")
    assert (first.returncode, kept.read_text()) == (0, "1\n")
    assert json.loads(again.stdout.splitlines()[0])["session_number"] == 1
    assert any(e.ev == "restart" for _, e in read(tmp_path / "log").events)
    kept.write_text("rubbish")
    broken = automcm(*args)
    assert broken.returncode == 3 and "holds no session number" in broken.stderr


def test_end_8_a_number_that_cannot_be_kept_does_not_go_on_the_air(tmp_path: Path) -> None:
    folder = tmp_path / "gone" / "number"
    args = ["--number-file", str(folder), "--request-after", "1", "--log", str(tmp_path / "log")]
    with bind("127.0.0.1", 0) as listener:
        via = f"127.0.0.1:{listener.getsockname()[1]}"
        done = automcm("station", "--id", "9", "--listen", "0", "--via", via, *args)
        listener.setblocking(False)
        heard = []
        with pytest.raises(BlockingIOError):
            while True:
                heard.append(listener.recv(65_535))
    assert done.returncode == 3 and str(folder) in done.stderr
    assert not any(b"Advertisement" in data for data in heard)


def test_a_log_that_cannot_be_written_is_exit_code_3(tmp_path: Path) -> None:
    done = automcm("station", "--id", "1", "--listen", "0", "--log", str(tmp_path / "no" / "log"))
    assert done.returncode == 3 and "no/log" in done.stderr
