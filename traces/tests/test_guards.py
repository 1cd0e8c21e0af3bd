"""The handlers as decision trees: held against every answer of the oracle."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from functools import cache
from typing import Any

import pytest

from automcm_spec.generate import ONE_PEER, TIGHT, TWO_PEERS, Graph
from automcm_spec.oracle import STATE_FIELDS, Oracle, load
from automcm_spec.paths import TLA
from automcm_spec.rules import RULES, handler, place
from automcm_traces.guards import MOST, armed_in, causes, lines, names, nearest, unarmed
from automcm_traces.guards_end import HANDLERS
from automcm_traces.guards_timers import ARMED, armed
from automcm_traces.guards_tree import Choice, Facts, Leaf, Tree, decide, done, ways
from automcm_traces.track import Entry, Track, View

Json = Any
Seen = dict[tuple[str, str, tuple[str, ...]], tuple[set[str], set[str]]]
"""What each leaf of a handler does always, and ever."""
ADVERTISEMENT = ["receive", ["Advertisement", 2, 0, [2, 1], 1, 0, False, "none", ["none", 0]], True]
PRESCRIPTION = ["receive", ["Prescription", 2, 1, [2, 1], 1, 1, False, "none", ["none", 0]], True]


@cache
def oracle(graph: Graph = ONE_PEER) -> Oracle:
    return load(graph.path)


def state(**wanted: Json) -> Json:
    """The first state of the one-peer oracle with these fields."""
    places = {STATE_FIELDS.index(name): value for name, value in wanted.items()}
    states = oracle().states
    return next(s for s in states if all(s[n] == value for n, value in places.items()))


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
                does = done(o.states[at], answer.effect, o.states[answer.next])
                yield to, facts, answer.effect.rule, does


def agrees(leaf: Leaf, rule: str, does: set[str]) -> bool:
    """Whether a leaf says what the oracle answers."""
    surely = {text for text in leaf.does if not text.endswith("?")}
    may = {text.removesuffix("?") for text in leaf.does}
    return leaf.rule == rule and surely <= does <= may


@cache
def walked() -> tuple[list[Json], Seen]:
    """Every answer of the oracle held against the trees: where they disagree, and what is done."""
    wrong: list[Json] = []
    seen: Seen = {}
    for graph, step in ((ONE_PEER, 1), (TIGHT, 1), (TWO_PEERS, 40)):
        for to, facts, rule, does in pairs(graph, step):
            leaf = decide(HANDLERS[to], facts)
            if not agrees(leaf, rule, does):
                wrong.append((graph.name, facts.st, facts.m, facts.c, facts.t, leaf, rule, does))
            always, ever = seen.setdefault((to, leaf.rule, leaf.does), (set(does), set()))
            always &= does
            ever |= does
    return wrong, seen


def test_the_trees_decide_as_the_oracle() -> None:
    wrong, seen = walked()
    assert wrong == []
    assert {rule for _, rule, _ in seen} == set(RULES) - {"ACT-1", "END-4"}  # these decide nothing


def test_a_leaf_does_no_more_and_no_less_than_it_says() -> None:
    """What may be done is done somewhere, and somewhere not (over all handlers that share it)."""
    _, seen = walked()
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
    _, seen = walked()
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
            for (guard, _), line in zip(way, lines(way), strict=True):
                assert guard.text in text[line - 1], (to, guard.text)
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
        "OnAdvertisement": 3,
        "OnIntention": 2,
        "OnPrescription": 2,
        "OnAcceptance": 6,
        "OnCancel": 3,
    }


# -- nearest


def test_adv_4_a_bound_station_that_joins_another_session() -> None:
    found = nearest(oracle(), state(phase="WAITING"), ADVERTISEMENT, ("send", "Intention"))
    assert found is not None
    assert (found.rule, found.guard, found.must_hold) == ("ADV-3", "Bound(st)", False)
    assert found.values == (("st.phase", "WAITING"),)
    assert found.line == place("OnAdvertisement", "Bound(st)")[0]
    assert found.text() == (
        "nearest allowed: ADV-3 send Intention (OnAdvertisement) blocked by guard Bound(st), "
        "which must not hold; it is in a session: st.phase = WAITING; "
        f"it has already joined this session, or a later one  Station.tla:{found.line}"
    )


def test_adv_3_what_did_not_concern_it() -> None:
    unconcerned = [*ADVERTISEMENT[:2], False]
    found = nearest(oracle(), oracle().states[0], unconcerned, ("send", "Intention"))
    assert found is not None
    assert (found.guard, found.why) == ("~concerned", "the Advertisement does not concern it")
    assert found.also == ()


def test_neg_1_a_stale_proposal() -> None:
    found = nearest(oracle(), state(phase="ACTUATING"), PRESCRIPTION, ("told", "verify"))
    assert found is not None
    assert found.guard == "OlderOrSame(m.proposal, st.proposal)"
    assert dict(found.values) == {"m.proposal": 1, "st.proposal": 1}


def test_end_5_the_guard_of_another_operator() -> None:
    to_one = ["receive", ["Advertisement", 2, 1, *ADVERTISEMENT[1][3:]], True]
    found = nearest(oracle(), oracle().states[0], to_one, ("send", "Intention"))
    assert found is not None
    assert (found.handler, found.where) == ("OnAdvertisement", "BreaksProtocol")
    assert "of BreaksProtocol" in found.text()


def test_what_is_missing_and_not_for_want_of_memory() -> None:
    waiting = state(phase="WAITING")
    found = nearest(oracle(), waiting, PRESCRIPTION, ("without", "arm", "decide"))
    assert found is not None
    assert (found.rule, found.guard[:8]) == ("END-5", "st.phase")
    found = nearest(oracle(), oracle().states[0], ADVERTISEMENT, ("nothing",))
    assert found is not None
    assert (found.rule, found.guard) == ("ADV-3", "~concerned")


def test_what_the_rule_does_but_in_another_form() -> None:
    found = nearest(oracle(), oracle().states[0], ADVERTISEMENT, ("send", "Intention"))
    assert found is not None
    assert (found.rule, found.guard) == ("ADV-3", "")
    assert found.text().endswith("(OnAdvertisement), but not in this form")


def test_what_no_branch_of_the_handler_does() -> None:
    assert nearest(oracle(), oracle().states[0], ADVERTISEMENT, ("send", "Fin")) is None


def test_a_timer_that_is_not_armed() -> None:
    waiting = state(phase="WAITING")
    found = nearest(oracle(), waiting, ["expire", ["cam"]], ("send", "Cancel", "cam_loss"))
    assert found == unarmed(oracle(), waiting, ["cam"])
    assert found is not None
    assert (found.where, found.guard) == ("Armed", 'st.phase = "ACTUATING"')
    assert found.text().startswith("nearest allowed: expire cam (OnCamLoss) blocked by guard")
    assert unarmed(oracle(), waiting, ["hold"]) is None
    assert armed_in(oracle(), ["decide"]) == ["CHOOSING", "NEGOTIATING"]


def test_what_would_have_caused_it() -> None:
    receiver = state(phase="ACTUATING", role="receiver")
    assert causes(oracle(), receiver, ("told", "fallback")) == [
        "expire cam",
        "expire lease",
        "receive Cancel from 2",
    ]
    assert causes(oracle(), receiver, ("send", "Cancel", "abort")) == ["command abort"]
    assert causes(oracle(), receiver, ("send", "Prescription")) == []
    assert causes(oracle(), ["no state"], ("send", "Fin")) == []


def test_the_values_are_given_with_the_ids_of_the_log() -> None:
    """ADV-8: real ids, sessions and limits instead of the oracle's."""
    track = Track(2002, 5, "ACTUATING", "receiver", (1001, 7), proposal=4, joined={1001: 7})
    sent = {"seq": 3, "proposal": 4, "accepted": True}
    track.outbox.append(Entry("Acceptance", 1001, (1001, 7), 4, sent))
    view = View(track, 1001, session=(1001, 7), k=4)
    real = names(view, {"OutboxLimit": 64})
    given = [
        "receive",
        [*PRESCRIPTION[1][:3], view.sessions((1001, 7)), 1, 1, *PRESCRIPTION[1][6:]],
    ]
    found = nearest(oracle(), view.state(), [*given, True], ("told", "verify"))
    assert found is not None
    assert "m.proposal = 4, st.proposal = 4" in found.text(real)
    shown = {
        ("st.outbox", "{Acceptance to 1001 session=1001/7 proposal=4}"),
        ("st.joined", "{1001/7}"),
        ("m.dst", "2002"),
        ("m.src", "1001"),
        ("OutboxLimit", "64"),
        ("MemoryLimit", "not told"),
        ("MaxRounds", "5"),
        ("st.deciding", "FALSE"),
    }
    values = {"st.outbox": view.state()[11], "st.joined": [[2, 1]], "m.dst": 1, "m.src": 2}
    values |= {"OutboxLimit": 5, "MemoryLimit": 4, "MaxRounds": 3, "st.deciding": False}
    assert {(name, real.of_value(name, value)) for name, value in values.items()} == shown
    assert causes(oracle(), view.state(), ("told", "fallback"), real)[-1] == (
        "receive Cancel from 1001"
    )


def test_of_everything_done_somewhere_the_nearest_is_found_in_every_state() -> None:
    """It blocks as it says, its values can be shown, and it names a line."""
    things = sorted(
        {text for tree in HANDLERS.values() for _, leaf in ways(tree) for text in leaf.does}
    )
    o, found = oracle(TIGHT), 0
    for at, i in list(enumerate(o.inputs))[::4]:
        s = o.states[at * 31 % len(o.states)]
        for text in things:
            near = nearest(o, s, i, text.removesuffix("?").split())
            if near is None or not near.guard:
                continue
            found += 1
            assert near.line > 0 and near.why in near.text()
            assert len(causes(o, s, text.removesuffix("?").split())) <= MOST
    assert found > 1000
