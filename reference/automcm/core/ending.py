"""Ending and robustness: END-1 … END-8."""

from __future__ import annotations

from collections.abc import Callable
from types import MappingProxyType

from automcm.core.outcome import (
    Heard,
    Me,
    Outcome,
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
    """END-1: leave, with a Cancel to everybody concerned."""
    return leave_with(st, cancels(me, st, others(st), "abort"))


ABORT: tuple[Row[Abort], ...] = (
    Row("CMD-1", lambda me, st, i: not st.bound, refuse),
    Row("PRE-5", stale, refuse),
    Row("END-1", always, abort),
)


def withdrawn_or_full(me: Me, st: State, i: Heard[Cancel]) -> bool:
    """END-3: in ADVERTISING, has it withdrawn before, or is there no room to note it (MEM-1)?"""
    p = i.message.src
    if st.phase != "ADVERTISING":
        return False
    return p in st.withdrawn or (p not in st.recorded and full(me, st))


def last_withdraws(me: Me, st: State, i: Heard[Cancel]) -> bool:
    """PRE-1: does the only station left to choose from withdraw?"""
    return len(st.recorded) == 1 and i.message.src in st.recorded


def withdraw(me: Me, st: State, i: Heard[Cancel]) -> Outcome:
    """END-2: the station is not there to be chosen any more."""
    p = i.message.src
    recorded = MappingProxyType({q: m for q, m in st.recorded.items() if q != p})
    withdrawn = st.withdrawn | {p} if st.phase == "ADVERTISING" else st.withdrawn
    left = st._replace(recorded=recorded, withdrawn=withdrawn)
    return Outcome(left, acks(me, i.message))


def last_withdrawn(me: Me, st: State, i: Heard[Cancel]) -> Outcome:
    """PRE-1: ack, and end as without participants."""
    return no_participants(me, st, i)._replace(messages=acks(me, i.message))


def cancelled(me: Me, st: State, i: Heard[Cancel]) -> Outcome:
    """END-2: ack and leave, and tell the reason."""
    told = Fallback(session=own(st), reason=i.message.reason)
    return Outcome(leave(st), acks(me, i.message), told)


CANCEL: tuple[Row[Heard[Cancel]], ...] = (
    Row("END-3", foreign, acked),
    Row("END-3", withdrawn_or_full, acked),
    Row("END-2", lambda me, st, i: st.phase == "ADVERTISING", withdraw),
    Row("PRE-1", last_withdraws, last_withdrawn),
    Row("END-2", lambda me, st, i: i.message.src in st.recorded, withdraw),
    Row("END-2", lambda me, st, i: i.message.src == st.peer, cancelled),
    Row("END-3", always, acked),
)


def acked_entry(st: State, m: Ack) -> Reliable | None:
    """END-6: the entry this Ack names, sent to the one it comes from; None: there is no such."""
    named = (m.of.type, m.src, m.session, m.of.seq)
    for entry in st.outbox:
        if (entry.type, entry.dst, entry.session, entry.seq) == named:
            return entry
    return None


def acks_nothing(me: Me, st: State, i: Heard[Ack]) -> bool:
    """END-6: is there no such entry?"""
    return acked_entry(st, i.message) is None


def entry_is(*types: str) -> Callable[[Me, State, Heard[Ack]], bool]:
    """END-6: is the entry of one of these types?  (There is one: the first row has looked.)"""
    return lambda me, st, i: i.message.of.type in types


def drop(st: State, gone: Reliable | None, event: str | None) -> Outcome:
    """The entry leaves the outbox; ``event`` moves the phase."""
    kept = tuple([entry for entry in st.outbox if entry is not gone])
    phase = after(st.role, st.phase, event) if event else st.phase
    return Outcome(st._replace(phase=phase, outbox=kept))


def ack_ends(event: str | None) -> Callable[[Me, State, Heard[Ack]], Outcome]:
    """The acked entry leaves the outbox; ``event`` moves the phase."""
    return lambda me, st, i: drop(st, acked_entry(st, i.message), event)


ACK: tuple[Row[Heard[Ack]], ...] = (
    Row("END-6", acks_nothing, ignore),
    Row("ADV-6", entry_is("Intention"), ack_ends("wait")),
    Row("PRE-4", entry_is("Prescription"), ack_ends("acknowledged")),
    Row("NEG-9", entry_is("Acceptance"), ack_ends(None)),
    Row("END-6", entry_is("Fin", "Cancel"), ack_ends(None)),
)


def restart(me: Me, st: State, i: Restart) -> Outcome:
    """END-8: only the number is left, and the quarantine begins."""
    return Outcome(State(number=st.number, quarantine=True), again=(QUARANTINE,))


def not_for_me(me: Me, st: State, i: Heard[Message]) -> bool:
    """MSG-1: is it addressed to another?"""
    return i.message.dst not in (me.station_id, BROADCAST)


def breaks_protocol(me: Me, st: State, i: Heard[Message]) -> bool:
    """END-5: is there anything in it that no station may send?"""
    m = i.message
    if m.src == me.station_id or (m.dst == BROADCAST) != (m.type == "Advertisement"):
        return True
    if m.type == "Cancel":
        return m.reason == "closed" and m.src != m.session[0]
    if m.type in ("Intention", "Acceptance"):
        return m.session[0] != me.station_id
    return m.type in ("Advertisement", "Prescription") and m.src != m.session[0]


FIRST: tuple[Row[Heard[Message]], ...] = (
    Row("MSG-1", not_for_me, ignore),
    Row("END-5", breaks_protocol, discard),
)
