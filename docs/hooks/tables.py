"""``\\|`` in the code of a cell is ``|``, as where the repository is read."""

from __future__ import annotations

import re
from typing import Any

CELL = re.compile(r"<td.*?</td>", re.DOTALL)


def on_page_content(html: str, **_: Any) -> str:
    """Python-Markdown splits cells as GitHub does, but leaves the backslash in code."""
    return CELL.sub(lambda cell: cell[0].replace("\\|", "|"), html)
