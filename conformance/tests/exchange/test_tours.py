"""Tours and the two-peer pairs, without any station."""

from __future__ import annotations

import json
import random
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import pytest
from suite_stage import graph

from automcm_conformance.exchange.play import offered
from automcm_conformance.exchange.tours import LATER_MS, LONGEST, Tours, timetable
from automcm_conformance.exchange.wire import LONG, STEP_MS
from automcm_conformance.suite import two_peer_pairs
from automcm_spec.graph import oracle as oracle_
from automcm_spec.graph.oracle import Oracle
from automcm_spec.graph.oracle_generation import ONE_PEER, TIGHT, TWO_PEERS
from automcm_spec.vocabulary import renumbering
from automcm_spec.vocabulary.parameters import TIMERS
from automcm_spec.vocabulary.station import Expire, Timer

# -- tours, without any station


@pytest.fixture(scope="module")
def tight() -> Oracle:
    return graph(TIGHT.path)


def every(oracle: Oracle) -> list[tuple[oracle_.OracleAnswer, str]]:
    """All pairs, each for a case named after its rule."""
    return [(a, a.effect.rule) for s in range(len(oracle.states)) for a in oracle.answers(s)]


def pairs(oracle: Oracle, tour: list[int]) -> list[tuple[int, int]]:
    """The pairs that a tour drives."""
    return list(zip(oracle.way(tour), tour, strict=False))


def anything(*_: object) -> bool:
    return True


def test_each_timer_has_a_duration_that_is_long() -> None:
    assert LONG.keys() == TIMERS.keys()


def test_tours_drive_each_pair_and_come_to_an_end(tight: Oracle) -> None:
    everything = every(tight)
    tours = Tours(tight, everything, anything, anything)
    driven: Counter[tuple[int, int]] = Counter()
    count = 0
    while (tour := tours.next()) is not None:
        count += 1
        fresh = 0
        for pair in pairs(tight, tour):
            driven[pair] += 1
            fresh += tours.done(pair) is not None
        assert fresh > 0
        assert len(tour) < LONGEST + len(tight.inputs)
    assert set(driven) == {(a.state, a.input) for a, _ in everything} and not tours.left
    refused = {(a.state, a.input) for a, _ in everything if not a.changes}
    more = sum(driven[pair] - 1 for pair in refused)
    assert 0 < more < 0.2 * len(refused), "what changes nothing is driven once, and on some ways"
    assert driven.total() < 1.3 * len(everything)
    assert count < len(tight.states) * 10


def test_tours_that_are_planned_before_any_is_done(tight: Oracle) -> None:
    tours = Tours(tight, every(tight), anything, lambda answer: False)
    seen: set[tuple[int, int]] = set()
    for _ in range(5):
        tour = tours.next()
        assert tour is not None
        still = {(s, i) for s, i in pairs(tight, tour) if i not in tight.moves(s)}
        assert not seen & still, "planned twice"
        seen |= still
    assert len(seen) > 1_000


def test_done_names_the_case_once(tight: Oracle) -> None:
    (answer, case), *_ = every(tight)
    tours = Tours(tight, [(answer, case)], anything, anything)
    pair = answer.state, answer.input
    assert tours.done((pair[0], pair[1] + 1)) is None and tours.done((9, 9)) is None
    assert tours.done(pair) == case and tours.done(pair) is None
    assert tours.left == {} and tours.next() is None


def test_allowed_keeps_tours_away(tight: Oracle) -> None:
    requests = {i for i, value in enumerate(tight.inputs) if value[:2] == ("command", "request")}
    targets = [(a, case) for a, case in every(tight) if a.input not in requests]

    def allowed(state: int, i: int) -> bool:
        return i not in requests

    tours = Tours(tight, targets, allowed, lambda answer: answer.input not in requests)
    reached = set()
    while (tour := tours.next()) is not None:
        assert not requests & set(tour)
        reached |= {state for state, _ in pairs(tight, tour)}
        for pair in pairs(tight, tour):
            tours.done(pair)
    assert reached and all(tight.states[s].role != "prescriber" for s in reached)
    assert any(tight.states[s].role == "prescriber" for s in tours.left)


def walks(oracle: Oracle, count: int) -> Iterator[list[int]]:
    """Random ways through a graph, the same each time; expiries twice as likely."""
    dice = random.Random(1)
    for _ in range(count):
        state, tour = 0, []
        for _ in range(60):
            answers = list(oracle.changes(state))
            expiries = [a for a in answers if oracle.inputs[a.input].kind == "expire"]
            answer = dice.choice(answers + expiries)
            tour.append(answer.input)
            state = answer.next
        yield tour


def test_the_timetable_makes_each_expiry_due_in_turn(tight: Oracle) -> None:
    start = 5_000
    for tour in walks(tight, 200):
        slots = timetable(tight, tour, start)
        deadlines: dict[Timer, int] = {}
        lease, told = 0, {}
        now = start
        for i, slot in zip(tour, slots, strict=True):
            value = tight.inputs[i]
            assert slot.answer.input == i and slot.at - now in (STEP_MS, STEP_MS + STEP_MS // 2)
            now = slot.at
            assert all(ms >= 1 for ms in slot.durations.values())
            assert not slot.durations.keys() & {"lease"}
            told |= slot.durations
            if isinstance(value, Expire):
                assert deadlines.pop(value.timer) == now
            assert all(deadline > now for deadline in deadlines.values()), "none is jumped over"
            lease = slot.lease_ms or lease
            for timer in slot.answer.effect.stop:
                del deadlines[timer]
            for timer in slot.answer.effect.arm:
                lasts = lease if timer[0] == "lease" else told[timer[0]]
                deadlines[timer] = now + lasts
        assert all(deadline >= now + STEP_MS for deadline in deadlines.values())


def test_what_changes_nothing_comes_a_little_later(tight: Oracle) -> None:
    refused = next(a.input for a in tight.answers(0) if not a.changes)
    moves = next(a.input for a in tight.changes(0))
    slots = timetable(tight, [refused, refused, moves], 0)
    now = STEP_MS // 2
    assert [slot.at for slot in slots] == [now + LATER_MS, now + LATER_MS, now + STEP_MS]


def test_a_timetable_of_what_is_not_offered(tight: Oracle) -> None:
    absent = next(i for i in range(len(tight.inputs)) if tight.answer(0, i) is None)
    with pytest.raises(ValueError, match="does not offer"):
        timetable(tight, [absent], 0)
    assert offered(tight, [absent]) == []


# -- the two-peer pairs


@pytest.fixture(scope="module")
def two() -> Oracle:
    return graph(TWO_PEERS.path)


@pytest.mark.slow
def test_each_two_peer_pair_is_offered(two: Oracle) -> None:
    written = json.loads(two_peer_pairs.PATH.read_bytes())["pairs"]
    kept = two_peer_pairs.read(two)
    assert len(kept) == sum(map(len, written.values())) > 10_000
    assert len({(a.state, a.input) for a in kept}) == len(kept)


@pytest.mark.slow
def test_two_peer_pairs_of_another_specification(two: Oracle, tmp_path: Path) -> None:
    file = tmp_path / "remainder.json"
    file.write_text(two_peer_pairs.PATH.read_text().replace(two.spec_hash, "0" * 64))
    for path in (file, tmp_path / "none.json"):
        with pytest.raises(oracle_.OracleError, match=path.name):
            two_peer_pairs.read(two, path)


@pytest.mark.slow
def test_the_two_peer_pairs_have_no_image(two: Oracle) -> None:
    """A sample: no pair of the file has an image, and of pairs that are alike the first decides."""
    one, dice = graph(ONE_PEER.path), random.Random(1)

    def has_image(answer: oracle_.OracleAnswer) -> bool:
        return any(two_peer_pairs._image(two, one, answer, away) for away in two_peer_pairs.PEERS)

    kept = two_peer_pairs.read(two)
    assert not any(has_image(answer) for answer in dice.sample(kept, 300))
    alike = {key(two, answer) for answer in kept}
    seen = Counter[bool]()
    for _ in range(300):
        state = dice.randrange(len(two.states))
        answer = dice.choice(list(two.answers(state)))
        either = {key(two, answer), key(two, mirror(two, answer))}
        written = bool(alike & either)
        seen[written] += 1
        if not has_image(answer) and not written:
            assert has_image(first_like(two, either))
    assert min(seen.values()) > 10


Key = tuple[two_peer_pairs.Seen, int]


def first_like(two: Oracle, keys: set[Key]) -> oracle_.OracleAnswer:
    """The first pair with one of these keys."""
    for state in range(len(two.states)):
        for _, i in sorted(keys, key=lambda key: key[1]):
            answer = two.answer(state, i)
            if answer is not None and key(two, answer) in keys:
                return answer
    raise AssertionError("no such pair")


def key(two: Oracle, answer: oracle_.OracleAnswer) -> Key:
    """Equal for pairs that differ only in parts that the input cannot affect."""
    view = two_peer_pairs._touches(two.inputs[answer.input])
    return two_peer_pairs._view(two.states[answer.state], view), answer.input


def mirror(two: Oracle, answer: oracle_.OracleAnswer) -> oracle_.OracleAnswer:
    """The pair with the peers exchanged."""
    state = renumbering.state(two.states[answer.state], two_peer_pairs._swap)
    i = renumbering.input_of(two.inputs[answer.input], two_peer_pairs._swap)
    return two.ask(state, i)
