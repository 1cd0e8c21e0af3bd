"""Which conditions of Station.tla are taken each way: the count, and the text with marks."""

from __future__ import annotations

import pytest

from automcm_spec.support.paths import TLA
from automcm_spec.vocabulary.condition_coverage import (
    ConditionCoverage,
    annotated,
    lacking,
    reached,
)
from automcm_spec.vocabulary.conditions import recording
from automcm_spec.vocabulary.reachable_steps import steps
from automcm_spec.vocabulary.rules import RULES, operators
from automcm_spec.vocabulary.station import CONDITIONS, Command, OpenStation, State, Station

STATION = Station(max_rounds=3, max_participants=4, outbox_limit=6, memory_limit=2)
REQUEST = Command("command", "request", (0, 0), 0, 0)


def place(operator: str, text: str) -> int:
    """The line of Station.tla where an operator has this text first."""
    first, body = operators()[operator]
    return first + body[: body.index(text)].count("\n")


BACKOFF_LINE = place("OnRequest", "st.backoff")
BACKOFF = STATION.initial._replace(backoff=True)


def covered(*states: State, times: int = 1) -> ConditionCoverage:
    """Of requests in these states."""
    coverage = ConditionCoverage(times=times)
    for st in states:
        recording(STATION, coverage.meet).step(1, st, REQUEST)
    return coverage


def counts(coverage: ConditionCoverage, operator: str) -> list[tuple[str, int, int]]:
    return [
        (row["text"], row["true"], row["false"])
        for row in coverage.as_list()
        if row["operator"] == operator
    ]


def test_a_condition_is_counted_by_its_value() -> None:
    assert counts(covered(STATION.initial, BACKOFF, BACKOFF), "OnRequest") == [
        ("Bound(st)", 0, 3),
        ("MayRequest(st)", 3, 0),
        ("st.backoff", 2, 1),
        ("Room(st)", 1, 0),
    ]
    assert counts(covered(BACKOFF, times=7), "OnRequest")[2] == ("st.backoff", 7, 0)


def test_what_lacks_a_value_is_named() -> None:
    lines = lacking(covered(STATION.initial))
    backoff = f"false OnRequest:{BACKOFF_LINE} st.backoff"
    assert backoff in lines
    assert f"true  OnRequest:{BACKOFF_LINE + 1} Room(st)" in lines
    own = [c for c in reached().conditions if c.operator == "OnPrescribe"]
    assert f"never OnPrescribe:{own[0].line} ({len(own)} conditions)" in lines
    assert backoff not in lacking(covered(STATION.initial, BACKOFF))
    assert covered(BACKOFF).both_ways() < covered(STATION.initial, BACKOFF).both_ways()


def test_the_text_has_a_mark_at_each_line_with_a_condition() -> None:
    lines = annotated(covered(STATION.initial, BACKOFF))
    n = BACKOFF_LINE
    assert f'false  {n - 2}   IF Bound(st) THEN Refuse(st, "ADV-1")' in lines
    assert f' both  {n}   ELSE IF st.backoff THEN Refuse(st, "END-7")' in lines
    at = lines.index(f' part  {n + 1}   ELSE IF ~Room(st) THEN Refuse(st, "MEM-1")')
    assert lines[at + 1].split() == ["true:", "Room(st)"]  # not what is negated
    assert f'  met  {n + 5}               {{Advertisement(me, s)}}, Nothing, "ADV-1")' in lines
    refused = place("OnPrescribe", 'Refuse(st, "PRE-2")')
    assert f'never  {refused}     ELSE Refuse(st, "PRE-2")' in lines
    text = (TLA / "Station.tla").read_text().splitlines()
    for line in lines:
        if line[:10].strip() and line[6:10].strip().isdigit():
            assert line[11:] == text[int(line[6:10]) - 1]
    marked = {int(line[6:10]) for line in lines if line[:5].strip()}
    assert marked == {c.line for c in (*reached().conditions, *reached().rules)}


def test_what_only_the_invariant_and_the_models_ask_does_not_count() -> None:
    own = {c.operator for c in reached().conditions}
    assert {"OnCam", "Armed", "Marks", "Bound"} <= own
    assert not own & {"StationTypeInv", "Offered", "If"}
    assert {c.text for c in reached().rules} == set(RULES) - {"ACT-1", "END-4"}


def test_a_let_that_stands_in_several_places_is_one_condition() -> None:
    line = place("OnCancel", "acks ==")
    acks = [c for c in CONDITIONS if (c.operator, c.line) == ("OnCancel", line)]
    assert len(acks) > 1 and len({reached().first[c] for c in acks}) == 1


def test_the_last_arm_of_a_case_is_never_false() -> None:
    assert {c.text for c in reached().last_arms} == {
        'i.kind = "restart"',
        'm.type = "Ack"',
        'c.name = "abort"',
        't[1] = "forget"',
    }
    rows = covered(STATION.initial).as_list()
    (row,) = [row for row in rows if row["text"] == 'i.kind = "restart"']
    assert (row["true"], row["false"]) == (0, None)


OPEN = [
    (2, 1, 5, 1, {2}, {1, 2}, {1}),
    (1, 2, 4, 2, {2, 3}, {1}, {1}),
    (2, 1, 5, 1, {2, 3}, {1}, {1}),
    (1, 1, 3, 2, {2, 3}, {1}, {1, 2}),
]


@pytest.mark.deep
def test_all_but_one_can_be_taken_both_ways() -> None:
    """The entry of another session is a Fin or a Cancel wherever AnswerClosed asks (END-1)."""
    coverage = ConditionCoverage()
    for *limits, peers, own, theirs in OPEN:
        station = OpenStation(*limits, frozenset(peers), frozenset(own), frozenset(theirs))
        recorded = recording(station, coverage.meet)
        for st in {st for st, _, _ in steps(station, recorded)}:
            recorded.marks(st)
    line = place("AnswerClosed", "e.type")
    assert lacking(coverage) == [f'true  AnswerClosed:{line} e.type \\in {{"Fin", "Cancel"}}']
