"""The figures in the README and in docs/ that something here can count."""

from __future__ import annotations

import json
import re
import runpy

import pytest

from automcm_conformance.report import report
from automcm_maintenance.documents.repository import ROOT
from automcm_maintenance.induction import recorded_proof
from automcm_spec.graph import oracle, oracle_generation
from automcm_spec.model_checking import models
from automcm_spec.vocabulary.rules import NO_GRAPH, RULES
from automcm_traces.checker import possible_states

OBLIGATIONS = json.loads(recorded_proof.PATH.read_text())["obligations"]
MODELS = {model.cfg: model for model in models.load()}
NOUNS = (
    "models|properties|cases|rules|obligations|conjuncts|mutants|edits|states|inputs|transitions|"
    "refusals|mechanisms|lemmas|vectors|faults|scenarios|logs"
)
FIGURE = re.compile(rf"\b\d+([.,]\d+)*( million| of \d+)?( [a-z]+)? ({NOUNS})\b")
BY_HAND = [
    "15.9 million inputs",  # below
    "24 edits",  # test_second_reader
    "22 of 24 mutants that were drawn",  # automcm conform certify --quick
    "256 MiB and 200 logs",  # test_page_limits
    "22 cases",  # test_first_hour, with the next two
    "335 transitions",
    "912 inputs",
]
"""Those of a measurement, and those that another test counts."""
GENERATED = {"evaluation.md"}


def prose(text: str) -> str:
    """A page without its examples and generated tables."""
    for begin, end in (("^```", "^```$"), ("<!-- begin", "<!-- end")):
        text = re.sub(f"{begin}.*?{end}", "", text, flags=re.MULTILINE | re.DOTALL)
    return " ".join(text.split())


PAGES = {
    path.name: prose(path.read_text(encoding="utf-8"))
    for path in (ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md")))
    if path.name not in GENERATED
}


def counted() -> dict[str, list[str]]:
    """What the pages must say."""
    edits = runpy.run_path(str(ROOT / "spec" / "tests" / "coupled_stage.py"))
    inductive = (ROOT / "spec" / "tla" / "Inductive.tla").read_text()
    conjuncts = re.findall(r"^  /\\ \w+Inv$", inductive, re.MULTILINE)
    return {
        "conformance.md": [f"up to {report.MAX_PAGES} failed cases"],
        "trace-format.md": [f"More than {possible_states.MOST} states"],
        "verification.md": [
            f"{len(conjuncts)} conjuncts",
            f"{OBLIGATIONS} obligations",
            f"step 2 leaves: {MODELS['cutoff'].distinct_states:,} states",
            f"`cutoff_timed`: {MODELS['cutoff_timed'].distinct_states:,} states",
            f"{len(edits['COUPLED'])} more edits of `Station.tla`",
            f"{len(edits['DEPENDENT'])} edits are refused",
        ],
    }


def test_each_figure_in_the_prose_is_counted() -> None:
    known = [*BY_HAND]
    for page, texts in counted().items():
        for text in texts:
            assert text in PAGES[page], (page, text)
            known.append(text)
    left = re.sub("|".join(map(re.escape, known)), "", "\n".join(PAGES.values()))
    assert [found[0] for found in FIGURE.finditer(left)] == [], "count it in counted()"


def test_the_screen_in_the_readme_has_the_recorded_counts() -> None:
    screen = (ROOT / "README.md").read_text(encoding="utf-8")
    held = re.findall(r"^(\w+) +([\d,]+) +\S+ +[\d.]+  ok$", screen, re.MULTILINE)
    failed = re.findall(r"(\w+) +([A-Z]-\d+) +(\d+)  ok", screen)
    assert len(held) >= 2 and len(failed) >= 2
    for name, states in held:
        assert states == f"{MODELS[name].distinct_states:,}", name
    for name, property_, steps in failed:
        assert (property_, int(steps)) == (MODELS[name].property, (MODELS[name].length or 1) - 1)
    missed = len(RULES.keys() - NO_GRAPH.keys())
    assert f"{missed} of {missed} missed when taken away; {len(NO_GRAPH)} shown" in screen
    assert f"Proof       {OBLIGATIONS} obligations proved" in screen


@pytest.mark.slow
def test_the_inputs_of_the_full_profile() -> None:
    graphs = [oracle.load(graph.path) for graph in oracle_generation.GRAPHS.values()]
    inputs = sum(graph.transitions + graph.refusals for graph in graphs)
    assert f"all {inputs / 1e6:.1f} million inputs" in PAGES["compiled-station.md"]
