""".ci/run: which failures end it, and with which code."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from automcm_maintenance.documents.repository import ROOT

pytestmark = pytest.mark.slow
MAKE = """#!/bin/sh
echo "make $1"
[ "$1" != test ] || {test}
"""
ONCE = """
from pathlib import Path
def test_once():
    first = not Path("seen").exists()
    Path("seen").touch()
    assert not first
"""
PYTEST = f'#!/bin/sh\nexec "{sys.executable}" -m pytest -p xdist.plugin "$@"\n'


@pytest.fixture
def clone(tmp_path: Path) -> Path:
    """A folder with the real .ci/run and pytest, one test, and no make."""
    files = {
        ".ci/run": (ROOT / ".ci" / "run").read_text(),
        ".venv/bin/pytest": PYTEST,
        "bin/apt-get": "#!/bin/sh\nexit 1\n",
        "pytest.ini": "[pytest]\n",
        "test_it.py": ONCE,
    }
    for name, text in files.items():
        write(tmp_path / name, text)
    return tmp_path


def write(path: Path, text: str) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text)
    path.chmod(0o755)


def run(clone: Path, test: str, **settings: str) -> subprocess.CompletedProcess[str]:
    """.ci/run with a make whose target ``test`` runs this shell command."""
    write(clone / "bin" / "make", MAKE.format(test=test))
    path = f"{clone / 'bin'}:{os.environ['PATH']}"
    return subprocess.run(
        [clone / ".ci" / "run"],
        env=os.environ | {"PATH": path, "PYTEST_DISABLE_PLUGIN_AUTOLOAD": "1"} | settings,
        capture_output=True,
        text=True,
    )


def test_a_failure_without_a_failed_test_ends_with_the_code_of_make(clone: Path) -> None:
    (clone / "seen").touch()
    found = run(clone, "exit 2")
    assert found.returncode == 2
    assert "make test failed (code 2) without a failed test" in found.stderr
    assert "make verify" not in found.stdout


@pytest.mark.parametrize(("until", "slow"), [("600", True), ("0", False)])
def test_the_slow_tests_run_only_if_there_is_time(clone: Path, until: str, slow: bool) -> None:
    found = run(clone, "exit 0", SLOW_UNTIL=until)
    assert found.returncode == 0, found.stderr
    assert ("make test-whole" in found.stdout) is slow
    assert ("SKIPPED: make test-whole" in found.stderr) is not slow
    assert "make test-foreign" in found.stdout


def test_a_test_that_failed_in_an_earlier_run_hides_nothing(clone: Path) -> None:
    subprocess.run([clone / ".venv/bin/pytest"], cwd=clone, capture_output=True)
    assert run(clone, "exit 2").returncode == 2


@pytest.mark.parametrize(("text", "code"), [(ONCE, 0), ("def test_it(): assert 0", 1)])
def test_a_failed_test_runs_once_more(clone: Path, text: str, code: int) -> None:
    (clone / "test_it.py").write_text(text)
    found = run(clone, ".venv/bin/pytest -q")
    assert found.returncode == code, found.stdout + found.stderr
    assert ("make verify" in found.stdout) is (code == 0)
