"""The extra ``kit``: neither the command ``automcm`` nor the pytest plugin works without it."""

from __future__ import annotations

from importlib.util import find_spec

_KIT = ("typer", "rich", "jinja2", "junitparser")


def kit_missing() -> str | None:
    """Which packages of the extra are missing and how to install them, in one line; else None."""
    missing = [name for name in _KIT if find_spec(name) is None]
    return f"needs {', '.join(missing)}: pip install 'automcm[kit]'" if missing else None
