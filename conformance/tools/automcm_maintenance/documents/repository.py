"""The folders of the repository, and tables of Markdown."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Sequence
from pathlib import Path

ROOT = Path(__file__).resolve().parents[4]
"""The root of the repository."""
SOURCES = {
    path.name: path
    for folder in ("spec", "reference", "traces", "conformance")
    for path in sorted((ROOT / folder).glob("automcm*"))
}
"""The folder of each package of the product and of the evaluation, by name."""
PAGES = Path(__file__).with_name("pages")
"""Templates of Markdown."""


def digest(root: Path, parts: Iterable[str]) -> str:
    """The hash of these files and folders."""
    whole = hashlib.sha256()
    for part in parts:
        found = root / part
        for path in sorted(found.rglob("*")) if found.is_dir() else [found]:
            if path.is_file() and path.suffix != ".pyc":
                whole.update(f"\0{path.relative_to(root)}\0".encode())
                whole.update(hashlib.sha256(path.read_bytes()).digest())
    return whole.hexdigest()


def markdown_table(
    heads: Sequence[str], rows: Sequence[Sequence[object]], left: Sequence[str] = ("what",)
) -> str:
    """A table of Markdown; the first and the ``left`` columns are left-aligned."""
    ruler = ["---" if n == 0 or head in left else "---:" for n, head in enumerate(heads)]
    cells = [[str(value).replace("|", "\\|") for value in row] for row in rows]
    return "\n".join(f"| {' | '.join(row)} |" for row in [list(heads), ruler, *cells])
