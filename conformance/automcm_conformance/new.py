"""``automcm conform new``: an adapter to begin with, in the language of the station."""

from __future__ import annotations

import shlex
from pathlib import Path

from automcm_conformance.paths import TEMPLATES
from automcm_spec import files

FILES = {
    "python": ("adapter.py", "run"),
    "cpp": ("CMakeLists.txt", "README.md", "adapter.cpp", "run"),
}
"""By language.  Each begins with an adapter that speaks the protocol and fails the suite."""


def create(language: str, target: Path) -> list[Path]:
    """Write the template into ``target``, which is made if need be; the files written.

    Raises ValueError for a language that there is none for, FileExistsError if ``target`` is a file
    or a folder that is not empty, and OSError if it cannot be written.
    """
    if language not in FILES:
        raise ValueError(f"no template in {language!r}, only in {', '.join(sorted(FILES))}")
    if target.exists() and (not target.is_dir() or any(target.iterdir())):
        raise FileExistsError(f"{target} is there and is not an empty folder")
    target.mkdir(parents=True, exist_ok=True)
    written = []
    for name in FILES[language]:
        path = target / name
        files.write(path, (TEMPLATES / language / name).read_bytes())
        if name == "run":
            path.chmod(0o755)  # an installed package may have lost it
        written.append(path)
    return written


def next_commands(language: str, target: Path) -> list[str]:
    """What to type when the template is written."""
    at = shlex.quote(str(target))
    build = [f"cmake -S {at} -B {at}/build && cmake --build {at}/build"]
    run = shlex.quote(str(target / "run"))
    return [
        *(build if language == "cpp" else []),
        f"automcm conform check-adapter -- {run}",
        f"automcm conform run -- {run}",
    ]
