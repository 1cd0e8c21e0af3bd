"""The catalogues of faults: each entry is checked when it is read."""

from __future__ import annotations

from pathlib import Path

import pytest

from automcm_maintenance.code_mutation import faults
from automcm_maintenance.code_mutation.faults import CATALOGUES


@pytest.mark.parametrize("path", sorted(CATALOGUES.glob("*.toml")), ids=lambda path: path.stem)
def test_each_text_is_found(path: Path) -> None:
    assert faults.load(path.stem)
