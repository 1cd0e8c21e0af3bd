"""The rules by id, and their places in Station.tla (docs/protocol.md)."""

from __future__ import annotations

import re
from functools import cache

from automcm_spec.support.paths import TLA
from automcm_spec.vocabulary.station import Cam, Command, Expire, Input, Receive

RULES: dict[str, str] = {
    "ADV-1": "a request opens a session at a station that is not bound",
    "ADV-2": "the Advertisement is broadcast every t_resend for t_advertise, never acked",
    "ADV-3": "a station concerned by an Advertisement joins and sends its Intention",
    "ADV-4": "a bound station ignores an Advertisement",
    "ADV-5": "which Intentions are recorded, acked, or answered that the session is closed",
    "ADV-6": "Ack, give-up or a Prescription ends the retransmission of the Intention",
    "ADV-7": "waiting ends by the hold timer at the latest",
    "ADV-8": "a station never rejoins a session, and remembers long enough",
    "ADV-9": "the application may close the window early, once somebody has answered",
    "PRE-1": "the window closes: the application chooses, or nobody has answered",
    "PRE-2": "the Prescription goes to the target, a Cancel to every other recorded station",
    "PRE-3": "proceeding alone cancels everybody recorded",
    "PRE-4": "Ack or Acceptance ends the retransmission of the Prescription; give-up cancels",
    "PRE-5": "no choice in time aborts; a stale choice is refused",
    "NEG-1": "a newer Prescription is acked and verified; copies are acked again",
    "NEG-2": "verified safe: the receiver accepts and is committed at once",
    "NEG-3": "not safe or not verified in time: the receiver refuses and waits",
    "NEG-4": "a bound station refuses the instruction of another session (busy)",
    "NEG-5": "a station in no session refuses an instruction (unknown_session)",
    "NEG-6": "the prescriber takes an Acceptance only for its session, target and proposal",
    "NEG-7": "a refusal leads to another proposal to the same target, or to the end",
    "NEG-8": "no answer in time cancels",
    "NEG-9": "want of an Ack does not end a commitment",
    "ACT-1": "both drive what was agreed, and nothing else",
    "ACT-2": "CAM loss ends the session, with a Cancel",
    "ACT-3": "Fin ends the session",
    "ACT-4": "the lease ends the session",
    "ACT-5": "only a newer CAM marked with the session counts as heard",
    "ACT-6": "a receiver that breaks a commitment off joins and requests nothing for a while",
    "END-1": "either application may abort; leaving ends what is being sent but Fin and Cancel",
    "END-2": "a Cancel from the peer ends the session; one before the choice withdraws",
    "END-3": "any copy of Fin and Cancel is acked, in any phase",
    "END-4": "a message of another session does nothing to the own one",
    "END-5": "a message that breaks the protocol is discarded and reported",
    "END-6": "an Ack counts only for the very message it names",
    "END-7": "a back-off follows a session without participants",
    "END-8": "after a restart numbers go on growing and nothing is joined for a while",
    "REL-1": "a reliable message is sent again every t_resend until acked or given up",
    "CMD-1": "a command for which the phase has no rule is refused",
    "MSG-1": "what is addressed to another is dropped silently",
    "MEM-1": "memory is bounded: outbox, participants, sessions remembered",
}
"""Every rule, in one line."""

_TESTS = "reference/tests/core/test_station.py"
NO_GRAPH: dict[str, str] = {
    "ACT-1": f"{_TESTS}::test_act_1_one_trajectory_is_handed_over_and_kept",
    "END-5 (malformed bytes)": f"{_TESTS}::test_end_5_malformed_bytes",
}
"""The rules that no graph of one station can show, with the tests that show them."""

OPERATOR = re.compile(r"^(\w+)(?:\([^=]*\))? +==", re.MULTILINE)
"""Matches the definition of an operator; group 1 is its name."""


@cache
def _lines() -> list[tuple[int, str, str]]:
    """Line number, operator and text of every line of Station.tla."""
    operator, lines = "", []
    for number, text in enumerate((TLA / "Station.tla").read_text().splitlines(), 1):
        if match := OPERATOR.match(text):
            operator = match[1]
        lines.append((number, operator, text))
    return lines


def handler(i: Input) -> str:
    """The operator of Station.tla that first handles an input."""
    match i:
        case Receive(message=message):
            return "On" + message.type
        case Command(name=name):
            return f"On{name.capitalize()}"
        case Expire(timer=timer):
            return _expired().get(timer[0], "OnExpiry")
    return f"On{i.kind.capitalize()}"


@cache
def _expired() -> dict[str, str]:
    """The operator that decides the expiry of a timer, if it is not OnExpiry itself."""
    called = re.findall(r't\[1\] = "(\w+)" +-> (On\w+)', operators()["OnExpiry"][1])
    return dict(called) | {"giveup": "GiveUpEntry"}  # OnGiveUp only calls it


def kind(i: Input) -> str:
    """The kind of an input: ``receive Fin``, ``command abort``, ``restart``."""
    match i:
        case Receive(message=message):
            return f"receive {message.type}"
        case Cam():
            return "receive CAM"
        case Expire(timer=timer):
            return f"expire {timer[0]}"
        case Command(name=name):
            return f"command {name}"
    return i.kind


def line(rule: str, i: Input) -> int:
    """The line of Station.tla where ``rule`` decides input ``i``; 0 if there is none."""
    where, wanted = _deciding(rule), handler(i)
    return next((n for n, operator in where if operator == wanted), where[0][0] if where else 0)


@cache
def _deciding(rule: str) -> list[tuple[int, str]]:
    """The lines of Station.tla that name a rule, with their operators."""
    return [(n, operator) for n, operator, text in _lines() if f'"{rule}"' in text]


@cache
def operators() -> dict[str, tuple[int, str]]:
    """Each operator of Station.tla: its first line, and its text."""
    found: dict[str, tuple[int, list[str]]] = {}
    for number, operator, text in _lines():
        found.setdefault(operator, (number, []))[1].append(text)
    return {operator: (first, "\n".join(texts)) for operator, (first, texts) in found.items()}


def cited(text: str) -> set[str]:
    """The rule ids in a text."""
    return set(re.findall(r"\b(?:ADV|PRE|NEG|ACT|END|REL|CMD|MSG|MEM)-\d\b", text))
