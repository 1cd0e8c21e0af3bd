"""The extras without which a part of the software cannot be imported, such as the command
``automcm`` and secured links."""

from __future__ import annotations

from importlib.util import find_spec

_PACKAGES = {
    "kit": ("typer", "rich", "jinja2", "junitparser"),
    "map": ("lanelet2",),
    "radio": ("ns",),
    "secure": ("cbor2", "cryptography"),
}


class MissingExtra(ImportError):
    """An extra is not installed; the text says how to install it."""


def missing(extra: str) -> str | None:
    """Which packages of the extra are missing and how to install them, in one line; else None."""
    names = [name for name in _PACKAGES[extra] if find_spec(name) is None]
    return f"needs {', '.join(names)}: pip install 'automcm[{extra}]'" if names else None
