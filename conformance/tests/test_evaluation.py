"""The committed results of the evaluation: small cells run again, and the page made of them."""

from __future__ import annotations

import json
import re
from typing import Any

import pytest

from automcm.experiments import NAMES, experiment, report, sweep
from automcm_cli import generated

Json = Any
FOLDER = generated.EVALUATION.with_suffix("")
SMALL: list[tuple[str, Json]] = [
    ("bandwidth", {"part": "sizes"}),
    ("bandwidth", {"part": "drive", "vehicles": 2, "loss": 0.0}),
    ("arrival", {"part": "one", "name": "notice", "speed_kmh": 30}),
    ("comfort", {"part": "fig6", "speed_kmh": 30}),
    ("loss", {"part": "cost", "t_timeout": 0, "loss": 50}),
    ("loss", {"part": "fine", "t_timeout": 1000, "loss": 88}),
    ("safety", {"part": "faults", "fault": "target aborts", "loss": 0.0}),
]
RESULTS = {name: json.loads((FOLDER / name / report.RESULTS).read_text()) for name in NAMES}


@pytest.mark.sweep(2)
@pytest.mark.parametrize(("name", "values"), SMALL, ids=lambda v: v if isinstance(v, str) else "")
def test_a_small_cell_gives_what_is_committed(name: str, values: Json) -> None:
    found = RESULTS[name]
    cell = next(c for c in found["cells"] if values.items() <= c["values"].items())
    assert sweep.run_cell(name, cell["values"], found["seed"]) == cell["result"]


@pytest.mark.parametrize("name", NAMES)
def test_the_committed_results_are_of_the_standard_profile_in_full(name: str) -> None:
    found, made = RESULTS[name], experiment(name)
    settings = made.set("standard", {})
    assert found["profile"] == "standard" and found["settings"] == settings.model_dump(mode="json")
    assert [cell["values"] for cell in found["cells"]] == made.cells(settings)
    assert not found["summary"].get("broken")


@pytest.mark.parametrize("name", NAMES)
def test_what_stands_beside_the_results_is_made_of_them(name: str) -> None:
    made = report.load(FOLDER / name / report.RESULTS)
    assert made == RESULTS[name]
    assert (FOLDER / name / f"{name}.csv").read_text() == report.table(made)


def test_each_figure_of_the_page_is_there() -> None:
    links = re.findall(r"!\[[^\]]+\]\((evaluation/[^)]+)\)", generated.EVALUATION.read_text())
    assert len(links) >= len(NAMES)
    for link in links:
        assert (FOLDER.parent / link).exists(), link
    drawn = {f"evaluation/{p.parent.name}/{p.name}" for p in FOLDER.glob("*/*.svg")}
    assert drawn == set(links), "no figure is left that no page shows"
