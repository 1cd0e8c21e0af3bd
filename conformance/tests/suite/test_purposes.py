"""The test purposes: they partition the graph and can be selected; errors in a bad file."""

from __future__ import annotations

from collections import Counter
from functools import cache
from pathlib import Path
from typing import Any

import pytest
from suite_stage import graph

from automcm_conformance.suite.purposes import (
    FEATURES,
    INPUTS,
    ROOM,
    WHY,
    Features,
    Owners,
    Purpose,
    features,
    input_kind,
    load,
    select,
)
from automcm_spec.graph.oracle_generation import ONE_PEER, TIGHT, TWO_PEERS
from automcm_spec.vocabulary.rules import RULES
from automcm_spec.vocabulary.station import Receive

PURPOSES = load()
SELECTED = [purpose for purpose in PURPOSES if purpose.select is not None]
BASE = {
    "id": '"AMCM/RCV/NEG/BI-01"',
    "rules": '["NEG-4"]',
    "level": '"MUST"',
    "given": '"a receiver"',
    "when": '"a Prescription arrives"',
    "then": '"it refuses"',
    "bug": '"one that obeys"',
    "cost": '"a collision"',
    "select": '{ rule = "NEG-4" }',
}

HOLD = {name: value for name, value in BASE.items() if name != "select"} | {"case": '"timer hold"'}


@cache
def pairs(every: int = 3) -> Counter[Features]:
    """The features of all pairs of each third state of ``one-peer``, and of MEM-1 in ``tight``."""
    found: Counter[Features] = Counter()
    for path, only in ((ONE_PEER.path, ""), (TIGHT.path, "MEM-1")):
        for s, state in list(enumerate(graph(path).states))[:: 1 if only else every]:
            for a in graph(path).answers(s):
                if not only or a.effect.rule == only:
                    i = graph(path).inputs[a.input]
                    found[features(state, i, a.effect, a.changes, False)] += 1
    return found


@cache
def owners(row: Features) -> list[Purpose]:
    return [purpose for purpose in SELECTED if purpose.matches(row)]


def text(*rows: dict[str, str]) -> str:
    return "\n".join(
        "[[purpose]]\n" + "".join(f"{name} = {value}\n" for name, value in row.items())
        for row in rows
    )


@pytest.mark.parametrize("every", [3, pytest.param(1, marks=pytest.mark.slow)])
def test_every_pair_has_exactly_one_owner(every: int) -> None:
    one = graph(ONE_PEER.path)
    assert pairs(every).total() > (one.transitions + one.refusals) // every
    assert not {row: owners(row) for row in pairs(every) if len(owners(row)) != 1}


def test_the_kind_of_a_purpose_is_that_of_its_pairs() -> None:
    for row in pairs():
        pair = dict(zip(FEATURES, row, strict=True))
        kind = "BV" if pair["changes"] else "BI"
        if pair["input"].startswith("expire"):
            kind = "TI"
        assert {purpose.kind for purpose in owners(row)} == {kind}, pair


@pytest.mark.slow
def test_every_selector_owns_a_pair() -> None:
    owned = {purpose.id for row in pairs(1) for purpose in owners(row)}
    left = {purpose.id for purpose in SELECTED} - owned
    assert left, "those with a third station"
    two = graph(TWO_PEERS.path)
    for s, state in enumerate(two.states):
        for a in two.answers(s) if left else ():
            i = two.inputs[a.input]
            third = isinstance(i, Receive) and i.message.src != state.session[0]
            found = owners(features(state, i, a.effect, a.changes, third))
            assert len(found) == 1
            left.discard(found[0].id)
    assert not left


def test_memory_gives_what_the_selectors_give() -> None:
    memory = Owners(PURPOSES)
    one = graph(ONE_PEER.path)
    for s in range(0, len(one.states), 50):
        for a in one.answers(s):
            pair = one.states[s], one.inputs[a.input], a.effect, a.changes
            assert [memory.owner(*pair)] == owners(features(*pair, False))


def test_no_owner() -> None:
    one = graph(ONE_PEER.path)
    answer = next(one.answers(0))
    pair = one.states[0], one.inputs[answer.input], answer.effect, answer.changes
    assert Owners([]).owner(*pair) is None


def test_the_role_of_an_id_is_that_of_the_states() -> None:
    roles = {"PRE": {"prescriber"}, "RCV": {"receiver"}}
    for row in pairs():
        for purpose in owners(row):
            wanted = roles.get(purpose.id.split("/")[1])
            assert wanted is None or row[FEATURES.index("role")] in wanted, purpose.id


def test_every_rule_has_a_purpose() -> None:
    assert set(RULES) - {rule for p in PURPOSES for rule in p.rules} == {"ACT-1"}


def test_the_first_rule_decides() -> None:
    for purpose in SELECTED:
        assert purpose.select is not None
        assert purpose.select["rule"] == frozenset({purpose.rules[0]}), purpose.id


def test_why_belongs_to_the_rule() -> None:
    for purpose in SELECTED:
        assert purpose.select is not None
        names = purpose.select.get("why", frozenset())
        assert names <= set(WHY.get(purpose.rules[0], ())), purpose.id
    found = {(row[FEATURES.index("rule")], row[FEATURES.index("why")]) for row in pairs()}
    assert {(rule, why) for rule, why in found if why is not None} <= {
        (rule, why) for rule, names in WHY.items() for why in names
    }


@pytest.mark.parametrize(
    "path", [ONE_PEER.path, pytest.param(TWO_PEERS.path, marks=pytest.mark.slow), TIGHT.path]
)
def test_room_is_that_of_the_graphs(path: Path) -> None:
    constants = graph(path).constants
    reserve = 1 + max(constants["MaxRounds"], constants["MaxParticipants"])
    assert constants["OutboxLimit"] - reserve == ROOM


def test_input_kinds() -> None:
    kinds = {input_kind(i) for i in graph(ONE_PEER.path).inputs}
    assert kinds == set(INPUTS)


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
    chosen = select(PURPOSES, selectors)
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
        select(PURPOSES, ["MUST", selector])


def test_a_good_file(tmp_path: Path) -> None:
    case = {**HOLD, "id": '"AMCM/RCV/NEG/BI-02"'}
    path = tmp_path / "good.toml"
    path.write_text(text(BASE, case))
    first, second = load(path)
    assert (
        first.select == {"rule": frozenset({"NEG-4"})} and first.case == "" and first.kind == "BI"
    )
    assert second.select is None and second.case == "timer hold"
    assert not second.matches(next(iter(pairs())))


@pytest.mark.parametrize(
    ("field", "value", "message"),
    [
        ("cost", None, "AMCM/RCV/NEG/BI-01: cost: Field required"),
        ("id", '"AMCM/RCV/NEG/BI-00"', "AMCM/RCV/NEG/BI-00: id: String should match pattern"),
        ("id", '"AMCM/RCV/KIN/BI-01"', "AMCM/RCV/KIN/BI-01: id: String should match pattern"),
        ("rules", '["NEG-4", "NEG-10"]', "BI-01: rules: Value error, unknown rule NEG-10"),
        ("rules", '["END-3"]', "BI-01: rules: Value error, the first must be of the group NEG"),
        ("when", '" "', "BI-01: when: String should match pattern"),
        ("select", None, "BI-01: Value error, give either select or case"),
        ("case", '"timer hold"', "BI-01: Value error, give either select or case"),
        ("select", '"all"', "BI-01: select: Value error, must be a table with at least one field"),
        ("select", "{}", "BI-01: select: Value error, must be a table with at least one field"),
        ("select", "{ colour = 1 }", "BI-01: select: Value error, colour: unknown field"),
        ("select", '{ rule = "NEG-10" }', "BI-01: select: Value error, rule: unknown value NEG-10"),
        ("select", '{ role = "none" }', "BI-01: select: Value error, rule: is required"),
        ("select", "{ role = [] }", "BI-01: select: Value error, role: must not be empty"),
        ("select", "{ phase = 3 }", "BI-01: select: Value error, phase: unknown value 3"),
        (
            "select",
            '{ input = "expire lunch" }',
            "BI-01: select: Value error, input: unknown value expire lunch",
        ),
        (
            "select",
            '{ changes = "yes" }',
            "BI-01: select: Value error, changes: unknown value yes",
        ),
        ("select", '{ sends = "a lot" }', "BI-01: select: Value error, sends: unknown value a lot"),
        ("select", '{ why = "mood" }', "BI-01: select: Value error, why: unknown value mood"),
    ],
)
def test_a_bad_file(tmp_path: Path, field: str, value: str | None, message: str) -> None:
    row = {name: text for name, text in {**BASE, field: value}.items() if text is not None}
    path = tmp_path / "bad.toml"
    path.write_text(text(row))
    with pytest.raises(ValueError) as caught:
        load(path)
    assert str(caught.value).startswith("bad.toml: ") and message in str(caught.value)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (text(BASE, BASE), "bad.toml: AMCM/RCV/NEG/BI-01: id: used twice"),
        (
            text(*(HOLD | {"id": f'"AMCM/RCV/NEG/BI-0{n}"'} for n in (1, 2))),
            "bad.toml: AMCM/RCV/NEG/BI-02: case: used twice",
        ),
        (text(BASE) + "[other]\n", "bad.toml: must contain a list of"),
        ("[[purpose\n", "bad.toml: not TOML: "),
    ],
)
def test_a_bad_whole(tmp_path: Path, content: str, message: str) -> None:
    path = tmp_path / "bad.toml"
    path.write_text(content)
    with pytest.raises(ValueError) as caught:
        load(path)
    assert str(caught.value).startswith(message)
