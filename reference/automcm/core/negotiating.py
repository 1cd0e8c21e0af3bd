"""Negotiating: NEG-1 … NEG-9."""

from __future__ import annotations

from automcm.core.advertising import answer_closed
from automcm.core.outcome import (
    Me,
    Outcome,
    Received,
    Row,
    ack,
    acked,
    acks,
    always,
    cancel_peer,
    discard,
    foreign,
    moved,
    own,
    post,
    refusal,
    refuse,
    stale,
    without,
)
from automcm.core.state import State
from automcm_spec.vocabulary.application import Accept, Accepted, Propose, Refuse, Undecided, Verify
from automcm_spec.vocabulary.messages import (
    ANSWER_REASONS,
    Acceptance,
    Prescription,
    RefusalReason,
    Trajectory,
)


def instructed(me: Me, st: State, i: Received[Prescription]) -> Outcome:
    """NEG-1: ack, and ask the application to verify the proposal."""
    m = i.message
    verifying = moved(st, "verify")._replace(
        proposal=m.proposal, lease_ms=m.lease_ms, outbox=without(st, "Intention")
    )
    indication = Verify(session=own(st), proposal=m.proposal, prescription=m)
    return Outcome(verifying, (ack(me, m),), indication)


PRESCRIPTION: tuple[Row[Received[Prescription]], ...] = (
    Row(
        "NEG-4",
        lambda me, st, i: foreign(me, st, i) and st.bound,
        lambda me, st, i: Outcome(st, (refusal(me, i.message, "busy"),)),
    ),
    Row(
        "NEG-5",
        foreign,
        lambda me, st, i: Outcome(st, (refusal(me, i.message, "unknown_session"),)),
    ),
    Row("NEG-1", lambda me, st, i: i.message.proposal <= st.proposal, acked),
    Row("NEG-1", lambda me, st, i: st.phase in ("INTENDING", "WAITING"), instructed),
    Row("END-5", always, discard),
)


def not_verifying(me: Me, st: State, i: object) -> bool:
    """CMD-1: is no proposal waiting for an answer?"""
    return not (st.phase == "NEGOTIATING" and st.role == "receiver")


def answer(
    me: Me,
    st: State,
    accepted: bool,
    *,
    reason: RefusalReason | None = None,
    selected: Trajectory | None = None,
) -> Acceptance:
    """The Acceptance of the current proposal, or its refusal."""
    return Acceptance(
        src=me.station_id,
        dst=st.peer,
        session=own(st),
        seq=st.seq + 1,
        proposal=st.proposal,
        accepted=accepted,
        reason=reason,
        selected=selected,
    )


def accept(me: Me, st: State, i: Accept) -> Outcome:
    """NEG-2: commit, and send the Acceptance until it is acked."""
    acceptance = answer(me, st, True, selected=i.selected)
    return Outcome(post(moved(st, "accept"), acceptance), (acceptance,))


def refuse_proposal(
    me: Me, st: State, reason: RefusalReason, indication: Undecided | None = None
) -> Outcome:
    """NEG-3: refuse with this reason, and wait for another proposal."""
    acceptance = answer(me, st, False, reason=reason)
    return Outcome(post(moved(st, "refuse"), acceptance), (acceptance,), indication)


ACCEPT: tuple[Row[Accept], ...] = (
    Row("CMD-1", not_verifying, refuse),
    Row("PRE-5", stale, refuse),
    Row("NEG-2", always, accept),
)
REFUSE: tuple[Row[Refuse], ...] = (
    Row("CMD-1", not_verifying, refuse),
    Row("PRE-5", stale, refuse),
    Row("NEG-3", always, lambda me, st, i: refuse_proposal(me, st, "unsafe")),
)


def untaken(me: Me, st: State, i: Received[Acceptance]) -> bool:
    """NEG-6: does it answer another proposal, or is no answer awaited?"""
    m = i.message
    return not (st.awaits_answer and m.proposal == st.proposal)


def not_yet_sent(me: Me, st: State, i: Received[Acceptance]) -> bool:
    """END-5: does it answer a proposal that was never sent to its sender?"""
    m = i.message
    return m.src != st.target or m.proposal > st.proposal


def agreed(me: Me, st: State, i: Received[Acceptance]) -> Outcome:
    """NEG-6: ack, and begin to act."""
    m = i.message
    acting = moved(st, "accepted")._replace(outbox=without(st, "Prescription"))
    indication = Accepted(session=own(st), proposal=m.proposal, acceptance=m)
    return Outcome(acting, (ack(me, m),), indication)


def may_propose_again(me: Me, st: State, i: Received[Acceptance]) -> bool:
    """NEG-7: is a round left, and does the reason allow another proposal?"""
    m = i.message
    return m.reason not in ANSWER_REASONS and st.proposal < me.max_rounds


def refused(me: Me, st: State, i: Received[Acceptance]) -> Outcome:
    """NEG-7: ack, and ask the application for another proposal."""
    m = i.message
    deciding = moved(st, "refused")._replace(deciding=True, outbox=without(st, "Prescription"))
    assert m.reason is not None
    indication = Propose(session=own(st), proposal=st.proposal + 1, reason=m.reason)
    return Outcome(deciding, (ack(me, m),), indication)


def no_agreement(me: Me, st: State, i: Received[Acceptance]) -> Outcome:
    """NEG-7: ack, and send the target a Cancel."""
    outcome = cancel_peer("no_agreement")(me, st, i)
    return outcome._replace(messages=acks(me, i.message) + outcome.messages)


ACCEPTANCE: tuple[Row[Received[Acceptance]], ...] = (
    Row("NEG-6", lambda me, st, i: foreign(me, st, i) and i.message.accepted, answer_closed),
    Row("NEG-6", foreign, acked),
    Row("END-5", not_yet_sent, discard),
    Row("NEG-6", untaken, acked),
    Row("NEG-6", lambda me, st, i: i.message.accepted, agreed),
    Row("NEG-7", may_propose_again, refused),
    Row("NEG-7", always, no_agreement),
)
