"""The stations of docs/first-hour.md, put together as the page says."""

from __future__ import annotations

import re
from pathlib import Path

from automcm_conformance.adapter.new_adapter import create

DOCS = Path(__file__).resolve().parents[2] / "docs"
PAGE = (DOCS / "first-hour.md").read_text(encoding="utf-8")
CPP = (DOCS / "first-hour" / "station.hpp").read_text(encoding="utf-8")
CASES = ("AMCM/RCV/ADV/BV", "AMCM/RCV/NEG")


def blocks(language: str) -> list[str]:
    """What the page shows in a language, block by block."""
    return re.findall(rf"^```{language}\n(.*?)^```$", PAGE, re.MULTILINE | re.DOTALL)


def _assemble(folder: Path, language: str, old_class: str, station: str, code: str) -> Path:
    """Write the template and edit it as the page says; the command of the adapter.

    Raises ValueError if the page or the template is not what this expects.
    """
    *_, run = create("python" if language == "python" else "cpp", folder)
    instead, features = blocks(language)[:2]
    adapter = folder / ("adapter.py" if language == "python" else "adapter.cpp")
    text, classes = re.subn(
        old_class, lambda _: instead, adapter.read_text(), count=1, flags=re.DOTALL
    )
    text, lines = re.subn(r'^ *\{?"features".*\n', lambda _: features, text, flags=re.MULTILINE)
    if (classes, lines) != (1, 1):
        raise ValueError(
            f"{adapter.name}: {classes} classes and {lines} lines replaced, not 1 and 1"
        )
    adapter.write_text(text)
    (folder / station).write_text(code)
    return run


def python_station(folder: Path) -> Path:
    """The station in Python; the command of its adapter."""
    code = "\n".join(blocks("python")[2:])
    return _assemble(
        folder, "python", r"class Station:.*?(?=\n\nclass Adapter)", "station.py", code
    )


def cpp_station(folder: Path) -> Path:
    """The station in C++, not built; the command of its adapter."""
    return _assemble(folder, "cpp", r"class Station \{.*?\n\};\n", "station.hpp", CPP)
