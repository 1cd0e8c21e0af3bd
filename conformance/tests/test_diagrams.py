"""The graph's phases are those of the reference's table and of docs/protocol.md."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from automcm.phases import TABLE
from automcm_conformance import diagrams
from automcm_conformance.diagrams import Edge
from automcm_spec import generate, models
from automcm_spec.oracle import Oracle, load

ROOT = Path(__file__).resolve().parents[2]
PROTOCOL = (ROOT / "docs" / "protocol.md").read_text()
Way = tuple[str, str, str]
"""Role, phase before, phase after."""


@pytest.fixture(scope="module")
def one_peer() -> Oracle:
    return load(generate.ONE_PEER.path)


@pytest.fixture(scope="module")
def edges(one_peer: Oracle) -> set[Edge]:
    return diagrams.edges(one_peer)


@pytest.fixture(scope="module")
def drawn(edges: set[Edge]) -> set[Edge]:
    return {edge for edge in edges if edge.event != "restart"}


def ways(edges: set[Edge]) -> set[Way]:
    return {(edge.role, edge.source, edge.target) for edge in edges}


def table_rows(first: str) -> list[list[str]]:
    """The rows of the first table of protocol.md whose head begins with ``first``."""
    lines = PROTOCOL[PROTOCOL.index(f"\n| {first} |") + 1 :].split("\n\n")[0].splitlines()
    return [re.split(r"(?<!\\)\|", line.strip("| ")) for line in lines[2:]]


def test_the_table_of_the_reference_allows_every_step_and_no_other(drawn: set[Edge]) -> None:
    assert ways(drawn) == {(role, source, target) for (role, source, _), target in TABLE.items()}


def test_the_tables_of_the_protocol_name_every_step_and_its_rules(drawn: set[Edge]) -> None:
    told: set[tuple[str, str, str, str]] = set()
    for role in diagrams.ROLES:
        bound = {e.source for e in drawn if e.role == role} - {"STANDALONE"}
        for sources, target, by in table_rows(f"{role}: from"):
            given = bound if "each but" in sources else re.findall(r"[A-Z]+", sources)
            for rule in re.findall(r"[A-Z]{3}-\d", by):
                told |= {(role, source, target.strip(), rule) for source in given}
    assert told == {(e.role, e.source, e.target, e.rule) for e in drawn}


def test_end_8_a_restart_leads_from_every_phase_to_standalone(edges: set[Edge]) -> None:
    restarts = {edge for edge in edges if edge.event == "restart"}
    assert {edge.rule for edge in restarts} == {"END-8"}
    bound = {(e.role, e.source, "STANDALONE") for e in edges if e.source != "STANDALONE"}
    assert ways(restarts) == bound


@pytest.mark.parametrize("graph", [generate.TIGHT, generate.TWO_PEERS], ids=lambda g: g.name)
def test_the_other_graphs_have_no_other_step(graph: generate.Graph, edges: set[Edge]) -> None:
    assert diagrams.edges(load(graph.path)) <= edges


@pytest.mark.parametrize("role", diagrams.ROLES)
def test_every_step_is_drawn_and_its_rule_named(role: str, drawn: set[Edge]) -> None:
    arrows = {}
    for line in diagrams.diagram(drawn, role).splitlines()[2:]:
        arrow, label = line.split(" : ")
        assert not set(":;#") & set(label), "Mermaid would end the label there"
        source, target = arrow.strip().split(" --> ")
        arrows[role, source, target] = label
    mine = {edge for edge in drawn if edge.role == role}
    assert set(arrows) == ways(mine)
    for edge in mine:
        label = arrows[edge.role, edge.source, edge.target]
        lines = [line for line in label.split("<br/>") if line.endswith(f"({edge.rule})")]
        assert len(lines) == 1 and edge.event in lines[0]


def test_an_event_with_two_ways_says_what_is_told(drawn: set[Edge]) -> None:
    text = diagrams.diagram(drawn, "prescriber")
    assert "ADVERTISING --> CHOOSING : advertise expires / choose (PRE-1)" in text
    assert "CHOOSING --> PRESCRIBING : prescribe (PRE-2)" in text


def test_the_order_of_the_graph_does_not_matter(one_peer: Oracle, edges: set[Edge]) -> None:
    assert diagrams.text(one_peer).endswith("```\n")
    shuffled = set(sorted(edges, key=lambda e: (e.told, e.event, e.role, e.rule)))
    for role in diagrams.ROLES:
        assert diagrams.diagram(shuffled, role) == diagrams.diagram(edges, role)


def rule_rows() -> dict[str, list[str]]:
    """The cells of every rule's row, by id."""
    rows = re.findall(r"^\| ([A-Z]{3}-\d) \| (.*) \|$", PROTOCOL, re.MULTILINE)
    return {rule: cells.split(" | ") for rule, cells in rows}


def test_every_rule_names_source_operator_and_need() -> None:
    assert {len(cells) for cells in rule_rows().values()} == {4}


def test_every_operator_named_is_in_the_specification() -> None:
    modules = "\n".join(path.read_text() for path in (ROOT / "spec" / "tla").glob("*.tla"))
    for rule, (_, _, operators, _) in rule_rows().items():
        for name in re.findall(r"`(\w+)`", operators):
            assert re.search(rf"^{name}\b.*==", modules, re.MULTILINE), f"{rule}: {name}"


def test_every_model_that_must_fail_is_named_by_a_rule_that_it_takes_away() -> None:
    named = {name for cells in rule_rows().values() for name in re.findall(r"`(\w+)`", cells[3])}
    # bound_less_one shows that a bound is tight; it takes no rule away
    must_fail = {m.cfg for m in models.load() if m.expect == "violates"}
    assert must_fail - {"bound_less_one"} <= named
