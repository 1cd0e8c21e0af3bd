"""The possible inputs of a logged station: the alphabet of OpenStation.tla over the ids of its log.

Only stations, sessions and proposals that the state or an event names are used. No others could
make an observable difference.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from functools import cached_property, lru_cache
from typing import Any

from automcm_spec.log_format.log import (
    ApplicationCommand,
    ApplicationIndication,
    Event,
    ForgetTimer,
    MessageTimer,
    Receive,
    Send,
    TimerArm,
    TimerEnd,
)
from automcm_spec.vocabulary import renumbering
from automcm_spec.vocabulary import station as spec
from automcm_spec.vocabulary.messages import session_in
from automcm_spec.vocabulary.renumbering import Rename
from automcm_traces.checker.track import NO_INDICATION, NUMBERED, UNBOUND, Limits, Track

AHEAD = 3
"""The maximum difference between the proposal of an unlogged Prescription and the last proposal."""
SOMEBODY = -1
"""A placeholder for an unknown station."""
STRANGER = -2
"""The stranger of OpenStation; no log uses this id."""


class Alphabet(spec.OpenStation):
    """OpenStation.tla over these ids and limits. A stranger has no session."""

    def __init__(
        self,
        limits: Limits,
        me: int,
        peers: Collection[int],
        sessions: Collection[spec.Session],
        proposals: Collection[int],
    ) -> None:
        own = frozenset(n for q, n in sessions if q == me)
        super().__init__(*limits, frozenset(peers), own, frozenset(), me, STRANGER)
        self._named = frozenset(sessions) - {UNBOUND}
        self.rounds = frozenset(proposals)
        """The relevant proposals."""
        self.beyond = max(proposals, default=0) + 1
        """An irrelevant proposal; a log may contain proposals above max_rounds."""
        self.foreign = frozenset()
        """The sessions of a stranger: none."""

    def peer_ids(self, p: int) -> frozenset[spec.Session]:
        """The named sessions of a peer."""
        return frozenset(s for s in self._named if s[0] == p)

    @cached_property
    def proper(self) -> tuple[spec.Input, ...]:
        """All inputs that obey the protocol, except expiries, in a fixed order."""
        found: set[spec.Input] = {*self.commands, spec.Restart("restart")}
        for p in self.peers:
            found |= self.heard(self.from_peer(p), True) | self.heard(self.acks(p), False)
            found |= self.cams(p)
        return tuple(sorted(found, key=repr))

    @cached_property
    def broken(self) -> tuple[spec.Input, ...]:
        """All inputs that break the protocol (END-5), in a fixed order."""
        found = (m for p in self.peers for m in self.heard(self.improper(p), True))
        return tuple(sorted(found, key=repr))

    def expiries(self, st: spec.State) -> Iterator[spec.Input]:
        """The expiries of the armed timers."""
        return (spec.Expire("expire", timer) for timer in sorted(self.armed(self.me, st)))


def alphabet(track: Track, named: Collection[int]) -> list[spec.Input]:
    """All inputs that are possible next, about the stations and sessions of the state and of
    ``named``.

    For each station it includes one newer session.
    """
    st = track.state
    peers = {*named, track.peer, *sorted(st.recorded)[:1]}
    peers = peers - {0, track.me} or {SOMEBODY}
    sessions = set(st.joined) | {e.spec.session for e in track.outbox}
    sessions |= {(track.me, st.number + n) for n in (0, 1)}
    joined = dict(st.joined)
    sessions |= {(p, joined.get(p, 0) + 1) for p in peers}
    proposals = {max(st.proposal, 1), st.proposal + 1, *(e.spec.seq for e in track.outbox)}
    found = Alphabet(track.limits, track.me, peers, sessions, proposals)
    return [*found.expiries(st), *found.proper, *found.broken]


LoggedEffect = tuple[str, ...]
"""("send", type, the type that an Ack names), ("indication", name), ("arm" or "stop", timer)."""
LOGGED_AS = {"arm": "timer", "stop": "timer", "expire": "timer", "cam": "receive"}
"""The kinds of effect and input that have another name in the promises of a log."""


def unseen(
    t: Track, event: Event, effect: LoggedEffect | None, promised: frozenset[str]
) -> Iterator[tuple[spec.Input, bool, bool]]:
    """The inputs that may have come unobserved before an event, which may be this effect: each with
    whether it has the effect, and whether the log promises any of its effects.

    The specification is asked with sessions that count from the first one that matters, for the
    same answers come in each session.
    """
    peers, sessions, proposals = _named_by(event)
    st = t.state
    peers |= {t.peer, *st.recorded, *(e.to for e in st.outbox)}
    sessions |= {st.session, (t.me, st.number + 1), *(e.session for e in st.outbox)}
    proposals |= {*range(max(st.proposal - 1, 1), st.proposal + AHEAD + 1)}
    proposals |= {e.seq for e in st.outbox if e.type in NUMBERED}
    sessions.discard(UNBOUND)
    first: dict[int, int] = {}
    for p, n in (*sessions, *st.joined):
        first[p] = min(first.get(p, n), n) if p else 0
    count, back = _moved(first, -1), _moved(first, 1)
    about = frozenset(peers - {0, t.me}), frozenset(map(count, sessions)), frozenset(proposals)
    state = renumbering.state(st, count)._replace(number=st.number - first[t.me])
    for i, shows, logged in _unseen(effect, promised, t.limits, t.me, *about, state):
        yield renumbering.input_of(i, back), shows, logged


def _moved(first: Mapping[int, int], by: int) -> Rename:
    return lambda session: (session[0], session[1] + by * first.get(session[0], 0))


@lru_cache(maxsize=8_000)
def _unseen(
    effect: LoggedEffect | None, promised: frozenset[str], *about: Any
) -> list[tuple[spec.Input, bool, bool]]:
    found = []
    for i, changes, effects in _answers(*about):
        shows = effect in effects
        logged = any(LOGGED_AS.get(kind, kind) in promised for kind, *_ in effects)
        if shows or (changes and not logged):
            found.append((i, shows, logged))
    return found


_ALPHABETS = lru_cache(maxsize=500)(Alphabet)


@lru_cache(maxsize=2_000)
def _answers(
    limits: Limits,
    me: int,
    peers: frozenset[int],
    sessions: frozenset[spec.Session],
    proposals: frozenset[int],
    st: spec.State,
) -> list[tuple[spec.Input, bool, frozenset[LoggedEffect]]]:
    """One input for each distinct outcome, whether it changes the state or a timer, and its
    effects."""
    alphabet = _ALPHABETS(limits, me, peers, sessions, proposals)
    first: dict[tuple[object, ...], spec.Input] = {}
    for i in (*alphabet.proper, *alphabet.expiries(st)):
        if alphabet.offered(st, i):
            named = i.message.type if i.kind == "receive" else i.name if i.kind == "command" else ""
            key = i if i.kind == "expire" else i.kind, named, alphabet.decide(me, st, i)
            first.setdefault(key, i)  # an equal effect has an equal outcome
    found: dict[tuple[object, ...], tuple[spec.Input, bool, frozenset[LoggedEffect]]] = {}
    for (kind, type_, _), i in first.items():
        outcome = alphabet.step(me, st, i)
        changes = bool(outcome.st != st or outcome.arm)
        effects = _effects(outcome)
        if changes or effects:
            found.setdefault((kind, type_, outcome), (i, changes, effects))
    return list(found.values())


def _effects(outcome: spec.Outcome) -> frozenset[LoggedEffect]:
    found: set[LoggedEffect] = {("send", m.type, m.of[0]) for m in outcome.out}
    found |= {("arm", timer[0]) for timer in outcome.arm}
    found |= {("stop", timer[0]) for timer in outcome.stop}
    if outcome.told != NO_INDICATION:
        found.add(("indication", outcome.told[0]))
    return frozenset(found)


def effect_of(event: Event) -> LoggedEffect | None:
    """The effect that an event shows; None for an input, and for *discarded*, which any input may
    have."""
    match event:
        case Send(message=m):
            of = m.get("of")
            acked = of.get("type") if isinstance(of, dict) else "none"
            return "send", str(m["type"]), str(acked)
        case ApplicationIndication(indication=indication) if indication.name != "discarded":
            return "indication", indication.name
        case TimerArm(timer=timer) | TimerEnd(op="stop", timer=timer):
            return event.op, timer.name
    return None


def _named_by(event: Event) -> tuple[set[int], set[spec.Session], set[int]]:
    """The stations, sessions and proposals that an event names."""
    fields: dict[str, object] = {}
    match event:
        case Send(message=m) | Receive(message=dict(m)):
            fields = {**m}
        case TimerArm(timer=MessageTimer(message=key)) | TimerEnd(timer=MessageTimer(message=key)):
            fields = {} if key is None else {"to": key.to, "session": list(key.session)}
        case TimerArm(timer=ForgetTimer(station=p)) | TimerEnd(timer=ForgetTimer(station=p)):
            fields = {"station": p}
        case ApplicationCommand(command=given):
            fields = given.model_extra or {}
        case ApplicationIndication(indication=told) if told.name == "refused":
            fields = {"target": SOMEBODY}  # of a command with a wrong target (PRE-2, NEG-7)
    names = ("src", "dst", "to", "target", "station")
    stations = {q for name in names if type(q := fields.get(name)) is int}
    sessions: set[spec.Session] = set()
    if (session := session_in(fields.get("session"))) is not None:
        sessions.add(session)
        stations.add(session[0])
    proposal = fields.get("proposal")
    return stations, sessions, {proposal} if type(proposal) is int and proposal else set()
