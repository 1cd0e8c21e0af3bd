"""The edits of a second reader (conformance/fault_catalogue/second_reader.toml)."""

from __future__ import annotations

from pathlib import Path

import pytest
from coupled_stage import edited

from automcm_maintenance.code_mutation import faults
from automcm_spec.model_checking import models

EDITS = faults.load("second_reader")


def test_the_figures_of_verification_md() -> None:
    assert (len(EDITS), sum("property" in e.notice for e in EDITS.values())) == (24, 19)


@pytest.mark.slow
@pytest.mark.parametrize("name", [name for name, edit in EDITS.items() if "model" in edit.notice])
def test_it_violates_its_property(name: str, tmp_path: Path) -> None:
    notice = EDITS[name].notice
    (base,) = [m for m in models.load() if m.cfg == notice["model"]]
    rest, checks = models.split(base.config)
    (check,) = [each for each in checks if each[1] == models.PROPERTIES[notice["property"]]]
    alone = base.model_copy(update={"config": f"{rest}\n{' '.join(check)}\n"})
    found = models.check(alone, tla_dir=edited(EDITS[name], tmp_path))
    assert found.outcome == "violates", found
