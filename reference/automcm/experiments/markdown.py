"""A table of Markdown, for the pages of the experiments."""

from __future__ import annotations

from collections.abc import Sequence


def table(heads: Sequence[str], rows: Sequence[Sequence[object]], left: int = 1) -> list[str]:
    """Its lines; the first ``left`` columns are texts, the others figures, to the right."""
    ruler = ["---" if n < left else "---:" for n in range(len(heads))]
    return [f"| {' | '.join(map(str, row))} |" for row in (heads, ruler, *rows)]
