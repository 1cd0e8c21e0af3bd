"""Conditions of the compiled station, recorded and flipped."""

from __future__ import annotations

import pytest

from automcm_spec.graph import oracle, oracle_generation
from automcm_spec.support.paths import TLA
from automcm_spec.vocabulary import conditions
from automcm_spec.vocabulary.json_forms import open_station
from automcm_spec.vocabulary.rules import RULES
from automcm_spec.vocabulary.station import CONDITIONS, Command, Effect, Receive, State, Station

ME = 4711
LIMITS = Station(max_rounds=7, max_participants=40, outbox_limit=64, memory_limit=64)
INTENDING = LIMITS.initial._replace(
    phase="INTENDING", role="receiver", session=(815, 3), joined=frozenset({(815, 3)})
)


def advertisement(session: tuple[int, int]) -> Receive:
    return Receive("receive", LIMITS.advertisement(session[0], session), True)


def decide(st: State, asked: Receive | Command) -> tuple[Effect, list[conditions.Evaluated]]:
    return conditions.record(LIMITS, lambda station: station.decide(ME, st, asked))


def test_a_condition_has_its_line_its_text_and_its_values() -> None:
    complete = Command("command", "complete", (815, 2), 0, 0)
    st = INTENDING._replace(phase="ACTUATING", role="prescriber")
    effect, evaluated = decide(st, complete)
    assert effect.rule == "PRE-5"
    (stale,) = (t for t in evaluated if t.condition.text == "c.session # st.session")
    assert stale.condition.operator == "OnComplete" and stale.condition.kind == "guard"
    line = (TLA / "Station.tla").read_text().splitlines()[stale.condition.line - 1]
    assert stale.condition.text in line
    assert stale.value and dict(stale.values) == {"c.session": (815, 2), "st.session": (815, 3)}


def test_an_index_is_shown_as_in_tla_and_a_limit_with_its_name() -> None:
    fin = Receive("receive", LIMITS.fin(815, ME, (815, 3)), False)
    _, evaluated = decide(INTENDING, fin)
    shown = {name: value for t in evaluated for name, value in t.values}
    assert "Peer(st)" not in shown and shown["m.src"] == 815
    refusal = Receive("receive", LIMITS.refusal(815, (ME, 3), 2, "unsafe"), False)
    st = INTENDING._replace(
        phase="PRESCRIBING", role="prescriber", session=(ME, 3), target=815, proposal=2
    )
    _, evaluated = decide(st, refusal)
    shown = {name: value for t in evaluated for name, value in t.values}
    assert shown["MaxRounds"] == 7 and shown["m.session[1]"] == ME


def test_a_recorded_station_decides_as_the_other() -> None:
    tight = oracle.load(oracle_generation.TIGHT.path, oracle_generation.spec_hash())
    station = open_station(tight.constants)
    met: set[tuple[conditions.Condition, bool]] = set()

    def hook(condition: conditions.Condition, value: bool, values: object) -> bool:
        met.add((condition, value))
        return value

    recorded = conditions.recording(station, hook)
    for n in range(0, len(tight.states), 5):
        st = tight.states[n]
        for answer in tight.answers(n):
            asked = tight.inputs[answer.input]
            assert recorded.step(1, st, asked) == station.step(1, st, asked)
    rules = {c.text for c, _ in met if c.kind == "rule"}
    assert rules >= set(RULES) - {"ACT-1", "END-4"}
    both_ways = [c for c in CONDITIONS if {(c, True), (c, False)} <= met]
    assert len(both_ways) > 100


def test_the_original_is_not_touched() -> None:
    decide(INTENDING, advertisement((815, 4)))
    assert type(LIMITS) is Station and "_hook" not in vars(LIMITS)


def test_the_line_that_decides() -> None:
    lines = (TLA / "Station.tla").read_text().splitlines()
    for st, asked in (
        (INTENDING, advertisement((815, 4))),
        (INTENDING, Receive("receive", LIMITS.prescription(9, ME, (9, 1), 1), False)),
        (LIMITS.initial, Receive("receive", LIMITS.prescription(9, ME, (9, 1), 1), False)),
    ):
        effect, evaluated = decide(st, asked)
        *_, rule = (each.condition for each in evaluated if each.condition.kind == "rule")
        assert rule.text == effect.rule and f'"{effect.rule}"' in lines[rule.line - 1]


# Which guard was in the way.


def in_way(
    st: State, asked: Receive | Command, wanted: str, most: int = 3
) -> list[list[tuple[str, bool]]]:
    found = conditions.blocking_conditions(
        LIMITS,
        lambda station: station.decide(ME, st, asked),
        lambda effect: any(m.type == wanted for m in effect.out),
        most,
    )
    return [[(t.condition.text, t.value) for t in choice] for choice in found]


BUSY = INTENDING._replace(joined=frozenset({(9, 1)}))
OLD = Receive("receive", LIMITS.prescription(815, ME, (815, 2), 1), False)
BOUND, STALE = ("Bound(st)", True), ("NewerThanJoined(st, m.session)", False)


@pytest.mark.parametrize(
    ("st", "asked", "wanted", "most", "found"),
    [
        (BUSY, advertisement((815, 4)), "Intention", 3, [[BOUND]]),
        (INTENDING, advertisement((815, 2)), "Intention", 3, [[BOUND, STALE]]),
        (INTENDING, advertisement((815, 2)), "Intention", 1, []),
        (LIMITS.initial, advertisement((815, 2)), "Intention", 3, [[]]),  # it happens
        (INTENDING, advertisement((815, 2)), "Fin", 3, []),  # no guard prevents it
        (INTENDING, OLD, "Ack", 3, [[("In(st, m.session)", False)]]),
    ],
)
def test_the_smallest_choices_of_guards_are_found_in_their_order(
    st: State, asked: Receive, wanted: str, most: int, found: list[list[tuple[str, bool]]]
) -> None:
    assert in_way(st, asked, wanted, most) == found


def test_parts_are_chosen_from_if_asked_for() -> None:
    """Those of what no guard decides, such as which timers are armed."""
    found = conditions.blocking_conditions(
        LIMITS, lambda s: s.armed(ME, INTENDING), lambda armed: ("hold",) in armed, kind="part"
    )
    assert [[t.condition.text for t in choice] for choice in found] == [['st.phase = "WAITING"']]


def test_a_subclass_is_refused() -> None:
    class Other(Station):
        pass

    with pytest.raises(TypeError, match="Other"):
        conditions.recording(Other(1, 1, 1, 1), lambda condition, value, values: value)
