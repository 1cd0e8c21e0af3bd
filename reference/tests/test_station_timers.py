"""The timers of one station: how often, when, in which order, and what outlives a session."""

from __future__ import annotations

from typing import Any

import pytest
from automcm_stage import (
    EVERY_100_MS,
    ME,
    OTHER,
    OWN,
    PRESCRIBER,
    TARGET,
    THEIRS,
    Stage,
    ack,
    advertisement,
    cam,
    cancel,
    intention,
    names,
    no,
    prescription,
    sent,
    times,
    told,
    yes,
)

from automcm.state import State, Timer, armed
from automcm_spec.application import NoParticipants
from automcm_spec.messages import Cancel, encode

# -- repetition


def test_adv_2_advertisement_21_times_then_the_window_closes() -> None:
    s = Stage()
    effects = s.do(0, "request") + s.run(2100)
    assert times(effects, "Advertisement") == EVERY_100_MS
    assert len({encode(m) for m in sent(effects)}) == 1
    assert (effects[-1].now_ms, effects[-1].rule) == (2100, "PRE-1")


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


def test_pre_1_nobody_answers() -> None:
    s = Stage()
    s.do(0, "request")
    (nobody,) = told(s.run(2100))
    assert nobody == NoParticipants(session=OWN)
    assert s.at == ("none", "STANDALONE")


def test_adv_6_intention_21_times_then_waiting() -> None:
    s = Stage()
    effects = s.hear(0, advertisement()) + s.run(2099)
    assert times(effects, "Intention") == EVERY_100_MS
    assert len({encode(m) for m in sent(effects)}) == 1
    assert s.at == ("receiver", "INTENDING")
    (given_up,) = s.run(2100)
    assert (given_up.rule, given_up.messages) == ("ADV-6", ())
    assert s.at == ("receiver", "WAITING")
    assert s.state.outbox == ()


@pytest.mark.parametrize(("t_timeout", "n"), [(0, 1), (1000, 11), (2000, 21)])
def test_t_3_a_reliable_message_is_sent_n_times(t_timeout: int, n: int) -> None:
    s = Stage(t_timeout=t_timeout)
    effects = s.hear(0, advertisement()) + s.run(5 * 2100)
    assert times(effects, "Intention") == [100 * k for k in range(n)]
    assert s.deadline("giveup") is None


def test_adv_6_an_ack_stops_the_intention() -> None:
    s = Stage()
    effects = s.hear(0, advertisement())
    (mine,) = sent(effects)
    effects += s.run(250)
    (only,) = s.hear(250, ack(mine))
    assert s.at == ("receiver", "WAITING")
    assert sorted(names(only.stopped)) == ["giveup", "resend"]
    assert times(effects + s.run(5000), "Intention") == [0, 100, 200]


def test_adv_7_hold_timer_ends_waiting_silently() -> None:
    s = Stage().walk("receiver", "WAITING")
    assert s.deadline("hold") == 10 + 2100 + 500 + 2 * 2100
    assert s.run(6809) == []
    (end,) = s.run(6810)
    assert (end.rule, end.messages, s.at) == ("ADV-7", (), ("none", "STANDALONE"))
    assert [(i.name, i.reason) for i in end.indications] == [("fallback", "timeout")]


def test_pre_4_prescription_is_given_up_at_2100_by_cancel_timeout() -> None:
    s = Stage().walk("prescriber", "CHOOSING")
    effects = s.do(2150, "prescribe", OWN) + s.run(4249)
    assert times(effects, "Prescription") == [2150 + t for t in EVERY_100_MS]
    assert s.at == ("prescriber", "PRESCRIBING")
    given_up = s.run(4250)
    assert [e.rule for e in given_up] == ["PRE-4", "REL-1"]  # the latter: not_selected
    assert [(m.dst, m.reason) for m in sent(given_up, "Cancel")] == [(TARGET, "timeout")]
    assert [(i.name, i.reason) for i in told(given_up)] == [("fallback", "timeout")]
    assert s.at == ("none", "STANDALONE")


def test_l_4_a_cancel_outlives_its_session_and_is_given_up() -> None:
    s = Stage().walk("receiver", "WAITING")
    effects = s.do(1000, "abort", THEIRS)
    assert s.at == ("none", "STANDALONE")
    effects += s.run(10_000)
    assert times(effects, "Cancel") == [1000 + t for t in EVERY_100_MS]
    assert s.state.outbox == ()


def test_neg_9_a_commitment_outlives_its_acceptance() -> None:
    s = Stage(t_cam_loss=10_000).walk("receiver", "ACTUATING")
    effects = s.run(5000)
    assert times(effects, "Acceptance") == [30 + t for t in EVERY_100_MS[1:]]
    assert s.state.outbox == ()
    assert s.at == ("receiver", "ACTUATING")


def test_a_copy_sent_as_an_answer_touches_no_timer() -> None:
    s = Stage().walk("prescriber", "CHOOSING")
    s.do(2200, "proceed", OWN)
    before = dict(s.station.timers)
    (copy,) = sent(s.hear(2250, intention()))
    assert (copy.type, copy.reason) == ("Cancel", "not_needed")
    assert s.station.timers == before


# -- the other timers


@pytest.mark.parametrize(
    ("role", "phase", "deadline"),
    [
        ("prescriber", "CHOOSING", 2100 + 500),
        ("receiver", "NEGOTIATING", 20 + 500),
    ],
)
def test_decide_timer(role: str, phase: str, deadline: int) -> None:
    assert Stage().walk(role, phase).deadline("decide") == deadline


def test_pre_5_no_choice_is_an_abort() -> None:
    s = Stage().walk("prescriber", "CHOOSING")
    effects = s.run(2600)
    assert effects[-1].rule == "PRE-5"
    assert [(m.dst, m.reason) for m in sent(effects)] == [(TARGET, "abort"), (OTHER, "abort")]


def test_neg_3_no_verdict_is_undecided() -> None:
    s = Stage().walk("receiver", "NEGOTIATING")
    effects = s.run(520)
    (refusal,) = sent(effects)
    assert (effects[-1].rule, refusal.reason, refusal.proposal) == ("NEG-3", "undecided", 1)
    assert s.at == ("receiver", "WAITING")
    assert s.deadline("hold") == 520 + 6800


def test_neg_8_answer_timer() -> None:
    s = Stage().walk("prescriber", "NEGOTIATING")
    assert s.deadline("answer") == 2200 + 500 + 2100
    effects = s.run(4800)
    assert effects[-1].rule == "NEG-8"
    assert [m.reason for m in sent(effects, "Cancel") if m.dst == TARGET] == ["timeout"]


def test_neg_7_a_refusal_stops_answer_and_lease_and_starts_decide() -> None:
    s = Stage().walk("prescriber", "NEGOTIATING")
    s.run(2300)
    (only,) = s.hear(2300, no())
    assert sorted(names(only.stopped)) == ["answer", "lease"]
    assert only.armed == ((Timer("decide"), 2800),)


@pytest.mark.parametrize("role", ["prescriber", "receiver"])
def test_act_2_cam_timer_fires_at_equality(role: str) -> None:
    s = Stage().walk(role, "ACTUATING")
    started = s.now
    peer, session = (TARGET, OWN) if role == "prescriber" else (PRESCRIBER, THEIRS)
    assert s.deadline("cam") == started + 1500
    s.run(started + 1000)
    s.hear(started + 1000, cam(peer, 700, session))
    assert s.deadline("cam") == started + 2500
    s.run(started + 2499)
    assert s.at == (role, "ACTUATING")
    effects = s.hear(started + 2500, cam(peer, 800, session))
    assert (effects[-2].rule, effects[-1].rule) == ("ACT-2", "ACT-5")
    assert [m.reason for m in sent(effects, "Cancel") if m.dst == peer] == ["cam_loss"]
    assert s.at == ("none", "STANDALONE")


@pytest.mark.parametrize(
    "heard",
    [
        cam(PRESCRIBER, 701),
        cam(PRESCRIBER, 701, (PRESCRIBER, 2)),
        cam(OTHER, 701, THEIRS),
        cam(PRESCRIBER, 700, THEIRS),
        cam(PRESCRIBER, 699, THEIRS),
    ],
    ids=["plain", "another session", "another station", "the same", "older"],
)
def test_act_5_any_other_cam_does_not_count(heard: Any) -> None:
    s = Stage().walk("receiver", "ACTUATING")
    s.hear(100, cam(PRESCRIBER, 700, THEIRS))
    state, deadline = s.state, s.deadline("cam")
    s.hear(110, heard)
    assert (s.state, s.deadline("cam")) == (state, deadline)


# -- order


def test_due_timers_fire_before_a_message_at_the_same_instant() -> None:
    s = Stage()
    (mine,) = sent(s.hear(0, advertisement()))
    s.run(2099)
    given_up, late = s.hear(2100, ack(mine))
    assert (given_up.rule, late.rule) == ("ADV-6", "END-6")


def test_due_timers_fire_before_a_command_at_the_same_instant() -> None:
    s = Stage().walk("receiver", "NEGOTIATING")
    undecided, late = s.do(520, "accept", THEIRS)
    assert (undecided.rule, late.rule) == ("NEG-3", "CMD-1")
    assert [i.name for i in told([late])] == ["refused"]


def test_order_advertise_before_resend() -> None:
    s = Stage()
    s.do(0, "request")
    s.run(2099)
    assert names(s.station.timers) == ["advertise", "resend"]
    assert set(s.station.timers.values()) == {2100}
    assert [e.rule for e in s.run(2100)] == ["PRE-1"]


def test_order_lease_before_giveup_before_resend() -> None:
    s = Stage().walk("prescriber", "CHOOSING")
    s.do(2150, "prescribe", OWN, lease_ms=2123)  # 2100 for the prescriber (ACT-4)
    (_, other) = s.state.outbox
    s.run(4249)
    due = [t.name for t, d in s.station.timers.items() if d == 4250]
    assert sorted(due) == ["giveup", "giveup", "lease", "resend", "resend"]
    effects = s.run(4250)
    assert [e.rule for e in effects] == ["ACT-4", "REL-1"]
    assert names([effects[1].input.timer]) == ["giveup"]  # type: ignore[union-attr]
    assert effects[1].input.timer.entry.to == other.dst  # type: ignore[union-attr]


def test_order_older_entries_before_younger_ones() -> None:
    s = Stage().walk("prescriber", "CHOOSING")
    s.do(2200, "proceed", OWN)
    assert [m.dst for m in sent(s.run(2300))] == [TARGET, OTHER]
    s.run(4299)
    given_up = [e.input.timer for e in s.run(4300)]  # type: ignore[union-attr]
    assert [(t.name, t.entry.to) for t in given_up] == [("giveup", TARGET), ("giveup", OTHER)]


def test_order_of_the_timers_that_outlive_a_session() -> None:
    s = Stage()
    entry = Cancel(src=ME, dst=7, session=(7, 1), seq=2, reason="abort")
    rest = State(quarantine=True, backoff=True, joined={7: 1, 8: 1}, outbox=(entry,))
    s.station.state = rest
    s.station.timers = dict.fromkeys(reversed(armed(ME, rest)), 100)
    effects = s.run(100)
    fired = [e.input.timer.name for e in effects]  # type: ignore[union-attr]
    assert fired == ["giveup", "quarantine", "forget", "forget", "backoff"]
    assert [e.rule for e in effects] == ["REL-1", "END-8", "ADV-8", "ADV-8", "END-7"]


def test_an_earlier_deadline_goes_first_whatever_the_order_says() -> None:
    s = Stage()
    s.hear(0, advertisement())
    first, second = s.run(150) + s.station.advance(5000)[:1]
    assert (first.now_ms, second.now_ms) == (100, 5000)
    assert names([second.input.timer]) == ["resend"]  # type: ignore[union-attr]
    assert s.at == ("receiver", "WAITING")


# -- lease

OWN_LEASE = 20_000 - 200 - 1
"""The prescriber's: shorter by 1 percent and 1 ms (ACT-4)."""


def test_t_4_the_prescribers_lease_ends_before_the_receivers() -> None:
    """The prescriber counts from its first sending, the receiver from its acceptance."""
    p, r = Stage().walk("prescriber", "CHOOSING"), Stage(station_id=TARGET)
    (offer,) = sent(r.hear(0, advertisement(OWN)))
    assert offer == intention()
    (proposal,) = sent(p.do(2150, "prescribe", OWN), "Prescription")
    assert p.deadline("lease") == 2150 + OWN_LEASE
    p.run(2350)
    r.run(2310)
    r.hear(2310, proposal)
    assert r.deadline("lease") is None
    (answer,) = sent(r.do(2400, "accept", OWN))
    assert r.deadline("lease") == 2400 + 20_000
    p.hear(2420, answer)
    assert p.deadline("lease") == 2150 + OWN_LEASE
    assert p.deadline("lease") < r.deadline("lease")  # type: ignore[operator]


def test_neg_6_accepted_tells_the_lease_left() -> None:
    s = Stage().walk("prescriber", "NEGOTIATING")
    (accepted,) = told(s.hear(2420, yes()))
    assert accepted.lease_left_ms == 2150 + OWN_LEASE - 2420
    assert accepted.as_dict()["lease_left_ms"] == 19_529


def test_act_4_a_new_proposal_arms_the_lease_anew() -> None:
    s = Stage().walk("prescriber", "NEGOTIATING")
    s.hear(2300, no())
    assert s.deadline("lease") is None
    s.do(2400, "prescribe", OWN, proposal=2, lease_ms=5000)
    assert s.deadline("lease") == 7349
    (accepted,) = told(s.hear(2500, yes(2)))
    assert (s.deadline("lease"), accepted.lease_left_ms) == (7349, 4849)


def test_act_4_with_clocks_that_run_alike_the_leases_last_as_long() -> None:
    s = Stage(clock_drift=0).walk("prescriber", "NEGOTIATING")
    assert s.deadline("lease") == 2150 + 20_000


@pytest.mark.parametrize(("role", "end"), [("prescriber", 2150 + OWN_LEASE), ("receiver", 20_030)])
def test_act_4_lease_ends_whatever_cams_are_heard(role: str, end: int) -> None:
    s = Stage().walk(role, "ACTUATING")
    peer, session = (TARGET, OWN) if role == "prescriber" else (PRESCRIBER, THEIRS)
    for t in range(s.now + 1000, end, 1000):
        s.hear(t, cam(peer, t, session))
    s.run(end - 1)
    assert s.at == (role, "ACTUATING")
    effects = s.run(end)
    assert [e.rule for e in effects] == ["ACT-4"]
    assert [(m.dst, m.reason) for m in sent(effects)] == [(peer, "lease_expired")]
    assert [(i.name, i.reason) for i in told(effects)] == [("fallback", "lease_expired")]


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


def test_end_7_no_request_during_the_backoff() -> None:
    s = Stage(backoff_min=700, backoff_max=700)
    s.do(0, "request")
    s.run(2100)
    (early,) = s.do(2799, "request")
    assert [(i.name, early.rule) for i in early.indications] == [("refused", "END-7")]
    assert s.at == ("none", "STANDALONE")
    *_, again = s.do(2800, "request")
    assert again.rule == "ADV-1"
    assert s.state.session == (ME, 2)


def test_end_7_no_backoff_after_a_session_with_participants() -> None:
    s = Stage().walk("prescriber", "CHOOSING")
    s.do(2200, "proceed", OWN)
    assert s.deadline("backoff") is None
    s.do(2300, "request")
    assert s.state.session == (ME, 2)


@pytest.mark.parametrize(("role", "phase"), Stage.PHASES)
def test_end_8_restart_forgets_all_but_the_number(role: str, phase: str) -> None:
    s = Stage(number=4).walk(role, phase)
    now, number = s.now + 50, s.state.number
    (only,) = s.station.restart(now)
    assert (only.rule, only.messages, only.indications) == ("END-8", (), ())
    assert s.station.timers == {Timer("quarantine"): now + 2100 + 4200}
    assert s.state == State(number=number, quarantine=True)
    assert s.state.marks == ()


def test_end_8_numbers_grow_and_nothing_is_joined_for_a_while() -> None:
    s = Stage(number=4).walk("prescriber", "ADVERTISING")
    assert s.state.session == (ME, 5)
    s.station.restart(1000)
    s.hear(7299, advertisement())
    assert s.at == ("none", "STANDALONE")
    s.hear(7300, advertisement())
    assert s.at == ("receiver", "INTENDING")
    s.hear(7400, cancel())
    s.do(7500, "request")
    assert s.state.session == (ME, 6)


def test_end_8_quarantine_starts_again_with_another_restart() -> None:
    s = Stage()
    s.station.restart(1000)
    s.station.restart(5000)
    assert s.station.timers == {Timer("quarantine"): 5000 + 6300}


# -- the clock


def test_time_does_not_go_back() -> None:
    s = Stage().walk("receiver", "WAITING")
    before, timers = s.state, dict(s.station.timers)
    for late in (
        lambda: s.station.advance(9),
        lambda: s.hear(9, prescription()),
        lambda: s.hear(9, b"rubbish"),
        lambda: s.do(9, "abort", THEIRS),
    ):
        with pytest.raises(ValueError, match="time goes back"):
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
