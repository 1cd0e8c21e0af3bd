"""The handlers as decision trees: held against every answer of the oracle."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from functools import cache
from typing import Any

import pytest

from automcm_spec.generate import ONE_PEER, TIGHT, TWO_PEERS, Graph
from automcm_spec.oracle import Oracle, load
from automcm_spec.paths import TLA
from automcm_spec.rules import RULES, handler, place
from automcm_traces.guards import lines
from automcm_traces.guards_common import phase
from automcm_traces.guards_end import HANDLERS
from automcm_traces.guards_timers import ARMED, armed
from automcm_traces.guards_tree import Choice, Facts, Leaf, Tree, decide, done, ways

Json = Any
Seen = dict[tuple[str, str, tuple[str, ...]], tuple[set[str], set[str]]]
"""What each leaf of a handler does always, and ever."""


@cache
def oracle(graph: Graph = ONE_PEER) -> Oracle:
    return load(graph.path)


def pairs(
    graph: Graph, step: int = 1, only: str | None = None
) -> Iterator[tuple[str, Facts, str, set[str]]]:
    """Offered inputs of every ``step``-th state: handler, facts, the rule, what is done."""
    o = oracle(graph)
    inputs = [(n, handler(i)) for n, i in enumerate(o.inputs)]
    for at in range(0, len(o.states), step):
        for n, to in inputs:
            if only is not None and to != only:
                continue
            answer = o.answer(at, n)
            if answer is not None:
                facts = Facts(o.states[at], o.inputs[n], o.constants)
                does = done(o, answer)
                yield to, facts, answer.effect.rule, does


def agrees(leaf: Leaf, rule: str, does: set[str]) -> bool:
    """Whether a leaf says what the oracle answers."""
    surely = {text for text in leaf.does if not text.endswith("?")}
    may = {text.removesuffix("?") for text in leaf.does}
    return leaf.rule == rule and surely <= does <= may


EVERY = 6
"""Of the states of the graph of one peer, as many as catch a guard that is negated or swapped."""


@cache
def walked(every: int) -> tuple[list[Json], Seen]:
    """Answers of the oracle held against the trees: where they disagree, and what is done."""
    wrong: list[Json] = []
    seen: Seen = {}
    for graph, step in ((ONE_PEER, every), (TIGHT, 1), (TWO_PEERS, 17 * every)):
        for to, facts, rule, does in pairs(graph, step):
            leaf = decide(HANDLERS[to], facts)
            if not agrees(leaf, rule, does):
                wrong.append((graph.name, facts.st, facts.m, facts.c, facts.t, leaf, rule, does))
            always, ever = seen.setdefault((to, leaf.rule, leaf.does), (set(does), set()))
            always &= does
            ever |= does
    return wrong, seen


@pytest.mark.parametrize("every", [EVERY, pytest.param(1, marks=pytest.mark.deep)])
def test_the_trees_decide_as_the_oracle(every: int) -> None:
    wrong, seen = walked(every)
    assert wrong == []
    assert {rule for _, rule, _ in seen} == set(RULES) - {"ACT-1", "END-4"}  # these decide nothing


def test_a_leaf_does_no_more_and_no_less_than_it_says() -> None:
    """What may be done is done somewhere, and somewhere not (over all handlers that share it)."""
    _, seen = walked(EVERY)
    both: Seen = {}
    for (_, rule, declared), (always, ever) in seen.items():
        always_, ever_ = both.setdefault(("", rule, declared), (set(always), set()))
        always_ &= always
        ever_ |= ever
    for (_, rule, declared), (always, ever) in both.items():
        for text in declared:
            assert text.removesuffix("?") in ever, (rule, text)
            assert text.endswith("?") != (text in always), (rule, text)


def test_every_leaf_is_reached_but_by_answers_that_nobody_gives() -> None:
    """An answer (seq 0) is a refusal without a session, or the prescriber's Cancel (closed)."""
    _, seen = walked(EVERY)
    missing = {
        (to, leaf.rule, leaf.does)
        for to, tree in HANDLERS.items()
        for way, leaf in ways(tree)
        if (to, leaf.rule, leaf.does) not in seen
    }
    assert {(to, rule) for to, rule, _ in missing} == {
        ("OnAcceptance", "NEG-6"),
        ("OnAcceptance", "NEG-7"),
        ("OnCancel", "PRE-1"),
        ("OnCancel", "END-2"),
    }
    assert not any("send Ack" in does for _, _, does in missing)


@pytest.mark.parametrize("graph", [ONE_PEER, TIGHT], ids=lambda graph: graph.name)
def test_a_timer_is_offered_where_its_guard_says_that_it_is_armed(graph: Graph) -> None:
    o = oracle(graph)
    timers = [(n, i) for n, i in enumerate(o.inputs) if i[0] == "expire"]
    assert {i[1][0] for _, i in timers} == set(ARMED)
    for at, s in enumerate(o.states):
        for n, i in timers:
            given_up_first = i[1][0] == "forget" and any(e[2][0] == i[1][1] for e in s[11])
            if not given_up_first:  # OpenStation: one order of two timers is assumed
                runs = armed(i[1]).test(Facts(s, i, o.constants))
                assert runs == (o.answer(at, n) is not None), (s, i)


def test_each_guard_stands_in_station_tla_in_this_order() -> None:
    text = (TLA / "Station.tla").read_text().splitlines()
    for to, tree in HANDLERS.items():
        for way, _ in ways(tree):
            last: dict[str, int] = {}
            for (guard, _), line in zip(way, lines(way), strict=True):
                assert guard.text in text[line - 1], (to, guard.text)
                assert line >= last.get(guard.where, 0), (to, guard.text)
                last[guard.where] = line
    for guard in ARMED.values():
        line, _ = place(guard.where, guard.text)
        assert guard.text.split(' \\/ st.phase = "N')[0] in text[line - 1]


def test_a_guard_that_stands_nowhere_is_an_error() -> None:
    with pytest.raises(ValueError, match=r"OnRequest in Station\.tla: no Bound"):
        place("OnRequest", "Bound(s)")
    line, end = place("OnPrescribe", 'st.phase = "CHOOSING"')
    assert place("OnPrescribe", 'st.phase = "CHOOSING"', end)[0] > line


def changed(tree: Tree, way: tuple[bool, ...], change: Any) -> Tree:
    """A copy of a tree with the choice at the end of a way changed."""
    assert isinstance(tree, Choice)
    if not way:
        result: Tree = change(tree)
        return result
    if way[0]:
        return Choice(tree.guard, changed(tree.then, way[1:], change), tree.otherwise)
    return Choice(tree.guard, tree.then, changed(tree.otherwise, way[1:], change))


def choices(tree: Tree, way: tuple[bool, ...] = ()) -> Iterator[tuple[tuple[bool, ...], Choice]]:
    if isinstance(tree, Choice):
        yield way, tree
        yield from choices(tree.then, (*way, True))
        yield from choices(tree.otherwise, (*way, False))


def negated(choice: Choice) -> Choice:
    return Choice(choice.guard, choice.otherwise, choice.then)


def swapped(choice: Choice) -> Choice:
    """The guard after its ELSE IF first."""
    second = choice.otherwise
    assert isinstance(second, Choice)
    return Choice(second.guard, second.then, Choice(choice.guard, choice.then, second.otherwise))


@cache
def sample(to: str) -> list[tuple[Facts, str, set[str]]]:
    """Answers to the inputs of one handler."""
    return [
        (facts, rule, does)
        for graph, step in ((TIGHT, 1), (ONE_PEER, 7))
        for _, facts, rule, does in pairs(graph, step, to)
    ]


def caught(to: str, tree: Tree) -> bool:
    return not all(agrees(decide(tree, facts), rule, does) for facts, rule, does in sample(to))


def test_a_negated_guard_is_caught() -> None:
    """Three are not: those that only such an answer would reach."""
    tried, missed = 0, []
    for to, tree in HANDLERS.items():
        for way, choice in choices(tree):
            tried += 1
            if not caught(to, changed(tree, way, negated)):
                missed.append((to, choice.guard.text.split(" \\/ ")[0]))
    assert tried > 100
    assert missed == [
        ("OnAcceptance", "RoundLeft(st)"),
        ("OnCancel", "m.src \\in st.withdrawn"),
        ("OnCancel", "st.recorded = {m.src}"),
    ]


def test_two_guards_in_the_wrong_order_are_caught() -> None:
    """The others commute: they exclude each other, or lead to the same."""
    found = Counter(
        to
        for to, tree in HANDLERS.items()
        for way, choice in choices(tree)
        if isinstance(choice.otherwise, Choice) and caught(to, changed(tree, way, swapped))
    )
    assert found == {
        "OnRequest": 2,
        "OnPrescribe": 2,
        "OnProceed": 1,
        "OnAccept": 1,
        "OnRefuse": 1,
        "OnComplete": 1,
        "OnAbort": 1,
        "OnAdvertisement": 4,
        "OnIntention": 3,
        "OnPrescription": 3,
        "OnAcceptance": 7,
        "OnCancel": 3,
        "OnFin": 1,
        "OnAck": 1,
    }


@pytest.mark.parametrize(
    ("text", "negated"),
    [
        ('st.phase = "WAITING"', False),
        ('st.phase \\in {"WAITING"}', False),
        ('st.phase # "WAITING"', True),
        ('~(st.phase = "WAITING")', True),
        ('st.phase \\notin {"WAITING"}', True),
    ],
)
def test_what_is_negated_is_told_the_other_way_round(text: str, negated: bool) -> None:
    guard = phase("OnHold", text, lambda f: True, "waiting")
    assert (guard.yes, guard.no)[negated] == "it is waiting"
    assert (guard.no, guard.yes)[negated] == "it is not waiting"
