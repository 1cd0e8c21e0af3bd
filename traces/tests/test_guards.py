"""What was allowed instead: in states of the oracle, and where logs diverge."""

from __future__ import annotations

from functools import cache
from typing import Any

import pytest

from automcm.links.simulated import Channel
from automcm.simulation import Simulation
from automcm.straight import Straight
from automcm_spec.generate import ONE_PEER, TIGHT, Graph
from automcm_spec.oracle import STATE_FIELDS, Oracle, load
from automcm_spec.rules import place
from automcm_traces.graph_engine import GraphEngine
from automcm_traces.graph_view import View
from automcm_traces.guards import (
    MOST,
    armed_in,
    causes,
    names,
    nearest,
    observed,
    timer_in,
    unarmed,
)
from automcm_traces.guards_end import HANDLERS
from automcm_traces.guards_tree import ways
from automcm_traces.log import Receive
from automcm_traces.reader import Log, read
from automcm_traces.step import Diverges
from automcm_traces.track import INITIAL, Entry, Track

Json = Any
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
    assert (found.guard, found.why) == (
        "~concerned",
        "the Advertisement does not concern it (no planned with it)",
    )
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
    assert found.text().endswith("(OnAdvertisement), but not in this form, or not again")


def test_what_no_branch_of_the_handler_does() -> None:
    assert nearest(oracle(), oracle().states[0], ADVERTISEMENT, ("send", "Fin")) is None


def test_rel_1_a_copy_may_carry_any_reason_but_is_of_what_was_sent() -> None:
    cancel = ["Cancel", 2, [1, 1], 1, False]
    sending = state(phase="STANDALONE", outbox=[cancel])
    resend = ["expire", ["resend", cancel]]
    found = nearest(oracle(), sending, resend, ("send", "Cancel", "abort"))
    assert found is not None
    assert (found.rule, found.guard) == ("REL-1", "")
    assert nearest(oracle(), sending, resend, ("send", "Fin")) is None  # of some states only
    assert nearest(oracle(), sending, resend, ("send", "Cancel", "abort", "more")) is None


def test_the_phase_that_it_stays_in() -> None:
    waiting = state(phase="WAITING")
    found = nearest(oracle(), waiting, PRESCRIPTION, ("phase", "WAITING"))
    assert found is not None
    assert (found.rule, found.must_hold, found.guard[:8]) == ("END-5", False, "st.phase")


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
    assert causes(oracle(), receiver, ("send", "Ack")) == [  # first what changes something
        "receive Cancel from 2",
        "receive Fin from 2",
        "receive Acceptance from 2 (refused)",
        "receive Prescription from 2",
    ]
    assert causes(oracle(), receiver, ("send", "Prescription")) == []
    assert causes(oracle(), receiver, ("without", "send", "Fin")) == []
    assert causes(oracle(), ["no state"], ("send", "Fin")) == []


def test_the_values_are_given_with_the_ids_of_the_log() -> None:
    """ADV-8: real ids, sessions and limits instead of the oracle's."""
    state = INITIAL._replace(phase="ACTUATING", role="receiver", session=(1001, 7), proposal=4)
    track = Track(2002, 5, state=state._replace(joined=frozenset({(1001, 7)})))
    sent = {"seq": 3, "proposal": 4, "accepted": True}
    track.outbox.append(Entry("Acceptance", 1001, (1001, 7), 4, sent))
    view = View(track, 1001, session=(1001, 7), k=4)
    real = names(view)
    given = [
        "receive",
        [*PRESCRIPTION[1][:3], view.sessions((1001, 7)), 1, 1, *PRESCRIPTION[1][6:]],
    ]
    found = nearest(oracle(), view.state(), [*given, True], ("told", "verify"))
    assert found is not None
    assert "m.proposal = 4, st.proposal = 4" in found.text(real)
    shown = {
        ("st.outbox", "{Acceptance to 1001 session=1001/7 proposal=4 seq=3}"),
        ("st.joined", "{1001/7}"),
        ("m.dst", "2002"),
        ("m.src", "1001"),
        ("OutboxLimit", "64"),
        ("MemoryLimit", "64"),
        ("MaxRounds", "5"),
        ("st.deciding", "FALSE"),
    }
    values = {"st.outbox": view.state()[11], "st.joined": [[2, 1]], "m.dst": 1, "m.src": 2}
    values |= {"OutboxLimit": 5, "MemoryLimit": 4, "MaxRounds": 3, "st.deciding": False}
    assert {(name, real.of_value(name, value)) for name, value in values.items()} == shown
    assert causes(oracle(), view.state(), ("told", "fallback"), real)[-1] == (
        "receive Cancel from 1001"
    )


def test_what_was_received_is_shown_as_the_log_has_it() -> None:
    """END-6: the seq of the wire, not what stands for it in the oracle."""
    track = Track(1001, state=INITIAL._replace(number=7))
    track.outbox.append(Entry("Fin", 2002, (1001, 7), 1, {"seq": 5}))
    ack = {"type": "Ack", "src": 2002, "dst": 1001, "session": [1001, 7], "seq": 0}
    ack |= {"of": {"type": "Fin", "seq": 5}}
    view = View(track, 2002, session=(1001, 7))
    given = ["receive", ["Ack", 2, 1, [1, 1], 0, 0, False, "none", ["Fin", 1]], False]
    found = nearest(oracle(), view.state(), given, ("without", "stop"))
    assert found is not None
    assert found.text(names(view, ack)) == (
        "nearest allowed: END-6 without stop (OnAck) blocked by guard acked = {}, which must hold; "
        "it matches a message that is still being sent: m.src = 2002, m.session = 1001/7, "
        "m.of = Fin seq=5, st.outbox = {Fin to 2002 session=1001/7 seq=5}  "
        f"Station.tla:{place('OnAck', 'acked = {}')[0]}"
    )


def test_a_timer_of_a_log_in_the_ids_of_the_oracle() -> None:
    """REL-1: of a message in the outbox, of one that is not, of the Advertisement."""
    state = INITIAL._replace(phase="ADVERTISING", role="prescriber", session=(1001, 7), number=7)
    track = Track(1001, state=state)
    track.outbox.append(Entry("Cancel", 2002, (1001, 7), 1, {"seq": 5}))
    view = View(track, 2002, session=(1001, 7))
    key = {"type": "Cancel", "to": 2002, "session": [1001, 7], "seq": 5}
    entry = ["Cancel", 2, [1, 1], 1, False]
    assert timer_in(view, {"name": "giveup", "message": key}) == ["giveup", entry]
    other = timer_in(view, {"name": "giveup", "message": {**key, "type": "Fin"}})
    assert other == ["giveup", ["Fin", *entry[1:]]]
    found = unarmed(oracle(), view.state(), other)
    assert found is not None
    assert (found.action, found.why) == (
        "expire giveup(Fin)",
        "no such message is being sent any more",
    )
    again = {"type": "Advertisement", "session": [1001, 7], "seq": 1}
    resend = timer_in(view, {"name": "resend", "message": again})
    assert unarmed(oracle(), view.state(), resend) is None
    assert timer_in(view, {"name": "forget", "station": 2002}) == ["forget", 2]
    assert timer_in(view, {"name": "forget", "station": 3003}) == ["forget", 9]


def test_mem_1_a_real_station_may_be_full() -> None:
    """Its limits decide, not those of the oracle."""
    standing = oracle().states[0]
    found = nearest(oracle(), standing, ADVERTISEMENT, ("send", "Intention"), full=True)
    assert found is not None
    assert (found.rule, found.guard[:8]) == ("ADV-3", "~(Room(s")
    request = ["command", "request", [0, 0], 0, 0]
    found = nearest(oracle(), standing, request, ("send", "Advertisement"), full=True)
    assert found is not None
    assert found.guard == "~Room(st)"
    found = nearest(oracle(), standing, request, ("told", "refused"), full=True)
    assert found is not None
    assert (found.rule, found.guard) == ("MEM-1", "")


def tuples(value: Json) -> Json:
    return tuple(tuples(v) for v in value) if isinstance(value, list) else value


def test_what_the_engine_gives_means_the_same() -> None:
    """Tuples for lists, an outbox in another order, whole messages and timers."""
    entries = [["Cancel", 2, [2, 1], 1, False], ["Cancel", 2, [2, 2], 1, False]]
    sending = state(phase="STANDALONE", outbox=entries)
    other = [*sending[:11], entries[::-1], *sending[12:]]
    cancel = {"type": "Cancel", "reason": "abort", "seq": 3}
    resend = ["expire", ["resend", entries[1]]]
    found = nearest(oracle(), sending, resend, ("send", "Cancel", "abort"))
    assert found is not None
    assert nearest(oracle(), tuples(other), tuples(resend), ("send", cancel)) == found
    told = causes(oracle(), sending, ("arm", "resend"))
    assert told[0] == "expire resend(Cancel)"
    assert causes(oracle(), tuples(other), ("arm", {"name": "resend"})) == told
    acceptance = {"type": "Acceptance", "accepted": False, "reason": "busy", "seq": 0}
    assert causes(oracle(), state(phase="WAITING"), ("send", acceptance)) == [
        "receive Prescription from 2"
    ]
    finished = causes(oracle(), state(phase="WAITING"), ("indication", "finished"))
    assert finished == ["receive Fin from 2"]
    assert unarmed(oracle(), tuples(other), tuples(["giveup", entries[0]])) is None


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Log:
    """A receiver's log."""
    folder = tmp_path_factory.mktemp("logs")
    simulation = Simulation(seed=3, channel=Channel(loss=0.2), logs=folder)
    for station in (1001, 2002):
        simulation.add(station, Straight())
    simulation.request(1001, at=500)
    simulation.run(until=10_000)
    return read(folder / "2002.ndjson")


def test_what_an_event_of_a_log_shows(log: Log) -> None:
    shown = {observed(event) for _, event in log.events}
    assert {
        (),
        ("send", "Intention", None),
        ("send", "Acceptance", True, None),
        ("arm", "giveup"),
        ("stop", "hold"),
        ("told", "verify", None),
    } <= shown


def test_adv_3_where_a_log_diverges_the_guard_is_found(log: Log) -> None:
    """The application's trajectory is missing, so the Advertisement does not concern it."""
    engine = GraphEngine(log.header)
    with pytest.raises(Diverges) as caught_:
        for at, event in log.events:
            if isinstance(event, Receive):
                event = event.model_copy(update={"planned": None})
            engine.feed(at, event)
    d = caught_.value
    assert d.step is not None
    assert d.step.found is not None
    view = d.step.found.view
    found = nearest(oracle(), view.state(), d.step.input, d.seen)
    assert found is not None
    assert (found.rule, found.action) == ("ADV-3", "phase INTENDING")  # what it says first
    assert found.text(names(view, d.step.given)).endswith(
        "the Advertisement does not concern it (no planned with it): concerned = FALSE  "
        f"Station.tla:{place('OnAdvertisement', '~concerned')[0]}"
    )


@pytest.mark.parametrize(
    ("every", "least"), [(12, 500), pytest.param(4, 1000, marks=pytest.mark.deep)]
)
def test_of_everything_done_somewhere_the_nearest_is_found_in_every_state(
    every: int, least: int
) -> None:
    """It blocks as it says, its values can be shown, and it names a line."""
    things = sorted(
        {text for tree in HANDLERS.values() for _, leaf in ways(tree) for text in leaf.does}
    )
    o, found = oracle(TIGHT), 0
    for at, i in list(enumerate(o.inputs))[::every]:
        s = o.states[at * 31 % len(o.states)]
        for text in things:
            near = nearest(o, s, i, text.removesuffix("?").split())
            if near is None or not near.guard:
                continue
            found += 1
            assert near.line > 0 and near.why in near.text()
            assert len(causes(o, s, text.removesuffix("?").split())) <= MOST
    assert found > least
