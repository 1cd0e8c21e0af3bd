"""The parts of the rules: inputs, outcomes, rows, and functions that several rules use.

A row is ``(rule, when, then)``.  Only a ``then`` makes a new State; a ``when`` has no effect.
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
    Close,
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
    """The configuration of a station, as far as the rules need it."""

    station_id: int
    max_rounds: int
    max_participants: int
    outbox_limit: int
    memory_limit: int
    t_resend: int
    clock_drift: int


M_co = TypeVar("M_co", bound=Message, covariant=True)
I_contra = TypeVar("I_contra", contravariant=True)


class Received(NamedTuple, Generic[M_co]):
    """A received message, and the trajectory that the application plans (None: not concerned)."""

    message: M_co
    planned: Trajectory | None = None


@dataclass(frozen=True, slots=True)
class Expiry:
    """An armed timer has expired."""

    timer: Timer


@dataclass(frozen=True, slots=True)
class Restart:
    """The station comes back and remembers no session (END-8)."""


class ReceivedCam(NamedTuple):
    """A received CAM, and when it was received, in ms of the station's clock (ACT-5)."""

    message: Cam
    at_ms: int


Input = Received[Message] | ReceivedCam | Command | Expiry | Restart
OfSession = Close | Prescribe | Proceed | Accept | Refuse | Complete | Abort
"""The commands that name a session: all but a request."""


class Outcome(NamedTuple):
    """The outcome of a rule: the next state, messages to send, an indication."""

    state: State
    messages: tuple[Message, ...] = ()
    indication: Indication | None = None
    again: tuple[Timer, ...] = ()
    """Running timers that restart."""


class Row(NamedTuple, Generic[I_contra]):
    """``when(me, st, i)``: does this row decide?  ``then(me, st, i)``: the outcome."""

    rule: str
    when: Callable[[Me, State, I_contra], bool]
    then: Callable[[Me, State, I_contra], Outcome]
    declared: bool = True
    """Whether phases.py must declare the row's change of the phase.  False only for ablations."""


Rules = dict[str, tuple[Row[Never], ...]]
"""The rows of a station for each kind of input.  Each row takes inputs of that kind."""


def always(me: Me, st: State, i: object) -> bool:
    """The guard of a row without a condition."""
    return True


def ignore(me: Me, st: State, i: object) -> Outcome:
    """Change nothing."""
    return Outcome(st)


def discard(me: Me, st: State, i: Received[Message]) -> Outcome:
    """END-5: change nothing; indicate the discarded message."""
    return Outcome(st, indication=Discarded(detail=i.message.type))


def refuse(me: Me, st: State, i: Command) -> Outcome:
    """CMD-1: change nothing; indicate the refused command."""
    return Outcome(st, indication=Refused(detail=i.name))


def moved(st: State, event: str) -> State:
    """``st`` in the phase after ``event`` (phases.py)."""
    return st._replace(phase=after(st.role, st.phase, event))


def post(st: State, *messages: Reliable) -> State:
    """``st`` with ``messages``, whose numbers begin with st.seq + 1, in the outbox."""
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


def leave_with(
    st: State, messages: Iterable[Reliable], indication: Indication | None = None
) -> Outcome:
    """Leave on the station's own decision, and send ``messages`` reliably.

    ACT-6: a receiver that breaks off its commitment in this way is quarantined.
    """
    sent = tuple(messages)
    breaks_off = (st.phase, st.role) == ("ACTUATING", "receiver")
    left = post(leave(st), *sent)._replace(seq=0, quarantine=st.quarantine or breaks_off)
    return Outcome(left, sent, indication)


def own(st: State) -> Session:
    """The session of a bound station."""
    assert st.session is not None
    return st.session


def cancels(
    me: Me, st: State, to: Iterable[int], reason: CancelReason, first: int = 1
) -> list[Cancel]:
    """A Cancel to each station; the first has the number st.seq + ``first``."""
    return [
        Cancel(src=me.station_id, dst=p, session=own(st), seq=st.seq + n, reason=reason)
        for n, p in enumerate(to, first)
    ]


def cancel_peer(reason: CancelReason) -> Callable[[Me, State, object], Outcome]:
    """Leave with a Cancel to the peer; indicate the fallback."""

    def then(me: Me, st: State, i: object) -> Outcome:
        indication = Fallback(session=own(st), reason=reason)
        return leave_with(st, cancels(me, st, [st.peer], reason), indication)

    return then


def others(st: State) -> list[int]:
    """END-1: the stations to which an abort sends a Cancel."""
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
    """The Ack of a message; none for an answer (seq 0)."""
    return (ack(me, m),) if m.seq else ()


def acked(me: Me, st: State, i: Received[Message]) -> Outcome:
    """Ack the message; change nothing."""
    return Outcome(st, acks(me, i.message))


def refusal(me: Me, m: Prescription, reason: RefusalReason) -> Acceptance:
    """The answer to a Prescription of a session that the station is not in (NEG-4, NEG-5)."""
    return Acceptance(
        src=me.station_id,
        dst=m.src,
        session=m.session,
        seq=0,
        proposal=m.proposal,
        accepted=False,
        reason=reason,
    )


def foreign(me: Me, st: State, i: Received[Message]) -> bool:
    """END-4: does the message belong to another session than the station's own?"""
    return i.message.session != st.session


def room(me: Me, st: State) -> bool:
    """MEM-1: has the outbox room for a session?"""
    reserve = 1 + max(me.max_participants, me.max_rounds)
    return len(st.outbox) + reserve <= me.outbox_limit


def full(me: Me, st: State) -> bool:
    """MEM-1: can no further station be recorded?"""
    return len(st.recorded) + len(st.withdrawn) >= me.max_participants


def stale(me: Me, st: State, i: OfSession) -> bool:
    """PRE-5: does the command name another session or proposal than the current one?"""
    if isinstance(i, Prescribe | Accept | Refuse) and i.proposal != st.proposal:
        return True
    return i.session != st.session
