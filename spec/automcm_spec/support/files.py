"""Writes files atomically: completely or not at all, and where the user meant them to be.

A foreign folder may have symbolic links at the names of our outputs. A link is followed only in a
path that the user named.
"""

from __future__ import annotations

import errno
import os
import secrets
import stat
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import BinaryIO

DEFAULT = "runs"
"""In the working directory, the folder of all outputs for which the user names no place."""
_NOT_BESIDE = {errno.EACCES, errno.EPERM, errno.EROFS}
"""The folder does not allow new files, but an existing file may still be writable."""


def refuse_links(path: Path, *, named: bool = False) -> None:
    """Raise OSError if a part of an output's path that the user did not name is a symbolic link.

    These are the last part unless ``named``, and every part from ``DEFAULT``.
    """
    parts = [path, *path.parents][:-1] if path.parts[:1] == (DEFAULT,) else [] if named else [path]
    for part in parts:
        if part.is_symlink() and not _is_device(part):
            problem = "a symbolic link, which is only followed in a path that was given; remove it"
            raise OSError(errno.ELOOP, problem, str(part))


def folder(path: Path, *, named: bool = False) -> Path:
    """Make an output folder if it does not exist; links as for ``refuse_links``. Raises OSError."""
    refuse_links(path, named=named)
    path.mkdir(parents=True, exist_ok=True)
    return path


@contextmanager
def new_folder(path: Path, *, named: bool = False) -> Iterator[None]:
    """The same for what follows; after an exception, nothing remains of it that is empty."""
    made = [each for each in (path, *path.parents) if not each.exists()]
    folder(path, named=named)
    try:
        yield
    except BaseException:
        for each in made:
            with suppress(OSError):
                each.rmdir()
        raise


def read_private(path: Path, most: int) -> bytes:
    """The first ``most`` bytes of a file with a secret.

    Raises OSError, also if other users than its owner can read the file.
    """
    with path.open("rb") as file:
        if os.fstat(file.fileno()).st_mode & 0o077:
            raise OSError(errno.EACCES, f"other users can read it; chmod 600 {path}", str(path))
        return file.read(most)


def write(path: Path, data: str | bytes, *, named: bool = False, durable: bool = False) -> None:
    """Write a file like ``writing``; text as UTF-8. Raises OSError."""
    with writing(path, named=named, durable=durable) as file:
        file.write(data.encode() if isinstance(data, str) else data)


@contextmanager
def writing(path: Path, *, named: bool = False, durable: bool = False) -> Iterator[BinaryIO]:
    """A file that replaces ``path`` at the end; if anything fails, ``path`` is unchanged.

    It is written beside ``path`` under a unique name, then renamed. If ``path`` is a symbolic link,
    its target is replaced, or without ``named`` the link refused (``refuse_links``). Devices, pipes
    and open files (/dev/stdout) are written directly, as are files in a folder that allows no new
    ones. With ``durable``, it is on disk on return. Raises OSError.
    """
    refuse_links(path, named=named)
    target = _target(path)
    new = None if target is None else _beside(target)
    if target is None or new is None:
        with path.open("wb") as file:
            yield file
        return
    try:
        with new.open("wb") as file:
            yield file
            if durable:
                file.flush()
                os.fsync(file.fileno())
        try:
            new.replace(target)
        except OSError as error:
            if error.errno != errno.EBUSY:
                raise
            target.write_bytes(new.read_bytes())  # a bind-mounted file, as in containers
            new.unlink()
    except BaseException:
        with suppress(OSError):
            new.unlink()
        raise


def _target(path: Path) -> Path | None:
    """The file that a path names, through links; None if it must be written directly."""
    with suppress(FileNotFoundError):
        if not stat.S_ISREG(path.stat().st_mode):
            return None
    while not _is_device(path):
        if not path.is_symlink():
            return path
        path = path.parent / path.readlink()
    return None


def _is_device(path: Path) -> bool:
    return os.path.abspath(path).startswith(("/dev/", "/proc/"))


def _beside(target: Path) -> Path | None:
    """A new empty file in the folder of the target, with its permissions.

    None if the folder allows no new file but the target exists.
    """
    new = target.with_name(f".{target.name[:40]}.{secrets.token_hex(4)}.new")
    try:
        os.close(os.open(new, os.O_CREAT | os.O_EXCL | os.O_WRONLY, 0o666))
    except OSError as error:
        if error.errno in _NOT_BESIDE and target.exists():
            return None
        error.filename = str(target)
        raise
    with suppress(OSError):
        new.chmod(stat.S_IMODE(target.stat().st_mode))
    return new
