"""The test purposes: they partition the graph and can be selected."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import Any

import pytest
from suite_stage import graph

from automcm_conformance.adapter.protocol import ROOM
from automcm_conformance.suite import purposes
from automcm_spec.graph.oracle_generation import ONE_PEER, TIGHT, TWO_PEERS
from automcm_spec.vocabulary.rules import RULES
from automcm_spec.vocabulary.station import Receive

PURPOSES = purposes.load()
SELECTED = [purpose for purpose in PURPOSES if purpose.select is not None]
ID = r"AMCM/(PRE|RCV|STA|SYS)/(ADV|PRE|NEG|ACT|END|REL|CMD|MSG|MEM)/(BV|BI|TI)-(0[1-9]|[1-9]\d)"


@cache
def pairs(every: int = 3) -> Counter[purposes.Features]:
    """The features of all pairs of each third state of ``one-peer``, and of MEM-1 in ``tight``."""
    found: Counter[purposes.Features] = Counter()
    for path, only in ((ONE_PEER.path, ""), (TIGHT.path, "MEM-1")):
        for s, state in list(enumerate(graph(path).states))[:: 1 if only else every]:
            for a in graph(path).answers(s):
                if not only or a.effect.rule == only:
                    i = graph(path).inputs[a.input]
                    found[purposes.features(state, i, a.effect, a.changes, False)] += 1
    return found


def pairs_of_two_peers(every: int = 1) -> Iterator[purposes.Features]:
    """The features of the pairs of some states of ``two-peers``."""
    two = graph(TWO_PEERS.path)
    for s, state in list(enumerate(two.states))[::every]:
        for a in two.answers(s):
            i = two.inputs[a.input]
            third = isinstance(i, Receive) and i.message.src != state.session[0]
            yield purposes.features(state, i, a.effect, a.changes, third)


@cache
def owners(row: purposes.Features) -> list[purposes.Purpose]:
    return [purpose for purpose in SELECTED if purpose.matches(row)]


@pytest.mark.parametrize("every", [3, pytest.param(1, marks=pytest.mark.slow)])
def test_every_pair_has_exactly_one_owner(every: int) -> None:
    one = graph(ONE_PEER.path)
    assert pairs(every).total() > (one.transitions + one.refusals) // every
    assert not {row: owners(row) for row in pairs(every) if len(owners(row)) != 1}


def test_the_kind_of_a_purpose_is_that_of_its_pairs() -> None:
    for row in pairs():
        pair = dict(zip(purposes.FEATURES, row, strict=True))
        kind = "BV" if pair["changes"] else "BI"
        if pair["input"].startswith("expire"):
            kind = "TI"
        assert {purpose.id.split("/")[3][:2] for purpose in owners(row)} == {kind}, pair


@pytest.mark.slow
def test_every_selector_owns_a_pair() -> None:
    owned = {purpose.id for row in pairs(1) for purpose in owners(row)}
    left = {purpose.id for purpose in SELECTED} - owned
    assert left, "those with a third station"
    for row in pairs_of_two_peers():
        (purpose,) = owners(row)
        left.discard(purpose.id)
    assert not left


def test_memory_gives_what_the_selectors_give() -> None:
    memory = purposes.Owners(PURPOSES)
    one = graph(ONE_PEER.path)
    for s in range(0, len(one.states), 50):
        for a in one.answers(s):
            pair = one.states[s], one.inputs[a.input], a.effect, a.changes
            assert [memory.owner(*pair)] == owners(purposes.features(*pair, False))


def test_no_owner() -> None:
    one = graph(ONE_PEER.path)
    answer = next(one.answers(0))
    pair = one.states[0], one.inputs[answer.input], answer.effect, answer.changes
    assert purposes.Owners([]).owner(*pair) is None


def test_the_role_of_an_id_is_that_of_the_states() -> None:
    roles = {"PRE": {"prescriber"}, "RCV": {"receiver"}}
    for row in pairs():
        for purpose in owners(row):
            wanted = roles.get(purpose.id.split("/")[1])
            assert wanted is None or row[purposes.FEATURES.index("role")] in wanted, purpose.id


def test_every_rule_has_a_purpose() -> None:
    assert set(RULES) - {rule for p in PURPOSES for rule in p.rules} == {"ACT-1"}


def test_the_first_rule_decides() -> None:
    for purpose in SELECTED:
        assert purpose.select is not None
        assert purpose.select["rule"] == frozenset({purpose.rules[0]}), purpose.id


def test_every_value_of_a_selector_is_that_of_a_pair() -> None:
    rows = [*pairs(), *pairs_of_two_peers(40)]
    found = {
        (row[0], name, value)
        for row in rows
        for name, value in zip(purposes.FEATURES, row, strict=True)
    }
    for purpose in SELECTED:
        assert purpose.select is not None
        wanted = {(name, value) for name, values in purpose.select.items() for value in values}
        assert not {(purpose.rules[0], *each) for each in wanted} - found, purpose.id


def test_the_head_of_a_purpose() -> None:
    for purpose in PURPOSES:
        assert re.fullmatch(ID, purpose.id)
        assert set(purpose.rules) <= set(RULES)
        assert purpose.rules[0].startswith(purpose.id.split("/")[2]), purpose.id
        texts = purpose.given, purpose.when, purpose.then, purpose.bug, purpose.cost
        assert all(text.strip() for text in texts), purpose.id
        assert bool(purpose.select) != bool(purpose.case.strip()), purpose.id
        assert set(purpose.select or ()) <= set(purposes.FEATURES), purpose.id
    assert len({purpose.id for purpose in PURPOSES}) == len(PURPOSES)
    assert len({purpose.case for purpose in PURPOSES}) == len(PURPOSES) - len(SELECTED) + 1


@pytest.mark.parametrize(
    "path", [ONE_PEER.path, pytest.param(TWO_PEERS.path, marks=pytest.mark.slow), TIGHT.path]
)
def test_room_is_that_of_the_graphs(path: Path) -> None:
    constants = graph(path).constants
    reserve = 1 + max(constants["MaxRounds"], constants["MaxParticipants"])
    assert constants["OutboxLimit"] - reserve == ROOM


@pytest.mark.parametrize(
    ("selectors", "wanted"),
    [
        ([], lambda p: True),
        (["AMCM/RCV"], lambda p: p.id.startswith("AMCM/RCV/")),
        (["AMCM/RCV/NEG/BI"], lambda p: p.id.startswith("AMCM/RCV/NEG/BI-")),
        (["AMCM/RCV/NEG/BI-01"], lambda p: p.id == "AMCM/RCV/NEG/BI-01"),
        (["amcm/rcv/neg/"], lambda p: p.id.startswith("AMCM/RCV/NEG/")),
        (["NEG-4"], lambda p: "NEG-4" in p.rules),
        (["MUST"], lambda p: p.level == "MUST"),
        (["MAY", "ADV-8"], lambda p: p.level == "MAY" or "ADV-8" in p.rules),
    ],
)
def test_select(selectors: list[str], wanted: Any) -> None:
    chosen = purposes.select(PURPOSES, selectors)
    assert chosen == [p for p in PURPOSES if wanted(p)] and chosen


@pytest.mark.parametrize(
    ("selector", "near"),
    [
        ("NEG-44", "NEG-4"),
        ("AMCM/RVC", "AMCM/RCV"),
        ("AMCM/RCV/NEG/BI-99", "AMCM/RCV/NEG/BI-0"),
        ("MUSTN", "MUST"),
        ("AMCM/RC", "AMCM/RCV"),
        ("XYZZY", ""),
    ],
)
def test_an_unknown_selector_is_refused(selector: str, near: str) -> None:
    said = f"{selector}: no case has .*" + (f"; near ones: .*{near}" if near else "name$")
    with pytest.raises(ValueError, match=said):
        purposes.select(PURPOSES, ["MUST", selector])
