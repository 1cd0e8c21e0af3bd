"""What a station may have had as input without it being logged: the alphabet on the ids of a log.

``OpenStation.tla`` says what the alphabet is.  Here its stations, sessions and proposals are those
that the state of a station and the next event name; nothing else that is unseen could show.
"""

from __future__ import annotations

from functools import lru_cache
from typing import Any, NamedTuple

from automcm_spec.station import Input, Outcome, Session, State
from automcm_traces.alphabet import Alphabet
from automcm_traces.log import ApplicationCommand, Event, Receive, Send, TimerArm, TimerEnd
from automcm_traces.track import NUMBERED, UNBOUND, Track

Json = Any
AHEAD = 3
"""By how much the proposal of an unseen Prescription may be above the last one."""


class Answer(NamedTuple):
    """An input, what the specification says to it, and whether it changes state or timers."""

    input: Input
    outcome: Outcome
    changes: bool


def _type(i: Input) -> str:
    return i.message.type if i.kind == "receive" else i.name if i.kind == "command" else ""


def answers(t: Track, event: Event) -> tuple[Answer, ...]:
    """What may have come unseen before an event, and what must follow it."""
    peers, sessions, proposals = _named_by(event)
    st = t.state
    peers |= {t.peer, *st.recorded, *(e.to for e in st.outbox)}
    sessions |= {st.session, (t.me, st.number + 1), *(e.session for e in st.outbox)}
    proposals |= {*range(max(st.proposal - 1, 1), st.proposal + AHEAD + 1)}
    proposals |= {e.seq for e in st.outbox if e.type in NUMBERED}
    about = frozenset(peers - {0, t.me}), frozenset(sessions - {UNBOUND}), frozenset(proposals)
    return _answers((t.max_rounds, *t.limits), t.me, *about, st)


@lru_cache(maxsize=2_000)
def _answers(
    limits: tuple[int, int, int, int],
    me: int,
    peers: frozenset[int],
    sessions: frozenset[Session],
    proposals: frozenset[int],
    st: State,
) -> tuple[Answer, ...]:
    """The inputs that do something in this state; of those that do the same, one."""
    alphabet = _alphabet(limits, me, peers, sessions, proposals)
    found: dict[Json, Answer] = {}
    for i in (*alphabet.proper, *alphabet.expiries(st)):
        if not alphabet.offered(st, i):
            continue
        outcome = alphabet.step(me, st, i)
        changes = bool(outcome.st != st or outcome.arm)
        if changes or outcome.out or outcome.told != alphabet.nothing:
            key = i if i.kind == "expire" else i.kind, _type(i), outcome
            found.setdefault(key, Answer(i, outcome, changes))
    return tuple(found.values())


@lru_cache(maxsize=500)
def _alphabet(*about: Any) -> Alphabet:
    return Alphabet(*about)


def _named_by(event: Event) -> tuple[set[int], set[Session], set[int]]:
    """The stations, the sessions and the proposals that an event names."""
    fields: dict[str, Json] = {}
    match event:
        case Send(message=m) | Receive(message=dict(m)):
            fields = m
        case TimerArm(timer=timer) | TimerEnd(timer=timer):
            told = timer.model_dump(exclude_none=True)
            fields = told | told.get("message", {})
        case ApplicationCommand(command=given):
            fields = given.model_extra or {}
    names = ("src", "dst", "to", "target", "station")
    stations = {q for name in names if type(q := fields.get(name)) is int}
    sessions: set[Session] = set()
    match fields.get("session"):
        case [int(q), int(n)]:
            sessions.add((q, n))
            stations.add(q)
    proposal = fields.get("proposal")
    return stations, sessions, {proposal} if type(proposal) is int and proposal else set()
