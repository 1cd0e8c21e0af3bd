"""The handlers of Station.tla as decision trees: which guards lead to which rule.

Each guard has the very text that it has in Station.tla, in the order in which it stands there, and
the same test in Python on a state and an input of the oracle.  A leaf names the rule that decides
and what it does.  The tests hold every leaf against the oracle.

What a leaf does is written ``send TYPE …``, ``told NAME …``, ``phase NAME`` (only if it changes),
``arm TIMER``, ``stop TIMER``; what depends on more than the guards ends in ``?``.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any, NamedTuple

from automcm_spec.oracle import Answer, Oracle

Json = Any
ME, NOBODY, BROADCAST = 1, 0, 0


class State(NamedTuple):
    """A state of the oracle (``automcm_spec.oracle.STATE_FIELDS``)."""

    phase: str
    role: str
    session: Json
    recorded: Json
    withdrawn: Json
    target: int
    proposal: int
    deciding: bool
    heard: bool
    number: int
    joined: Json
    outbox: Json
    quarantine: bool
    backoff: bool


class Message(NamedTuple):
    """A message of the oracle."""

    type: str = ""
    src: int = 0
    dst: int = 0
    session: Json = None
    seq: int = 0
    proposal: int = 0
    accepted: bool = False
    reason: str = "none"
    of: Json = None


class Command(NamedTuple):
    """A command of the oracle."""

    name: str = ""
    session: Json = None
    proposal: int = 0
    target: int = 0


class Cam(NamedTuple):
    """A CAM of the oracle."""

    src: int = 0
    marks: Json = ()
    newer: bool = False


class Entry(NamedTuple):
    """An entry of the outbox."""

    type: str = ""
    to: int = 0
    session: Json = None
    seq: int = 0
    accepted: bool = False


NOTHING = Message(), Command(), Cam(), Entry()


class Facts:
    """What guards look at: a state, an input, and the constants of the oracle.

    The names are those of Station.tla; what the input is not is empty.  ``full``: no guard finds
    room, whatever the constants.
    """

    __slots__ = ("c", "concerned", "e", "full", "i", "limits", "m", "st", "t")

    def __init__(self, state: Json, i: Json, limits: dict[str, Json], full: bool = False) -> None:
        self.st = State(*state)
        self.limits, self.full = limits, full
        self.m, self.c, self.i, self.e = NOTHING
        self.concerned = False
        self.t: Json = [""]
        if i[0] == "receive":
            self.m, self.concerned = Message(*i[1]), i[2]
        elif i[0] == "command":
            self.c = Command(*i[1:])
        elif i[0] == "cam":
            self.i = Cam(*i[1:])
        elif i[0] == "expire":
            self.t = i[1]
            if self.t[0] in ("resend", "giveup"):
                self.e = Entry(*self.t[1])

    # -- operators of Station.tla

    @property
    def bound(self) -> bool:
        """Bound(st)."""
        return self.st.phase != "STANDALONE"

    def inside(self, session: Json) -> bool:
        """In(st, session)."""
        return self.bound and bool(self.st.session == session)

    @property
    def peer(self) -> int:
        """Peer(st)."""
        if self.st.role != "receiver":
            return self.st.target
        prescriber: int = self.st.session[0]
        return prescriber

    @property
    def reserve(self) -> int:
        """Reserve (MEM-1)."""
        return 1 + int(max(self.limits["MaxRounds"], self.limits["MaxParticipants"]))

    @property
    def room(self) -> bool:
        """Room(st)."""
        used = len(self.st.outbox) + self.reserve
        return not self.full and bool(used <= self.limits["OutboxLimit"])

    @property
    def room_to_record(self) -> bool:
        """RoomToRecord(st)."""
        known = len(self.st.recorded) + len(self.st.withdrawn)
        return not self.full and bool(known < self.limits["MaxParticipants"])

    @property
    def room_to_remember(self) -> bool:
        """RoomToRemember(st, m.src)."""
        known = any(j[0] == self.m.src for j in self.st.joined)
        return known or (not self.full and len(self.st.joined) < self.limits["MemoryLimit"])

    @property
    def joined_since(self) -> bool:
        """~NewerThanJoined(st, m.session)."""
        p, number = self.m.session
        return any(j[0] == p and j[1] >= number for j in self.st.joined)

    @property
    def awaits_answer(self) -> bool:
        """AwaitsAnswer(st)."""
        st = self.st
        return st.phase == "PRESCRIBING" or (st.phase == "NEGOTIATING" and not st.deciding)

    @property
    def mine(self) -> list[Json]:
        """Fin and Cancel still being sent to the sender of m about its session."""
        m = self.m
        return [
            e
            for e in self.st.outbox
            if e[1] == m.src and e[2] == m.session and e[0] in ("Fin", "Cancel")
        ]

    @property
    def acked(self) -> list[Json]:
        """The entries that the Ack m matches (AckMatches)."""
        m = self.m
        return [
            e
            for e in self.st.outbox
            if e[1] == m.src and e[2] == m.session and m.of[1] != 0 and m.of == [e[0], e[3]]
        ]

    @property
    def types(self) -> set[str]:
        """The types of these entries."""
        return {e[0] for e in self.acked}


Test = Callable[[Facts], bool]


@dataclass(frozen=True, slots=True)
class Guard:
    """A condition of Station.tla.

    ``where`` is the operator it stands in, ``text`` what stands there, ``shows`` the values worth
    showing, ``yes`` and ``no`` say in words that it holds and that it does not.
    """

    where: str
    text: str
    test: Test
    shows: tuple[str, ...]
    yes: str
    no: str


@dataclass(frozen=True, slots=True)
class Leaf:
    """The end of a way through a tree: the rule, and what it does."""

    rule: str
    does: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class Choice:
    """IF guard THEN then ELSE otherwise."""

    guard: Guard
    then: Tree
    otherwise: Tree


Tree = Choice | Leaf
Way = tuple[tuple[Guard, bool], ...]
"""The guards from the root to a leaf, and whether each must hold."""


def leaf(rule: str, *does: str) -> Leaf:
    """A leaf; ``"stop cam, lease?"`` is short for ``stop cam`` and ``stop lease?``."""
    parted = (text.split(" ", 1) for text in does)
    return Leaf(rule, tuple(f"{verb} {what}" for verb, all_ in parted for what in all_.split(", ")))


def all_of(guards: list[Guard], then: Tree, otherwise: Tree) -> Tree:
    """IF all guards hold THEN then ELSE otherwise."""
    for guard in reversed(guards):
        then = Choice(guard, then, otherwise)
    return then


def decide(tree: Tree, facts: Facts) -> Leaf:
    """The leaf that these facts lead to."""
    while isinstance(tree, Choice):
        tree = tree.then if tree.guard.test(facts) else tree.otherwise
    return tree


def ways(tree: Tree, way: Way = ()) -> Iterator[tuple[Way, Leaf]]:
    """Every way to a leaf, in the order of Station.tla."""
    if isinstance(tree, Leaf):
        yield way, tree
        return
    yield from ways(tree.then, (*way, (tree.guard, True)))
    yield from ways(tree.otherwise, (*way, (tree.guard, False)))


def done(oracle: Oracle, answer: Answer) -> set[str]:
    """What an answer of the oracle does, in the words of a leaf."""
    effect, told = answer.effect, answer.effect.told
    before, after = oracle.states[answer.state][0], oracle.states[answer.next][0]
    what = {sent(m) for m in effect.messages}
    what |= {" ".join(["told", *told])} if told != ["nothing"] else set()
    what |= {f"phase {after}"} if after != before else set()
    what |= {f"arm {t[0]}" for t in effect.arm} | {f"stop {t[0]}" for t in effect.stop}
    return what


def sent(message: Json) -> str:
    """``send TYPE``; of an Acceptance also ``accepted`` or ``refused``, and a reason if any."""
    m = Message(*message)
    words = ["send", m.type]
    if m.type == "Acceptance":
        words.append("accepted" if m.accepted else "refused")
    if m.reason != "none":
        words.append(m.reason)
    return " ".join(words)
