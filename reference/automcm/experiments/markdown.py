"""The pages of the experiments: templates in ``pages``, filled with figures of a report."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from jinja2 import Environment, FileSystemLoader, StrictUndefined

from automcm.experiments.intervals import wilson

ENVIRONMENT = Environment(
    loader=FileSystemLoader(Path(__file__).parent / "pages"),
    undefined=StrictUndefined,
    trim_blocks=True,
    lstrip_blocks=True,
)


def page(name: str, **values: Any) -> list[str]:
    """The lines of the page ``pages/NAME.md.j2``; a value that it lacks is jinja2's error."""
    return ENVIRONMENT.get_template(f"{name}.md.j2").render(values).splitlines()


ENVIRONMENT.filters["fmt"] = format
ENVIRONMENT.globals["wilson"] = wilson
