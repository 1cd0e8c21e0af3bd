"""Ids are compared for equality and session numbers for order, and nothing else."""

from __future__ import annotations

from pathlib import Path

import pytest
from coupled_stage import DEPENDENT, edited

from automcm_maintenance.compilation import compiler, data_independence, sany


def test_ids_are_compared_and_session_numbers_ordered(open_xml: bytes) -> None:
    uses = data_independence.uses(open_xml)
    assert not uses["id", "ordered"] and not uses["id", "incremented"]
    assert uses["number", "ordered"] == ["NewerThanJoined"]
    assert uses["number", "incremented"] == ["OnRequest"]
    assert {"OfPeer", "NextTarget"} <= set(uses["id", "compared"]) - set(uses["number", "compared"])


@pytest.mark.sweep(1)
@pytest.mark.parametrize("what", DEPENDENT)
def test_any_other_use_is_refused(what: str, tmp_path: Path) -> None:
    tla = edited(DEPENDENT[what], tmp_path)
    with pytest.raises(sany.NotCompiled, match=r"^Station.tla:\d+: .*"):
        data_independence.uses(sany.export(compiler.PLAN.module, tla))
