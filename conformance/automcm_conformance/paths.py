"""Where the data of the kit is."""

from pathlib import Path

_HERE = Path(__file__).resolve().parent


def data(name: str) -> Path:
    """The folder beside this package in a checkout, else the copy a wheel carries."""
    checkout = _HERE.parent / name
    return checkout if checkout.is_dir() else _HERE / "_data" / name


SUITE = data("suite")
TEMPLATES = _HERE / "templates"
