"""The replacements that make mutants, and the exceptions with their reasons."""

from __future__ import annotations

MODULES = ("Station", "System")
"""The modules that are mutated by default."""

KINDS: dict[str, str] = {
    "conjunct": "a conjunct, the condition of an implication or that of a set filter is dropped",
    "disjunct": "a disjunct or an arm of a CASE is dropped",
    "action": "what a CASE dispatches to is not done: the station ignores the input",
    "guard": "a condition is negated, or a named guard is always true",
    "branch": "the THEN of an IF is never taken",
    "assignment": "a field of an EXCEPT, or a variable, keeps its value",
    "constant": "a phase, role, message type, reason, timer, command or truth value is another one",
    "number": "a number is off by one, a comparison takes or leaves its boundary",
    "member": "a member of a set, a part of a union or a subtraction is dropped",
}

NOT_MUTATED: dict[str, str] = {
    "Station.Phases": "read by the type invariant only",
    "Station.Roles": "read by the type invariant only",
    "Station.StationTypeInv": "a property",
    "Station.Nobody": "a name for a value; any that no station has will do",
    "Station.Broadcast": "a name for a value; any that no station has will do",
    "Station.NoSession": "a name for a value; any that no session has will do",
    "Station.Nothing": "a name for a value; any that tells the application nothing will do",
    "Station.LimitsSuffice": "an assumption on the constants",
    "Station.Step": "arm and stop: the models take the timers from Armed; the oracle sees it",
    "Station.Expired": "used by Step alone",
    "System.Init": "the start; its parts are mutated in Station.Initial",
    "System.vars": "the subscript of the actions",
    "System.view": "what TLC takes for a state",
    "System.Spec": "Init and Next put together",
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
    "prescribe": "proceed",
    "proceed": "abort",
    "accept": "refuse",
    "refuse": "accept",
    "complete": "abort",
    "abort": "complete",
}
"""Replacements for the names of commands."""
