"""The C++ station of the repository and its mutants (implementations/cpp/mutants.toml): built."""

from __future__ import annotations

import shutil
import subprocess
import tomllib
from dataclasses import dataclass
from pathlib import Path

from automcm_spec.support import children
from automcm_spec.vocabulary.rules import RULES

SOURCE = Path(__file__).resolve().parents[2] / "implementations" / "cpp"
SECONDS = 900
"""For one compiler, or one run of the suite."""
COMBINED = SOURCE / "combined.toml"
INCLUDE = b"#include <nlohmann/json.hpp>\nint main() {}\n"


@dataclass(frozen=True)
class Mutant:
    """Mistakes in station.hpp: ``edits`` are texts and what stands there instead."""

    name: str
    story: str
    rules: tuple[str, ...]
    edits: tuple[tuple[str, str], ...]


def mutants(path: Path = SOURCE / "mutants.toml") -> list[Mutant]:
    """The mutants of a file.  Raises ValueError naming the mutant and the field."""
    station = (path.parent / "station.hpp").read_text()
    found = []
    for row in tomllib.loads(path.read_text())["mutant"]:
        edits = tuple((edit["old"], edit["new"]) for edit in row.get("edit", [row]))
        mutant = Mutant(row["name"], row["story"], tuple(row["rules"]), edits)
        for old, new in edits:
            if station.count(old) != 1:
                raise ValueError(f"{mutant.name}: old: {station.count(old)} times, not once")
            if new == old:
                raise ValueError(f"{mutant.name}: new: changes nothing")
        if not mutant.rules or set(mutant.rules) - set(RULES):
            raise ValueError(f"{mutant.name}: rules: {', '.join(mutant.rules)}")
        found.append(mutant)
    if len({mutant.name for mutant in found}) != len(found):
        raise ValueError("name: used twice")
    return found


def missing() -> str:
    """What is not there; empty if all is."""
    for tool in ("cmake", "g++"):
        if shutil.which(tool) is None:
            return tool
    compiled = subprocess.run(
        ["g++", "-fsyntax-only", "-x", "c++", "-"], input=INCLUDE, capture_output=True
    )
    return "" if compiled.returncode == 0 else "nlohmann/json.hpp"


def build(folder: Path, *more: str) -> Path:
    """The station as its README says, and more targets.  Raises CalledProcessError."""
    for command in (
        ["cmake", "-S", str(SOURCE), "-B", str(folder)],
        ["cmake", "--build", str(folder), "-j2", "--target", "station", *more],
    ):
        _run(command)
    return folder / "station"


def build_mutant(mutant: Mutant, folder: Path) -> Path:
    """A copy of the folder with the mistake in it, compiled.  Raises CalledProcessError."""
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
    tied = children.tied(command, group=True)
    subprocess.run(tied, check=True, capture_output=True, text=True, timeout=SECONDS)
