"""``automcm verify --no-models --rule ID``: the small graph, and its findings about a rule."""

from __future__ import annotations

from functools import cache
from pathlib import Path
from typing import Any

import pytest
from cli_stage import automcm, shown

from automcm_maintenance.documents import generated_files
from automcm_maintenance.verify import graph_comparison
from automcm_maintenance.verify import verify as verify_
from automcm_spec.graph import oracle, oracle_generation
from automcm_spec.vocabulary.rules import NO_GRAPH, RULES

REAL = oracle_generation.build


@cache
def built() -> Any:
    return REAL(oracle_generation.SMALL, short=True)


@pytest.fixture(autouse=True)
def built_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """TLC writes the small graph once for all tests here; nothing else is asked for."""

    def build(graph: oracle_generation.Graph, *, short: bool) -> Any:
        assert graph is oracle_generation.SMALL and short
        return built()

    def unwanted(*_: object, **__: object) -> None:
        raise AssertionError("only the small graph is compared")

    monkeypatch.setattr(oracle_generation, "build", build)
    monkeypatch.setattr(verify_, "KEPT", tmp_path)
    for module, name in ((verify_, "_models"), (verify_, "_behave"), (generated_files, "drift")):
        monkeypatch.setattr(module, name, unwanted)


def test_an_unknown_rule_is_2_and_the_known_ones_are_named() -> None:
    answer = automcm("verify", "--no-models", "--rule", "NEG-44")
    assert answer.exit_code == 2 and all(rule in answer.output for rule in RULES)


@pytest.mark.slow
@pytest.mark.parametrize("rule", [rule for rule in RULES if rule in NO_GRAPH])
def test_a_rule_that_decides_nothing_there_is_4(rule: str) -> None:
    report = verify_.run(models_too=False, rule=rule)
    assert (report.pairs, report.ok, report.exit_code) == (0, False, 4)
    assert f"Cannot tell {rule} decides nothing in the small graph; it is shown by" in shown(report)


@pytest.mark.slow
def test_the_small_graph_misses_every_rule_that_is_taken_away() -> None:
    graph = oracle.parse(oracle.dump(built()[0]), "small")
    found = graph_comparison.covered(graph, lambda rule: verify_._reference(graph.constants, rule))
    assert not found.uncovered and set(found.covered) == set(RULES) - set(NO_GRAPH)
