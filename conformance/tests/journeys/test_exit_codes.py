"""Output that cannot be written never ends with 1, a verdict against: every command, each way."""

from __future__ import annotations

import errno
import json
import os
import re
import resource
import shutil
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest
from broken_stations import REFERENCE
from cli_stage import automcm
from test_help import COMMANDS

from automcm_cli import exit_codes
from automcm_cli.main import app
from automcm_cli.shared import common
from automcm_evaluation.sweeps.catalogue import NAMES
from automcm_spec.support.bad_input import BadInput
from automcm_traces.checker.engine import Engine

ROOT = Path(__file__).resolve().parents[3]
CORPUS = ROOT / "traces" / "corpus"
AUTOMCM = Path(sys.executable).parent / "automcm"
ADAPTER = ["--", str(AUTOMCM), "adapter"]
FULL = f"automcm: standard output: {os.strerror(errno.ENOSPC)}\n"


@dataclass(frozen=True)
class Cheap:
    """It prints something within seconds, and writes what these options name."""

    arguments: list[str]
    files: tuple[str, ...] = ()
    reads: tuple[str, ...] = ()
    """Options that name inputs."""
    stdin: str = ""
    slow: bool = False
    """Seconds: only one of the two ways is tried."""


Device = Callable[[], AbstractContextManager[int]]
JSON, OUT = "--json", "--out"

CHEAP: dict[str, Cheap] = {
    "trace diff": Cheap(["1001.ndjson", "2002.ndjson"], files=(JSON,)),
    "adapter": Cheap([], stdin='{"cmd":"hello"}\n'),
    "bench radio": Cheap(["--seconds", "0.1"], files=(JSON,), slow=True),
    "bench station": Cheap(["--seconds", "0.1"], files=(JSON,), slow=True),
    "bench window": Cheap(["--seconds", "0.1"], files=(JSON,), slow=True),
    "conform check-adapter": Cheap(ADAPTER, files=(JSON,), slow=True),
    "conform explore": Cheap(["1", "--walks", "1", *ADAPTER], files=(OUT, JSON), slow=True),
    "conform list": Cheap(["NEG-4"], files=(JSON,)),
    "conform new": Cheap(["made"], files=("made",)),
    "conform report": Cheap(["report.json"], files=(OUT,)),
    "conform run": Cheap(
        ["AMCM/RCV/NEG/BI-05", *ADAPTER], files=(OUT, JSON), reads=("--expect",), slow=True
    ),
    "keys authority": Cheap(["made"], files=(JSON,)),
    "keys issue": Cheap(["authority", "station", "--renew"], files=(JSON,)),
    "keys revoke": Cheap(["authority", "--id", "7"], files=(JSON,)),
    "keys show": Cheap(["station"], files=(JSON,)),
    "simulate drives": Cheap(["--drives", "1"], files=(JSON,), slow=True),
    "simulate lane-change": Cheap(["--vehicles", "4"], files=(OUT, JSON), slow=True),
    "spec check": Cheap(["bare_ack"], files=("--traces", JSON), slow=True),
    "spec list": Cheap([], files=(JSON,)),
    "spec prove": Cheap(["--step", "backoff"], files=(JSON,), slow=True),
    "trace coverage": Cheap(["1001.ndjson"], files=(OUT, JSON), slow=True),
    "trace explain": Cheap(["busy_accepted.ndjson"], files=(OUT, JSON), slow=True),
    "trace export": Cheap(["1001.ndjson"], files=(OUT, JSON)),
    "trace html": Cheap(["1001.ndjson"], files=(OUT, JSON), reads=("--compare", "--traffic")),
    "trace itf": Cheap(["1001.ndjson"], files=(OUT, JSON)),
    "trace lint": Cheap(["1001.ndjson"], files=(JSON,)),
    "trace replay": Cheap(["1001.ndjson", *ADAPTER], files=(OUT, JSON)),
    "trace show": Cheap(["1001.ndjson"], files=(JSON,)),
    "trace shrink": Cheap(["busy_accepted.ndjson"], files=(OUT, JSON), slow=True),
    "trace watch": Cheap(["1001.ndjson"], files=(JSON,)),
    "vectors check": Cheap(["--kernel", "collide"], files=(JSON,)),
}
NOT_RUN = {
    # minutes, or TLC, which spec check runs here
    *("bench conform", "bench kernels", "bench traces", "conform certify"),
    *("demo", "generate", "spec mutate", "spec pages", "spec simulate", "verify"),
    *("experiment render", *(f"experiment {name}" for name in ("all", *NAMES))),
    # SUMO: reference/tests/foreign_traffic.py
    *("bench traffic", "simulate traffic", "experiment traffic-sweep"),
    # they serve others and go on without standard output: test_station_faults
    *("conform live", "drive", "link relay", "station"),
    "conform replay",  # it prints as conform run does
}


def test_every_command_is_tried_or_takes_long() -> None:
    assert {*CHEAP} | NOT_RUN == {" ".join(path) for path, group in COMMANDS.items() if not group}


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Where the commands run: logs, a report of the kit, an authority and a station of it."""
    made = tmp_path_factory.mktemp("output")
    for path in (*sorted((CORPUS / "pair").iterdir()), CORPUS / "bad" / "busy_accepted.ndjson"):
        shutil.copy(path, made)
    report = ["--json", made / "report.json", "--out", made / "runs", "--", *REFERENCE]
    for words in (
        ["conform", "run", "AMCM/STA/END/BI-19", *report],
        ["keys", "authority", made / "authority"],
        ["keys", "issue", made / "authority", made / "station", "--id", "7"],
    ):
        assert automcm(*words).exit_code == 0
    return made


@contextmanager
def full_device() -> Iterator[int]:
    descriptor = os.open("/dev/full", os.O_WRONLY)
    yield descriptor
    os.close(descriptor)


@contextmanager
def closed_pipe() -> Iterator[int]:
    """A pipe that nobody reads any more."""
    reading, writing = os.pipe()
    os.close(reading)
    yield writing
    os.close(writing)


def ends(
    arguments: list[str], stdout: int, folder: Path, stdin: str = "", unbuffered: bool = False
) -> tuple[int, str]:
    """The exit code and standard error."""
    environment = {k: v for k, v in os.environ.items() if k != "PYTHONUNBUFFERED"}
    done = subprocess.run(
        [AUTOMCM, *arguments],
        cwd=folder,
        input=stdin,
        stdout=stdout,
        stderr=subprocess.PIPE,
        text=True,
        env=environment | ({"PYTHONUNBUFFERED": "1"} if unbuffered else {}),
    )
    return done.returncode, done.stderr


@pytest.mark.sweep(1)
@pytest.mark.parametrize("command", CHEAP)
def test_output_that_cannot_be_written(command: str, folder: Path) -> None:
    way, words = CHEAP[command], command.split()
    ways: tuple[tuple[str, Device, int], ...] = (
        ("full", full_device, exit_codes.UNWRITTEN),
        ("pipe", closed_pipe, exit_codes.CLOSED_PIPE),
    )
    for name, device, code in ways[: 1 if way.slow else 2]:
        where = folder / name / "-".join(words)
        shutil.copytree(folder, where, ignore=shutil.ignore_patterns("full", "pipe", "limited"))
        with device() as stdout:
            ended, told = ends([*words, *way.arguments], stdout, where, way.stdin)
        assert ended == code, told
        assert "Traceback" not in told and os.strerror(errno.EPIPE) not in told
        assert told.endswith(FULL) == (name == "full") and told.count("standard output") < 2


def path_options(command: str) -> set[str]:
    """The options of a command that take a path."""
    text = automcm(*command.split(), "--help").output
    return set(re.findall(r"^  (--[\w-]+) <(?:list\[)?path", text, re.MULTILINE | re.IGNORECASE))


@pytest.mark.sweep(1)
@pytest.mark.parametrize("command", CHEAP)
def test_files_that_cannot_be_written(command: str, folder: Path) -> None:
    """As on a full disk: no file takes a byte."""
    way, words = CHEAP[command], command.split()
    options = [name for name in way.files if name.startswith("--")]
    assert path_options(command) == {*options, *way.reads}
    if not way.files:
        return
    where = folder / "limited" / "-".join(words)
    shutil.copytree(folder, where, ignore=shutil.ignore_patterns("full", "pipe", "limited"))
    given = [word for name in options for word in (name, f"there{name}")]
    done = subprocess.run(
        [AUTOMCM, *words, *given, *way.arguments],
        cwd=where,
        capture_output=True,
        text=True,
        input=way.stdin,
        preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (0, 0)),
    )
    assert done.returncode == exit_codes.UNWRITTEN, done.stderr
    assert "Traceback" not in done.stderr and done.stderr.count("\n") < 3
    assert os.strerror(errno.EFBIG) in done.stderr
    assert [path for path in where.glob("there*") if path.is_file()] == [], "none is cut"


DIFF = ["trace", "diff", "1001.ndjson", "2002.ndjson"]


@pytest.mark.slow
@pytest.mark.parametrize("more", [[], ["--json", "-"]], ids=["text", "json"])
@pytest.mark.parametrize("unbuffered", [False, True], ids=["buffered", "unbuffered"])
def test_a_verdict_that_cannot_be_written_is_none(
    more: list[str], unbuffered: bool, folder: Path
) -> None:
    """The logs differ: without output nobody has been told so."""
    with open(folder / "verdict", "w") as file:
        assert ends([*DIFF, *more], file.fileno(), folder, unbuffered=unbuffered)[0] == 1
    with full_device() as device:
        found = ends([*DIFF, *more], device, folder, unbuffered=unbuffered)
        assert found == (exit_codes.UNWRITTEN, FULL)
    with closed_pipe() as pipe:
        found = ends([*DIFF, *more], pipe, folder, unbuffered=unbuffered)
        assert found == (exit_codes.CLOSED_PIPE, "")


def shell(line: str, folder: Path) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        ["bash", "-c", line.replace("automcm", str(AUTOMCM))],
        cwd=folder,
        capture_output=True,
        text=True,
    )


@pytest.mark.slow
@pytest.mark.parametrize("unbuffered", ["", "PYTHONUNBUFFERED=1"])
def test_a_reader_that_goes_away_is_no_divergence(unbuffered: str, folder: Path) -> None:
    """What pipefail makes of it, and more than a pipe holds; nothing of it is lost otherwise."""
    command = f"unset PYTHONUNBUFFERED; set -o pipefail; {unbuffered} automcm conform list --json -"
    done = shell(f"{command} | head -c 1", folder)
    assert (done.returncode, done.stdout, done.stderr) == (exit_codes.CLOSED_PIPE, "[", "")
    whole = shell(f"{command} | cat", folder)
    assert len(whole.stdout) > 2**16 and json.loads(whole.stdout) and whole.returncode == 0


@pytest.mark.sweep(1)
@pytest.mark.parametrize(
    "words",
    ["--version", "--help", "trace --help", "link relay --help", " ".join(DIFF), "spec list"],
)
def test_a_closed_standard_output_is_no_divergence(words: str, folder: Path) -> None:
    done = shell(f"automcm {words} >&-", folder)
    assert done.returncode == exit_codes.UNWRITTEN
    assert done.stderr == f"automcm: standard output: {os.strerror(errno.EBADF)}\n"


@pytest.mark.slow
@pytest.mark.parametrize("closed", ["1", "2", "1 2", "0 1 2"])
def test_no_file_takes_the_place_of_what_is_closed(closed: str, folder: Path) -> None:
    """What is printed must not get into the page, which would be the next file opened."""
    where = f"page-{closed.replace(' ', '')}.html"
    redirected = " ".join(f"{number}>&-" for number in closed.split())
    shell(f"automcm trace html 1001.ndjson --out {where} {redirected}", folder)
    shell("automcm trace html 1001.ndjson --out page.html", folder)
    assert (folder / where).read_bytes() == (folder / "page.html").read_bytes()


@pytest.mark.slow
@pytest.mark.parametrize("lost", ["2>/dev/full", "2>&-"])
def test_standard_error_that_cannot_be_written_changes_no_verdict(lost: str, folder: Path) -> None:
    assert shell(f"automcm trace explain none.ndjson {lost}", folder).returncode == 3
    assert shell(f"automcm nonsense {lost}", folder).returncode == 2
    assert shell(f"automcm {' '.join(DIFF)} {lost}", folder).returncode == 1


def raises(error: Exception) -> None:
    raise error


def follows(_: None) -> None:
    """A fault of the follower, which is no verdict on the log."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Engine, "feed", lambda *_: raises(KeyError("ours")))
        app(["trace", "explain", str(CORPUS / "pair" / "1001.ndjson")])


def breaks_a_pipe(_: None) -> None:
    """A child that ends early is no reader that went away."""
    reading, writing = os.pipe()
    os.close(reading)
    os.write(writing, b"x")


ODD = BadInput("a.json", 3, "x", "is odd", "form")
REPORT = r"Traceback[^$]*\nKeyError: 'ours'\n.*please report it.*\n"


@pytest.mark.parametrize(
    ("program", "given", "code", "said"),
    [
        (raises, KeyError("ours"), exit_codes.FAULT, REPORT),
        (follows, None, exit_codes.FAULT, REPORT),
        (raises, ODD, 3, r"automcm: a.json:3: x: is odd \[form\]\n"),
        (open, "/none/such", 3, f"automcm: /none/such: {os.strerror(errno.ENOENT)}\n"),
        (breaks_a_pipe, None, 3, f"automcm: {os.strerror(errno.EPIPE)}\n"),
    ],
)
def test_what_nobody_caught_has_a_code_and_is_named(
    program: Callable[[Any], Any],
    given: Any,
    code: int,
    said: str,
    monkeypatch: pytest.MonkeyPatch,
    capfd: pytest.CaptureFixture[str],
) -> None:
    for name in ("stdout", "stderr"):
        monkeypatch.setattr(sys, name, getattr(sys, name))  # it may replace them
    assert exit_codes.run(lambda: program(given)) == code
    assert re.fullmatch(said, capfd.readouterr().err)


def test_the_exit_codes_are_in_the_help() -> None:
    for code in (exit_codes.UNWRITTEN, exit_codes.FAULT, exit_codes.CLOSED_PIPE):
        assert re.search(rf"\b{code} \w", common.CODES)
