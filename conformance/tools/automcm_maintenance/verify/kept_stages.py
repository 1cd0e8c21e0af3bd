"""Keeps results of stages from run to run, each with a hash of the files that it depends on."""

from __future__ import annotations

import hashlib
import pickle
import sys
from collections.abc import Callable
from contextlib import suppress
from importlib import metadata
from pathlib import Path
from typing import TypeVar

from automcm_maintenance.documents import repository
from automcm_spec.support import files

T = TypeVar("T")


def key(root: Path, *parts: str) -> str:
    """The hash of these files and folders of the clone, of Python, and of what is installed."""
    digest = hashlib.sha256(sys.version.encode())
    installed = sorted(f"{found.name} {found.version}" for found in metadata.distributions())
    digest.update("\n".join([*installed, repository.digest(root, parts)]).encode())
    return digest.hexdigest()


def kept(path: Path, key: str, make: Callable[[], T], clean: Callable[[T], bool]) -> tuple[T, bool]:
    """The result under this key, and whether it is an earlier one; made anew if there is none.

    Only a clean result is kept. A damaged file counts as none; one that cannot be written is not
    kept.
    """
    with suppress(OSError, ValueError):
        digest, data = path.read_bytes().split(b"\n", 1)
        if digest == _digest(key, data):
            found: T = pickle.loads(data)
            return found, True
    result = make()
    if clean(result):
        data = pickle.dumps(result)
        with suppress(OSError):
            path.parent.mkdir(parents=True, exist_ok=True)
            files.write(path, _digest(key, data) + b"\n" + data)
    return result, False


def _digest(key: str, data: bytes) -> bytes:
    return hashlib.sha256(key.encode() + data).hexdigest().encode()
