"""The folders of the kit's data."""

from pathlib import Path

from automcm_spec.support.paths import data

_HERE = Path(__file__).resolve().parents[1]
SUITE = data("suite", _HERE)
VECTORS = data("vectors", _HERE)
TEMPLATES = Path(__file__).with_name("templates")
