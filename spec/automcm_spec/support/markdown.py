"""Pages of Markdown, made from templates of Jinja."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from jinja2 import Environment, FileSystemLoader, StrictUndefined


def page(template: Path, **values: Any) -> str:
    """The page; a value that the template needs and is not given is an error of jinja2.

    Beside Jinja's own filters there is ``fmt``, Python's ``format``.
    """
    environment = Environment(
        loader=FileSystemLoader(template.parent),
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )
    environment.filters["fmt"] = format
    return environment.get_template(template.name).render(values)
