"""The table of what there is on each rule."""

from __future__ import annotations

from pathlib import Path

import pytest

from automcm_maintenance.documents import citations
from automcm_maintenance.documents.citations import Cell
from automcm_spec.model_checking import models
from automcm_spec.vocabulary.rules import RULES

ROOT = Path(__file__).resolve().parents[3]


@pytest.fixture(scope="module")
def found() -> dict[str, dict[str, Cell]]:
    return citations.found(ROOT)


def test_each_rule_kernel_and_property_has_a_row_and_each_link_leads_somewhere(
    found: dict[str, dict[str, Cell]],
) -> None:
    assert {*RULES, "KIN-1", "KIN-7", "S-1", "L-4", "T-5"} <= set(found)
    links = {link for cells in found.values() for cell in cells.values() for link in cell}
    for name, link in links:
        path, _, line = link.partition("#L")
        text = (ROOT / path).read_text()
        assert not line or name in text.splitlines()[int(line) - 1], link


STEPS = {"ADV-1", "ADV-2", "PRE-1", "PRE-3", "NEG-8"}
"""A step of the session, not a protection: ``station_properties`` must reach it."""
NO_EFFECT = {"CMD-1", "MSG-1"}
"""The comparison gives every such input to every state."""
APPLICATION = "ACT-1"
"""Up to the application: no message and no timer shows it."""


def test_each_rule_is_specified_coded_and_checked(found: dict[str, dict[str, Cell]]) -> None:
    def without(column: str) -> set[str]:
        return {rule for rule in RULES if not found[rule][column]}

    assert without("code") == without("test") == set()
    for column in ("specification", "case", "log tools"):
        assert without(column) == {APPLICATION}, column
    assert without("must fail") == STEPS | NO_EFFECT | {APPLICATION}
    kernels = [*citations.KINEMATIC, "APP-6"]
    assert not [rule for rule in kernels if not found[rule]["vector"] or not found[rule]["code"]]
    for property_, formula in models.PROPERTIES.items():
        if property_ != "TypeInv":
            cells = found[property_]
            assert cells["specification"] and cells["must fail"], formula
