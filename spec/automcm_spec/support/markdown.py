"""Markdown pages from Jinja templates."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from automcm_spec.support.templates import environment


def page(template: Path, **values: Any) -> str:
    """The rendered page. A missing value raises an exception of jinja2.

    Besides Jinja's own filters there is ``fmt``, Python's ``format``.
    """
    templates = environment(template.parent, keep_trailing_newline=True)
    templates.filters["fmt"] = format
    return templates.get_template(template.name).render(values)
