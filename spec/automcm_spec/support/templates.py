"""Pages from Jinja templates, with the same options for all."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from jinja2 import Environment, FileSystemLoader, StrictUndefined


def environment(folder: Path, **options: Any) -> Environment:
    """The templates of a folder. A missing value raises an exception of jinja2, and a block on a
    line of its own leaves no line. Besides Jinja's own filters there is ``fmt``: Python's format.
    ``options`` are further ones of ``Environment``."""
    found = Environment(
        loader=FileSystemLoader(folder),
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
        **options,
    )
    found.filters["fmt"] = format
    return found


def page(template: Path, **values: Any) -> str:
    """The rendered Markdown page. A missing value raises an exception of jinja2."""
    return environment(template.parent).get_template(template.name).render(values)
