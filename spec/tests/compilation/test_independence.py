"""The models of N-1 to N-3 notice every edit of Station.tla that couples sessions."""

from __future__ import annotations

from pathlib import Path

import pytest
from coupled_stage import COUPLED, edited

from automcm_spec.model_checking import models

LEMMAS = sorted(
    (m for m in models.load() if m.module == "Independence" and m.expect == "holds"),
    key=lambda model: model.seconds,
)
SECONDS = 900


@pytest.mark.slow
@pytest.mark.parametrize("what", COUPLED)
def test_an_edit_that_couples_sessions_breaks_a_lemma(what: str, tmp_path: Path) -> None:
    tla = edited(COUPLED[what], tmp_path)
    verdicts = (models.check(model, tla_dir=tla, timeout_s=SECONDS) for model in LEMMAS)
    assert any(verdict.outcome == "violates" for verdict in verdicts)
