"""The models of N-1 to N-3 notice every edit of Station.tla that couples sessions."""

from __future__ import annotations

from pathlib import Path

import pytest
from coupled_stage import COUPLED, edited
from model_stage import LISTED

from automcm_spec.model_checking import models


@pytest.mark.slow
@pytest.mark.parametrize("what", COUPLED)
def test_an_edit_that_couples_sessions_breaks_a_lemma(what: str, tmp_path: Path) -> None:
    model = LISTED[COUPLED[what].notice.get("model", "independent_tight")]
    tla = edited(COUPLED[what], tmp_path)
    assert models.check(model, tla_dir=tla).outcome == "violates"
