"""The paths of a package's data: the TLA+ modules, the models, the oracle."""

from pathlib import Path


def data(name: str, package: Path) -> Path:
    """The copy of a folder inside a wheel, or the folder beside ``package`` in a checkout."""
    packaged = package / "_data" / name
    return packaged if packaged.is_dir() else package.parent / name


_HERE = Path(__file__).resolve().parents[1]


TLA = data("tla", _HERE)
MODELS = data("models", _HERE)
ORACLES = data("oracle", _HERE)
SIMULATION = data("simulation", _HERE)
