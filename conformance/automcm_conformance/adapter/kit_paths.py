"""Where the data of the kit is, and where reports go."""

from datetime import datetime
from pathlib import Path

from automcm_spec.support.paths import data

_HERE = Path(__file__).resolve().parents[1]


SUITE = data("suite", _HERE)
VECTORS = data("vectors", _HERE)
TEMPLATES = Path(__file__).with_name("templates")


def fresh_folder() -> Path:
    """runs/<time>, with a number behind it if it is there.

    Raises FileExistsError if a thousand are there.
    """
    stem = datetime.now().strftime("%Y-%m-%dT%H-%M-%S")
    for n in range(1, 1000):
        folder = Path("runs") / (stem if n == 1 else f"{stem}-{n}")
        if not folder.exists():
            return folder
    raise FileExistsError("runs: too many folders of this second")
