"""Prescribing: ADV-9, PRE-1 … PRE-5, and the next proposal of NEG-7."""

from __future__ import annotations

from automcm.core.outcome import (
    Expiry,
    Me,
    Outcome,
    Row,
    always,
    cancels,
    leave,
    leave_with,
    moved,
    own,
    post,
    refuse,
    stale,
)
from automcm.core.state import NO_INTENTIONS, State
from automcm_spec.vocabulary.application import Choose, Close, NoParticipants, Prescribe, Proceed
from automcm_spec.vocabulary.messages import Prescription, Reliable


def no_participants(me: Me, st: State, i: object) -> Outcome:
    """PRE-1, END-7: leave, and begin the back-off before the next session."""
    return Outcome(leave(st)._replace(backoff=True), indication=NoParticipants(session=own(st)))


def window_closes(me: Me, st: State, i: Expiry | Close) -> Outcome:
    """PRE-1, ADV-9: ask the application to choose from the Intentions."""
    intentions = tuple(st.recorded[p] for p in sorted(st.recorded))
    chosen = moved(st, "choose")._replace(withdrawn=frozenset(), advertisement=None)
    return Outcome(chosen, indication=Choose(session=own(st), intentions=intentions))


WINDOW_ENDS: tuple[Row[Expiry], ...] = (
    Row("PRE-1", lambda me, st, i: not st.recorded, no_participants),
    Row("PRE-1", always, window_closes),
)

CLOSE: tuple[Row[Close], ...] = (
    Row("CMD-1", lambda me, st, i: st.phase != "ADVERTISING", refuse),
    Row("PRE-5", stale, refuse),
    Row("ADV-9", lambda me, st, i: not st.recorded, refuse),
    Row("ADV-9", always, window_closes),
)


def prescribe(me: Me, st: State, i: Prescribe) -> Outcome:
    """Send the proposal to the target, and release every other recorded station."""
    prescription = Prescription(
        src=me.station_id,
        dst=i.target,
        session=own(st),
        seq=st.seq + 1,
        proposal=i.proposal,
        prescribed=i.prescribed,
        hold_ms=i.hold_ms,
        lease_ms=i.lease_ms,
    )
    released = [p for p in sorted(st.recorded) if p != i.target]
    sent: tuple[Reliable, ...] = (prescription, *cancels(me, st, released, "not_selected", first=2))
    chosen = moved(st, "prescribe")._replace(
        target=i.target,
        proposal=i.proposal,
        deciding=False,
        lease_ms=i.lease_ms,
        recorded=NO_INTENTIONS,
    )
    return Outcome(post(chosen, *sent), sent)


def stale_choice(me: Me, st: State, i: Prescribe) -> bool:
    """PRE-5: does it name another session, or not the next proposal?"""
    return i.session != st.session or i.proposal != st.proposal + 1


PRESCRIBE: tuple[Row[Prescribe], ...] = (
    Row("CMD-1", lambda me, st, i: not (st.phase == "CHOOSING" or st.deciding), refuse),
    Row("PRE-5", stale_choice, refuse),
    Row("PRE-2", lambda me, st, i: not st.deciding and i.target in st.recorded, prescribe),
    Row("PRE-2", lambda me, st, i: not st.deciding, refuse),
    Row("NEG-7", lambda me, st, i: i.target == st.target, prescribe),
    Row("NEG-7", always, refuse),
)


def proceed(me: Me, st: State, i: Proceed) -> Outcome:
    """PRE-3: leave, with a Cancel to each recorded station."""
    return leave_with(st, cancels(me, st, sorted(st.recorded), "not_needed"))


PROCEED: tuple[Row[Proceed], ...] = (
    Row("CMD-1", lambda me, st, i: st.phase != "CHOOSING", refuse),
    Row("PRE-5", stale, refuse),
    Row("PRE-3", always, proceed),
)
