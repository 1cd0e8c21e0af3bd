"""What leads to where a case begins: scripts, in the oracle's values.

A script is a list of inputs, and of what only the kit can say: ``["wait", ms]`` lets time pass,
``["at", timer, input]`` gives an input at the very time at which a timer expires, and ``["with",
fields, input]`` gives one whose message or command has other values in these fields, and
``["older", ms, cam]`` a CAM that was generated so long before the last one that counted.
"""

from __future__ import annotations

from typing import Any

from automcm_conformance.malformed import named_by_acks
from automcm_conformance.protocol import DEFAULTS
from automcm_conformance.wire import ME, STRANGER
from automcm_conformance.wire import PLAIN as VALUES
from automcm_spec.parameters import derived

Json = Any
Script = list[Json]
USUAL = DEFAULTS | {"backoff_min": 750, "backoff_max": 750}
GIVEUP_MS = derived(USUAL)["t_giveup"]
Y, MINE, THEIRS = 2, [1, 1], [2, 1]


def received(
    type_: str,
    session: Json,
    k: int = 1,
    accepted: bool = False,
    of: Json = None,
    source: int = Y,
) -> Json:
    """A message of a peer; ``seq`` is that of the oracle."""
    proposal = k if type_ in ("Prescription", "Acceptance") else 0
    refused = type_ == "Cancel" or (type_ == "Acceptance" and not accepted)
    to = 0 if type_ == "Advertisement" else 1
    seq = 0 if type_ == "Ack" else k
    reason = "as_sent" if refused else "none"
    message = [type_, source, to, session, seq, proposal, accepted, reason, of or ["none", 0]]
    return ["receive", message, type_ != "Ack"]


def command(name: str, session: Json, k: int = 0, target: int = 0) -> Json:
    """A command of the application, as the oracle writes it."""
    return ["command", name, session, k, target]


def entry(type_: str, to: int, session: Json, k: int = 1, accepted: bool = False) -> Json:
    """An entry of the outbox, as the oracle writes it."""
    return [type_, to, session, k, accepted]


ADVERTISED = received("Advertisement", THEIRS)
INTENTION_ACKED = received("Ack", THEIRS, of=["Intention", 1])
INSTRUCTED = received("Prescription", THEIRS)
ACCEPT, REFUSE = command("accept", THEIRS, 1), command("refuse", THEIRS, 1)
ACCEPTANCE_ACKED = received("Ack", THEIRS, of=["Acceptance", 1])
HEARD_THEM = ["cam", Y, [THEIRS], True]
FINISHED = received("Fin", THEIRS)
REQUEST = command("request", [0, 0])
INTENDED = received("Intention", MINE)
WINDOW = ["expire", ["advertise"]]
PRESCRIBE = command("prescribe", MINE, 1, Y)
PRESCRIPTION_ACKED = received("Ack", MINE, of=["Prescription", 1])
ACCEPTED, REFUSED = received("Acceptance", MINE, accepted=True), received("Acceptance", MINE)
HEARD_TARGET = ["cam", Y, [MINE], True]
COMPLETE, ABORT = command("complete", MINE), command("abort", MINE)
PROCEED, LEAVE = command("proceed", MINE), command("abort", THEIRS)
CANCELLED, WITHDRAWN = received("Cancel", THEIRS), received("Cancel", MINE)
INSTRUCTED_2, ACCEPT_2 = received("Prescription", THEIRS, 2), command("accept", THEIRS, 2)
PRESCRIBE_2 = command("prescribe", MINE, 2, Y)
ACCEPTED_2 = received("Acceptance", MINE, 2, accepted=True)
PAUSE = ["wait", 30]

NEXT = [2, 2]
AGAIN = [
    received("Advertisement", NEXT),
    received("Ack", NEXT, of=["Intention", 1]),
    received("Prescription", NEXT),
    command("accept", NEXT, 1),
    received("Ack", NEXT, of=["Acceptance", 1]),
    ["wait", 400],
    ["cam", Y, [NEXT], True],
]
"""Another session of the same prescriber, in which a CAM has been heard."""

WAITING = [ADVERTISED, INTENTION_ACKED]
VERIFYING = [*WAITING, INSTRUCTED]
COMMITTED = [*VERIFYING, ACCEPT]
CHOOSING = [REQUEST, INTENDED, WINDOW]
PRESCRIBING = [*CHOOSING, PRESCRIBE]
ACTING = [*PRESCRIBING, ACCEPTED]

TIMERS: dict[str, list[Script]] = {
    "advertise": [[REQUEST, WINDOW], [REQUEST, ["wait", 30], INTENDED, WINDOW]],
    "resend Advertisement": [
        [REQUEST, ["expire", ["resend", entry("Advertisement", 0, MINE)]]],
    ],
    "resend Intention": [[ADVERTISED, ["expire", ["resend", entry("Intention", Y, THEIRS)]]]],
    "resend Prescription": [[*PRESCRIBING, ["expire", ["resend", entry("Prescription", Y, MINE)]]]],
    "resend Acceptance": [
        [*COMMITTED, ["expire", ["resend", entry("Acceptance", Y, THEIRS, accepted=True)]]],
        [*VERIFYING, REFUSE, ["expire", ["resend", entry("Acceptance", Y, THEIRS)]]],
    ],
    "resend Fin": [[*ACTING, COMPLETE, ["expire", ["resend", entry("Fin", Y, MINE)]]]],
    "resend Cancel": [[*ACTING, ABORT, ["expire", ["resend", entry("Cancel", Y, MINE)]]]],
    "decide choice": [[*CHOOSING, ["expire", ["decide"]]]],
    "decide proposal": [[*PRESCRIBING, REFUSED, ["expire", ["decide"]]]],
    "decide verdict": [[*VERIFYING, ["expire", ["decide"]]]],
    "hold": [[*WAITING, ["expire", ["hold"]]], [*VERIFYING, REFUSE, ["expire", ["hold"]]]],
    "answer": [[*PRESCRIBING, ["wait", 30], PRESCRIPTION_ACKED, ["expire", ["answer"]]]],
    "cam prescriber": [
        [*ACTING, ["expire", ["cam"]]],
        [*ACTING, ["wait", 400], HEARD_TARGET, ["wait", 333], HEARD_TARGET, ["expire", ["cam"]]],
    ],
    "cam receiver": [
        [*COMMITTED, ACCEPTANCE_ACKED, ["expire", ["cam"]]],
        [*COMMITTED, ACCEPTANCE_ACKED, ["wait", 400], HEARD_THEM, ["expire", ["cam"]]],
        [*COMMITTED, ACCEPTANCE_ACKED, HEARD_THEM, FINISHED, *AGAIN, ["expire", ["cam"]]],
    ],
    "lease prescriber": [
        [*ACTING, ["expire", ["lease"]]],
        [*CHOOSING, PAUSE, PRESCRIBE, ["wait", 250], ACCEPTED, PAUSE, ["expire", ["lease"]]],
        [*PRESCRIBING, PAUSE, PRESCRIPTION_ACKED, PAUSE, ACCEPTED, ACCEPTED, ["expire", ["lease"]]],
        [
            *PRESCRIBING,
            PAUSE,
            REFUSED,
            PAUSE,
            PRESCRIBE_2,
            PAUSE,
            ACCEPTED_2,
            ["expire", ["lease"]],
        ],
    ],
    "lease receiver": [
        [*COMMITTED, ACCEPTANCE_ACKED, ["expire", ["lease"]]],
        [
            ADVERTISED,
            PAUSE,
            INSTRUCTED,
            PAUSE,
            ACCEPT,
            PAUSE,
            ACCEPTANCE_ACKED,
            ["expire", ["lease"]],
        ],
        [*VERIFYING, PAUSE, ACCEPT, PAUSE, INSTRUCTED, ACCEPTANCE_ACKED, ["expire", ["lease"]]],
        [*VERIFYING, REFUSE, PAUSE, INSTRUCTED_2, PAUSE, ACCEPT_2, PAUSE, HEARD_THEM]
        + [received("Ack", THEIRS, of=["Acceptance", n]) for n in (1, 2)]
        + [["expire", ["lease"]]],
    ],
    "giveup Intention": [[ADVERTISED, ["expire", ["giveup", entry("Intention", Y, THEIRS)]]]],
    "giveup Prescription": [[*PRESCRIBING, ["expire", ["giveup", entry("Prescription", Y, MINE)]]]],
    "giveup Acceptance": [
        [*VERIFYING, REFUSE, ["expire", ["giveup", entry("Acceptance", Y, THEIRS)]]]
    ],
    "giveup Fin": [[*ACTING, COMPLETE, ["expire", ["giveup", entry("Fin", Y, MINE)]]]],
    "giveup Cancel": [[*ACTING, ABORT, ["expire", ["giveup", entry("Cancel", Y, MINE)]]]],
    "quarantine": [[["restart"], ["expire", ["quarantine"]]]],
    "forget": [
        [*WAITING, FINISHED, ["expire", ["forget", Y]]],
        [*WAITING, ["wait", 5000], FINISHED, ["expire", ["forget", Y]]],
    ],
    "backoff": [[REQUEST, WINDOW, ["expire", ["backoff"]], REQUEST]],
}
"""What leads to the arming of each timer; it ends with its expiry."""

_INTENTION, _PRESCRIPTION = (
    entry("Intention", Y, THEIRS),
    entry("Prescription", Y, MINE),
)
_RESTART = ["restart"]
_DUE: list[tuple[Script, Json, Script]] = [
    ([ADVERTISED], ["giveup", _INTENTION], [LEAVE, INSTRUCTED, CANCELLED, _RESTART]),
    ([ADVERTISED], ["resend", _INTENTION], [LEAVE, REQUEST, _RESTART]),
    (WAITING, ["hold"], [LEAVE, CANCELLED, REQUEST, ADVERTISED, _RESTART]),
    (VERIFYING, ["decide"], [REFUSE, LEAVE, CANCELLED, INSTRUCTED, _RESTART]),
    ([*COMMITTED, ACCEPTANCE_ACKED], ["cam"], [LEAVE, CANCELLED, REQUEST, _RESTART]),
    ([*COMMITTED, ACCEPTANCE_ACKED], ["lease"], [LEAVE, CANCELLED, REQUEST, _RESTART]),
    ([*WAITING, FINISHED], ["forget", Y], [ADVERTISED, REQUEST, _RESTART]),
    ([REQUEST], ["advertise"], [ABORT, REQUEST, _RESTART]),
    ([REQUEST, INTENDED], ["advertise"], [WITHDRAWN, ABORT, REQUEST, _RESTART]),
    ([REQUEST], ["resend", entry("Advertisement", 0, MINE)], [ABORT, INTENDED, _RESTART]),
    ([REQUEST, WINDOW], ["backoff"], [ADVERTISED, _RESTART]),
    (CHOOSING, ["decide"], [ABORT, PROCEED, WITHDRAWN, _RESTART]),
    (PRESCRIBING, ["giveup", _PRESCRIPTION], [PRESCRIPTION_ACKED, ACCEPTED, ABORT, _RESTART]),
    (PRESCRIBING, ["resend", _PRESCRIPTION], [PRESCRIPTION_ACKED, REFUSED, ABORT, _RESTART]),
    ([*PRESCRIBING, REFUSED], ["decide"], [PRESCRIBE_2, ABORT, _RESTART]),
    ([*PRESCRIBING, PRESCRIPTION_ACKED], ["answer"], [REFUSED, ABORT, WITHDRAWN, _RESTART]),
    (ACTING, ["cam"], [HEARD_TARGET, ABORT, WITHDRAWN, REQUEST, _RESTART]),
    (ACTING, ["lease"], [HEARD_TARGET, COMPLETE, ABORT, WITHDRAWN, REQUEST, _RESTART]),
    ([*ACTING, COMPLETE], ["giveup", entry("Fin", Y, MINE)], [INTENDED, REQUEST, _RESTART]),
    ([*ACTING, ABORT], ["resend", entry("Cancel", Y, MINE)], [INTENDED, REQUEST, _RESTART]),
]
"""A timer that runs, and inputs at the very time at which it expires."""

SAME_INSTANT: list[Script] = [
    [ADVERTISED, ["at", ["giveup", entry("Intention", Y, THEIRS)], INTENTION_ACKED]],
    [ADVERTISED, ["at", ["resend", entry("Intention", Y, THEIRS)], INTENTION_ACKED]],
    [*WAITING, ["at", ["hold"], INSTRUCTED]],
    [*VERIFYING, ["at", ["decide"], ACCEPT]],
    [*COMMITTED, ACCEPTANCE_ACKED, ["at", ["cam"], HEARD_THEM]],
    [*COMMITTED, ACCEPTANCE_ACKED, ["at", ["lease"], FINISHED]],
    [REQUEST, ["at", ["advertise"], INTENDED]],
    [*CHOOSING, ["at", ["decide"], PRESCRIBE]],
    [*PRESCRIBING, PRESCRIPTION_ACKED, ["at", ["answer"], ACCEPTED]],
    [*ACTING, ["at", ["cam"], COMPLETE]],
    [REQUEST, WINDOW, ["at", ["backoff"], REQUEST]],
    *(
        [*script, ["at", timer, value], PAUSE]
        for script, timer, values in _DUE
        for value in values
        if value != ["restart"]
    ),
]
"""An input at the very time at which a timer expires: the timer comes first."""

TIES: list[tuple[Script, int]] = [
    ([*COMMITTED, ACCEPTANCE_ACKED, ["wait", 2000]], USUAL["t_cam_loss"]),
    ([*PRESCRIBING, PRESCRIPTION_ACKED, ["wait", 3000]], USUAL["t_decide"] + GIVEUP_MS),
    ([*PRESCRIBING, ["wait", 2500]], GIVEUP_MS),
]
"""Two timers at the same instant, with the lease that makes it so: cam, answer and giveup beside
lease.  They fire in the order of section 3."""

CONTENT: dict[str, list[Script]] = {
    "Advertisement": [[REQUEST, ["wait", 200]]],
    "Intention": [[ADVERTISED, ["wait", 200], INTENTION_ACKED]],
    "Prescription": [
        [*PRESCRIBING, ["wait", 200], REFUSED],
        [*CHOOSING, ["with", {"hold_ms": 0}, PRESCRIBE], ["wait", 200]],
    ],
    "Acceptance": [[*COMMITTED, ["wait", 200], INSTRUCTED], [*VERIFYING, REFUSE, ["wait", 200]]],
    "Fin": [[*ACTING, COMPLETE, ["wait", 200], ACCEPTED, INTENDED]],
    "Cancel": [[*ACTING, ABORT, ["wait", 200], INTENDED], [*CHOOSING, ABORT, ["wait", 100]]],
    "Ack": [[*VERIFYING, INSTRUCTED, FINISHED, FINISHED], [REQUEST, INTENDED, INTENDED]],
}
"""Exchanges in which a message of the type is sent, sent again, or answered."""

RECEIVED: dict[str, tuple[Script, Json, Script]] = {
    "Advertisement": ([], ADVERTISED, [INTENTION_ACKED]),
    "Intention": ([REQUEST], INTENDED, [WINDOW, PRESCRIBE]),
    "Prescription": (WAITING, INSTRUCTED, [ACCEPT, ["wait", 200]]),
    "Acceptance": (PRESCRIBING, ACCEPTED, [["wait", 200], COMPLETE]),
    "Fin": (COMMITTED, FINISHED, [FINISHED]),
    "Cancel": (COMMITTED, received("Cancel", THEIRS), [received("Cancel", THEIRS)]),
    "Ack": ([ADVERTISED], INTENTION_ACKED, [INSTRUCTED]),
    "CAM": ([*COMMITTED, ACCEPTANCE_ACKED, PAUSE], HEARD_THEM, [["wait", 700]]),
}
"""Where a message of the type would have an effect, that message, and what may follow."""

MARKED: list[Script] = [
    [*COMMITTED, ACCEPTANCE_ACKED, FINISHED],
    [*ACTING, COMPLETE, received("Ack", MINE, of=["Fin", 1])],
    [*ACTING, ABORT],
]
"""Sessions whose marks are looked at."""

HEARD_TWICE = ["wait", 400], HEARD_THEM, ["wait", 300], HEARD_THEM, ["wait", 300]
TARGET_HEARD_TWICE = ["wait", 400], HEARD_TARGET, ["wait", 300], HEARD_TARGET, ["wait", 300]


def _older(cam: Json) -> list[Script]:
    """CAMs that do not count, from the last one back to the beginning of time."""
    again = [*cam[:3], False]
    steps = [["older", ms, again] for ms in (0, 1, 50, 100, 101, 10**9)]
    return [[step] for step in steps] + [steps[::-1]]


_INTENDED_3 = received("Intention", MINE, source=3)
_BOTH_RECORDED = [REQUEST, _INTENDED_3, INTENDED, WINDOW]
_TO_3 = entry("Cancel", 3, MINE)
_CANCEL_ACKED = received("Ack", MINE, of=["Cancel", 1])
_CANCEL_ACKED_3 = received("Ack", MINE, of=["Cancel", 1], source=3)
_WITHDRAWN_3 = received("Cancel", MINE, source=3)
_LEAVE_NEXT = command("abort", NEXT)
_TWO_LEFT = [ADVERTISED, LEAVE, received("Advertisement", NEXT), _LEAVE_NEXT]
ROOM: list[Script] = [
    [*_TWO_LEFT, REQUEST],
    [REQUEST, INTENDED, ABORT, ADVERTISED, LEAVE, received("Advertisement", NEXT), REQUEST],
    [ADVERTISED, LEAVE, REQUEST, INTENDED, ABORT, received("Advertisement", NEXT), REQUEST],
    [ADVERTISED, LEAVE, received("Advertisement", NEXT), PAUSE],
    [*_TWO_LEFT, received("Ack", NEXT, of=["Cancel", 1]), REQUEST, PAUSE],
]
"""Sessions with one or two entries in the outbox when they should begin."""

_CANCELS = (
    *("not_selected", "not_needed", "no_agreement", "timeout"),
    *("cam_loss", "lease_expired", "abort"),
)

_OVERHEARD = [
    ["receive", [type_, Y, STRANGER, MINE, *fields], True]
    for type_, *fields in (
        ("Intention", 1, 0, False, "none", ["none", 0]),
        ("Prescription", 1, 1, False, "none", ["none", 0]),
        ("Acceptance", 1, 1, True, "none", ["none", 0]),
        ("Fin", 1, 0, False, "none", ["none", 0]),
        ("Cancel", 1, 0, False, "as_sent", ["none", 0]),
        ("Ack", 0, 0, False, "none", ["Cancel", 1]),
    )
]
"""Messages to another station."""
_ECHOED = {"src": VALUES.ids[ME], "session": [VALUES.ids[ME], 1]}

PLAIN: dict[str, list[Script]] = {
    "echoes": [
        [*script, ["wait", 30], *(["with", _ECHOED, message] for message in _OVERHEARD)]
        for script in ([], WAITING, COMMITTED, [REQUEST, INTENDED], PRESCRIBING, ACTING)
    ],
    "reasons receiver": [
        [*script, ["with", {"reason": reason}, CANCELLED], CANCELLED]
        for script in ([ADVERTISED], WAITING, VERIFYING, COMMITTED)
        for reason in _CANCELS
    ],
    "reasons prescriber": [
        [*script, ["with", {"reason": reason}, WITHDRAWN], WITHDRAWN]
        for script in (PRESCRIBING, [*PRESCRIBING, PRESCRIPTION_ACKED], ACTING)
        for reason in _CANCELS
    ]
    + [
        [*script, ["with", {"reason": reason}, REFUSED], PRESCRIBE_2]
        for script in (PRESCRIBING, [*PRESCRIBING, PRESCRIPTION_ACKED])
        for reason in ("unsafe", "undecided")
    ],
    "two receivers": [
        [*_BOTH_RECORDED, PRESCRIBE, PRESCRIPTION_ACKED, ["expire", ["giveup", _TO_3]]],
        [*_BOTH_RECORDED, PRESCRIBE, PRESCRIPTION_ACKED, PAUSE, _INTENDED_3, ["wait", 2500]],
        [*_BOTH_RECORDED, PRESCRIBE, ACCEPTED, PAUSE, _CANCEL_ACKED, _CANCEL_ACKED_3, COMPLETE],
        [*_BOTH_RECORDED, PROCEED, ["wait", 250], _CANCEL_ACKED, ["wait", 2500]],
        [*_BOTH_RECORDED, ABORT, ["wait", 250], _CANCEL_ACKED_3, ["wait", 2500]],
        [*_BOTH_RECORDED, ABORT, ["wait", 2500]],
        [*_BOTH_RECORDED, ["expire", ["decide"]], ["wait", 2500]],
    ],
    "two withdrawn": [
        [REQUEST, INTENDED, _INTENDED_3, WITHDRAWN, _WITHDRAWN_3, INTENDED, _INTENDED_3, WINDOW],
        [REQUEST, _WITHDRAWN_3, WITHDRAWN, _INTENDED_3, INTENDED, WINDOW],
    ],
    "restart at a deadline": [
        [*script, ["at", timer, _RESTART], ["wait", 500]] for script, timer, _ in _DUE
    ]
    + [[_RESTART, ["at", ["quarantine"], value], PAUSE] for value in (ADVERTISED, _RESTART)],
    "bounds Ack": [
        [ADVERTISED]
        + [["with", {"of": of}, received("Ack", THEIRS, of=["Fin", 1])] for of in named_by_acks()]
        + [INTENTION_ACKED]
    ],
    "cam older receiver": [
        [*COMMITTED, ACCEPTANCE_ACKED, *HEARD_TWICE, *older, ["expire", ["cam"]]]
        for older in _older(HEARD_THEM)
    ],
    "cam older prescriber": [
        [*ACTING, *TARGET_HEARD_TWICE, *older, ["expire", ["cam"]]]
        for older in _older(HEARD_TARGET)
    ],
}
"""Cases that are scripts and nothing else."""
