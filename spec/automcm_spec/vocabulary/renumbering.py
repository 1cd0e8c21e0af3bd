"""Replaces station ids in values of the specification."""

from __future__ import annotations

from collections.abc import Callable

from automcm_spec.vocabulary.station import (
    Cam,
    Command,
    Entry,
    Expire,
    Input,
    Message,
    Receive,
    Session,
    State,
    Timer,
)

Rename = Callable[[Session], Session]
"""Maps a session to a session. A station maps to the prescriber of the session that its session 1
maps to."""


def station(p: int, to: Rename) -> int:
    """A station with its new id."""
    return to((p, 1))[0]


def entry(e: Entry, to: Rename) -> Entry:
    """An outbox entry with new ids."""
    return e._replace(to=station(e.to, to), session=to(e.session))


def message(m: Message, to: Rename) -> Message:
    """A message with new ids."""
    return m._replace(src=station(m.src, to), dst=station(m.dst, to), session=to(m.session))


def timer(t: Timer, to: Rename) -> Timer:
    """A timer with new ids."""
    match t:
        case (name, Entry() as e):
            return name, entry(e, to)
        case (name, int(p)):
            return name, station(p, to)
    return t


def state(st: State, to: Rename) -> State:
    """A state with new ids."""
    return st._replace(
        session=to(st.session),
        recorded=frozenset(station(p, to) for p in st.recorded),
        withdrawn=frozenset(station(p, to) for p in st.withdrawn),
        target=station(st.target, to),
        joined=frozenset(map(to, st.joined)),
        outbox=frozenset(entry(e, to) for e in st.outbox),
    )


def input_of(i: Input, to: Rename) -> Input:
    """An input with new ids."""
    match i:
        case Receive(message=m):
            return i._replace(message=message(m, to))
        case Cam():
            return i._replace(src=station(i.src, to), marks=frozenset(map(to, i.marks)))
        case Command():
            return i._replace(session=to(i.session), target=station(i.target, to))
        case Expire(timer=t):
            return i._replace(timer=timer(t, to))
    return i
