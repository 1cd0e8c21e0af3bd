"""Temporary folders in the user's own directory, and locks between processes.

The directory is ``automcm`` in $XDG_CACHE_HOME, or in ~/.cache. Without a writable home directory,
a temporary folder of this process is used, and there is no locking between processes.
"""

from __future__ import annotations

import os
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from functools import cache
from pathlib import Path

try:
    import fcntl
except ImportError:  # without flock, proceed as without a home directory
    fcntl = None  # type: ignore[assignment]


def user_folder() -> Path | None:
    """The user's own directory, created with mode 0700 if necessary; None if there is none."""
    given, home = os.environ.get("XDG_CACHE_HOME", ""), os.environ.get("HOME", "")
    try:
        if os.path.isabs(given):
            base = Path(given)
        elif os.path.isabs(home) and Path(home).stat().st_uid == os.geteuid():
            base = Path(home, ".cache")
        else:
            return None
        folder = base / "automcm"
        for path in (base, folder):
            path.mkdir(mode=0o700, exist_ok=True)
            if path.stat().st_uid != os.geteuid():
                return None
    except OSError:
        return None
    return folder if fcntl and os.access(folder, os.W_OK | os.X_OK) else None


@contextmanager
def locked_folder(folder: Path) -> Iterator[None]:
    """A lock on a folder between processes, also of other users. Raises OSError."""
    lock = os.open(folder, os.O_RDONLY)
    try:
        if fcntl:
            fcntl.flock(lock, fcntl.LOCK_EX)
        yield
    finally:
        os.close(lock)


@contextmanager
def folder(name: str) -> Iterator[Path]:
    """A new folder, removed at the end.

    The first call removes the folders of killed processes. Raises OSError.
    """
    base = user_folder()
    if base is None:
        with tempfile.TemporaryDirectory(prefix=f"automcm-{name}-") as private:
            yield Path(private)
        return
    scratch = base / "scratch"
    scratch.mkdir(mode=0o700, exist_ok=True)
    _sweep(scratch)
    with ExitStack() as stack:
        with locked_folder(scratch):  # another process must not remove it before it is locked
            made = Path(tempfile.mkdtemp(prefix=f"{name}-", dir=scratch))
            stack.enter_context(locked_folder(made))
        stack.callback(shutil.rmtree, made, ignore_errors=True)
        yield made


@cache
def _sweep(scratch: Path) -> None:
    """Remove the folders whose processes have ended, so that nobody holds their locks."""
    with locked_folder(scratch):
        for path in scratch.iterdir():
            with suppress(OSError):
                lock = os.open(path, os.O_RDONLY)
                try:
                    fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
                    shutil.rmtree(path, ignore_errors=True)
                finally:
                    os.close(lock)
