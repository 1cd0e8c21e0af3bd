"""A station that is followed by its log: the specification's state, and what that does not keep.

Of a message the specification keeps what docs/protocol.md says under "What the specification keeps
of a message": ``seq`` is there the proposal, 1, or 0 for an answer.  ``Track`` has the rest.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple, get_args

from automcm_spec import station as spec
from automcm_spec.messages import Message
from automcm_spec.parameters import DEFAULTS
from automcm_spec.station import State, Station
from automcm_traces.same import same

Json = Any
NUMBERED = tuple(m.__name__ for m in get_args(Message) if "proposal" in m.model_fields)
"""The messages whose seq is the proposal."""
ROUNDS = DEFAULTS["max_rounds"]
UNBOUND = (0, 0)
"""The session of a station that has none."""


class CannotTell(Exception):
    """What the log holds is not enough for a verdict; the text says why."""


@dataclass(slots=True)
class Entry:
    """A reliable message still being sent: ``k`` is its seq in the specification."""

    type: str
    to: int
    session: tuple[int, int]
    k: int
    message: dict[str, Json]

    @property
    def accepted(self) -> bool:
        """Is it an Acceptance that accepts?"""
        return bool(self.message.get("accepted", False))

    @property
    def spec(self) -> spec.Entry:
        """As the specification has it."""
        return spec.Entry(self.type, self.to, self.session, self.k, self.accepted)


class Limits(NamedTuple):
    """What bounds the memory of a station (MEM-1)."""

    participants: int = DEFAULTS["max_participants"]
    outbox: int = DEFAULTS["outbox_limit"]
    memory: int = DEFAULTS["memory_limit"]


DEFAULT_LIMITS = Limits()
_STATION = Station(ROUNDS, *DEFAULT_LIMITS)
INITIAL, NOTHING_TOLD = _STATION.initial, _STATION.nothing
PHASES, ROLES = tuple(sorted(_STATION.phases)), tuple(sorted(_STATION.roles))


@dataclass(slots=True)
class Track:
    """What is known of a station: the state of the specification, with real ids, and content."""

    me: int
    max_rounds: int = ROUNDS
    limits: Limits = DEFAULT_LIMITS
    state: State = INITIAL
    outbox: list[Entry] = field(default_factory=list)
    """Those of the state, with their messages, in the order in which they were sent."""
    advertisement: dict[str, Json] | None = None
    heard_ms: int | None = None
    """When the last CAM that counted was generated; None if none was heard."""
    seq: int = 0
    """The last one used in the session."""
    lease_ms: int = 0

    def copy(self) -> Track:
        """The same station, to go on from here on its own."""
        return replace(self, outbox=list(self.outbox))

    def key(self) -> Json:
        """What tells this station from others; hashes."""
        return self.state, tuple(e.spec for e in self.outbox), self.heard_ms, self.seq

    @property
    def phase(self) -> str:
        """Of ``PHASES``."""
        return self.state.phase

    @property
    def role(self) -> str:
        """Of ``ROLES``."""
        return self.state.role

    @property
    def session(self) -> tuple[int, int] | None:
        """The own session."""
        return None if self.state.session == UNBOUND else self.state.session

    @property
    def recorded(self) -> list[int]:
        """The stations whose Intention counts, in order of their ids."""
        return sorted(self.state.recorded)

    @property
    def withdrawn(self) -> frozenset[int]:
        """The stations that have withdrawn."""
        return self.state.withdrawn

    @property
    def target(self) -> int:
        """The station that is prescribed to; 0 if there is none."""
        return self.state.target

    @property
    def proposal(self) -> int:
        """The current one; 0 if there is none."""
        return self.state.proposal

    @property
    def deciding(self) -> bool:
        """Whether the prescriber's application is asked for another proposal."""
        return self.state.deciding

    @property
    def number(self) -> int:
        """Of its last own session."""
        return self.state.number

    @property
    def joined(self) -> dict[int, int]:
        """By prescriber the number of the last session joined."""
        return dict(sorted(self.state.joined))

    @property
    def quarantine(self) -> bool:
        """Whether it joins nothing after a restart."""
        return self.state.quarantine

    @property
    def backoff(self) -> bool:
        """Whether it opens no session."""
        return self.state.backoff

    @property
    def peer(self) -> int:
        """The other station of the own session; 0 if there is none."""
        return self.state.session[0] if self.role == "receiver" else self.target

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
    """The seq of a message in the specification: its proposal, 1, or 0 for an answer."""
    if message["seq"] == 0:
        return 0
    if message["type"] in NUMBERED:
        return int(message["proposal"])
    return 1


@dataclass(frozen=True, slots=True)
class Expected:
    """A message that the specification expects."""

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


def expected(t: Track, m: spec.Message, given: dict[str, Json] | None) -> Expected:
    """A message of the specification; ``given`` is the message it may acknowledge."""
    of = (given["type"], given.get("seq")) if m.type == "Ack" and given is not None else None
    copy = t.entry(m.type, m.dst, m.session, m.seq) if m.seq else None
    if m.type == "Advertisement" and t.advertisement is not None:
        copy = Entry(m.type, 0, m.session, 1, t.advertisement)
    more = m.proposal, m.accepted, m.reason
    return Expected(m.type, m.dst, m.session, m.seq, *more, of, copy)


def difference(
    e: Expected, m: dict[str, Json], t: Track, content: Mapping[str, Json], fresh: int
) -> str | None:
    """Why the logged message ``m`` is not the expected one; None if it is.

    ``content`` is what the application gave, ``fresh`` how many new messages the step sent.
    """
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
    """In how many fields the logged message ``m`` is not the expected one: one more than those
    counted here, which may be right while its seq or its content is not."""
    told: dict[str, Json] = {"dst": e.dst, "session": list(e.session), "proposal": e.proposal}
    told |= {"accepted": e.accepted, "reason": e.reason if e.reason != "none" else None}
    found = {"dst": 0, "proposal": 0, "accepted": False} | m
    return 1 + len([name for name, wanted in told.items() if found.get(name) != wanted])


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


def lift(t: Track, after: State, sent: Iterable[tuple[Expected, dict[str, Json]]]) -> None:
    """Bring ``t`` to the state that comes next, with the messages really sent."""
    if after.session != t.state.session:
        t.seq = 0
    t.state = after
    if after.phase != "ADVERTISING":
        t.advertisement = None
    if not after.proposal:
        t.lease_ms = 0
    if not after.heard:
        t.heard_ms = None
    t.outbox = [e for e in t.outbox if e.spec in after.outbox]
    for e, m in sent:
        if e.type == "Advertisement":  # any number above the last one will do
            me, number = t.me, m["session"][1]
            t.state, t.advertisement = after._replace(session=(me, number), number=number), m
        elif e.k and e.copy_of is None:
            t.outbox.append(Entry(e.type, e.dst, e.session, e.k, m))
        if e.k and e.copy_of is None and t.session is not None:
            t.seq = max(t.seq, m["seq"])
        if e.type == "Prescription" and e.copy_of is None:
            t.lease_ms = m["lease_ms"]
