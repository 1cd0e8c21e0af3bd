"""Walks: their steps, their ends, and the names of their cases."""

from __future__ import annotations

import pytest
from suite_stage import LIMIT, graph
from wrong_station import station

from automcm_conformance.adapter.adapter import Adapter
from automcm_conformance.exchange.exchange import Exchange
from automcm_conformance.exchange.play import play
from automcm_conformance.explore import explore
from automcm_conformance.explore.walks import NOTHING, Act, Faults, Setting, WalkCoverage, perform
from automcm_conformance.live.live import Unwritten
from automcm_conformance.suite import scripts
from automcm_conformance.suite.graph_cases import PARAMETERS, Runner
from automcm_spec.graph.oracle_generation import ONE_PEER, TWO_PEERS

LIMITS = {"max_rounds": 3, "max_participants": 2, "outbox_limit": 5, "memory_limit": 4}


@pytest.mark.slow
def test_a_walk_ends_where_a_peer_would_be_forgotten_too_early() -> None:
    # Two Cancels are given up at once, the later of the two times; forget(2) is due between.
    closed = scripts.received("Cancel", scripts.NEXT)
    message = closed.message._replace(seq=0, reason="closed")
    tour = [
        scripts.ADVERTISED,
        scripts.LEAVE,
        scripts.received("Advertisement", scripts.NEXT),
        closed._replace(message=message),
        scripts.REQUEST,
        scripts.received("Intention", scripts.MINE),
        scripts.received("Intention", scripts.MINE, source=3),
        scripts.ABORT,
        scripts.expire("giveup", scripts.entry("Cancel", 2, scripts.MINE)),
        scripts.received("Ack", scripts.THEIRS, of=("Cancel", 1)),
        scripts.expire("forget", 2),
        scripts.expire("giveup", scripts.entry("Cancel", 3, scripts.MINE)),
    ]
    oracle = graph(TWO_PEERS.path)
    adapter = Adapter(station(), LIMIT)
    try:
        x = Runner(adapter, (), 1, lambda text: None).exchange(oracle)
        inputs = [oracle.input_index[value] for value in tour]
        off = play(x, inputs, True)
        x.flush()
    finally:
        adapter.stop()
    assert off is not None and off[1] == inputs[8]


def test_in_natural_time_each_timer_expires_when_it_is_due() -> None:
    oracle = graph(ONE_PEER.path)
    x = Exchange(oracle, Unwritten(), PARAMETERS, predict=True, logged=False)
    for pause_ms, i in ((10, oracle.input_index[scripts.REQUEST]), (250, NOTHING)):
        perform(x, Act(pause_ms, i), Setting(False))
    assert [step.now - x.now for step in x.unwritten_steps[-3:]] == [-150, -50, 0]


def test_a_case_says_what_it_was_played_with() -> None:
    oracle = graph(ONE_PEER.path)
    coverage = WalkCoverage(oracle, lambda state, i: True)
    walk = explore.Walk(12, coverage, Faults(5, 0, 40, 20), Setting(False), [Act(0, 1)])
    assert walk.id(7) == "EXPLORE/7/12/one-peer/natural/again5-late0-odd40-silent20"


@pytest.mark.slow
def test_two_timers_of_one_name_armed_at_once_do_not_turn_back_time() -> None:
    """Two Cancels, or a Prescription and a Cancel, are sent again together or not at all."""
    two = graph(TWO_PEERS.path)
    intentions = [scripts.received("Intention", scripts.MINE, source=p) for p in (2, 3)]
    resends = [
        scripts.expire("resend", scripts.entry(*to, scripts.MINE))
        for to in (("Cancel", 2), ("Prescription", 3))
    ]
    values = [
        scripts.REQUEST,
        *intentions,
        scripts.WINDOW,
        scripts.command("prescribe", scripts.MINE, 1, 3),
    ]
    copy = intentions[0]
    tour = [two.input_index[v] for v in (*values, resends[1], copy, resends[0], copy)]
    right = Adapter(station(), LIMIT)
    x = Exchange(two, right, PARAMETERS | LIMITS)
    off = play(x, tour, True)
    x.flush()
    right.stop()
    assert off is not None and off[1] == tour[-4]
