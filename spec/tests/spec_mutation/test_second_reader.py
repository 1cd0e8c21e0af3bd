"""The edits of a second reader (conformance/fault_catalogue/second_reader.toml)."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from automcm_maintenance.code_mutation import faults
from automcm_maintenance.documents.repository import ROOT
from automcm_spec.model_checking import models
from automcm_spec.support.paths import TLA

EDITS = faults.load("second_reader")


def test_each_harmful_one_has_a_property_and_each_other_a_reason() -> None:
    assert len(EDITS) == 24
    for edit in EDITS.values():
        assert set(edit.notice) in ({"property", "model"}, {"allowed"}), edit.name
    assert sum("property" in edit.notice for edit in EDITS.values()) == 19


@pytest.mark.slow
@pytest.mark.parametrize("name", [name for name, edit in EDITS.items() if "model" in edit.notice])
def test_it_violates_its_property(name: str, tmp_path: Path) -> None:
    notice = EDITS[name].notice
    shutil.copytree(TLA, tmp_path / TLA.relative_to(ROOT))
    EDITS[name].write(tmp_path)
    (base,) = [m for m in models.load() if m.cfg == notice["model"]]
    formula = models.PROPERTIES[notice["property"]]
    assert formula in models.checked_in(base.config)
    config = f"{models.split(base.config)[0]}\n{models._keyword(formula)} {formula}\n"
    found = models.check(
        base.model_copy(update={"config": config}), tla_dir=tmp_path / TLA.relative_to(ROOT)
    )
    assert found.outcome == "violates", found
