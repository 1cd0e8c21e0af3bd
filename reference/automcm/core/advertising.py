"""Advertising: ADV-1 … ADV-8, and END-7 and MEM-1 where they apply to it."""

from __future__ import annotations

from types import MappingProxyType

from automcm.core.outcome import (
    Expiry,
    Me,
    Outcome,
    Received,
    Row,
    ack,
    acked,
    always,
    foreign,
    full,
    ignore,
    leave,
    own,
    post,
    refuse,
    room,
)
from automcm.core.phases import after
from automcm.core.state import State
from automcm_spec.vocabulary.application import Fallback, Request
from automcm_spec.vocabulary.messages import Advertisement, Cancel, Intention, Message


def open_session(me: Me, st: State, i: Request) -> Outcome:
    """ADV-1: open a session with the next number and advertise it at once."""
    session = (me.station_id, st.number + 1)
    advertisement = Advertisement(
        src=me.station_id,
        session=session,
        seq=1,
        scenario=i.scenario,
        details=i.details,
        planned=i.planned,
    )
    opened = st._replace(
        phase=after("prescriber", st.phase, "open"),
        role="prescriber",
        session=session,
        number=st.number + 1,
        advertisement=advertisement,
        seq=1,
    )
    return Outcome(opened, (advertisement,))


def advertise_again(me: Me, st: State, i: Expiry) -> Outcome:
    """ADV-2: repeat the Advertisement."""
    assert st.advertisement is not None
    return Outcome(st, (st.advertisement,))


REQUEST: tuple[Row[Request], ...] = (
    Row("ADV-1", lambda me, st, i: st.bound, refuse),
    Row("ACT-6", lambda me, st, i: st.quarantine, refuse),
    Row("END-7", lambda me, st, i: st.backoff, refuse),
    Row("MEM-1", lambda me, st, i: not room(me, st), refuse),
    Row("ADV-1", always, open_session),
)


def joined_before(me: Me, st: State, i: Received[Advertisement]) -> bool:
    """ADV-8: has the station joined this session or a newer one of that prescriber?"""
    return i.message.session[1] <= st.joined.get(i.message.src, 0)


def no_room_to_join(me: Me, st: State, i: Received[Advertisement]) -> bool:
    """MEM-1: is there no room to join the session or to remember it?"""
    remembers = i.message.src in st.joined or len(st.joined) < me.memory_limit
    return not (room(me, st) and remembers)


def join(me: Me, st: State, i: Received[Advertisement]) -> Outcome:
    """ADV-3: join the session, send the Intention, remember the session."""
    assert i.planned is not None
    m = i.message
    intention = Intention(src=me.station_id, dst=m.src, session=m.session, seq=1, planned=i.planned)
    joined = st._replace(
        phase=after("receiver", st.phase, "join"),
        role="receiver",
        session=m.session,
        joined=MappingProxyType({**st.joined, m.src: m.session[1]}),
    )
    return Outcome(post(joined, intention), (intention,))


ADVERTISEMENT: tuple[Row[Received[Advertisement]], ...] = (
    Row("ADV-4", lambda me, st, i: st.bound, ignore),
    Row("END-8", lambda me, st, i: st.quarantine, ignore),
    Row("ADV-8", joined_before, ignore),
    Row("ADV-3", lambda me, st, i: i.planned is None, ignore),
    Row("MEM-1", no_room_to_join, ignore),
    Row("ADV-3", always, join),
)


def answer_closed(me: Me, st: State, i: Received[Message]) -> Outcome:
    """Answer with the Fin or Cancel that is still being sent there, else with Cancel(closed)."""
    m = i.message
    for entry in st.outbox:
        if entry.dst == m.src and entry.session == m.session and entry.type in ("Fin", "Cancel"):
            return Outcome(st, (entry,))
    closed = Cancel(src=me.station_id, dst=m.src, session=m.session, seq=0, reason="closed")
    return Outcome(st, (closed,))


def record(me: Me, st: State, i: Received[Intention]) -> Outcome:
    """ADV-5: record the Intention and ack it."""
    m = i.message
    recorded = MappingProxyType({**st.recorded, m.src: m})
    return Outcome(st._replace(recorded=recorded), (ack(me, m),))


INTENTION: tuple[Row[Received[Intention]], ...] = (
    Row("ADV-5", foreign, answer_closed),
    Row("ADV-5", lambda me, st, i: i.message.src in st.recorded, acked),
    Row("ADV-5", lambda me, st, i: i.message.src in st.withdrawn, answer_closed),
    Row("MEM-1", lambda me, st, i: st.phase == "ADVERTISING" and full(me, st), ignore),
    Row("ADV-5", lambda me, st, i: st.phase == "ADVERTISING", record),
    Row("ADV-5", lambda me, st, i: i.message.src == st.target, acked),
    Row("ADV-5", always, answer_closed),
)


def forget(me: Me, st: State, i: Expiry) -> Outcome:
    """ADV-8: forget the prescriber, because no copy of its Advertisement can still arrive."""
    kept = {p: n for p, n in st.joined.items() if p != i.timer.station}
    return Outcome(st._replace(joined=MappingProxyType(kept)))


def hold_ends(me: Me, st: State, i: Expiry) -> Outcome:
    """ADV-7: leave, because no Prescription has arrived in time."""
    return Outcome(leave(st), indication=Fallback(session=own(st), reason="timeout"))
