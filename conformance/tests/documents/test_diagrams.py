"""The phases and rules declared are those of the graph and of docs/protocol.md."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from automcm.core.phases import WAYS
from automcm_maintenance.documents import citations, state_diagrams
from automcm_maintenance.documents.state_diagrams import Edge, Way
from automcm_spec.graph import oracle_generation
from automcm_spec.graph.oracle import Oracle, load
from automcm_spec.model_checking import models
from automcm_spec.vocabulary.rules import RULES

ROOT = Path(__file__).resolve().parents[3]
PROTOCOL = (ROOT / "docs" / "protocol.md").read_text()


@pytest.fixture(scope="module")
def one_peer() -> Oracle:
    return load(oracle_generation.ONE_PEER.path)


@pytest.fixture(scope="module")
def edges(one_peer: Oracle) -> set[Edge]:
    return state_diagrams.edges(one_peer)


@pytest.fixture(scope="module")
def drawn(edges: set[Edge]) -> set[Edge]:
    return {edge for edge in edges if edge.event != "restart"}


def ways(edges: set[Edge]) -> set[Way]:
    return {edge.way for edge in edges}


def table_rows(first: str) -> list[list[str]]:
    """The rows of the first table of protocol.md whose head begins with ``first``."""
    lines = PROTOCOL[PROTOCOL.index(f"\n| {first} |") + 1 :].split("\n\n")[0].splitlines()
    return [re.split(r"(?<!\\)\|", line.strip("| ")) for line in lines[2:]]


def test_the_declaration_names_every_step_and_its_rule_and_no_other(edges: set[Edge]) -> None:
    assert ways(edges) == set(WAYS)


@pytest.mark.parametrize("way", WAYS, ids="-".join)
def test_a_way_missing_from_either_is_named(way: Way, edges: set[Edge]) -> None:
    role, source, target, rule = way
    said = f"{role} {source} to {target} by {rule}"
    with pytest.raises(ValueError, match=f"differ: only in the graph: {said}$"):
        state_diagrams.diagram(WAYS.keys() - {way}, edges, role)
    with pytest.raises(ValueError, match=f"differ: only declared: {said}$"):
        state_diagrams.check(WAYS, {edge for edge in edges if edge.way != way})


def test_the_tables_of_the_protocol_name_every_step_and_its_rules(drawn: set[Edge]) -> None:
    told: set[tuple[str, str, str, str]] = set()
    for role in state_diagrams.ROLES:
        bound = {e.source for e in drawn if e.role == role} - {"STANDALONE"}
        for sources, target, by in table_rows(f"{role}: from"):
            given = bound if "each but" in sources else re.findall(r"[A-Z]+", sources)
            for rule in re.findall(r"[A-Z]{3}-\d", by):
                told |= {(role, source, target.strip(), rule) for source in given}
    assert told == ways(drawn)


def test_end_8_a_restart_leads_from_every_phase_to_standalone(edges: set[Edge]) -> None:
    restarts = {edge for edge in edges if edge.event == "restart"}
    assert {edge.rule for edge in restarts} == {"END-8"}
    bound = {(e.role, e.source, "STANDALONE", "END-8") for e in edges if e.source != "STANDALONE"}
    assert ways(restarts) == bound == {way for way in WAYS if way[3] == state_diagrams.RESTART}


@pytest.mark.slow
@pytest.mark.parametrize(
    "graph", [oracle_generation.TIGHT, oracle_generation.TWO_PEERS], ids=lambda g: g.name
)
def test_the_other_graphs_have_no_other_step(
    graph: oracle_generation.Graph, edges: set[Edge]
) -> None:
    assert state_diagrams.edges(load(graph.path)) <= edges


@pytest.mark.parametrize("role", state_diagrams.ROLES)
def test_every_step_is_drawn_and_its_rule_named(
    role: str, edges: set[Edge], drawn: set[Edge]
) -> None:
    arrows = {}
    for line in state_diagrams.diagram(WAYS, edges, role).splitlines()[2:]:
        arrow, label = line.split(" : ")
        assert not set(":;#") & set(label), "Mermaid would end the label there"
        source, target = arrow.strip().split(" --> ")
        arrows[role, source, target] = label
    mine = {edge for edge in drawn if edge.role == role}
    assert set(arrows) == {edge.way[:3] for edge in mine}
    for edge in mine:
        label = arrows[edge.role, edge.source, edge.target]
        lines = [line for line in label.split("<br/>") if line.endswith(f"({edge.rule})")]
        assert len(lines) == 1 and edge.event in lines[0]


RULE = re.compile(
    r"^#### ([A-Z]{3}-\d)\n\n(1\. .*?)\n\n"
    r"Source: (.+?)\.(?:\nOperators: (.+?)\.(?:\nNeed shown by: (.+?)\.)?)?\n(?:\n|\Z)",
    re.MULTILINE | re.DOTALL,
)
"""A rule of protocol.md: id, sentences, source, operators and, if there are any, models; a kernel
rule ends with its source."""
PARSED = {rule: fields for rule, *fields in RULE.findall(PROTOCOL)}


def test_the_page_has_every_rule_once_and_no_other() -> None:
    headings = re.findall(r"^#### (\S+)$", PROTOCOL, re.MULTILINE)
    assert headings == list(PARSED)
    assert sorted(headings) == sorted([*RULES, *citations.KINEMATIC, *citations.APPLICATION])


def test_every_rule_of_the_station_has_operators_and_no_other_has() -> None:
    assert {rule for rule, (*_, operators, _) in PARSED.items() if operators} == set(RULES)


def test_every_operator_named_is_in_the_specification() -> None:
    modules = "\n".join(path.read_text() for path in (ROOT / "spec" / "tla").glob("*.tla"))
    for rule, (*_, operators, _) in PARSED.items():
        for name in re.findall(r"`(\w+)`", operators):
            assert re.search(rf"^{name}\b.*==", modules, re.MULTILINE), f"{rule}: {name}"


def test_every_model_that_must_fail_is_named_by_a_rule_that_it_takes_away() -> None:
    named = {name for *_, need in PARSED.values() for name in re.findall(r"`(\w+)`", need)}
    must_fail = {m.cfg for m in models.load() if m.expect == "violates"}
    # ..._less_one shows that a bound is tight; an attacker may break what no rule protects; N-1 to
    # N-3 are about the station as a whole
    other = {m.cfg for m in models.load() if m.module in (*models.ATTACKED, "Independence")}
    other |= {name for name in must_fail if name.endswith("_less_one")}
    assert must_fail - other <= named <= must_fail
