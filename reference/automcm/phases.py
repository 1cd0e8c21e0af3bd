"""The phases of both roles, declared once (docs/protocol.md, section 4).

python-statemachine holds the declaration: it checks it, and draws the diagrams.  A station
walks ``TABLE``, compiled from it at import; a test enumerates that both agree.  A pair that is
not in the table is an error in this program, never an input's fault: rules decide first.
"""

from __future__ import annotations

from typing import Literal

from statemachine import State as Phase_
from statemachine import StateMachine

Phase = Literal[
    "STANDALONE",
    "ADVERTISING",
    "CHOOSING",
    "PRESCRIBING",
    "INTENDING",
    "WAITING",
    "NEGOTIATING",
    "ACTUATING",
]
Role = Literal["none", "prescriber", "receiver"]


class PrescriberPhases(StateMachine):
    """A prescriber: advertise, choose, prescribe, negotiate, act."""

    STANDALONE = Phase_(initial=True)
    ADVERTISING = Phase_()
    CHOOSING = Phase_()
    PRESCRIBING = Phase_()
    NEGOTIATING = Phase_()
    ACTUATING = Phase_()

    open = STANDALONE.to(ADVERTISING)  # ADV-1
    choose = ADVERTISING.to(CHOOSING)  # PRE-1
    prescribe = CHOOSING.to(PRESCRIBING) | NEGOTIATING.to(PRESCRIBING)  # PRE-2, NEG-7
    acknowledged = PRESCRIBING.to(NEGOTIATING)  # PRE-4
    refused = PRESCRIBING.to(NEGOTIATING) | NEGOTIATING.to(NEGOTIATING)  # NEG-7
    accepted = PRESCRIBING.to(ACTUATING) | NEGOTIATING.to(ACTUATING)  # NEG-6
    leave = (
        ADVERTISING.to(STANDALONE)
        | CHOOSING.to(STANDALONE)
        | PRESCRIBING.to(STANDALONE)
        | NEGOTIATING.to(STANDALONE)
        | ACTUATING.to(STANDALONE)
    )


class ReceiverPhases(StateMachine):
    """A receiver: intend, wait, negotiate (verify), act."""

    STANDALONE = Phase_(initial=True)
    INTENDING = Phase_()
    WAITING = Phase_()
    NEGOTIATING = Phase_()
    ACTUATING = Phase_()

    join = STANDALONE.to(INTENDING)  # ADV-3
    wait = INTENDING.to(WAITING)  # ADV-6
    verify = INTENDING.to(NEGOTIATING) | WAITING.to(NEGOTIATING)  # NEG-1
    refuse = NEGOTIATING.to(WAITING)  # NEG-3
    accept = NEGOTIATING.to(ACTUATING)  # NEG-2
    leave = (
        INTENDING.to(STANDALONE)
        | WAITING.to(STANDALONE)
        | NEGOTIATING.to(STANDALONE)
        | ACTUATING.to(STANDALONE)
    )


MACHINES: dict[Role, type[StateMachine]] = {
    "prescriber": PrescriberPhases,
    "receiver": ReceiverPhases,
}


def _compile() -> dict[tuple[Role, str, str], Phase]:
    return {
        (role, source.id, transition.event): transition.target.id
        for role, machine in MACHINES.items()
        for source in machine.states
        for transition in source.transitions
    }


TABLE = _compile()


def after(role: Role, phase: Phase, event: str) -> Phase:
    """The phase after ``event``.  Raises KeyError if the role declares no such transition."""
    return TABLE[role, phase, event]
