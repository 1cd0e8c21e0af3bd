"""Jinja templates, with the same options for all pages."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from jinja2 import Environment, FileSystemLoader, StrictUndefined


def environment(folder: Path, **options: Any) -> Environment:
    """The templates of a folder. A missing value raises an exception of jinja2, and a block on a
    line of its own leaves no line. ``options`` are further ones of ``Environment``."""
    return Environment(
        loader=FileSystemLoader(folder),
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        **options,
    )
