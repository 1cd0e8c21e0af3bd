"""The state of a station: one immutable value with the fields of Station.tla.

In addition to the specification it holds content (whole messages, not only their identification),
the last ``seq``, and the times of the CAMs that counted.
"""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import NamedTuple

from automcm_spec.vocabulary.application import Phase, Role
from automcm_spec.vocabulary.messages import Advertisement, Intention, Reliable, Session

NOBODY = 0
_EMPTY: Mapping[int, int] = MappingProxyType({})
NO_INTENTIONS: Mapping[int, Intention] = MappingProxyType({})


class EntryKey(NamedTuple):
    """The identification of a repeated message; an Ack must match it completely (END-6)."""

    type: str
    to: int
    session: Session
    seq: int


class Timer(NamedTuple):
    """A named timer; ``entry`` for resend and giveup, ``station`` for forget."""

    name: str
    entry: EntryKey | None = None
    station: int = 0


ADVERTISE, DECIDE, HOLD, ANSWER = map(Timer, ("advertise", "decide", "hold", "answer"))
CAM, LEASE, QUARANTINE, BACKOFF = map(Timer, ("cam", "lease", "quarantine", "backoff"))


def key(message: Reliable) -> EntryKey:
    """The key of an outbox entry."""
    return EntryKey(message.type, message.dst, message.session, message.seq)


class State(NamedTuple):
    """The state of one station.  ``State()`` is the initial state."""

    phase: Phase = "STANDALONE"
    role: Role = "none"
    session: Session | None = None
    advertisement: Advertisement | None = None
    """In ADVERTISING, the message that is broadcast again (ADV-2)."""
    recorded: Mapping[int, Intention] = NO_INTENTIONS
    withdrawn: frozenset[int] = frozenset()
    target: int = NOBODY
    proposal: int = 0
    deciding: bool = False
    heard_ms: int | None = None
    """Generation time of the last CAM that counted in ACTUATING (ACT-5)."""
    first_cam_ms: tuple[int, int] | None = None
    """When the first CAM that counted in ACTUATING was generated and received (ACT-5)."""
    number: int = 0
    joined: Mapping[int, int] = _EMPTY
    """Newest session number joined, by prescriber (ADV-8)."""
    outbox: tuple[Reliable, ...] = ()
    """Reliable messages that are still being sent, the oldest first."""
    quarantine: bool = False
    backoff: bool = False
    lease_ms: int = 0
    """The lease of the last Prescription sent or received (ACT-4)."""
    seq: int = 0
    """The last seq used in the current session."""

    @property
    def bound(self) -> bool:
        """Whether the station is in a session."""
        return self.phase != "STANDALONE"

    @property
    def peer(self) -> int:
        """A receiver's prescriber, or a prescriber's target (from PRESCRIBING on)."""
        if self.role == "receiver" and self.session is not None:
            return self.session[0]
        return self.target

    @property
    def awaits_answer(self) -> bool:
        """Whether the prescriber waits for the answer to its current proposal (NEG-6)."""
        return self.phase == "PRESCRIBING" or (
            self.phase == "NEGOTIATING" and self.role == "prescriber" and not self.deciding
        )

    @property
    def marks(self) -> tuple[Session, ...]:
        """The sessions that its CAM names: its own, and those whose Fin is not acked (ACT-5)."""
        sessions = {message.session for message in self.outbox if message.type == "Fin"}
        if self.session is not None:
            sessions.add(self.session)
        return tuple(sorted(sessions))


def armed(me: int, st: State) -> list[Timer]:
    """The running timers; those of equal rank in the order of their messages, the oldest first."""
    timers: list[Timer] = []
    match st.phase:
        case "ADVERTISING":
            assert st.session is not None
            advertisement = EntryKey("Advertisement", 0, st.session, 1)
            timers = [ADVERTISE, Timer("resend", advertisement)]
        case "WAITING":
            timers = [HOLD]
        case "PRESCRIBING":
            timers = [LEASE]
        case "NEGOTIATING" if st.awaits_answer:
            timers = [ANSWER, LEASE]
        case "CHOOSING" | "NEGOTIATING":
            timers = [DECIDE]
        case "ACTUATING":
            timers = [CAM, LEASE]
    if st.outbox:
        keys = [key(message) for message in st.outbox]
        timers += [Timer("giveup", k) for k in keys]
        timers += [Timer("resend", k) for k in keys]
    if st.quarantine:
        timers.append(QUARANTINE)
    if st.joined:
        bound_to = st.session[0] if st.role == "receiver" and st.session else NOBODY
        for p in st.joined:
            if p != bound_to:
                timers.append(Timer("forget", None, p))
    if st.backoff:
        timers.append(BACKOFF)
    return timers
