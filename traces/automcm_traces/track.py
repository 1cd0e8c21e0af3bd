"""From a real log to the oracle and back.

The oracle knows one or two peers, two sessions of each and three proposals; a log knows any
number of real ids.  ``Track`` is what a station's log says about it so far, with real ids.  A
``View`` is the part of it that one event can touch, in the oracle's ids: the station the event
is about (``y``), and the one that decides the phase (``z``: the target, the prescriber, or
another recorded station).  What a view leaves out is untouched by the event (END-4), so the
answer of the oracle for the view is the answer for the whole.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from copy import copy
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple

from automcm_traces.same import same

Json = Any
ME, Y, Z, STRANGER = 1, 2, 3, 9
FIELDS = {
    "Advertisement": {"scenario", "details", "planned"},
    "Intention": {"planned"},
    "Prescription": {"proposal", "prescribed", "hold_ms", "lease_ms"},
    "Acceptance": {"proposal", "accepted", "reason", "selected"},
    "Fin": set(),
    "Cancel": {"reason"},
    "Ack": {"of"},
}
"""What each message has beside v, type, src, dst, session and seq."""
COMMON = {"v", "type", "src", "dst", "session", "seq"}
NUMBERED = ("Prescription", "Acceptance")
OPTIONAL = {"dst", "planned", "reason", "selected"}
PHASES = (
    "STANDALONE",
    "ADVERTISING",
    "CHOOSING",
    "PRESCRIBING",
    "INTENDING",
    "WAITING",
    "NEGOTIATING",
    "ACTUATING",
)
ROLES = ("none", "prescriber", "receiver")
"""Of Station.tla."""
ROUNDS = 3
BEYOND = ROUNDS + 1
NOBODY = -1
"""Stands for a station that nothing is known of."""


class CannotTell(Exception):
    """What the log holds cannot be expressed in the oracle; the text says why."""


@dataclass(slots=True)
class Entry:
    """A reliable message still being sent: ``k`` is what identifies it for the oracle."""

    type: str
    to: int
    session: tuple[int, int]
    k: int
    message: dict[str, Json]

    @property
    def accepted(self) -> bool:
        """Is it an Acceptance that accepts?"""
        return bool(self.message.get("accepted", False))


class Limits(NamedTuple):
    """What bounds the memory of a station (MEM-1); section 3 has the defaults."""

    participants: int = 32
    outbox: int = 64
    memory: int = 64


DEFAULT_LIMITS = Limits()


@dataclass(slots=True)
class Track:
    """What is known of a station.  The fields of Station.tla, with real ids and content."""

    me: int
    max_rounds: int = ROUNDS
    limits: Limits = DEFAULT_LIMITS
    phase: str = "STANDALONE"
    role: str = "none"
    session: tuple[int, int] | None = None
    advertisement: dict[str, Json] | None = None
    recorded: list[int] = field(default_factory=list)
    withdrawn: set[int] = field(default_factory=set)
    target: int = 0
    proposal: int = 0
    deciding: bool = False
    heard_ms: int | None = None
    number: int = 0
    joined: dict[int, int] = field(default_factory=dict)
    outbox: list[Entry] = field(default_factory=list)
    quarantine: bool = False
    backoff: bool = False
    seq: int = 0
    lease_ms: int = 0

    def copy(self) -> Track:
        """The same station, to go on from here on its own."""
        return replace(
            self,
            recorded=list(self.recorded),
            withdrawn=set(self.withdrawn),
            joined=dict(self.joined),
            outbox=list(self.outbox),
        )

    def key(self) -> Json:
        """What tells this station from others; hashes."""
        return (
            self.phase,
            self.role,
            self.session,
            tuple(self.recorded),
            tuple(sorted(self.withdrawn)),
            self.target,
            self.proposal,
            self.deciding,
            self.heard_ms,
            self.number,
            tuple(self.joined.items()),
            tuple((e.type, e.to, e.session, e.k, e.accepted) for e in self.outbox),
            self.quarantine,
            self.backoff,
            self.seq,
        )

    @property
    def peer(self) -> int:
        """The other station of the own session; 0 if there is none."""
        if self.role == "receiver" and self.session:
            return self.session[0]
        return self.target

    @property
    def marks(self) -> list[list[int]]:
        """The sessions that its CAM names (ACT-5), in order."""
        marks = {e.session for e in self.outbox if e.type == "Fin"}
        return [list(s) for s in sorted(marks | ({self.session} if self.session else set()))]

    def entry(self, type_: str, to: int, session: tuple[int, int], k: int) -> Entry | None:
        """The entry in the outbox, if it is there."""
        for e in self.outbox:
            if (e.type, e.to, e.session, e.k) == (type_, to, session, k):
                return e
        return None

    def entry_by_seq(self, key: dict[str, Json]) -> Entry | None:
        """The entry that a timer or an Ack names by its seq on the wire."""
        for e in self.outbox:
            if (e.type, e.to, list(e.session), e.message["seq"]) == (
                key["type"],
                key.get("to", 0),
                list(key["session"]),
                key["seq"],
            ):
                return e
        return None


def number_of(message: dict[str, Json]) -> int:
    """What identifies a message for the oracle: its proposal, 1, or 0 for an answer."""
    if message["seq"] == 0:
        return 0
    if message["type"] in NUMBERED:
        return int(message["proposal"])
    return 1


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


@dataclass(frozen=True, slots=True)
class Expected:
    """A message that the oracle expects, with real ids."""

    type: str
    dst: int
    session: tuple[int, int]
    k: int
    proposal: int
    accepted: bool
    reason: str
    of: tuple[str, int | None] | None
    """What an Ack names; its seq is None if that message was not observed."""
    copy_of: Entry | None

    def __str__(self) -> str:
        extra = [f"proposal={self.proposal}"] if self.proposal else []
        if self.type == "Acceptance":
            extra.append("accepted" if self.accepted else "refused")
        if self.reason not in ("none", "as_sent"):
            extra.append(self.reason)
        if self.of:
            extra.append(f"of {self.of[0]} seq={self.of[1]}")
        if self.copy_of:
            extra.append(f"copy of seq={self.copy_of.message['seq']}")
        to = f" to {self.dst}" if self.dst else ""
        inner = f" ({', '.join(extra)})" if extra else ""
        return f"{self.type}{to} session={self.session[0]}/{self.session[1]}{inner}"


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


def difference(
    e: Expected, m: dict[str, Json], t: Track, content: dict[str, Json], fresh: int
) -> str | None:
    """Why the logged message ``m`` is not the expected one; None if it is.

    ``content`` is what the application gave, ``fresh`` how many new messages the step sent.
    """
    allowed = COMMON | FIELDS[e.type]
    for name in sorted(set(m) ^ allowed):
        if name not in OPTIONAL or name not in allowed:
            return f"{name}: {e.type} {'needs' if name in allowed else 'has no'} this field"
    if m["v"] != 1:
        return f"v: 1 is expected, not {m['v']}"
    plain = (
        ("type", e.type, m.get("type")),
        ("src", t.me, m.get("src")),
        ("dst", e.dst, m.get("dst", 0)),
        ("session", list(e.session), m.get("session")),
        ("proposal", e.proposal, m.get("proposal", 0)),
        ("accepted", e.accepted, m.get("accepted", False)),
    )
    for name, wanted, found in plain:
        if wanted != found and not (name == "session" and _opens(e, m, t)):
            return f"{name}: {wanted} is expected, not {found}"
    if e.copy_of is not None:
        return _copy_difference(e.copy_of.message, m)
    if e.reason != "none" and m.get("reason") != e.reason:
        return f"reason: {e.reason} is expected, not {m.get('reason')}"
    if e.of is not None and m.get("of") not in _acks(e.of, m):
        return f"of: {e.of[0]} seq={e.of[1]} is expected, not {m.get('of')}"
    if e.k == 0 and m["seq"] != 0:
        return f"seq: an answer has 0, not {m['seq']} (END-6)"
    if e.k and m["seq"] != t.seq + fresh + 1:
        return f"seq: new content takes the next seq, {t.seq + fresh + 1}, not {m['seq']}"
    for name in set(content) & set(m) - {"name", "session", "proposal", "target"}:
        if not same(content[name], m[name]):
            return f"{name}: not what the application gave"
    return None


def off(e: Expected, m: dict[str, Json]) -> int:
    """In how many fields the logged message ``m`` is not the expected one, at least 1."""
    told: dict[str, Json] = {"dst": e.dst, "session": list(e.session), "proposal": e.proposal}
    told |= {"accepted": e.accepted, "reason": e.reason if e.reason != "none" else None}
    found = {"dst": 0, "proposal": 0, "accepted": False} | m
    return len([name for name, wanted in told.items() if found.get(name) != wanted]) or 1


def _acks(of: tuple[str, int | None], m: dict[str, Json]) -> list[Json]:
    """The ``of`` that an Ack may hold; any seq if what it acks was not observed."""
    seq = m["of"]["seq"] if of[1] is None else of[1]
    return [{"type": of[0], "seq": seq}]


def _opens(e: Expected, m: dict[str, Json], t: Track) -> bool:
    """A new session may take any number above the last one."""
    session = m.get("session")
    return (
        e.type == "Advertisement"
        and e.copy_of is None
        and isinstance(session, list)
        and session[0] == t.me
        and session[1] > t.number
    )


def _copy_difference(first: dict[str, Json], m: dict[str, Json]) -> str | None:
    for name in sorted(set(first) | set(m)):
        if not same(first.get(name), m.get(name)):
            return f"{name}: a copy repeats the message byte for byte"
    return None


def others(track: Track, y: int) -> list[int]:
    """Who else decides the phase: the peer, or the other recorded stations."""
    if track.phase in ("ADVERTISING", "CHOOSING"):
        return [p for p in track.recorded if p != y]
    return [track.peer] if track.peer and track.peer != y else []


def lift(
    t: Track, view: View, after: Json, sent: Iterable[tuple[Expected, dict[str, Json]]]
) -> None:
    """Bring ``t`` to the state the oracle says comes next, with the messages really sent."""
    gone = [e for e in view.entries() if view.entry(e) not in after[11]]
    was = t.session
    (t.phase, t.role) = after[0], after[1]
    t.session = None if after[2] == (0, 0) else view.real_session(after[2])
    if t.session != was:
        t.seq = 0
    for place, p in ((view.ids[p], p) for p in view.ids):
        if place in after[3] and p not in t.recorded:
            t.recorded.append(p)
        if place not in after[3] and p in t.recorded:
            t.recorded.remove(p)
        if place in after[4]:
            t.withdrawn.add(p)
    if t.phase not in ("ADVERTISING", "CHOOSING"):
        t.recorded.clear()
    if t.phase != "ADVERTISING":
        t.withdrawn.clear()
        t.advertisement = None
    t.target = view.real_id(after[5]) if after[5] else 0
    if after[6] == 0:
        t.proposal = t.lease_ms = 0
    t.deciding = after[7]
    if not after[8]:
        t.heard_ms = None
    t.quarantine, t.backoff = after[12], after[13]
    for p in [p for p in t.joined if p in view.ids]:
        if not any(q == view.ids[p] for q, _ in after[10]):
            del t.joined[p]
    for q, n in after[10]:
        p, number = view.real_session((q, n))
        t.joined[p] = number
    t.outbox = [e for e in t.outbox if not any(e is g for g in gone)]
    for e, m in sent:
        if e.type == "Advertisement":
            t.session = (t.me, m["session"][1])
            t.number = t.session[1]
            t.advertisement = m
        elif e.k and e.copy_of is None:
            t.outbox.append(Entry(e.type, e.dst, e.session, e.k, m))
        if e.k and e.copy_of is None and t.session is not None:
            t.seq = max(t.seq, m["seq"])
        if e.type == "Prescription" and e.copy_of is None:
            t.proposal, t.lease_ms = m["proposal"], m["lease_ms"]
