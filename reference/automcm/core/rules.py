"""The tables of rows for each kind of input, and ``decide``, which evaluates them.

For each kind of input there is a list of rows, ``(rule, when, then)``.  The first row whose
``when`` holds decides; the rows are in the order of the specification (Station.tla).  ``decide`` is
a pure function of a state and an input, and has no notion of time: rules arm and stop timers by
changing the state, and ``state.armed`` derives the running timers from it.
"""

from __future__ import annotations

from collections.abc import Callable

from automcm.core.actuating import CAM, COMPLETE, FIN
from automcm.core.advertising import (
    ADVERTISEMENT,
    INTENTION,
    REQUEST,
    advertise_again,
    forget,
    hold_ends,
)
from automcm.core.ending import ABORT, ACK, CANCEL, FIRST, drop, restart
from automcm.core.negotiating import ACCEPT, ACCEPTANCE, PRESCRIPTION, REFUSE, refuse_proposal
from automcm.core.outcome import (
    Expiry,
    Input,
    Me,
    Outcome,
    Received,
    ReceivedCam,
    Restart,
    Row,
    Rules,
    always,
    cancel_peer,
    cancels,
    leave_with,
    others,
    own,
)
from automcm.core.phases import require
from automcm.core.prescribing import CLOSE, PRESCRIBE, PROCEED, WINDOW_ENDS
from automcm.core.state import State, Timer, key
from automcm_spec.vocabulary.application import Fallback, Undecided
from automcm_spec.vocabulary.messages import Reliable


def undecided(me: Me, st: State, i: Expiry) -> Outcome:
    """NEG-3: refuse, because the application has not verified in time."""
    indication = Undecided(session=own(st), proposal=st.proposal)
    return refuse_proposal(me, st, "undecided", indication)


def no_choice(me: Me, st: State, i: Expiry) -> Outcome:
    """PRE-5: leave, because the application has not chosen in time."""
    indication = Fallback(session=own(st), reason="abort")
    return leave_with(st, cancels(me, st, others(st), "abort"), indication)


def entry_of(st: State, timer: Timer) -> Reliable:
    """The outbox entry of a timer."""
    return next(entry for entry in st.outbox if key(entry) == timer.entry)


def send_again(me: Me, st: State, i: Expiry) -> Outcome:
    """REL-1: repeat the message."""
    return Outcome(st, (entry_of(st, i.timer),))


def gives_up(type_: str) -> Callable[[Me, State, Expiry], bool]:
    """Has the timer's entry this type?"""
    return lambda me, st, i: i.timer.entry is not None and i.timer.entry.type == type_


def give_up(event: str | None) -> Callable[[Me, State, Expiry], Outcome]:
    """REL-1: remove the entry from the outbox; ``event`` changes the phase."""
    return lambda me, st, i: drop(st, entry_of(st, i.timer), event)


TIMERS: dict[str, tuple[Row[Expiry], ...]] = {
    "advertise": WINDOW_ENDS,
    "resend": (
        Row("ADV-2", gives_up("Advertisement"), advertise_again),
        Row("REL-1", always, send_again),
    ),
    "giveup": (
        Row("ADV-6", gives_up("Intention"), give_up("wait")),
        Row("PRE-4", gives_up("Prescription"), cancel_peer("timeout")),
        Row("NEG-9", gives_up("Acceptance"), give_up(None)),
        Row("REL-1", always, give_up(None)),
    ),
    "decide": (
        Row("NEG-3", lambda me, st, i: st.role == "receiver", undecided),
        Row("PRE-5", always, no_choice),
    ),
    "hold": (Row("ADV-7", always, hold_ends),),
    "answer": (Row("NEG-8", always, cancel_peer("timeout")),),
    "cam": (Row("ACT-2", always, cancel_peer("cam_loss")),),
    "lease": (Row("ACT-4", always, cancel_peer("lease_expired")),),
    "quarantine": (Row("END-8", always, lambda me, st, i: Outcome(st._replace(quarantine=False))),),
    "forget": (Row("ADV-8", always, forget),),
    "backoff": (Row("END-7", always, lambda me, st, i: Outcome(st._replace(backoff=False))),),
}

MESSAGES: Rules = {
    "Advertisement": FIRST + ADVERTISEMENT,
    "Intention": FIRST + INTENTION,
    "Prescription": FIRST + PRESCRIPTION,
    "Acceptance": FIRST + ACCEPTANCE,
    "Fin": FIRST + FIN,
    "Cancel": FIRST + CANCEL,
    "Ack": FIRST + ACK,
}

COMMANDS: Rules = {
    "request": REQUEST,
    "close": CLOSE,
    "prescribe": PRESCRIBE,
    "proceed": PROCEED,
    "accept": ACCEPT,
    "refuse": REFUSE,
    "complete": COMPLETE,
    "abort": ABORT,
}

RESTART = (Row("END-8", always, restart),)

RULES: Rules = {
    **{f"receive {name}": rows for name, rows in MESSAGES.items()},
    **{f"command {name}": rows for name, rows in COMMANDS.items()},
    **{f"expire {name}": rows for name, rows in TIMERS.items()},
    "receive CAM": CAM,
    "restart": RESTART,
}


_RECEIVED = {name: f"receive {name}" for name in MESSAGES}
_EXPIRED = {name: f"expire {name}" for name in TIMERS}


def kind(i: Input) -> str:
    """The key of the rows for ``i`` in RULES."""
    if isinstance(i, Received):
        return _RECEIVED[i.message.type]
    if isinstance(i, ReceivedCam):
        return "receive CAM"
    if isinstance(i, Expiry):
        return _EXPIRED[i.timer.name]
    return "restart" if isinstance(i, Restart) else f"command {i.name}"


def decide(me: Me, st: State, i: Input, rules: Rules = RULES) -> tuple[str, Outcome]:
    """The rule and the outcome of the first row that applies; without one, no rule and no change.

    Raises KeyError if the row changes the phase but phases.py does not declare this for its rule.
    """
    rows: tuple[Row[Input], ...] = rules[kind(i)]  # type: ignore[assignment]  # rows of this kind take i
    for rule, when, then, declared in rows:
        if when(me, st, i):
            outcome = then(me, st, i)
            to = outcome.state
            if to is not st and to.phase != st.phase and declared:
                require((st if st.bound else to).role, st.phase, to.phase, rule)
            return rule, outcome
    return "", Outcome(st)
