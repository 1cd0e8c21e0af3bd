"""From a station that is followed to the finite graph of the oracle, and back.

The graph knows one or two peers, two sessions of each and three proposals; a log knows any
number of real ids.  A ``View`` is the part of a ``Track`` that one event can touch, in the graph's
ids: the station the event is about (``y``), and the one that decides the phase (``z``: the target,
the prescriber, or another recorded station).  What a view leaves out is untouched by the event
(END-4), so the answer of the oracle for the view is the answer for the whole.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from copy import copy
from typing import Any, NamedTuple

from automcm_spec import station as spec
from automcm_spec.oracle import Answer
from automcm_spec.station import State, Timer
from automcm_traces.track import NUMBERED, ROUNDS, UNBOUND, CannotTell, Entry, Expected, Track

Json = Any
ME, Y, Z, STRANGER = 1, 2, 3, 9
BEYOND = ROUNDS + 1
NOBODY = -1
"""Stands for a station that nothing is known of."""


class View:
    """A part of a Track in the oracle's ids.  ``session`` and ``k`` are those of the event."""

    def __init__(
        self,
        track: Track,
        y: int = 0,
        z: int = 0,
        session: Sequence[int] | None = None,
        k: int = 0,
    ) -> None:
        self.track = track
        if not y:
            y, z = z, 0
        self.ids = {track.me: ME}
        if y:
            self.ids[y] = Y
        if z and z not in self.ids:
            self.ids[z] = Z
        self.event_session = tuple(session) if session else None
        self.numbers = {q: self._numbers(q) for q in self.ids}
        self._k = k

    def on(self, track: Track) -> View:
        """The same view of a copy of the station."""
        other = copy(self)
        other.track = track
        return other

    def _numbers(self, q: int) -> dict[int, int]:
        """Numbers of q's sessions, in order, as 1 and 2."""
        t, numbers = self.track, set()
        if q == t.me and t.number:
            numbers.add(t.number)
        elif q in t.joined:
            numbers.add(t.joined[q])
        if self.event_session is not None and self.event_session[0] == q:
            numbers.add(self.event_session[1])
        return {n: place for place, n in enumerate(sorted(numbers), 1)}

    # -- into the oracle

    def sessions(self, session: Sequence[int] | None) -> tuple[int, int]:
        """A session in the oracle's ids; one of nobody in view is the stranger's."""
        if session is None:
            return 0, 0
        q, n = session
        if q in self.ids and n in self.numbers[q]:
            return self.ids[q], self.numbers[q][n]
        return STRANGER, 1

    def proposals(self, k: int) -> int:
        """A proposal as 1 … 3, in order; one that is beyond all others in view may be 4."""
        t = self.track
        if k == 0:
            return 0
        if t.role == "prescriber":
            return self._of_prescriber(k)
        ranks = {t.proposal, self._k, k} | {e.k for e in self.entries() if e.type in NUMBERED}
        if max(ranks) <= ROUNDS:
            return k
        ordered = sorted(ranks - {0})
        place = ordered.index(k) + 1
        if place > ROUNDS + (k == ordered[-1]):
            raise CannotTell(f"proposals {ordered}: more at once than the oracle knows")
        return place

    def _of_prescriber(self, k: int) -> int:
        """What counts is which is the current one, the next one (NEG-7), and whether the current
        one is the last; the oracle's last is 3."""
        t = self.track
        if t.proposal == 0:
            return min(k, ROUNDS)
        if t.max_rounds == ROUNDS:
            return min(k, BEYOND)
        lower = 0 < self._k < t.proposal
        current = ROUNDS if t.proposal == t.max_rounds else 1 + lower
        away = max(-2, min(k - t.proposal, 2))
        return max(1, min(current + away, BEYOND))

    def entries(self) -> list[Entry]:
        """The part of the outbox in view."""
        t, seen = self.track, []
        for e in t.outbox:
            bound = e.session == t.session and e.type not in ("Fin", "Cancel")
            about = self.ids.get(e.to) == Y and e.session in (self.event_session, t.session)
            if e.to in self.ids and (bound or about):
                seen.append(e)
        return seen

    def entry(self, e: Entry) -> Json:
        """An entry of the outbox, as the oracle has it."""
        k = self.proposals(e.k) if e.type in NUMBERED else e.k
        return e.type, self.ids[e.to], self.sessions(e.session), k, e.accepted

    def state(self) -> Json:
        """The state in view, as the oracle has it."""
        t, ids = self.track, self.ids
        joined = [(ids[q], self.numbers[q][n]) for q, n in t.joined.items() if q in ids]
        return (
            t.phase,
            t.role,
            self.sessions(t.session),
            tuple(sorted(ids[p] for p in t.recorded if p in ids)),
            tuple(sorted(ids[p] for p in t.withdrawn if p in ids)),
            ids.get(t.target, 0),
            self.proposals(t.proposal),
            t.deciding,
            t.heard_ms is not None,
            self.numbers[t.me].get(t.number, 0),
            tuple(sorted(joined)),
            tuple(sorted(self.entry(e) for e in self.entries())),
            t.quarantine,
            t.backoff,
        )

    # -- and back

    def real_id(self, place: int) -> int:
        """The station that the oracle calls so; 0 for nobody."""
        return next((real for real, p in self.ids.items() if p == place), 0)

    def real_session(self, session: Sequence[int]) -> tuple[int, int]:
        """A session of the oracle with real ids; a number not yet used is the next one."""
        q = self.real_id(session[0])
        for n, place in self.numbers.get(q, {}).items():
            if place == session[1]:
                return q, n
        if self.event_session is not None and session[0] == STRANGER:
            return self.event_session[0], self.event_session[1]
        return q, self.track.number + 1


def expected(view: View, message: Json, given: dict[str, Json] | None) -> Expected:
    """A message of the oracle with real ids; ``given`` is the message it may acknowledge."""
    type_, _, dst, session, k, proposal, accepted, reason, _ = message
    t = view.track
    real = view.real_session(session)
    to = view.real_id(dst)
    if proposal:
        real_proposal = proposal
        if view.proposals(t.proposal) == proposal and t.proposal:
            real_proposal = t.proposal
        elif given is not None and "proposal" in given:
            real_proposal = given["proposal"]
        for e in t.outbox:
            if e.type == type_ and e.session == real and view.proposals(e.k) == proposal:
                real_proposal = e.k
    else:
        real_proposal = 0
    key = real_proposal if k and real_proposal else k
    of = (given["type"], given.get("seq")) if type_ == "Ack" and given is not None else None
    copy = t.entry(type_, to, real, key) if k else None
    if type_ == "Advertisement" and t.advertisement is not None:
        copy = Entry("Advertisement", 0, real, 1, t.advertisement)
    return Expected(type_, to, real, key, real_proposal, accepted, reason, of, copy)


class Found(NamedTuple):
    """A question to the graph and its answer."""

    view: View
    value: Json
    """The input in the graph's ids, as nested tuples."""
    answer: Answer
    after: Json
    """The state that comes next, in the graph's ids."""


def real_timer(view: View, timer: Json, messages: Iterable[Expected] = ()) -> Timer | None:
    """A timer of the graph with real ids; ``messages`` are what the step sends.  None if it is of a
    message that neither the outbox nor the step has."""
    if timer[0] == "forget":
        return "forget", view.real_id(timer[1])
    if len(timer) == 1:
        return (timer[0],)
    type_, to, session, _, accepted = timer[1]
    if type_ == "Advertisement":
        return timer[0], spec.Entry(type_, 0, view.real_session(session), 1, False)
    for e in view.track.outbox:
        if e.to in view.ids and view.entry(e) == timer[1]:
            return timer[0], e.spec
    about = type_, view.real_id(to)
    for m in messages:
        if (m.type, m.dst) == about:
            return timer[0], spec.Entry(*about, m.session, m.k, accepted)
    return None


def real_after(
    found: Found, given: dict[str, Json] | None, sent: Iterable[tuple[Expected, dict[str, Json]]]
) -> State:
    """The state that comes next with real ids, as far as the messages were sent."""
    view, after = found.view, found.after
    t, ids = view.track, view.ids
    gone = {e.spec for e in view.entries() if view.entry(e) not in after[11]}
    new = [(e, m) for e, m in sent if e.k and e.copy_of is None and e.type != "Advertisement"]
    posted = {Entry(e.type, e.dst, e.session, e.k, m).spec for e, m in new}
    proposal = t.proposal if after[6] else 0
    if given and given.get("type") == "Prescription" and after[0] == "NEGOTIATING" != t.phase:
        proposal = given["proposal"]
    proposal = next((m["proposal"] for e, m in new if e.type == "Prescription"), proposal)
    unseen_recorded = {p for p in t.recorded if p not in ids}
    recorded = unseen_recorded | {p for p, place in ids.items() if place in after[3]}
    withdrawn = t.withdrawn | {p for p, place in ids.items() if place in after[4]}
    joined = {(p, n) for p, n in t.joined.items() if p not in ids}
    joined |= {view.real_session(session) for session in after[10]}
    return State(
        phase=after[0],
        role=after[1],
        session=UNBOUND if after[2] == (0, 0) else view.real_session(after[2]),
        recorded=frozenset(recorded if after[0] in ("ADVERTISING", "CHOOSING") else ()),
        withdrawn=frozenset(withdrawn if after[0] == "ADVERTISING" else ()),
        target=view.real_id(after[5]) if after[5] else 0,
        proposal=proposal,
        deciding=after[7],
        heard=after[8],
        number=t.number,
        joined=frozenset(joined),
        outbox=(t.state.outbox - gone) | posted,
        quarantine=after[12],
        backoff=after[13],
    )


def others(track: Track, y: int) -> list[int]:
    """Who else decides the phase: the peer, or the other recorded stations."""
    if track.phase in ("ADVERTISING", "CHOOSING"):
        return [p for p in track.recorded if p != y]
    return [track.peer] if track.peer and track.peer != y else []
