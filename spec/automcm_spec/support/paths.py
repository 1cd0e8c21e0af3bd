"""Where data is that belongs to a package: the TLA+ modules, the models, the oracle."""

from pathlib import Path


def data(name: str, package: Path) -> Path:
    """The copy of a folder that a wheel carries, else the one beside ``package`` in a checkout."""
    packaged = package / "_data" / name
    return packaged if packaged.is_dir() else package.parent / name


_HERE = Path(__file__).resolve().parents[1]


TLA = data("tla", _HERE)
MODELS = data("models", _HERE)
ORACLES = data("oracle", _HERE)
BENCH = data("bench", _HERE)
SIMULATION = data("simulation", _HERE)
