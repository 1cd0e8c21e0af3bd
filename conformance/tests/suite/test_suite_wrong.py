"""The suite against stations that answer wrongly: blamed is the case that it belongs to."""

from __future__ import annotations

import json
from collections.abc import Sequence

import pytest
from suite_stage import ACCEPTS, BUSY, IGNORES, LATER, Suite, of
from suite_stage import conform as conform
from wrong_station import station

from automcm_conformance.adapter.adapter import Adapter
from automcm_conformance.adapter.protocol import ProtocolError
from automcm_conformance.exchange import tours
from automcm_conformance.exchange.answers import differences
from automcm_conformance.exchange.wire import Required, Wire
from automcm_conformance.suite import graph_cases
from automcm_spec.vocabulary.station import Message


def test_a_wrong_answer_is_blamed_on_its_case(conform: Suite) -> None:
    found = conform(station(IGNORES), BUSY, ACCEPTS, "AMCM/RCV/ADV/BV-01", states=60)
    case = of(found, BUSY)
    assert case.verdict == "FAIL" and "not sent: Acceptance" in case.reason
    assert [c.verdict for c in found.cases if c is not case] == ["PASS", "PASS"]
    assert found.exit_code == 1 and len(case.failures) == graph_cases.ENOUGH
    assert case.reached == graph_cases.ENOUGH < case.total
    for failure in case.failures:
        assert (failure.rule, failure.operator) == ("NEG-4", "OnForeignPrescription")
        assert failure.line > 0 and failure.rule_text
        assert "Acceptance" in failure.allowed[0] and "Acceptance" not in failure.came[0]
        said = [line.text for line in failure.exchange if line.who == "kit"]
        inputs = [text for text in said if not text.startswith(("reset", "timers"))]
        assert len(inputs) == 2, "an Advertisement, and a Prescription of another session"


@pytest.mark.slow
def test_no_bulk_changes_what_is_found(conform: Suite, monkeypatch: pytest.MonkeyPatch) -> None:
    """One bulk is judged while the station answers the next, and after a wrong answer that one is
    played again."""
    sent: list[int] = []
    send = Adapter.send

    def counted(self: Adapter, lines: Sequence[bytes], *, continued: bool = False) -> None:
        sent[-1] += len(lines)
        send(self, lines, continued=continued)

    monkeypatch.setattr(Adapter, "send", counted)
    monkeypatch.setattr(tours, "LONGEST", 20)
    names = (BUSY, ACCEPTS, "AMCM/RCV/ADV/BV-01")
    for bulk in (1, 40, 100_000):
        monkeypatch.setattr(graph_cases, "BULK", bulk)
        sent.append(0)
        right = conform(station(), *names, states=60, folder=f"right-{bulk}")
        assert [(c.verdict, c.reached) for c in right.cases] == [
            ("PASS", case.total) for case in right.cases
        ]
        sent.append(0)
        wrong = conform(station(IGNORES), *names, states=60, folder=f"wrong-{bulk}")
        assert [c.verdict for c in wrong.cases] == ["PASS", "PASS", "FAIL"]
        assert [c.reached for c in wrong.cases[:2]] == [c.total for c in right.cases[:2]]
    pairs = sum(case.total for case in right.cases)
    assert max(sent[::2]) < 4 * pairs, "no pair is driven twice"


def test_a_way_that_goes_wrong_is_inconclusive(conform: Suite) -> None:
    acks = "def answer(c):\n    out = right(c)\n"
    acks += "    return out | {'messages': []} if received(c, 'Advertisement') else out"
    found = conform(station(acks), BUSY, ACCEPTS, LATER, states=60)
    for name in (BUSY, ACCEPTS):
        case = of(found, name)
        assert case.verdict == "INCONC" and "the way there went wrong" in case.reason
        assert "not sent: Intention" in case.reason and not case.failures
        assert case.reached < case.total
    assert of(found, LATER).verdict == "PASS"
    assert found.exit_code == 4


def test_a_refused_input_that_changes_something_is_blamed_and_nobody_else(conform: Suite) -> None:
    secret = """
poisoned = False
def answer(c):
    global poisoned
    if c["cmd"] == "reset":
        poisoned = False
    if c["cmd"] == "command":
        name, session = c["command"]["name"], c["command"].get("session")
        if name == "refuse" and state().phase == "NEGOTIATING" and (
                tuple(session) != state().session):
            poisoned = True
        if name == "accept" and poisoned:
            c = {"cmd": "advance", "now": c["now"]}
    return right(c)
"""
    culprit = "AMCM/RCV/PRE/BI-03"
    found = conform(station(secret), culprit, ACCEPTS, "AMCM/RCV/ADV/BV-01", states=60)
    case = of(found, culprit)
    assert case.verdict == "FAIL" and "an input before it, which must change nothing" in case.reason
    assert of(found, ACCEPTS).verdict == of(found, "AMCM/RCV/ADV/BV-01").verdict == "PASS"
    assert {failure.rule for failure in case.failures} == {"PRE-5"}


# -- what changes something in secret


def test_an_ack_of_a_stranger_names_what_is_in_use() -> None:
    """END-6: the sender alone must keep it from counting."""
    wire = Wire()
    intention = {"type": "Intention", "dst": 1702, "session": [1702, 5], "seq": 7}
    wire.outbox["Intention", 2, (2, 1), 1] = intention
    ack = Message("Ack", 3, 1, (2, 1), 0, 0, False, "none", ("Intention", 1))
    assert wire.message(ack)["of"] == {"type": "Intention", "seq": 7}
    assert wire.message(ack)["src"] != intention["dst"]


@pytest.mark.parametrize(
    ("name", "wanted", "found"), [("accepted", True, 1), ("seq", 1, True), ("proposal", 1, 1.0)]
)
def test_no_value_of_another_type_is_taken(name: str, wanted: object, found: object) -> None:
    type_ = "Acceptance" if name == "accepted" else "Prescription"
    message = {"type": type_, "session": [2, 1], "seq": 1, name: wanted}
    expected = Required(messages=[message], phase="ACTUATING")
    answer = {"messages": [message], "indications": [], "deadline": None}
    assert differences(expected, json.dumps(answer).encode()) == []
    answer["messages"] = [message | {name: found}]
    try:
        assert differences(expected, json.dumps(answer).encode())
    except ProtocolError as error:
        assert "not an integer" in str(error)
