"""Ending and robustness: END-1 … END-8."""

from __future__ import annotations

from collections.abc import Callable
from types import MappingProxyType

from automcm.core.outcome import (
    Me,
    Outcome,
    Received,
    Restart,
    Row,
    acked,
    acks,
    always,
    cancels,
    discard,
    foreign,
    full,
    ignore,
    leave,
    leave_with,
    others,
    own,
    refuse,
    stale,
)
from automcm.core.phases import after
from automcm.core.prescribing import no_participants
from automcm.core.state import QUARANTINE, State
from automcm_spec.vocabulary.application import Abort, Fallback
from automcm_spec.vocabulary.messages import BROADCAST, Ack, Cancel, Message, Reliable


def abort(me: Me, st: State, i: Abort) -> Outcome:
    """END-1: leave, with a Cancel to each station of the session."""
    return leave_with(st, cancels(me, st, others(st), "abort"))


ABORT: tuple[Row[Abort], ...] = (
    Row("CMD-1", lambda me, st, i: not st.bound, refuse),
    Row("PRE-5", stale, refuse),
    Row("END-1", always, abort),
)


def withdrawn_or_full(me: Me, st: State, i: Received[Cancel]) -> bool:
    """END-3: in ADVERTISING, has the sender withdrawn before, or is there no room (MEM-1)?"""
    p = i.message.src
    if st.phase != "ADVERTISING":
        return False
    return p in st.withdrawn or (p not in st.recorded and full(me, st))


def last_withdraws(me: Me, st: State, i: Received[Cancel]) -> bool:
    """PRE-1: does the last recorded station withdraw?"""
    return len(st.recorded) == 1 and i.message.src in st.recorded


def withdraw(me: Me, st: State, i: Received[Cancel]) -> Outcome:
    """END-2: remove the station from the recorded ones, so that it cannot be chosen."""
    p = i.message.src
    recorded = MappingProxyType({q: m for q, m in st.recorded.items() if q != p})
    withdrawn = st.withdrawn | {p} if st.phase == "ADVERTISING" else st.withdrawn
    left = st._replace(recorded=recorded, withdrawn=withdrawn)
    return Outcome(left, acks(me, i.message))


def last_withdrawn(me: Me, st: State, i: Received[Cancel]) -> Outcome:
    """PRE-1: ack, and end the session as without participants."""
    return no_participants(me, st, i)._replace(messages=acks(me, i.message))


def cancelled(me: Me, st: State, i: Received[Cancel]) -> Outcome:
    """END-2: ack and leave; indicate the reason."""
    indication = Fallback(session=own(st), reason=i.message.reason)
    return Outcome(leave(st), acks(me, i.message), indication)


CANCEL: tuple[Row[Received[Cancel]], ...] = (
    Row("END-3", foreign, acked),
    Row("END-3", withdrawn_or_full, acked),
    Row("END-2", lambda me, st, i: st.phase == "ADVERTISING", withdraw),
    Row("PRE-1", last_withdraws, last_withdrawn),
    Row("END-2", lambda me, st, i: i.message.src in st.recorded, withdraw),
    Row("END-2", lambda me, st, i: i.message.src == st.peer, cancelled),
    Row("END-3", always, acked),
)


def acked_entry(st: State, m: Ack) -> Reliable | None:
    """END-6: the outbox entry that this Ack names and that went to its sender, or None."""
    named = (m.of.type, m.src, m.session, m.of.seq)
    for entry in st.outbox:
        if (entry.type, entry.dst, entry.session, entry.seq) == named:
            return entry
    return None


def acks_nothing(me: Me, st: State, i: Received[Ack]) -> bool:
    """END-6: does the Ack name no entry of the outbox?"""
    return acked_entry(st, i.message) is None


def entry_is(*types: str) -> Callable[[Me, State, Received[Ack]], bool]:
    """END-6: has the entry one of these types?  (It exists: the first row checks that.)"""
    return lambda me, st, i: i.message.of.type in types


def drop(st: State, gone: Reliable | None, event: str | None) -> Outcome:
    """Remove an entry from the outbox; ``event`` changes the phase."""
    kept = tuple([entry for entry in st.outbox if entry is not gone])
    phase = after(st.role, st.phase, event) if event else st.phase
    return Outcome(st._replace(phase=phase, outbox=kept))


def ack_ends(event: str | None) -> Callable[[Me, State, Received[Ack]], Outcome]:
    """Remove the acked entry from the outbox; ``event`` changes the phase."""
    return lambda me, st, i: drop(st, acked_entry(st, i.message), event)


ACK: tuple[Row[Received[Ack]], ...] = (
    Row("END-6", acks_nothing, ignore),
    Row("ADV-6", entry_is("Intention"), ack_ends("wait")),
    Row("PRE-4", entry_is("Prescription"), ack_ends("acknowledged")),
    Row("NEG-9", entry_is("Acceptance"), ack_ends(None)),
    Row("END-6", entry_is("Fin", "Cancel"), ack_ends(None)),
)


def restart(me: Me, st: State, i: Restart) -> Outcome:
    """END-8: keep only the session number, and begin the quarantine."""
    return Outcome(State(number=st.number, quarantine=True), again=(QUARANTINE,))


def not_for_me(me: Me, st: State, i: Received[Message]) -> bool:
    """MSG-1: is the message addressed to another station?"""
    return i.message.dst not in (me.station_id, BROADCAST)


def breaks_protocol(me: Me, st: State, i: Received[Message]) -> bool:
    """END-5: does the message contain anything that no station may send?"""
    m = i.message
    if m.src == me.station_id or (m.dst == BROADCAST) != (m.type == "Advertisement"):
        return True
    if m.type == "Cancel":
        return m.reason == "closed" and m.src != m.session[0]
    if m.type in ("Intention", "Acceptance"):
        return m.session[0] != me.station_id
    if m.type == "Prescription" and m.proposal > me.max_rounds:
        return True
    return m.type in ("Advertisement", "Prescription") and m.src != m.session[0]


FIRST: tuple[Row[Received[Message]], ...] = (
    Row("MSG-1", not_for_me, ignore),
    Row("END-5", breaks_protocol, discard),
)
