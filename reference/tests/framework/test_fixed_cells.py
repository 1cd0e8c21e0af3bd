"""Small cells of every experiment give the results that are kept; so do the committed cells."""

from __future__ import annotations

import json
import lzma
import re
from typing import Any

import fixed_cells
import pytest
from fixed_cells import EVALUATION, committed

from automcm_evaluation.sweeps import report
from automcm_evaluation.sweeps.catalogue import NAMES, experiment


@pytest.mark.sweep(30)
@pytest.mark.parametrize(
    "cell",
    fixed_cells.CELLS,
    ids=lambda cell: " ".join(re.findall(r"[a-z]\w+", str(cell))[:6]),
)
def test_a_cell_has_the_result_that_is_kept(cell: Any) -> None:
    """``python reference/tests/fixed_cells.py`` renews them if a change is meant."""
    assert fixed_cells.result(cell) == cell["result"]


@pytest.mark.parametrize("name", NAMES)
def test_the_committed_cells_give_the_committed_summary_and_claims(name: str) -> None:
    (path,) = (path for path in report.results(EVALUATION) if path.parent.name == name)
    data = path.read_bytes()
    written = json.loads(lzma.decompress(data) if path.suffix == ".xz" else data)
    assert json.loads(json.dumps(committed(name))) == written


@pytest.mark.parametrize("name", NAMES)
def test_the_committed_cells_are_those_of_the_settings(name: str) -> None:
    made, of = committed(name), experiment(name)
    cells = of.cells(of.settings.model_validate(made["settings"]))
    assert [cell["values"] for cell in made["cells"]] == json.loads(json.dumps(cells))
