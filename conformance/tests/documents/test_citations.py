"""The table of what there is on each rule: nothing is missing without a reason."""

from __future__ import annotations

from pathlib import Path

import pytest

from automcm_maintenance.documents import citations, uncited
from automcm_maintenance.documents.citations import Cell
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


def test_no_cell_is_empty_without_a_reason(monkeypatch: pytest.MonkeyPatch) -> None:
    assert "**none**" not in citations.table(ROOT)
    (_, rules, _), *others = uncited.WHY
    monkeypatch.setattr(uncited, "WHY", others)
    assert citations.table(ROOT).count("**none**") == len(rules)
