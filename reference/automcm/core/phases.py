"""The phases of both roles, declared once (docs/protocol.md, section 4).

python-statemachine holds the declaration and checks it: every transition has a guard that names
the rules that may take it, and an event without a transition raises an exception.  A station uses
``TABLE``, which is compiled from the declaration at import; a test compares both completely.  A
missing transition is an error in this program, not in an input, because the rules decide first.
"""

from __future__ import annotations

from collections.abc import Callable

from statemachine import State as Phase_
from statemachine import StateMachine

from automcm_spec.vocabulary.application import Phase, Role

Way = tuple[Role, Phase, Phase, str]
"""Role, phase before, phase after, and the rule."""

RULES = (
    *("ADV-1", "ADV-3", "ADV-6", "ADV-7", "ADV-9"),
    *("PRE-1", "PRE-2", "PRE-3", "PRE-4", "PRE-5"),
    *("NEG-1", "NEG-2", "NEG-3", "NEG-6", "NEG-7", "NEG-8"),
    *("ACT-2", "ACT-3", "ACT-4", "END-1", "END-2", "END-8"),
)
"""The rules that take a transition."""


class _Guarded(StateMachine):
    """With ``machine.send(event, rule="ADV-1")`` only the guard ADV_1 holds."""


def _guard(of: str) -> Callable[[_Guarded, str], bool]:
    def guard(self: _Guarded, rule: str) -> bool:
        return rule == of

    return guard


_GUARDS = {rule.replace("-", "_"): rule for rule in RULES}
for _name, _rule in _GUARDS.items():
    setattr(_Guarded, _name, _guard(_rule))


class PrescriberPhases(_Guarded):
    """A prescriber: advertise, choose, prescribe, negotiate, act."""

    STANDALONE = Phase_(initial=True)
    ADVERTISING = Phase_()
    CHOOSING = Phase_()
    PRESCRIBING = Phase_()
    NEGOTIATING = Phase_()
    ACTUATING = Phase_()

    open = STANDALONE.to(ADVERTISING, cond="ADV_1")
    choose = ADVERTISING.to(CHOOSING, cond="PRE_1 or ADV_9")
    prescribe = CHOOSING.to(PRESCRIBING, cond="PRE_2") | NEGOTIATING.to(PRESCRIBING, cond="NEG_7")
    acknowledged = PRESCRIBING.to(NEGOTIATING, cond="PRE_4")
    refused = NEGOTIATING.from_(PRESCRIBING, NEGOTIATING, cond="NEG_7")
    accepted = ACTUATING.from_(PRESCRIBING, NEGOTIATING, cond="NEG_6")
    leave = (
        ADVERTISING.to(STANDALONE, cond="PRE_1 or END_1")
        | CHOOSING.to(STANDALONE, cond="PRE_1 or PRE_3 or PRE_5 or END_1")
        | PRESCRIBING.to(STANDALONE, cond="PRE_4 or NEG_7 or ACT_4 or END_1 or END_2")
        | NEGOTIATING.to(STANDALONE, cond="PRE_5 or NEG_7 or NEG_8 or ACT_4 or END_1 or END_2")
        | ACTUATING.to(STANDALONE, cond="ACT_2 or ACT_3 or ACT_4 or END_1 or END_2")
    )
    restart = STANDALONE.from_(
        ADVERTISING, CHOOSING, PRESCRIBING, NEGOTIATING, ACTUATING, cond="END_8"
    )


class ReceiverPhases(_Guarded):
    """A receiver: intend, wait, negotiate (verify), act."""

    STANDALONE = Phase_(initial=True)
    INTENDING = Phase_()
    WAITING = Phase_()
    NEGOTIATING = Phase_()
    ACTUATING = Phase_()

    join = STANDALONE.to(INTENDING, cond="ADV_3")
    wait = INTENDING.to(WAITING, cond="ADV_6")
    verify = NEGOTIATING.from_(INTENDING, WAITING, cond="NEG_1")
    refuse = NEGOTIATING.to(WAITING, cond="NEG_3")
    accept = NEGOTIATING.to(ACTUATING, cond="NEG_2")
    leave = (
        INTENDING.to(STANDALONE, cond="ACT_3 or END_1 or END_2")
        | WAITING.to(STANDALONE, cond="ADV_7 or ACT_3 or END_1 or END_2")
        | NEGOTIATING.to(STANDALONE, cond="ACT_3 or END_1 or END_2")
        | ACTUATING.to(STANDALONE, cond="ACT_2 or ACT_3 or ACT_4 or END_1 or END_2")
    )
    restart = STANDALONE.from_(INTENDING, WAITING, NEGOTIATING, ACTUATING, cond="END_8")


MACHINES: dict[Role, type[StateMachine]] = {
    "prescriber": PrescriberPhases,
    "receiver": ReceiverPhases,
}


def compiled(
    machines: dict[Role, type[StateMachine]],
) -> dict[tuple[Role, Phase, str, str], Phase]:
    """Every transition by role, phase, event and rule.  Raises KeyError for an unknown guard."""
    return {
        (role, source.id, transition.event, _GUARDS[name]): transition.target.id
        for role, machine in machines.items()
        for source in machine.states
        for transition in source.transitions
        for guard in transition.cond
        for name in str(guard).split(" or ")
    }


TABLE = compiled(MACHINES)
NEXT = {(role, phase, event): target for (role, phase, event, _), target in TABLE.items()}
WAYS: dict[Way, str] = {
    (role, phase, target, rule): event for (role, phase, event, rule), target in TABLE.items()
}
"""The event of each transition.  It is unique, so every transition that ``require`` allows is in
TABLE."""


def after(role: Role, phase: Phase, event: str) -> Phase:
    """The phase after ``event``.  Raises KeyError if the role declares no such transition."""
    return NEXT[role, phase, event]


def require(role: Role, before: Phase, after: Phase, rule: str) -> None:
    """Raises KeyError if ``rule`` may not lead ``role`` from one phase to the other."""
    if (role, before, after, rule) not in WAYS:
        raise KeyError(f"{rule} may not lead a {role} from {before} to {after}")
