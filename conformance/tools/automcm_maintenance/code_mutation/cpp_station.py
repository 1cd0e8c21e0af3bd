"""Builds the C++ station of the repository and its mutants (implementations/cpp/mutants.toml)."""

from __future__ import annotations

import shutil
import subprocess
import tomllib
from dataclasses import dataclass
from pathlib import Path

from automcm_spec.support import children
from automcm_spec.vocabulary.rules import RULES

SOURCE = Path(__file__).resolve().parents[3] / "implementations" / "cpp"
SECONDS = 900
"""Time limit for one compiler run or one run of the suite, in s."""
COMBINED = SOURCE / "combined.toml"
INCLUDE = b"#include <nlohmann/json.hpp>\nint main() {}\n"


@dataclass(frozen=True)
class CppMutant:
    """A mutant of station.hpp: ``edits`` are texts with their replacements."""

    name: str
    story: str
    rules: tuple[str, ...]
    edits: tuple[tuple[str, str], ...]


def mutants(path: Path = SOURCE / "mutants.toml") -> list[CppMutant]:
    """The mutants of a file.  Raises ValueError, which names the mutant and the field."""
    station = (path.parent / "station.hpp").read_text()
    found = []
    for row in tomllib.loads(path.read_text())["mutant"]:
        edits = tuple((edit["old"], edit["new"]) for edit in row.get("edit", [row]))
        mutant = CppMutant(row["name"], row["story"], tuple(row["rules"]), edits)
        for old, new in edits:
            if station.count(old) != 1:
                raise ValueError(
                    f"{mutant.name}: old: must occur once in station.hpp, not "
                    f"{station.count(old)} times"
                )
            if new == old:
                raise ValueError(f"{mutant.name}: new: must differ from old")
        if not mutant.rules or set(mutant.rules) - set(RULES):
            raise ValueError(f"{mutant.name}: rules: unknown rule in {', '.join(mutant.rules)}")
        found.append(mutant)
    if len({mutant.name for mutant in found}) != len(found):
        raise ValueError("name: each name may be used only once")
    return found


def missing() -> str:
    """The missing tool; empty if all are installed."""
    for tool in ("cmake", "g++"):
        if shutil.which(tool) is None:
            return tool
    compiled = subprocess.run(
        ["g++", "-fsyntax-only", "-x", "c++", "-"], input=INCLUDE, capture_output=True
    )
    return "" if compiled.returncode == 0 else "nlohmann/json.hpp"


def build(folder: Path, *more: str) -> Path:
    """Build the station as in its README, and more targets.  Raises CalledProcessError."""
    for command in (
        ["cmake", "-S", str(SOURCE), "-B", str(folder)],
        ["cmake", "--build", str(folder), "-j2", "--target", "station", *more],
    ):
        _run(command)
    return folder / "station"


def build_mutant(mutant: CppMutant, folder: Path) -> Path:
    """Compile a copy of the folder with the mutant.  Raises CalledProcessError."""
    copy = folder / mutant.name
    shutil.copytree(SOURCE, copy)
    header = copy / "station.hpp"
    text = header.read_text()
    for old, new in mutant.edits:
        text = text.replace(old, new)
    header.write_text(text)
    out = copy / "station"
    _run(["g++", "-std=c++17", "-O1", "-o", str(out), str(copy / "adapter.cpp")])
    return out


def _run(command: list[str]) -> None:
    ending_with_parent = children.ending_with_parent(command, group=True)
    subprocess.run(ending_with_parent, check=True, capture_output=True, text=True, timeout=SECONDS)
