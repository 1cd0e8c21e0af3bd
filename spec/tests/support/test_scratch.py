"""Temporary folders and locks in the user's directory."""

import os
import select
import stat
import subprocess
import sys
import tempfile
from pathlib import Path

import pytest

from automcm_spec.support import scratch

HOLD = """
from automcm_spec.support import scratch
with scratch.{what}:
    print("in", flush=True)
    input()
"""


@pytest.fixture
def home(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("HOME", str(tmp_path))
    monkeypatch.delenv("XDG_CACHE_HOME", raising=False)
    scratch._sweep.cache_clear()
    return tmp_path


def holding(what: str) -> subprocess.Popen[str]:
    """Another process that is in there until it is killed or gets a line."""
    child = subprocess.Popen(
        [sys.executable, "-c", HOLD.format(what=what)],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    )
    assert child.stdout is not None
    return child


def inside(child: subprocess.Popen[str]) -> bool:
    assert child.stdout is not None
    return child.stdout.readline() == "in\n"


def test_it_is_in_the_home_and_nobody_else_looks_in(home: Path) -> None:
    own = scratch.user_folder()
    assert own == home / ".cache" / "automcm"
    assert stat.S_IMODE(own.stat().st_mode) == 0o700


def test_xdg_cache_home_is_taken(home: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(home / "caches"))
    assert scratch.user_folder() == home / "caches" / "automcm"
    monkeypatch.setenv("XDG_CACHE_HOME", "relative")
    assert scratch.user_folder() == home / ".cache" / "automcm"


@pytest.mark.parametrize("set_to", [None, "", "relative", "/nowhere/at/all", "/dev/null", "/proc"])
def test_without_a_home_it_is_a_private_temporary_folder(
    set_to: str | None, home: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(tempfile, "tempdir", str(home))
    if set_to is None:
        monkeypatch.delenv("HOME")
    else:
        monkeypatch.setenv("HOME", set_to)
    assert scratch.user_folder() is None
    with scratch.folder("tlc") as folder:
        assert folder.parent == home and stat.S_IMODE(folder.stat().st_mode) == 0o700
    assert list(home.iterdir()) == [] and not Path("/nowhere").exists()


def test_a_folder_of_another_user_is_not_taken(home: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert scratch.user_folder() is not None
    monkeypatch.setattr(os, "geteuid", lambda: 12345)
    assert scratch.user_folder() is None
    monkeypatch.setenv("XDG_CACHE_HOME", str(home))
    assert scratch.user_folder() is None


def test_a_folder_is_gone_at_the_end_whatever_happens(home: Path) -> None:
    with pytest.raises(KeyboardInterrupt), scratch.folder("tlc") as folder:
        (folder / "states").mkdir()
        raise KeyboardInterrupt
    assert list((home / ".cache/automcm/scratch").iterdir()) == []


def test_what_a_killed_process_left_is_removed_and_what_is_in_use_is_not(home: Path) -> None:
    there = home / ".cache/automcm/scratch"
    with holding("folder('live')") as live, holding("folder('left')") as left:
        assert inside(live) and inside(left)
        left.kill()
        left.wait()
        with scratch.folder("tlc") as mine:
            found = sorted(path.name.split("-")[0] for path in there.iterdir())
            assert found == ["live", "tlc"]
            scratch._sweep.cache_clear()
            scratch._sweep(there)  # what this process uses stays as well
            assert mine.is_dir()
        live.communicate("\n")
    assert list(there.iterdir()) == []


def test_alone_is_one_process_at_a_time_also_after_one_was_killed(home: Path) -> None:
    lock = f"locked_folder({str(home)!r})"
    with holding(lock) as first:
        assert inside(first)
        with holding(lock) as second:
            assert not select.select([second.stdout], [], [], 0.3)[0]
            first.kill()
            assert inside(second)
            second.communicate("\n")
    assert list(home.iterdir()) == []
