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

PAGE = (Path(__file__).resolve().parents[2] / "docs" / "library.md").read_text(encoding="utf-8")
BLOCKS = re.findall(r"^```(?:python)?\n(.*?)^```$", PAGE, re.M | re.S)
TWO_STATIONS, PRINTS, ALONE, PRINTS_TOO, OVER_UDP = BLOCKS


def test_every_promised_name_is_there_and_others_are_not() -> None:
    for name in automcm.__all__:
        assert getattr(automcm, name), name
    assert dir(automcm) == automcm.__all__
    with pytest.raises(AttributeError, match="'McStation'"):
        automcm.__getattr__("McStation")


def test_import_loads_no_station() -> None:
    code = (
        "import automcm, sys; print([m for m in sys.modules if m.startswith(('automcm', 'pyd'))])"
    )
    found = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert found.stdout == "['automcm']\n"


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
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sock:
        sock.bind(("127.255.255.255", 0))
        where = sock.getsockname()
    driver = TWO_STATIONS.partition("clock = VirtualClock()")[0]
    program = driver + OVER_UDP.replace("UdpLink()", f"UdpLink(broadcast={where})")
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
