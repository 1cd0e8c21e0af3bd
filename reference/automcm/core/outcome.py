"""What the rules are made of: inputs, outcomes, rows, and the few things they all do.

A row is ``(rule, when, then)``.  Rule 1: nothing but a ``then`` changes a State.  Rule 2: a
``when`` only looks.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Generic, NamedTuple, Never, TypeVar

from automcm.core.phases import after
from automcm.core.state import State, Timer
from automcm_spec.vocabulary.application import (
    Abort,
    Accept,
    Command,
    Complete,
    Discarded,
    Fallback,
    Indication,
    Prescribe,
    Proceed,
    Refuse,
    Refused,
)
from automcm_spec.vocabulary.messages import (
    Acceptance,
    Ack,
    Cam,
    Cancel,
    CancelReason,
    Message,
    Prescription,
    RefusalReason,
    Reliable,
    Session,
    Trajectory,
)


class Me(NamedTuple):
    """What a station is configured with and the rules look at."""

    station_id: int
    max_rounds: int
    max_participants: int
    outbox_limit: int
    memory_limit: int


M_co = TypeVar("M_co", bound=Message, covariant=True)
I_contra = TypeVar("I_contra", contravariant=True)


class Heard(NamedTuple, Generic[M_co]):
    """A message, and the trajectory the application would intend (None: not concerned)."""

    message: M_co
    planned: Trajectory | None = None


@dataclass(frozen=True, slots=True)
class Expiry:
    """An armed timer has expired."""

    timer: Timer


@dataclass(frozen=True, slots=True)
class Restart:
    """The station comes back and remembers no session (END-8)."""


Input = Heard[Message] | Cam | Command | Expiry | Restart
OfSession = Prescribe | Proceed | Accept | Refuse | Complete | Abort
"""The commands that name a session: all but a request."""


class Outcome(NamedTuple):
    """What a rule decided."""

    state: State
    messages: tuple[Message, ...] = ()
    told: Indication | None = None
    again: tuple[Timer, ...] = ()
    """Timers armed anew although they ran before."""


class Row(NamedTuple, Generic[I_contra]):
    """``when(me, st, i)``: does this row decide?  ``then(me, st, i)``: the outcome."""

    rule: str
    when: Callable[[Me, State, I_contra], bool]
    then: Callable[[Me, State, I_contra], Outcome]
    declared: bool = True
    """phases.py declares how it changes the phase.  Only an ablation is exempt."""


Rules = dict[str, tuple[Row[Never], ...]]
"""The rows for each kind of input: what a station runs on.  Each takes inputs of that kind."""


def always(me: Me, st: State, i: object) -> bool:
    """The guard of a row without a condition."""
    return True


def ignore(me: Me, st: State, i: object) -> Outcome:
    """Nothing happens."""
    return Outcome(st)


def discard(me: Me, st: State, i: Heard[Message]) -> Outcome:
    """END-5: nothing happens but that it is reported."""
    return Outcome(st, told=Discarded(detail=i.message.type))


def refuse(me: Me, st: State, i: Command) -> Outcome:
    """CMD-1: the command changes nothing, and the application is told."""
    return Outcome(st, told=Refused(detail=i.name))


def moved(st: State, event: str) -> State:
    """``st`` in the phase after ``event`` (phases.py)."""
    return st._replace(phase=after(st.role, st.phase, event))


def post(st: State, *messages: Reliable) -> State:
    """``st`` with ``messages`` in the outbox; they were numbered from st.seq + 1 on."""
    return st._replace(outbox=st.outbox + messages, seq=st.seq + len(messages))


def without(st: State, *types: str) -> tuple[Reliable, ...]:
    """The outbox without entries of these types."""
    return tuple([message for message in st.outbox if message.type not in types])


def leave(st: State) -> State:
    """END-1: leaving ends the retransmission of Intention, Prescription and Acceptance."""
    return State(
        phase=after(st.role, st.phase, "leave"),
        number=st.number,
        joined=st.joined,
        outbox=without(st, "Intention", "Prescription", "Acceptance") if st.outbox else (),
        quarantine=st.quarantine,
        backoff=st.backoff,
    )


def leave_with(st: State, messages: Iterable[Reliable], told: Indication | None = None) -> Outcome:
    """Leave by its own decision, and send ``messages`` reliably.

    ACT-6: a receiver that breaks its commitment off so is quarantined.
    """
    sent = tuple(messages)
    breaks_off = (st.phase, st.role) == ("ACTUATING", "receiver")
    left = post(leave(st), *sent)._replace(seq=0, quarantine=st.quarantine or breaks_off)
    return Outcome(left, sent, told)


def own(st: State) -> Session:
    """The session of a bound station."""
    assert st.session is not None
    return st.session


def cancels(
    me: Me, st: State, to: Iterable[int], reason: CancelReason, first: int = 1
) -> list[Cancel]:
    """A Cancel to each, numbered from the first'th next seq on."""
    return [
        Cancel(src=me.station_id, dst=p, session=own(st), seq=st.seq + n, reason=reason)
        for n, p in enumerate(to, first)
    ]


def cancel_peer(reason: CancelReason) -> Callable[[Me, State, object], Outcome]:
    """Leave by a Cancel to the peer, and tell the application."""

    def then(me: Me, st: State, i: object) -> Outcome:
        told = Fallback(session=own(st), reason=reason)
        return leave_with(st, cancels(me, st, [st.peer], reason), told)

    return then


def others(st: State) -> list[int]:
    """END-1: whom an abort goes to."""
    if st.phase in ("ADVERTISING", "CHOOSING"):
        return sorted(st.recorded)
    return [st.peer]


def ack(me: Me, m: Message) -> Ack:
    """The Ack of a message (END-6)."""
    of = {"type": m.type, "seq": m.seq}
    fields = {"src": me.station_id, "dst": m.src, "session": m.session, "of": of}
    made: Ack = Ack.__pydantic_validator__.validate_python(fields)  # a third faster than Ack()
    return made


def acks(me: Me, m: Message) -> tuple[Ack, ...]:
    """What a message is answered with: an Ack, but an answer (seq 0) with nothing."""
    return (ack(me, m),) if m.seq else ()


def acked(me: Me, st: State, i: Heard[Message]) -> Outcome:
    """Nothing changes but that it is acked."""
    return Outcome(st, acks(me, i.message))


def refusal(me: Me, m: Prescription, reason: RefusalReason) -> Acceptance:
    """The answer to a Prescription of a session the station is not in (NEG-4, NEG-5)."""
    return Acceptance(
        src=me.station_id,
        dst=m.src,
        session=m.session,
        seq=0,
        proposal=m.proposal,
        accepted=False,
        reason=reason,
    )


def foreign(me: Me, st: State, i: Heard[Message]) -> bool:
    """END-4: is it of another session than the own one?"""
    return i.message.session != st.session


def room(me: Me, st: State) -> bool:
    """MEM-1: a session needs room in the outbox."""
    reserve = 1 + max(me.max_participants, me.max_rounds)
    return len(st.outbox) + reserve <= me.outbox_limit


def full(me: Me, st: State) -> bool:
    """MEM-1: no more stations are recorded."""
    return len(st.recorded) + len(st.withdrawn) >= me.max_participants


def stale(me: Me, st: State, i: OfSession) -> bool:
    """PRE-5: the answer of an application names session and proposal."""
    if isinstance(i, Prescribe | Accept | Refuse) and i.proposal != st.proposal:
        return True
    return i.session != st.session
