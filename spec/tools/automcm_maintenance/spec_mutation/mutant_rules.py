"""The replacements that make mutants, and the exceptions with their reasons."""

from __future__ import annotations

from typing import Literal

MODULES = ("Station", "System")
"""The modules that are mutated by default."""

KINDS: dict[str, str] = {
    "conjunct": "a conjunct, or the condition of an implication or set filter, is dropped",
    "disjunct": "a disjunct or an arm of a CASE is dropped",
    "action": "the action of a CASE arm is dropped: the station ignores the input",
    "guard": "a condition is negated, or a named guard is always true",
    "branch": "the THEN of an IF is never taken",
    "assignment": "a field of an EXCEPT, or a variable, keeps its value",
    "constant": "a phase, role, message type, reason, timer, command or truth value is replaced",
    "number": "a number is off by one, or a comparison includes or excludes its bound",
    "member": "a member of a set, an operand of a union, or a subtraction is dropped",
}

How = Literal["property", "probe", "graph", "evaluation", "timeout", "counts"]
HOW: dict[How, str] = {
    "property": "a property that must hold is violated",
    "probe": "a probe reaches a situation that it did not reach before, or no longer reaches one",
    "graph": "an answer of one station differs from the oracle, and so from the reference",
    "evaluation": "TLC cannot evaluate the mutant",
    "timeout": "TLC exceeds three times the time without the mutant, or its memory",
    "counts": "only the recorded numbers of states or steps differ",
}
"""What a mutant may change.  Only the first kills it; the others, the most informative first, are
comparisons with the specification without the mutant."""

NOT_MUTATED: dict[str, str] = {
    "Station.Phases": "read by the type invariant only",
    "Station.Roles": "read by the type invariant only",
    "Station.StationTypeInv": "a property",
    "Station.Nobody": "names a value that no station has; any such value is right",
    "Station.Broadcast": "names a value that no station has; any such value is right",
    "Station.NoSession": "names a value that no session has; any such value is right",
    "Station.Nothing": "names the absence of an indication; any such value is right",
    "Station.LimitsSuffice": "an assumption on the constants",
    "Station.Step": "arms and stops timers; the models read Armed instead, the oracle reads it",
    "Station.Expired": "used only by Step",
    "System.Init": "the initial state; its parts are mutated in Station.Initial",
    "System.vars": "the subscript of the actions",
    "System.view": "what TLC distinguishes as states",
    "System.Spec": "combines Init and Next",
    "System.Excuses": "defines a history variable, which belongs to S-5",
    "System.Received": "defines a history variable, which belongs to S-6",
}
"""Definitions that are not mutated, and the reasons.  For properties see PROPERTIES_FROM."""

PROPERTIES_FROM = "Helpers of the properties"
"""A module is not mutated after the heading with these words, so that no property is weakened."""

HISTORY = {"excused", "received", "last"}
"""Variables whose next value is not mutated, because only properties read them."""

UNSEEN_FIELDS = {"rule", "again"}
"""Fields of an effect that are not mutated: no model reads them (the oracle's graph has them)."""

UNREAD_ZERO = "Cmd"
"""A zero as this operator's argument fills an unused field of a command."""

UNINDEXED = {"t", "timer", "of"}
"""Tuples of different types, whose index is not mutated: TLC could not evaluate the mutant.  For
the same reason, the conditions of a CASE without OTHER are not mutated; its actions are."""

NEIGHBOURS: dict[str, str] = {
    "STANDALONE": "WAITING",
    "ADVERTISING": "CHOOSING",
    "CHOOSING": "PRESCRIBING",
    "PRESCRIBING": "NEGOTIATING",
    "INTENDING": "WAITING",
    "WAITING": "NEGOTIATING",
    "NEGOTIATING": "ACTUATING",
    "ACTUATING": "NEGOTIATING",
    "prescriber": "receiver",
    "receiver": "prescriber",
    "Advertisement": "Intention",
    "Intention": "Prescription",
    "Prescription": "Acceptance",
    "Acceptance": "Prescription",
    "Fin": "Cancel",
    "Cancel": "Fin",
    "Ack": "Fin",
    # A reason matters where "busy" and "unknown_session" end a negotiation and "closed" a session.
    "busy": "unsafe",
    "unknown_session": "unsafe",
    "unsafe": "busy",
    "undecided": "busy",
    "closed": "abort",
    "not_selected": "closed",
    "not_needed": "closed",
    "no_agreement": "closed",
    "timeout": "closed",
    "cam_loss": "closed",
    "lease_expired": "closed",
    "abort": "closed",
    "as_sent": "none",
    "advertise": "backoff",
    "backoff": "advertise",
    "decide": "hold",
    "hold": "decide",
    "answer": "lease",
    "lease": "cam",
    "cam": "lease",
    "quarantine": "forget",
    "forget": "quarantine",
    "resend": "giveup",
    "giveup": "resend",
}
"""Constants and plausible replacements of the same kind.  "none" is omitted: it has three kinds."""
COMMANDS: dict[str, str] = {
    "request": "abort",
    "close": "proceed",
    "prescribe": "proceed",
    "proceed": "abort",
    "accept": "refuse",
    "refuse": "accept",
    "complete": "abort",
    "abort": "complete",
}
"""Replacements for the names of commands."""
