"""Builds the C++ station of the repository and its mutants (fault_catalogue/cpp.toml)."""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path

from automcm_maintenance.code_mutation.faults import Fault
from automcm_spec.support import children

SOURCE = Path(__file__).resolve().parents[3] / "implementations" / "cpp"
SECONDS = 900
"""Time limit for one compiler run or one run of the suite, in s."""
INCLUDE = b"#include <nlohmann/json.hpp>\nint main() {}\n"


def missing() -> str:
    """The missing tool; empty if all are installed."""
    for tool in ("cmake", "g++"):
        if shutil.which(tool) is None:
            return tool
    compiled = subprocess.run(
        ["g++", "-fsyntax-only", "-x", "c++", "-"], input=INCLUDE, capture_output=True
    )
    return "" if compiled.returncode == 0 else "nlohmann/json.hpp"


def build(folder: Path) -> Path:
    """Build the station as in its README.  Raises CalledProcessError."""
    for command in (
        ["cmake", "-S", str(SOURCE), "-B", str(folder)],
        ["cmake", "--build", str(folder), "-j2", "--target", "station"],
    ):
        _run(command)
    return folder / "station"


def build_mutant(mutant: Fault, folder: Path) -> Path:
    """Compile a copy of the folder with the mutant.  Raises CalledProcessError."""
    copy = folder / mutant.name
    shutil.copytree(SOURCE, copy)
    for path, text in mutant.texts().items():
        (copy / path.name).write_text(text)
    out = copy / "station"
    _run(["g++", "-std=c++17", "-O1", "-o", str(out), str(copy / "adapter.cpp")])
    return out


def _run(command: list[str]) -> None:
    ending_with_parent = children.ending_with_parent(command, group=True)
    subprocess.run(ending_with_parent, check=True, capture_output=True, text=True, timeout=SECONDS)
