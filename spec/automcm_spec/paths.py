"""Where the TLA+ modules and the models are."""

from pathlib import Path

_HERE = Path(__file__).resolve().parent


def _data(name: str) -> Path:
    """The folder beside this package in a checkout, else the copy a wheel carries."""
    checkout = _HERE.parent / name
    packaged = _HERE / "_data" / name
    return packaged if packaged.is_dir() else checkout


TLA = _data("tla")
MODELS = _data("models")
ORACLES = _data("oracle")
BENCH = _data("bench")
SIMULATION = _data("simulation")
