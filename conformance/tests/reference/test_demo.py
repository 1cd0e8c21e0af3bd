"""``automcm demo``, ``station`` and ``link relay``: real processes on real UDP sockets."""

from __future__ import annotations

import asyncio
import json
import os
import pty
import re
import signal
import socket
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
from cli_stage import AUTOMCM, LIMIT_S, automcm, automcm_process
from forked_station import automcm_popen

from automcm.links.udp_link import bind
from automcm_cli.reference import demo_command
from automcm_simulation.road.demo_processes import Demo, DemoVehicle
from automcm_spec.log_format.reader import read

LATE_MS = 50
"""An alarm that rings so late (half of ``t_resend``) is a pause of the machine, not of the station;
the same is then tried again."""
ATTEMPTS = 4


@contextmanager
def running(*args: str) -> Iterator[subprocess.Popen[str]]:
    """A process that is stopped by SIGTERM at the end; its end is left to the caller to read."""
    with automcm_popen(*args, stdout=subprocess.PIPE) as process:
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


@pytest.mark.slow
@pytest.mark.parametrize(
    ("options", "story"),
    [
        ([], {"prescriber": "ACT-3", "B": "finished"}),
        pytest.param(
            ["--loss", "0.3"], {"prescriber": "ACT-3", "B": "finished"}, marks=pytest.mark.deep
        ),
        (["--kill", "B"], {"prescriber": "fallback(cam_loss)"}),
        pytest.param(
            ["--second-prescriber"],
            {"B": "busy", "second prescriber": "fallback(no_agreement)"},
            marks=pytest.mark.deep,
        ),
        pytest.param(["--close-early"], {"prescriber": "CHOOSING ADV-9"}, marks=pytest.mark.deep),
    ],
    ids=["plain", "loss", "kill", "second", "early"],
)
def test_the_demonstration_ends_as_described(
    options: list[str], story: dict[str, str], tmp_path: Path
) -> None:
    for n in range(ATTEMPTS):
        logs = tmp_path / str(n)
        done = automcm_process("demo", "--out", str(logs), "--listen", "0", "--json", "-", *options)
        found = json.loads(done.stdout)
        if max(vehicle["latest_ms"] for vehicle in found["vehicles"]) < LATE_MS:
            break
    assert (done.returncode, done.stderr) == (0, "")
    assert found["ok"] and found["problems"] == []
    for vehicle in found["vehicles"]:
        if vehicle["name"] in story:
            assert story[vehicle["name"]] in json.dumps(vehicle)
    assert (found["lost"] > 0) == ("--loss" in options)
    assert [log["verdict"] for log in found["logs"]] == ["allowed"] * len(found["vehicles"])
    places = set()
    for vehicle in found["vehicles"]:
        log = logs / f"{vehicle['station']}.ndjson"
        assert len(read(log).events) > 50
        assert f'"x_name":"{vehicle["name"]}"' in log.read_text().splitlines()[0]
        own = rf'"src":{vehicle["station"]},[^\n]*?"x_mm":(-?\d+),"y_mm":(-?\d+)'
        places.add(re.findall(own, log.read_text())[0])
    assert len(places) == len(found["vehicles"]), "each has a place of its own"
    assert found["page"] == str(logs / "page.html") and (logs / "page.html").stat().st_size > 50_000


def test_the_way_of_each_vehicle_is_told(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    demo = Demo(tmp_path, listen_ms=0)
    first = demo.vehicles[0]
    first.way, first.killed = ["ADVERTISING ADV-1", "STANDALONE ACT-3"], True
    demo_command._summary(demo)
    way = "ADVERTISING (ADV-1) > STANDALONE (ACT-3) > killed"
    assert f"{first.name} (station {first.station_id}): {way}\n" in capsys.readouterr().out


SOON_OVER = ["--maneuver", "1000"]


def shown(folder: Path, **options: list[str]) -> Demo:
    """A demonstration in which vehicles get further options."""
    for _ in range(ATTEMPTS):
        demo = Demo(folder, listen_ms=0)
        for vehicle in demo.vehicles:
            vehicle.options += options.get(vehicle.name, [])
        asyncio.run(demo.run())
        if max(vehicle.latest_ms for vehicle in demo.vehicles) < LATE_MS:
            break
    return demo


@pytest.mark.slow
def test_another_end_than_described_is_a_problem(tmp_path: Path) -> None:
    demo = shown(tmp_path, prescriber=SOON_OVER, B=["--refuse-first", "3"])
    assert "not as described: B accepts" in demo.problems
    assert not demo.as_dict()["ok"]
    assert {v.verdict for v in demo.verdicts} == {"allowed"}  # but no rule was broken


@pytest.mark.slow
def test_a_station_that_cannot_start_is_a_problem(tmp_path: Path) -> None:
    demo = shown(tmp_path, C=["--host", "198.51.100.1"])
    assert any(p.startswith("C: ") and "198.51.100.1" in p for p in demo.problems)


@pytest.mark.slow
def test_a_log_that_the_oracle_does_not_allow_is_a_problem(tmp_path: Path) -> None:
    demo = shown(tmp_path, prescriber=SOON_OVER)
    assert demo.problems == []
    path = tmp_path / "3.ndjson"
    path.write_text(path.read_text().replace('"accepted":true', '"accepted":false', 1))
    demo._judge()
    assert any("3.ndjson" in problem for problem in demo.problems)

    path.write_text("\n".join((tmp_path / "2.ndjson").read_text().splitlines()[:99]) + "\n")
    demo.problems.clear()
    demo._judge()
    assert any("3.ndjson" in problem for problem in demo.problems)  # cut short, but "allowed"
    path.write_text("rubbish")
    demo.problems.clear()
    demo._judge()
    assert any("3.ndjson" in problem and "unreadable" in problem for problem in demo.problems)


@pytest.mark.slow
def test_a_process_that_hangs_or_leaves_early_is_a_problem(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("automcm_simulation.road.demo_processes.ENDING_S", 2)
    early = shown(tmp_path / "early", C=["--for", "2500"])
    assert early.problems[0] == "C: ended before SIGTERM"

    hung = Demo(tmp_path / "hung", listen_ms=0)

    def hang(demo: Demo) -> None:
        a = demo.vehicle("A")
        if a.way and a.process is not None:
            a.process.send_signal(signal.SIGSTOP)
            demo.changed = lambda demo: None
            asyncio.get_running_loop().call_later(1, os.kill, os.getpid(), signal.SIGTERM)

    hung.changed = hang
    asyncio.run(hung.run())
    assert "A: did not end after SIGTERM" in hung.problems


@pytest.mark.slow
@pytest.mark.parametrize("begun", [1, 3], ids=["in the start", "when all drive"])
def test_a_demonstration_told_to_stop_leaves_no_process(begun: int, tmp_path: Path) -> None:
    with subprocess.Popen([*AUTOMCM, "demo", "--out", str(tmp_path)], stderr=subprocess.PIPE) as p:
        while len(list(tmp_path.glob("*.ndjson"))) < begun:
            assert p.poll() is None
        p.send_signal(signal.SIGTERM)
        assert p.wait(timeout=LIMIT_S) in (1, 130, -signal.SIGTERM, -signal.SIGINT)
    left = subprocess.run(["pgrep", "-f", f"--log {tmp_path}"], capture_output=True)
    assert left.stdout == b""


def test_a_vehicle_is_idle_only_after_a_session() -> None:
    vehicle = DemoVehicle("A", 2)
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


@pytest.mark.sweep(6)
@pytest.mark.parametrize(
    ("args", "error"),
    [
        (["demo", "--kill", "A"], "only B"),
        (["demo", "--kill", "B", "--second-prescriber"], "cannot be combined"),
        (["demo", "--loss", "2"], "loss"),
        (["station", "--id", "0"], "id"),
        (["station", "--id", "1", "--set", "t_cam_loss=900"], "t_cam_loss"),
        (["station", "--id", "1", "--set", "t_resend=-1"], "t_resend"),
        (["station", "--id", "1", "--set", "speed=1"], "there is no parameter 'speed'"),
        (["station", "--id", "1", "--set", "t_decide=x"], "t_decide must be an integer"),
        (["station", "--id", "1", "--codec", "xml"], "xml"),
        (["station", "--id", "1", "--via", "nowhere"], "HOST:PORT"),
        (["link", "relay", "--delay", "9:1"], "MIN exceeds MAX in 9:1"),
        (["link", "relay", "--port", "70000"], "port"),
        (["station", "--id", "1", "--zero", "nan"], "zero"),
        (["station", "--id", "1", "--zero", "1e12"], "zero"),
    ],
)
def test_wrong_usage_is_exit_code_2_and_names_it(args: list[str], error: str) -> None:
    done = automcm(*args)
    assert done.exit_code == 2 and error in done.output


def test_a_port_in_use_is_exit_code_3_and_names_it() -> None:
    with bind("127.0.0.1", 0) as taken:
        port = taken.getsockname()[1]
        done = automcm_process("link", "relay", "--port", port)
    assert done.returncode == 3 and f"UDP 127.0.0.1:{port}" in done.stderr


def test_an_address_beyond_loopback_is_exit_code_3() -> None:
    done = automcm_process("station", "--id", "1", "--broadcast", "192.0.2.255:47100")
    assert done.returncode == 3 and "192.0.2.255 is not a loopback address" in done.stderr


@pytest.mark.slow
def test_a_station_id_that_is_on_the_air_is_refused() -> None:
    with running("link", "relay", "--port", "0") as relay:
        via = ["--via", f"127.0.0.1:{report(relay)['port']}", "--id", "7"]
        with running("station", "--listen", "0", "--first", *via) as first:
            report(first)
            done = automcm_process("station", "--for", "1", *via)
    assert done.returncode == 3 and "station_id 7 is in use by another station" in done.stderr


@pytest.mark.slow
def test_end_8_the_number_file_makes_the_next_start_a_restart(tmp_path: Path) -> None:
    kept, idle = tmp_path / "number", tmp_path / "idle"
    args = ["station", "--id", "9", "--listen", "0", "--for", "300"]
    with running("link", "relay", "--port", "0") as relay:
        args += ["--via", f"127.0.0.1:{report(relay)['port']}"]

        def started(number: Path, log: str, *more: str) -> Any:
            return automcm_process(
                *args, "--number-file", str(number), "--log", str(tmp_path / log), *more
            )

        assert started(idle, "idle log").returncode == 0
        assert idle.read_text() == "0\n", "it has run, whatever it did"
        started(kept, "first", "--request-after", "1")
        again = started(kept, "again")
    assert not restarts(tmp_path / "idle log") and not restarts(tmp_path / "first")
    assert kept.read_text() == "1\n" and restarts(tmp_path / "again")
    assert json.loads(again.stdout.splitlines()[0])["session_number"] == 1


def test_a_refused_request_says_rule_and_reason_and_a_terminal_shows_words() -> None:
    """After a restart a station is in quarantine (ACT-6, END-8)."""
    words = ["--id", "7", "--listen", "0", "--request-after", "1", "--for", "50"]
    via = ["--via", "127.0.0.1:9"]
    done = automcm_process("station", *words, *via)
    (told,) = (r for r in map(json.loads, done.stdout.splitlines()) if r["event"] == "told")
    assert told["rule"] == "ACT-6" and re.fullmatch(r"quarantine, \d s left", told["reason"])
    terminal, end = pty.openpty()
    assert automcm_popen("station", *words, *via, stdout=end).wait(LIMIT_S) == 0
    shown = os.read(terminal, 10_000).decode()
    assert re.search(r"command was refused by ACT-6: quarantine, \d s left\r\n", shown)
    assert "{" not in shown


def restarts(log: Path) -> bool:
    return any(event.ev == "restart" for _, event in read(log).events)


@pytest.mark.slow
def test_end_8_without_a_number_file_a_station_may_have_run_before(tmp_path: Path) -> None:
    for n, first in enumerate(([], ["--first"])):
        log = tmp_path / str(n)
        automcm_process(
            "station", "--id", "9", "--listen", "0", "--for", "1", "--log", str(log), *first
        )
        assert restarts(log) == (not first)


@pytest.mark.sweep(1)
@pytest.mark.parametrize("text", ["rubbish", "-1", "9" * 5000, "9007199254740991", "\u0663"])
def test_end_8_a_number_file_with_no_number_is_exit_code_3(text: str, tmp_path: Path) -> None:
    kept = tmp_path / "number"
    kept.write_text(text)
    broken = automcm_process("station", "--id", "9", "--listen", "0", "--number-file", kept)
    assert broken.returncode == 3 and "expected a session number" in broken.stderr
    assert len(broken.stderr.splitlines()) == 1


def test_end_8_a_number_that_cannot_be_kept_does_not_go_on_the_air(tmp_path: Path) -> None:
    folder = tmp_path / "gone" / "number"
    args = ["--number-file", str(folder), "--request-after", "1", "--log", str(tmp_path / "log")]
    with bind("127.0.0.1", 0) as listener:
        via = f"127.0.0.1:{listener.getsockname()[1]}"
        done = automcm_process("station", "--id", "9", "--listen", "0", "--via", via, *args)
        listener.setblocking(False)
        heard = []
        with pytest.raises(BlockingIOError):
            while True:
                heard.append(listener.recv(65_535))
    assert done.returncode == 3 and str(folder) in done.stderr
    assert not any(b"Advertisement" in data for data in heard)


def test_a_log_that_cannot_be_written_is_exit_code_3(tmp_path: Path) -> None:
    done = automcm_process(
        "station", "--id", "1", "--listen", "0", "--log", str(tmp_path / "no" / "log")
    )
    assert done.returncode == 3 and "no/log" in done.stderr


@pytest.mark.slow
def test_told_to_stop_while_it_listens_a_station_ends_well() -> None:
    with bind("127.0.0.1", 0) as relay:
        via = f"127.0.0.1:{relay.getsockname()[1]}"
        command = [*AUTOMCM, "station", "--id", "1", "--listen", "30000", "--via", via]
        process = subprocess.Popen(command)
        relay.settimeout(LIMIT_S)
        relay.recv(1)  # it registers, and listens
        process.send_signal(signal.SIGTERM)
        assert process.wait(timeout=LIMIT_S) == 0


@pytest.mark.slow
def test_driving_software_at_the_other_end_of_a_bridge(tmp_path: Path) -> None:
    """station --bridge, and automcm drive, which asks for a lane change and completes it."""
    (tmp_path / "token").touch(0o600)
    (tmp_path / "token").write_text("0123456789abcdef\n")
    token = ["--token-file", str(tmp_path / "token")]
    with running("link", "relay", "--port", "0") as relay:
        via = ["--via", f"127.0.0.1:{report(relay)['port']}", "--listen", "0", "--first"]
        bridged = ["--bridge", "0", "--set", "t_timeout=500", "--for", "20000"]
        with (
            running("station", "--id", "1", *bridged, *token, *via) as router,
            running("station", "--id", "2", *via),
        ):
            uri = f"ws://127.0.0.1:{report(router)['bridge']}"
            denied = automcm_process("drive", "--uri", uri)
            assert denied.returncode == 3 and "it requires a token" in denied.stderr
            with running(
                "drive", "--uri", uri, "--request-after", "500", "--for", "20000", *token
            ) as drive:
                assert report(drive)["event"] == "connected"
                seen = []
                while "ACT-3" not in seen:
                    event = report(router)
                    seen += [event["rule"]] if event["event"] == "phase" else []
    assert seen == ["ADV-1", "PRE-1", "PRE-2", "PRE-4", "NEG-6", "ACT-3"]


@pytest.mark.slow
def test_a_bridge_that_cannot_be_reached_or_opened_is_exit_code_3() -> None:
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = taken.getsockname()[1]
        busy = automcm_process("station", "--id", "1", "--listen", "0", "--bridge", port)
    assert busy.returncode == 3 and str(port) in busy.stderr
    gone = automcm_process("drive", "--uri", f"ws://127.0.0.1:{port}", "--attempts", "1")
    assert gone.returncode == 3 and f"ws://127.0.0.1:{port}" in gone.stderr


def test_a_bridge_beyond_loopback_needs_a_token(tmp_path: Path) -> None:
    (tmp_path / "token").touch(0o600)
    (tmp_path / "token").write_text("short")
    beyond = ["--bridge", "0", "--host", "0.0.0.0", "--allow-remote"]
    for more, code, problem in (
        (beyond, 3, "'0.0.0.0' is not a loopback address, so the bridge needs a token: give"),
        ([*beyond, "--token-file", tmp_path / "token"], 3, "token: a token must be 16 to 256"),
        (["--bridge", "0", "--token-file", tmp_path / "none"], 3, "none: No such file"),
        (["--token-file", tmp_path / "token"], 2, "--token-file needs --bridge"),
    ):
        refused = automcm_process("station", "--id", "1", "--listen", "0", "--for", "1", *more)
        assert refused.returncode == code and problem in " ".join(refused.stderr.split()), refused
