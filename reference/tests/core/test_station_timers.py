"""The timers of one station: count, time, order, and those that outlive a session."""

from __future__ import annotations

import pytest
from automcm_stage import (
    OTHER,
    OWN,
    PRESCRIBER,
    TARGET,
    THEIRS,
    Stage,
    ack,
    advertisement,
    cancel,
    intention,
    no,
    prescription,
    sent,
    told,
    yes,
)

from automcm_spec.vocabulary.parameters import DEFAULTS, lease_lasts

# -- repetition


def test_pre_1_choose_comes_at_2100_with_the_intentions() -> None:
    s = Stage()
    s.do(0, "request")
    s.hear(1000, intention(OTHER))
    s.hear(1100, intention(TARGET))
    assert s.run(2099) and s.at == ("prescriber", "ADVERTISING")
    (choose,) = told(s.run(2100))
    assert (choose.name, choose.session) == ("choose", OWN)
    assert choose.intentions == (intention(TARGET), intention(OTHER))
    assert s.at == ("prescriber", "CHOOSING")


# -- order


def test_due_timers_fire_before_an_input_at_the_same_instant() -> None:
    s = Stage()
    (mine,) = sent(s.hear(0, advertisement()))
    resent, discarded = s.hear(100, b"rubbish")
    assert ([m.type for m in resent.messages], discarded.rule) == (["Intention"], "END-5")
    s.run(2099)
    given_up, late = s.hear(2100, ack(mine))
    assert (given_up.rule, late.rule) == ("ADV-6", "END-6")
    s = Stage().walk("receiver", "NEGOTIATING")
    undecided, late = s.do(DEFAULTS["t_decide"] + 20, "accept", THEIRS)
    assert (undecided.rule, late.rule) == ("NEG-3", "CMD-1")


def test_order_lease_before_giveup_before_resend() -> None:
    s = Stage().walk("prescriber", "CHOOSING")
    s.do(2150, "prescribe", OWN, lease_ms=2123)  # 2100 for the prescriber (ACT-4)
    s.run(4249)
    due = [t.name for t, d in s.station.timers.items() if d == 4250]
    assert sorted(due) == ["giveup", "giveup", "lease", "resend", "resend"]
    assert [e.rule for e in s.run(4250)] == ["ACT-4", "REL-1"]


def test_order_older_entries_before_younger_ones() -> None:
    s = Stage().walk("prescriber", "CHOOSING")
    s.do(2200, "proceed", OWN)
    assert [m.dst for m in sent(s.run(2300))] == [TARGET, OTHER]
    s.run(4299)
    given_up = [e.input.timer for e in s.run(4300)]  # type: ignore[union-attr]
    assert [(t.name, t.entry.to) for t in given_up] == [("giveup", TARGET), ("giveup", OTHER)]


# -- lease


def test_t_4_the_prescribers_lease_ends_before_the_receivers() -> None:
    """The prescriber counts from its first sending, the receiver from its acceptance."""
    p, r = Stage().walk("prescriber", "CHOOSING"), Stage(station_id=TARGET)
    r.hear(0, advertisement(OWN))
    (proposal,) = sent(p.do(2150, "prescribe", OWN), "Prescription")
    p.run(2350)
    r.run(2310)
    r.hear(2310, proposal)
    (answer,) = sent(r.do(2400, "accept", OWN))
    p.hear(2420, answer)
    own_ms = lease_lasts(p.station.parameters.clock_drift, "prescriber", proposal.lease_ms)
    assert (p.deadline("lease"), r.deadline("lease")) == (2150 + own_ms, 2400 + proposal.lease_ms)
    assert own_ms < proposal.lease_ms


def test_neg_6_accepted_tells_what_is_left_of_the_lease_of_the_last_proposal() -> None:
    s = Stage().walk("prescriber", "NEGOTIATING")
    s.hear(2300, no())
    s.do(2400, "prescribe", OWN, proposal=2, lease_ms=5000)
    (accepted,) = told(s.hear(2500, yes(2)))
    assert (s.deadline("lease"), accepted.as_dict()["lease_left_ms"]) == (7349, 4849)


# -- what outlives a session


@pytest.mark.parametrize(("left", "until"), [(100, 6300), (2100, 6300), (2101, 6301), (5000, 9200)])
def test_adv_8_forget_timer_counts_from_joining_and_from_leaving(left: int, until: int) -> None:
    s = Stage().walk("receiver", "WAITING")
    assert s.deadline("forget") is None
    s.run(left)
    s.hear(left, cancel())
    assert s.deadline("forget") == until
    s.hear(until - 1, advertisement())
    assert s.at == ("none", "STANDALONE")
    s.run(until)
    assert s.state.joined == {}


def test_adv_8_a_newer_session_counts_anew() -> None:
    s = Stage().walk("receiver", "WAITING")
    s.hear(1000, cancel())
    s.hear(3000, advertisement((PRESCRIBER, 2)))
    assert (s.at, s.deadline("forget")) == (("receiver", "INTENDING"), None)
    s.hear(3100, cancel(session=(PRESCRIBER, 2)))
    assert s.deadline("forget") == 3000 + 6300
    assert s.state.joined == {PRESCRIBER: 2}


def test_adv_8_forgetting_one_prescriber_moves_no_other() -> None:
    s = Stage()
    s.hear(0, advertisement((OTHER, 1)))
    s.hear(100, cancel("abort", OTHER, (OTHER, 1)))
    s.hear(5000, advertisement())
    s.run(6300)
    assert s.state.joined.keys() == {PRESCRIBER}
    s.hear(6400, cancel())
    assert s.deadline("forget") == 5000 + 6300


def backoff_of(seed: int) -> int:
    s = Stage(seed=seed)
    s.do(0, "request")
    s.run(2100)
    deadline = s.deadline("backoff")
    assert deadline is not None
    return deadline - 2100


def test_end_7_backoff_is_seeded_and_within_its_range() -> None:
    drawn = [backoff_of(seed) for seed in range(20)]
    assert drawn == [backoff_of(seed) for seed in range(20)]
    assert len(set(drawn)) > 10
    assert all(500 <= ms <= 2000 for ms in drawn)


# -- the clock


def test_time_does_not_go_back() -> None:
    s = Stage().walk("receiver", "WAITING")
    before, timers = s.state, dict(s.station.timers)
    for late in (
        lambda: s.station.advance(9),
        lambda: s.hear(9, prescription()),
        lambda: s.hear(9, b"rubbish"),
        lambda: s.do(9, "abort", THEIRS),
        lambda: s.restart(9),
    ):
        with pytest.raises(ValueError, match="must not decrease"):
            late()
    assert (s.state, s.station.timers) == (before, timers)
    assert s.station.advance(10) == []


def test_next_deadline_is_the_earliest_or_none() -> None:
    s = Stage()
    assert s.station.next_deadline() is None
    s.do(30, "request")
    assert s.station.next_deadline() == 130
    s.run(2099)
    assert s.station.next_deadline() == 2130
    s.station.restart(2100)
    assert s.station.next_deadline() == 2100 + 6300


def test_a_late_advance_fires_each_timer_once_and_arms_from_now() -> None:
    s = Stage()
    s.do(0, "request")
    (only,) = s.station.advance(350)
    assert [m.type for m in only.messages] == ["Advertisement"]
    assert [deadline for _, deadline in only.armed] == [450]
    assert s.station.advance(449) == []
    assert s.deadline("advertise") == 2100
