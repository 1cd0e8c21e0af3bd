"""Any input in any phase: the station acts as specified (``Stage``)."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from itertools import product
from typing import Any

import pytest
from automcm_stage import (
    ME,
    OTHER,
    PRESCRIBER,
    TARGET,
    Stage,
    ack,
    advertisement,
    cam,
    cancel,
    fin,
    intention,
    no,
    prescription,
    sent,
    told,
    yes,
)

from automcm.core.outcome import Received
from automcm.core.rules import decide
from automcm_spec.vocabulary.messages import MessageId, Session

OWN = (ME, 6)
"""The stage's own session: five went before it."""
THEIRS = (PRESCRIBER, 1)
SESSIONS = (OWN, (ME, 2), THEIRS, (PRESCRIBER, 2), (8, 1), (5, 1))
SENDERS = (TARGET, OTHER, PRESCRIBER, 8, ME)
RECEIVERS = (ME, 5, 0)
"""The station, another one, and everybody."""
SMALL = {"max_participants": 2, "max_rounds": 2, "outbox_limit": 4, "memory_limit": 1}
"""Limits that bind (MEM-1)."""
COMMANDS = {
    **{name: () for name in ("request", "close", "proceed", "complete", "abort")},
    **{"prescribe": ("proposal", "target"), "accept": ("proposal",), "refuse": ("proposal",)},
}


def at(role: str, phase: str, leaves: str = "") -> Stage:
    """In this phase; or after a command, two restarts, or because nobody joins."""
    s = Stage(number=5, **SMALL).walk(role, phase)
    if leaves == "restart":
        s.restart(s.now)
        s.restart(s.now + 700)
    elif leaves == "no participants":
        s.run(2100)
    elif leaves:
        s.do(s.now, leaves, s.state.session or OWN)
    return s


STATES = [(*place, leaves) for place in Stage.PHASES for leaves in ("", "abort", "restart")] + [
    ("prescriber", "ADVERTISING", "no participants"),
    ("prescriber", "CHOOSING", "proceed"),
    ("prescriber", "ACTUATING", "complete"),
    ("receiver", "NEGOTIATING", "refuse"),
]
EVERYWHERE = pytest.mark.parametrize("state", STATES, ids=" ".join)
State = tuple[str, str, str]


def each(state: State, inputs: Iterable[Any]) -> Iterator[tuple[Stage, Any]]:
    """A stage in this state for each of the inputs."""
    s = at(*state)
    before = s.state
    for i in inputs:
        yield s, i
        if s.state is not before:
            s = at(*state)
            before = s.state


def messages(session: Session, src: int) -> Iterator[Any]:
    """From this station to station 1, with the right content."""
    yield advertisement(session, src=src)
    yield intention(src, session)
    yield fin(session, src=src)
    yield from (cancel(reason, src, session) for reason in ("abort", "cam_loss", "closed"))
    for proposal in (1, 2):
        yield prescription(proposal, session, src=src)
        yield yes(proposal, src, session)
        yield from (
            no(proposal, reason, src, session) for reason in ("unsafe", "busy", "unknown_session")
        )
    for type_, seq in product(("Intention", "Prescription", "Fin"), (0, 1, 2)):
        acked = ack(fin(session, src=ME, dst=src))
        yield acked.model_copy(update={"of": MessageId(type=type_, seq=seq)})


MESSAGES = [
    message.model_copy(update={"dst": dst})
    for session, src, dst in product(SESSIONS, SENDERS, RECEIVERS)
    for message in messages(session, src)
    if dst != 5 or session in (OWN, THEIRS)
]


@pytest.mark.sweep(17)
@EVERYWHERE
def test_end_4_end_5_msg_1_mem_1_every_message_in_every_phase(state: State) -> None:
    for s, message in each(state, MESSAGES):
        (only,) = s.hear(s.now, message)
        discarded = [i.detail for i in only.indications if i.name == "discarded"]
        assert discarded == [message.type] * len(discarded)


@EVERYWHERE
def test_cmd_1_pre_5_every_command_in_every_phase(state: State) -> None:
    values = product(COMMANDS, SESSIONS, (1, 2, 3), (TARGET, OTHER, 7, ME))
    for s, (name, session, proposal, target) in each(state, values):
        fields = {f: {"proposal": proposal, "target": target}[f] for f in COMMANDS[name]}
        (only,) = s.do(s.now, name, None if name == "request" else session, **fields)
        assert [(i.name, i.detail) for i in only.indications] in ([], [("refused", name)])


@EVERYWHERE
def test_act_5_every_cam_in_every_phase(state: State) -> None:
    s, marks = at(*state), [(), *((session,) for session in SESSIONS), SESSIONS]
    for at_ms, src, named in product((700, 701, 701, 699), SENDERS, marks):
        s.hear(s.now, cam(src, at_ms, *named))


@EVERYWHERE
@pytest.mark.parametrize("cams", [False, True])
def test_l_1_every_timer_of_every_phase(state: State, cams: bool) -> None:
    """Left alone, or with the CAMs of its peer, a station ends all that it has begun: ADV-2,
    ADV-6, ADV-7, ADV-8, PRE-1, PRE-4, PRE-5, NEG-3, NEG-8, NEG-9, ACT-2, ACT-4, END-7, END-8."""
    s = at(*state)
    for now in range(s.now + 1000, 40_000, 1000):
        s.run(now)
        if cams:
            for src, session in ((TARGET, OWN), (PRESCRIBER, THEIRS)):
                s.hear(now, cam(src, now, session))
    assert s.at == ("none", "STANDALONE") and not s.station.timers


# -- states that the way into a phase does not meet


def test_end_3_a_second_cancel_while_advertising_is_only_acked() -> None:
    s = at("prescriber", "ADVERTISING")
    s.hear(10, cancel(src=TARGET, session=OWN))
    assert s.hear(20, cancel(src=TARGET, session=OWN))[0].rule == "END-3"
    s.hear(30, intention(session=OWN))
    assert s.state.withdrawn == {TARGET}


def test_adv_5_after_the_window_an_intention_is_closed_although_there_is_no_room() -> None:
    s = at("prescriber", "CHOOSING")
    me = s.station.me._replace(max_participants=len(s.state.recorded))
    rule, outcome = decide(me, s.state, Received(intention(7, OWN)))
    assert (rule, [m.type for m in outcome.messages]) == ("ADV-5", ["Cancel"])


def test_pre_1_the_last_one_withdraws_while_choosing() -> None:
    s = at("prescriber", "CHOOSING")
    s.hear(2200, cancel(src=TARGET, session=OWN))
    s.do(2205, "prescribe", OWN)
    effects = s.hear(2210, cancel(src=OTHER, session=OWN))
    assert [i.name for i in told(effects)] == ["no_participants"]
    assert s.state.backoff


def test_adv_5_a_copy_is_answered_with_the_fin_in_the_outbox() -> None:
    s = at("prescriber", "ACTUATING")
    (last,) = sent(s.do(2250, "complete", OWN), "Fin")
    assert sent(s.hear(2260, yes(session=OWN)) + s.hear(2260, intention(session=OWN))) == [last] * 2


def test_neg_7_the_target_never_changes_and_the_proposal_grows_by_one() -> None:
    s = at("prescriber", "NEGOTIATING")
    s.hear(2250, no(session=OWN))
    for proposal, target in ((2, OTHER), (1, TARGET), (3, TARGET)):
        s.do(2250, "prescribe", OWN, proposal=proposal, target=target)
    s.do(2250, "proceed", OWN)
    s.do(2260, "prescribe", OWN, proposal=2)
    assert (s.at, s.state.proposal) == (("prescriber", "PRESCRIBING"), 2)
    # NEG-6: a late copy of a refusal does not refuse the next proposal
    assert {s.hear(2270, late(session=OWN))[0].rule for late in (no, yes)} == {"NEG-6"}


def test_adv_9_closing_the_window_is_its_end_and_stops_its_timers() -> None:
    closed, expired = (at("prescriber", "ADVERTISING") for _ in range(2))
    assert told(closed.do(10, "close", OWN))[0].name == "refused"  # nobody has answered
    for s in (closed, expired):
        s.hear(20, intention(session=OWN))
    (effects,) = closed.do(30, "close", OWN)
    last = expired.run(expired.station.next_deadline() or 0)
    while expired.at[1] == "ADVERTISING":
        last = expired.run(expired.station.next_deadline() or 0)
    assert effects.state == expired.state and effects.indications == last[-1].indications
    assert {timer.name for timer in effects.stopped} == {"advertise", "resend"}
    assert [timer.name for timer in closed.station.timers] == ["decide"]
    assert told(closed.do(40, "close", OWN))[0].name == "refused"
    assert sent(closed.hear(50, intention(OTHER, OWN)), "Cancel")[0].reason == "closed"


def test_end_5_a_proposal_above_max_rounds_is_discarded_in_every_phase() -> None:
    for role, phase in Stage.PHASES:
        s = at(role, phase)
        before = s.state
        (effects,) = s.hear(s.now, prescription(SMALL["max_rounds"] + 1, THEIRS))
        assert (effects.rule, sent([effects]), s.state) == ("END-5", [], before)
        assert told([effects])[0].name == "discarded"
    last = prescription(SMALL["max_rounds"], THEIRS)
    s = at("receiver", "INTENDING")
    assert s.hear(s.now, last)[-1].rule == "NEG-1"


def test_neg_7_no_agreement_after_max_rounds() -> None:
    s = Stage(max_rounds=2).walk("prescriber", "NEGOTIATING")
    s.hear(2250, no())
    s.do(2260, "prescribe", s.own, proposal=2)
    effects = s.hear(2270, no(2))
    assert [(i.name, i.reason) for i in told(effects)] == [("fallback", "no_agreement")]
