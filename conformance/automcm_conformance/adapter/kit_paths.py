"""The folders of the kit's data and of its reports."""

from datetime import datetime
from pathlib import Path

from automcm_spec.support.paths import data

_HERE = Path(__file__).resolve().parents[1]


SUITE = data("suite", _HERE)
VECTORS = data("vectors", _HERE)
TEMPLATES = Path(__file__).with_name("templates")


def fresh_folder() -> Path:
    """A new folder runs/<time>, with a number appended if that exists.

    Raises FileExistsError after a thousand attempts.
    """
    stem = datetime.now().strftime("%Y-%m-%dT%H-%M-%S")
    for n in range(1, 1000):
        folder = Path("runs") / (stem if n == 1 else f"{stem}-{n}")
        if not folder.exists():
            return folder
    raise FileExistsError(f"runs/{stem} to runs/{stem}-999 exist; delete some, or name a folder")
