"""The clone of the repository that is maintained, and how its pages are written."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

ROOT = Path(__file__).resolve().parents[3]
"""The clone."""
PAGES = Path(__file__).with_name("pages")
"""Templates of Markdown."""


def markdown_table(
    heads: Sequence[str], rows: Sequence[Sequence[object]], left: Sequence[str] = ("what",)
) -> str:
    """A table of Markdown; the first column and those named are texts, the others figures."""
    ruler = ["---" if n == 0 or head in left else "---:" for n, head in enumerate(heads)]
    cells = [[str(value).replace("|", "\\|") for value in row] for row in rows]
    return "\n".join(f"| {' | '.join(row)} |" for row in [list(heads), ruler, *cells])
