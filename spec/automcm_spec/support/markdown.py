"""Markdown pages from Jinja templates."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from jinja2 import Environment

from automcm_spec.support.templates import environment


def templates(folder: Path) -> Environment:
    """The templates of a folder.  Besides Jinja's own filters there is ``fmt``: Python's format."""
    found = environment(folder, keep_trailing_newline=True)
    found.filters["fmt"] = format
    return found


def page(template: Path, **values: Any) -> str:
    """The rendered page. A missing value raises an exception of jinja2."""
    return templates(template.parent).get_template(template.name).render(values)
