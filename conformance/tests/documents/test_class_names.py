"""A public class name stands once in the packages, or names the same concept."""

from __future__ import annotations

import re
from collections import defaultdict
from pathlib import Path

ROOT = Path(__file__).resolve().parents[3]
PUBLISHED = {
    "spec/automcm_spec/vocabulary/station.py",  # generated: the names of the specification
    "spec/automcm_spec/log_format/log.py",
    "conformance/automcm_conformance/adapter/protocol.py",
    "conformance/automcm_conformance/adapter/templates/python/adapter.py",  # a skeleton
    "conformance/automcm_conformance/vectors/vector_validation.py",
    "conformance/tools/automcm_maintenance/exact_vectors/exact_geometry.py",  # the kernels again
}
"""Modules whose classes have the names of the same concepts: in a schema, or as noted."""
SAME = {"Trajectory"}  # in integers of a message, and in SI units


def test_a_public_class_name_stands_once() -> None:
    places = defaultdict(list)
    for path in sorted(ROOT.glob("*/**/automcm*/**/*.py")):
        name = str(path.relative_to(ROOT))
        if name in PUBLISHED or "/tests/" in name:
            continue
        for found in re.findall(
            r"^class ([A-Z]\w*)", path.read_text(encoding="utf-8"), re.MULTILINE
        ):
            places[found].append(name)
    assert {name: some for name, some in places.items() if len(some) > 1}.keys() == SAME
    assert all((ROOT / name).exists() for name in PUBLISHED)
