"""One model is checked wherever the sources are and whatever the environment holds."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from cli_stage import AUTOMCM

from automcm_maintenance.documents.repository import SOURCES

ROOT = Path(__file__).resolve().parents[3]
NAME = "ein Weg (mit Ümläuten) & 'mehr'"
NOWHERE = "http://127.0.0.1:9"
LIMIT_S = 120


@pytest.fixture(scope="module")
def copied(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The sources that are needed, in a folder of that name."""
    root = tmp_path_factory.mktemp("environments") / NAME
    for folder in SOURCES.values():
        shutil.copytree(folder, root / folder.relative_to(ROOT))
    for name in ("tla", "models"):
        shutil.copytree(ROOT / "spec" / name, root / "spec" / name)
    return root


@pytest.mark.slow
@pytest.mark.parametrize(
    "changes",
    [
        {},
        {"LC_ALL": "C"},
        {"LC_ALL": "C", "PYTHONUTF8": "0"},
        {"HOME": None, "XDG_CACHE_HOME": None},
        {"HOME": "/nowhere/at/all", "XDG_CACHE_HOME": None},
        {"HOME": "/proc", "XDG_CACHE_HOME": None},  # nobody can write there
        {"PATH": None},
        {"PATH": "/nowhere", "JAVA_HOME": "/nowhere", "JDK_HOME": "/nowhere"},
        {"http_proxy": NOWHERE, "https_proxy": NOWHERE, "all_proxy": NOWHERE},
    ],
    ids=lambda changes: " ".join(f"{k}={v}" for k, v in changes.items()) or "as it is",
)
def test_a_model_is_checked(changes: dict[str, str | None], copied: Path, tmp_path: Path) -> None:
    if "LC_ALL" in changes and sys.version_info < (3, 13) and not str(ROOT).isascii():
        pytest.skip("Python reads by the locale where we are installed")
    here = tmp_path / NAME
    here.mkdir()
    environment = os.environ | {"PYTHONPATH": path_of(copied), "XDG_CACHE_HOME": str(here)}
    environment |= {name: value for name, value in changes.items() if value is not None}
    for name in [name for name, value in changes.items() if value is None]:
        environment.pop(name, None)
    code = "import automcm_spec; print(automcm_spec.__file__)"
    where = subprocess.run([sys.executable, "-c", code], env=environment, capture_output=True)
    assert where.stdout.decode().startswith(str(copied))
    done = subprocess.run(
        [*AUTOMCM, "spec", "check", "bare_ack", "--json", "ö.json"],
        cwd=here,
        env=environment,
        capture_output=True,
        timeout=LIMIT_S,
    )
    assert (done.returncode, done.stderr.count(b"\n")) == (0, 1), done.stderr.decode()
    assert sorted(path.name for path in here.iterdir() if path.name != "automcm") == [
        "runs",
        "ö.json",
    ]


def path_of(root: Path) -> str:
    return os.pathsep.join(
        str(root / folder) for folder in ("spec", "reference", "traces", "conformance")
    )


def test_what_cannot_be_downloaded_is_one_line(tmp_path: Path) -> None:
    """The very first run, without a network and without earlier downloads."""
    code = """
import sys
from automcm_spec.model_checking import tlc, toolchain
sys.prefix = sys.argv[1]
try:
    tlc.tools()
except tlc.TlcError as error:
    print(error)
"""
    nowhere = {"http_proxy": NOWHERE, "https_proxy": NOWHERE}
    done = subprocess.run(
        [sys.executable, "-c", code, str(tmp_path)],
        env=os.environ | nowhere | {"HOME": str(tmp_path), "M2_REPO": str(tmp_path / "m2")},
        capture_output=True,
        text=True,
        timeout=LIMIT_S,
    )
    assert done.stdout.count("\n") == 1 and done.stderr == ""
    assert "could not be downloaded" in done.stdout and "AUTOMCM_TLA2TOOLS" in done.stdout
