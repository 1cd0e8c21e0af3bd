"""``import automcm``: its names, and the programs of docs/library.md."""

from __future__ import annotations

import re
import socket
import subprocess
import sys
from pathlib import Path

import pytest

import automcm
from automcm.service.application import Application, check_methods

PAGE = (Path(__file__).resolve().parents[3] / "docs" / "library.md").read_text(encoding="utf-8")
BLOCKS = re.findall(r"^```(?:python)?\n(.*?)^```$", PAGE, re.M | re.S)
TWO_STATIONS, PRINTS, ALONE, PRINTS_TOO, OVER_UDP = BLOCKS


def test_every_promised_name_is_there_and_others_are_not() -> None:
    for name in automcm.__all__:
        assert getattr(automcm, name), name
    assert dir(automcm) == automcm.__all__
    with pytest.raises(AttributeError, match="'McStation'"):
        automcm.__getattr__("McStation")


DRIVER = TWO_STATIONS.partition("clock = VirtualClock()")[0]


def free_port() -> tuple[str, int]:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sock:
        sock.bind(("127.255.255.255", 0))
        where: tuple[str, int] = sock.getsockname()
    return where


LOADED = """
import sys
from pathlib import Path
for name, module in sys.modules.items():
    if name.partition(".")[0] in ("automcm", "automcm_spec", "pydantic", "numpy"):
        print(name, Path(module.__file__).read_bytes().count(b"\\n"))
"""


@pytest.mark.parametrize(
    ("program", "modules", "lines"),
    [
        ("import automcm", 1, 100),
        (DRIVER + OVER_UDP.replace("sleep(10)", "sleep(0.6)"), 30, 5400),
        ("import automcm.service.station_process", 30, 5700),
    ],
    ids=["import automcm", "the page's station over UDP", "automcm station"],
)
def test_a_program_loads_little_of_us(program: str, modules: int, lines: int) -> None:
    program = program.replace("UdpLink()", f"UdpLink(broadcast={free_port()})")
    command = [sys.executable, "-c", program + LOADED, "1"]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    loaded = {name: int(count) for name, count in map(str.split, done.stdout.splitlines())}
    ours = {name: count for name, count in loaded.items() if name.startswith("automcm")}
    of_the_station = [name for name in ours if name.partition(".")[0] == "automcm"]
    print(len(of_the_station), "modules of automcm;", sum(ours.values()), "lines with automcm_spec")
    assert len(of_the_station) <= modules and sum(ours.values()) <= lines
    assert loaded == ours or modules > 1


@pytest.mark.parametrize(("program", "output"), [(TWO_STATIONS, PRINTS), (ALONE, PRINTS_TOO)])
def test_a_program_of_the_page_prints_what_the_page_says(
    program: str,
    output: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    exec(program, {"__name__": "program"})
    assert capsys.readouterr().out == output


def test_the_first_program_is_short() -> None:
    assert len(TWO_STATIONS.splitlines()) <= 42
    assert TWO_STATIONS.count("import") == 1


@pytest.mark.slow
def test_the_stations_of_the_page_agree_over_udp(tmp_path: Path) -> None:
    program = DRIVER + OVER_UDP.replace("UdpLink()", f"UdpLink(broadcast={free_port()})")
    (tmp_path / "program.py").write_text(program)
    running = [
        subprocess.Popen([sys.executable, "program.py", n], cwd=tmp_path, stdout=-1, text=True)
        for n in ("1", "2")
    ]
    prescriber, receiver = (process.communicate(timeout=60)[0] for process in running)
    assert "station 1 drives the agreed trajectory as prescriber" in prescriber
    assert "station 2 drives the agreed trajectory as receiver" in receiver


def test_an_application_without_a_method_is_refused_when_it_is_attached() -> None:
    methods = [name for name in vars(Application) if not name.startswith("_")]
    for left_out in methods:
        names = {name: lambda *_: None for name in methods if name != left_out}
        with pytest.raises(TypeError, match=f"^Driver lacks {left_out}: an Application has attach"):
            check_methods(type("Driver", (), names)())
