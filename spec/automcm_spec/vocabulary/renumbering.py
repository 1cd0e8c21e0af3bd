"""Replaces station ids in values of the specification."""

from __future__ import annotations

from collections.abc import Callable

from automcm_spec.vocabulary import station as spec

Rename = Callable[[spec.Session], spec.Session]
"""Maps a session to a session. A station maps to the prescriber of the session that its session 1
maps to."""


def station(p: int, to: Rename) -> int:
    """A station with its new id."""
    return to((p, 1))[0]


def entry(e: spec.Entry, to: Rename) -> spec.Entry:
    """An outbox entry with new ids."""
    return spec.Entry(e.type, station(e.to, to), to(e.session), *e[3:])


def message(m: spec.Message, to: Rename) -> spec.Message:
    """A message with new ids."""
    return spec.Message(m.type, station(m.src, to), station(m.dst, to), to(m.session), *m[4:])


def timer(t: spec.Timer, to: Rename) -> spec.Timer:
    """A timer with new ids."""
    match t:
        case (name, spec.Entry() as e):
            return name, entry(e, to)
        case (name, int(p)):
            return name, station(p, to)
    return t


def state(st: spec.State, to: Rename) -> spec.State:
    """A state with new ids."""
    return st._replace(
        session=to(st.session),
        recorded=frozenset(station(p, to) for p in st.recorded),
        withdrawn=frozenset(station(p, to) for p in st.withdrawn),
        target=station(st.target, to),
        joined=frozenset(map(to, st.joined)),
        outbox=frozenset(entry(e, to) for e in st.outbox),
    )


def input_of(i: spec.Input, to: Rename) -> spec.Input:
    """An input with new ids."""
    match i:
        case spec.Receive(message=m):
            return spec.Receive("receive", message(m, to), i.concerned)
        case spec.Cam():
            return i._replace(src=station(i.src, to), marks=frozenset(map(to, i.marks)))
        case spec.Command():
            return i._replace(session=to(i.session), target=station(i.target, to))
        case spec.Expire(timer=t):
            return spec.Expire("expire", timer(t, to))
    return i
