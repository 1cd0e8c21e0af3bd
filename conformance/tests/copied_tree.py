"""The repository, copied to be changed, and Python that runs on the copy."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
FOLDERS = [f + t for f in ("spec", "reference", "traces", "conformance") for t in ("", "/tools")]
LEFT_OUT = shutil.ignore_patterns(".git", ".venv", ".*_cache", "__pycache__", "runs", "site")


def copied(target: Path, folder: str = ".") -> Path:
    """Copy a folder of the repository, or all of it, to where it is in ``target``."""
    shutil.copytree(ROOT / folder, target / folder, ignore=LEFT_OUT)
    return target


def python(root: Path, *words: str, codes: Sequence[int] = (0,)) -> str:
    """What Python says with these arguments: of the folders in ``root``, else of the repository.

    Raises AssertionError for another exit code than one of ``codes``.
    """
    paths = [root / name if (root / name).exists() else ROOT / name for name in FOLDERS]
    done = subprocess.run(
        [sys.executable, *words],
        env=os.environ | {"PYTHONPATH": os.pathsep.join(map(str, paths))},
        cwd=root,
        capture_output=True,
        text=True,
    )
    assert done.returncode in codes, done.stderr
    return done.stdout
