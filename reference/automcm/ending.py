"""Ending and robustness: END-1 … END-8."""

from __future__ import annotations

from collections.abc import Callable
from types import MappingProxyType

from automcm.outcome import (
    Heard,
    Me,
    Outcome,
    Restart,
    Row,
    acked,
    always,
    cancels,
    discard,
    foreign,
    full,
    ignore,
    leave,
    leave_with,
    moved,
    others,
    own,
    refuse,
    stale,
)
from automcm.prescribing import no_participants
from automcm.state import EntryKey, State, Timer, key
from automcm_spec.application import Abort, Fallback
from automcm_spec.messages import (
    BROADCAST,
    Ack,
    Cancel,
    Message,
    Reliable,
)


def abort(me: Me, st: State, i: Abort) -> Outcome:
    """END-1: leave, with a Cancel to everybody concerned."""
    return leave_with(st, cancels(me, st, others(st), "abort"))


ABORT = (
    Row("CMD-1", lambda me, st, i: not st.bound, refuse),
    Row("PRE-5", stale, refuse),
    Row("END-1", always, abort),
)


def withdrawn_or_full(me: Me, st: State, i: Heard[Cancel]) -> bool:
    """END-3: in ADVERTISING, has it withdrawn before, or is there no room to note it (MEM-1)?"""
    p = i.message.src
    noted = p in st.withdrawn or (p not in st.recorded and full(me, st))
    return st.phase == "ADVERTISING" and noted


def last_withdraws(me: Me, st: State, i: Heard[Cancel]) -> bool:
    """PRE-1: does the only station left to choose from withdraw?"""
    return st.recorded.keys() == {i.message.src}


def withdraw(me: Me, st: State, i: Heard[Cancel]) -> Outcome:
    """END-2: the station is not there to be chosen any more."""
    p = i.message.src
    recorded = MappingProxyType({q: m for q, m in st.recorded.items() if q != p})
    withdrawn = st.withdrawn | {p} if st.phase == "ADVERTISING" else st.withdrawn
    return acked(me, st, i)._replace(state=st._replace(recorded=recorded, withdrawn=withdrawn))


def last_withdrawn(me: Me, st: State, i: Heard[Cancel]) -> Outcome:
    """PRE-1: ack, and end as without participants."""
    return no_participants(me, st, i)._replace(messages=acked(me, st, i).messages)


def cancelled(me: Me, st: State, i: Heard[Cancel]) -> Outcome:
    """END-2: ack and leave, and tell the reason."""
    told = Fallback(session=own(st), reason=i.message.reason)
    return Outcome(leave(st), acked(me, st, i).messages, told)


CANCEL = (
    Row("END-3", foreign, acked),
    Row("END-3", withdrawn_or_full, acked),
    Row("END-2", lambda me, st, i: st.phase == "ADVERTISING", withdraw),
    Row("PRE-1", last_withdraws, last_withdrawn),
    Row("END-2", lambda me, st, i: i.message.src in st.recorded, withdraw),
    Row("END-2", lambda me, st, i: i.message.src == st.peer, cancelled),
    Row("END-3", always, acked),
)


def acked_key(m: Ack) -> EntryKey:
    """END-6: the key of the entry this Ack names, sent to the one it comes from."""
    return EntryKey(m.of.type, m.src, m.session, m.of.seq)


def acks_nothing(me: Me, st: State, i: Heard[Ack]) -> bool:
    """END-6: is there no such entry?"""
    return acked_key(i.message) not in map(key, st.outbox)


def acks(*types: str) -> Callable[[Me, State, Heard[Ack]], bool]:
    """END-6: is the entry of one of these types?  (There is one: the first row has looked.)"""
    return lambda me, st, i: i.message.of.type in types


def drop(st: State, gone: EntryKey) -> tuple[Reliable, ...]:
    """The outbox without the entry."""
    return tuple(entry for entry in st.outbox if key(entry) != gone)


def ack_ends(event: str | None) -> Callable[[Me, State, Heard[Ack]], Outcome]:
    """The acked entry leaves the outbox; ``event`` moves the phase."""

    def then(me: Me, st: State, i: Heard[Ack]) -> Outcome:
        kept = drop(st, acked_key(i.message))
        return Outcome((moved(st, event) if event else st)._replace(outbox=kept))

    return then


ACK = (
    Row("END-6", acks_nothing, ignore),
    Row("ADV-6", acks("Intention"), ack_ends("wait")),
    Row("PRE-4", acks("Prescription"), ack_ends("acknowledged")),
    Row("NEG-9", acks("Acceptance"), ack_ends(None)),
    Row("END-6", acks("Fin", "Cancel"), ack_ends(None)),
)


def restart(me: Me, st: State, i: Restart) -> Outcome:
    """END-8: only the number is left, and the quarantine begins."""
    return Outcome(State(number=st.number, quarantine=True), again=(Timer("quarantine"),))


def not_for_me(me: Me, st: State, i: Heard[Message]) -> bool:
    """MSG-1: is it addressed to another?"""
    return i.message.dst not in (me.station_id, BROADCAST)


def breaks_protocol(me: Me, st: State, i: Heard[Message]) -> bool:
    """END-5: is there anything in it that no station may send?"""
    m = i.message
    if m.src == me.station_id or (m.dst == BROADCAST) != (m.type == "Advertisement"):
        return True
    prescriber = m.session[0]
    if m.type in ("Advertisement", "Prescription"):
        return m.src != prescriber
    if m.type in ("Intention", "Acceptance"):
        return prescriber != me.station_id
    return m.type == "Cancel" and m.reason == "closed" and m.src != prescriber


FIRST = (Row("MSG-1", not_for_me, ignore), Row("END-5", breaks_protocol, discard))
