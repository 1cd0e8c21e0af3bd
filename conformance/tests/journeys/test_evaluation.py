"""The committed results of the evaluation: small cells run again, and the page made of them."""

from __future__ import annotations

import copy
import json
import lzma
import re
from functools import cache
from pathlib import Path
from typing import Any

import pytest

from automcm_evaluation.sweeps import report, sweep
from automcm_evaluation.sweeps.catalogue import NAMES, experiment
from automcm_maintenance.documents import built_pages, generated_files

Json = Any
FOLDER = generated_files.EVALUATION.with_suffix("")
SMALL: list[tuple[str, Json]] = [
    ("bandwidth", {"part": "sizes"}),
    ("bandwidth", {"part": "drive", "vehicles": 2, "loss": 0.0}),
    ("arrival", {"part": "one", "name": "notice", "speed_kmh": 30}),
    ("comfort", {"part": "fig6", "speed_kmh": 30}),
    ("loss", {"part": "cost", "t_timeout": 0, "loss": 50}),
    ("loss", {"part": "fine", "t_timeout": 1000, "loss": 88}),
    ("safety", {"part": "faults", "fault": "target aborts", "loss": 0.0}),
    ("traffic", {"part": "all ask", "stations": 2, "spread_ms": 0}),
]


@cache
def results(name: str) -> Json:
    """The committed report of an experiment."""
    return report.load(FOLDER / name / report.RESULTS)


@pytest.mark.sweep(2)
@pytest.mark.parametrize(("name", "values"), SMALL, ids=lambda v: v if isinstance(v, str) else "")
def test_a_small_cell_gives_what_is_committed(name: str, values: Json) -> None:
    found = results(name)
    cell = next(c for c in found["cells"] if values.items() <= c["values"].items())
    assert sweep.run_cell(name, cell["values"], found["seed"]) == cell["result"]


@pytest.mark.parametrize("name", NAMES)
def test_the_committed_results_are_of_the_standard_profile_in_full(name: str) -> None:
    found, made = results(name), experiment(name)
    settings = made.set("standard", {})
    assert found["profile"] == "standard" and found["settings"] == settings.model_dump(mode="json")
    assert [cell["values"] for cell in found["cells"]] == made.cells(settings)
    assert not found["summary"].get("broken")


@pytest.mark.parametrize("name", NAMES)
def test_the_summary_and_the_claims_in_the_file_are_of_its_cells(name: str) -> None:
    plain = FOLDER / name / report.RESULTS
    packed = plain.with_name(plain.name + report.COMPRESSED)
    data = plain.read_bytes() if plain.exists() else lzma.decompress(packed.read_bytes())
    assert json.loads(data) == results(name)


def test_short_runs_in_which_nobody_comes_near_have_a_page(tmp_path: Path) -> None:
    for name in NAMES:
        (tmp_path / name).mkdir()
        if name != "traffic":
            (tmp_path / name / report.RESULTS).symlink_to(FOLDER / name / report.RESULTS)
    made = copy.deepcopy(results("traffic"))
    road = [c for c in made["cells"] if c["values"]["part"] == "road"]
    for cell in road:
        cell["result"] |= {"least_ttc_s": None, "vehicle_s": 1.0}
    first = [c for c in road if c["values"]["seed"] == 1 and c["values"]["per_km"] == 50]
    made["cells"] = [c for c in made["cells"] if c["values"]["part"] != "road"] + first
    (tmp_path / "traffic" / report.RESULTS).write_text(json.dumps(made))
    text = report.evaluation(tmp_path)
    assert "runs with stations (" in text and "the least" not in text.split("- Distances.")[1]


@pytest.mark.slow
def test_each_figure_is_there_and_on_a_page() -> None:
    built = built_pages.pages()
    pages = {FOLDER / name / report.PAGE: built[f"evaluation/{name}/README.md"]() for name in NAMES}
    pages[generated_files.EVALUATION] = generated_files.EVALUATION.read_text()
    shown = {
        path.parent / link
        for path, text in pages.items()
        for link in re.findall(r"!\[[^\]]+\]\(([^)]+)\)", text)
    }
    assert shown == set(FOLDER.glob("*/*.svg"))


def test_the_summary_has_a_picture_and_a_link_to_the_details_of_each_experiment() -> None:
    text = generated_files.EVALUATION.read_text()
    for name in NAMES:
        assert f"](evaluation/{name}/{report.PAGE})" in text
        assert re.search(rf"!\[[^\]]+\]\(evaluation/{name}/\S+\.svg\)", text), name
    for claim in (claim for name in NAMES for claim in results(name)["claims"]):
        assert (claim["claim"] in text) == (claim["verdict"] != "beyond the paper"), claim["claim"]
