"""``automcm conform new``: an adapter template in the language of the station."""

from __future__ import annotations

import shlex
from pathlib import Path

from automcm_conformance.adapter.kit_paths import TEMPLATES
from automcm_spec.support import files

LANGUAGES = sorted(folder.name for folder in TEMPLATES.iterdir())
"""Those with a template.  Each template speaks the adapter protocol; its station does nothing."""
BUILD = {
    "cpp": "cmake -S {at} -B {at}/build && cmake --build {at}/build",
    "go": "go build -C {at} -o adapter",
    "java": "javac -d {at}/build {at}/*.java",
    "rust": "cargo build --release --manifest-path {at}/Cargo.toml",
}
"""The shell command that builds a template in the folder ``at``, if it needs to be built."""


def create(language: str, target: Path) -> list[Path]:
    """Write the template into the folder ``target``, created if needed; returns the files written.

    Raises FileExistsError if ``target`` is a file or a folder that is not empty, and OSError if it
    cannot be written.
    """
    if target.exists() and (not target.is_dir() or any(target.iterdir())):
        raise FileExistsError(f"{target} exists and is not an empty folder; name a new folder")
    files.folder(target, named=True)
    written = []
    for template in sorted(filter(Path.is_file, (TEMPLATES / language).iterdir())):
        path = target / template.name
        files.write(path, template.read_bytes())
        if template.name == "run":
            path.chmod(0o755)  # an installed package may have lost this bit
        written.append(path)
    return written


def next_commands(language: str, target: Path) -> list[str]:
    """The commands that build the template, check it and run the suite."""
    run = shlex.quote(str(target / "run"))
    return [
        *([BUILD[language].format(at=shlex.quote(str(target)))] if language in BUILD else []),
        f"automcm conform check-adapter -- {run}",
        f"automcm conform run -- {run}",
    ]
