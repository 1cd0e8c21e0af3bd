"""Scripts: inputs that lead to the beginning of a case, with steps that only the kit can make."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple, TypeAlias, get_args

from automcm_conformance.adapter.protocol import DEFAULTS
from automcm_conformance.exchange.malformed_messages import named_by_acks
from automcm_conformance.exchange.wire import COPY_REASONS, ME, STRANGER
from automcm_conformance.exchange.wire import PLAIN as VALUES
from automcm_spec.vocabulary import station as spec
from automcm_spec.vocabulary.messages import ANSWER_REASONS, LIMIT, CancelReason
from automcm_spec.vocabulary.parameters import derived


class Wait(NamedTuple):
    """Let time pass."""

    ms: int


class At(NamedTuple):
    """An input at the very time at which a timer expires."""

    timer: spec.Timer
    input: spec.Input


class Late(NamedTuple):
    """Let time pass with one line, beyond deadlines; then an input."""

    ms: int
    input: spec.Input | None = None


class With(NamedTuple):
    """An input whose message or command has other values in these fields."""

    fields: dict[str, Any]
    input: spec.Input


class Older(NamedTuple):
    """A CAM with a generation time this long before that of the last one that counted."""

    ms: int
    input: spec.Cam


class Ahead(NamedTuple):
    """A CAM with a generation time this much above the latest that may count (ACT-5)."""

    ms: int
    input: spec.Cam


Script: TypeAlias = Sequence[spec.Input | Wait | At | Late | With | Older | Ahead]
USUAL = DEFAULTS | {"backoff_min": 750, "backoff_max": 750}
GIVEUP_MS = derived(USUAL)["t_giveup"]
Y, MINE, THEIRS = 2, (1, 1), (2, 1)
RESTART = spec.Restart("restart")


def received(
    type_: str,
    session: spec.Session,
    k: int = 1,
    accepted: bool = False,
    of: tuple[str, int] = ("none", 0),
    source: int = Y,
) -> spec.Receive:
    """A message of a peer; ``seq`` is that of the oracle."""
    proposal = k if type_ in ("Prescription", "Acceptance") else 0
    refused = type_ == "Cancel" or (type_ == "Acceptance" and not accepted)
    to = 0 if type_ == "Advertisement" else 1
    seq = 0 if type_ == "Ack" else k
    reason = "as_sent" if refused else "none"
    message = spec.Message(type_, source, to, session, seq, proposal, accepted, reason, of)
    return spec.Receive("receive", message, type_ != "Ack")


def cam(source: int, session: spec.Session) -> spec.Cam:
    """A new CAM of a peer that names this session."""
    return spec.Cam("cam", source, frozenset({session}), True)


def command(name: str, session: spec.Session, k: int = 0, target: int = 0) -> spec.Command:
    """A command of the application."""
    return spec.Command("command", name, session, k, target)


def entry(
    type_: str, to: int, session: spec.Session, k: int = 1, accepted: bool = False
) -> spec.Entry:
    """An entry of the outbox."""
    return spec.Entry(type_, to, session, k, accepted)


def expire(name: str, *of: spec.Entry | int) -> spec.Expire:
    """The expiry of a timer."""
    return spec.Expire("expire", (name, *of))  # type: ignore[arg-type]


ADVERTISED = received("Advertisement", THEIRS)
INTENTION_ACKED = received("Ack", THEIRS, of=("Intention", 1))
INSTRUCTED = received("Prescription", THEIRS)
ACCEPT, REFUSE = command("accept", THEIRS, 1), command("refuse", THEIRS, 1)
ACCEPTANCE_ACKED = received("Ack", THEIRS, of=("Acceptance", 1))
HEARD_THEM = cam(Y, THEIRS)
FINISHED = received("Fin", THEIRS)
REQUEST = command("request", (0, 0))
INTENDED = received("Intention", MINE)
WINDOW, CLOSE = expire("advertise"), command("close", MINE)
PRESCRIBE = command("prescribe", MINE, 1, Y)
PRESCRIPTION_ACKED = received("Ack", MINE, of=("Prescription", 1))
ACCEPTED, REFUSED = received("Acceptance", MINE, accepted=True), received("Acceptance", MINE)
HEARD_TARGET = cam(Y, MINE)
COMPLETE, ABORT = command("complete", MINE), command("abort", MINE)
PROCEED, LEAVE = command("proceed", MINE), command("abort", THEIRS)
CANCELLED, WITHDRAWN = received("Cancel", THEIRS), received("Cancel", MINE)
INSTRUCTED_2, ACCEPT_2 = received("Prescription", THEIRS, 2), command("accept", THEIRS, 2)
PRESCRIBE_2 = command("prescribe", MINE, 2, Y)
ACCEPTED_2 = received("Acceptance", MINE, 2, accepted=True)
PAUSE = Wait(30)

NEXT, AFTER = (2, 2), (1, 2)


def as_prescriber(
    session: spec.Session, peer: int, refused: bool, closes: spec.Input = WINDOW
) -> list[spec.Input]:
    """An own session, up to the Ack of the Fin; ``refused``: the first proposal is refused;
    ``closes``: ends the advertising window."""
    k = 2 if refused else 1
    rounds: list[spec.Input] = [
        received("Acceptance", session, 1, source=peer),
        command("prescribe", session, 2, peer),
    ]
    return [
        REQUEST,
        received("Intention", session, source=peer),
        closes,
        command("prescribe", session, 1, peer),
        received("Ack", session, of=("Prescription", 1), source=peer),
        *(rounds if refused else []),
        received("Acceptance", session, k, accepted=True, source=peer),
        cam(peer, session),
        cam(peer, session),
        command("complete", session),
        received("Ack", session, of=("Fin", 1), source=peer),
    ]


def as_receiver(session: spec.Session, refuses: bool) -> list[spec.Input]:
    """A session of another station, up to its Fin; ``refuses``: the first proposal is refused."""
    peer, k = session[0], 2 if refuses else 1
    rounds: list[spec.Input] = [
        command("refuse", session, 1),
        received("Prescription", session, 2, source=peer),
    ]
    return [
        received("Advertisement", session, source=peer),
        received("Ack", session, of=("Intention", 1), source=peer),
        received("Prescription", session, 1, source=peer),
        *(rounds if refuses else []),
        command("accept", session, k),
        received("Ack", session, of=("Acceptance", k), source=peer),
        cam(peer, session),
        cam(peer, session),
        received("Fin", session, source=peer),
    ]


AGAIN: Script = [*as_receiver(NEXT, False)[:5], Wait(400), cam(Y, NEXT)]
"""Another session of the same prescriber, with one CAM received."""

WAITING: list[spec.Input] = [ADVERTISED, INTENTION_ACKED]
VERIFYING: list[spec.Input] = [*WAITING, INSTRUCTED]
COMMITTED: list[spec.Input] = [*VERIFYING, ACCEPT]
CHOOSING: list[spec.Input] = [REQUEST, INTENDED, WINDOW]
PRESCRIBING: list[spec.Input] = [*CHOOSING, PRESCRIBE]
ACTING: list[spec.Input] = [*PRESCRIBING, ACCEPTED]
_RECEIVING = [*COMMITTED, ACCEPTANCE_ACKED]

TIMERS: dict[str, list[Script]] = {
    "advertise": [[REQUEST, WINDOW], [REQUEST, Wait(30), INTENDED, WINDOW]],
    "resend Advertisement": [[REQUEST, expire("resend", entry("Advertisement", 0, MINE))]],
    "resend Intention": [[ADVERTISED, expire("resend", entry("Intention", Y, THEIRS))]],
    "resend Prescription": [[*PRESCRIBING, expire("resend", entry("Prescription", Y, MINE))]],
    "resend Acceptance": [
        [*COMMITTED, expire("resend", entry("Acceptance", Y, THEIRS, accepted=True))],
        [*VERIFYING, REFUSE, expire("resend", entry("Acceptance", Y, THEIRS))],
    ],
    "resend Fin": [[*ACTING, COMPLETE, expire("resend", entry("Fin", Y, MINE))]],
    "resend Cancel": [[*ACTING, ABORT, expire("resend", entry("Cancel", Y, MINE))]],
    "decide choice": [[*CHOOSING, expire("decide")]],
    "decide proposal": [[*PRESCRIBING, REFUSED, expire("decide")]],
    "decide verdict": [[*VERIFYING, expire("decide")]],
    "hold": [[*WAITING, expire("hold")], [*VERIFYING, REFUSE, expire("hold")]],
    "answer": [[*PRESCRIBING, Wait(30), PRESCRIPTION_ACKED, expire("answer")]],
    "cam prescriber": [
        [*ACTING, expire("cam")],
        [*ACTING, Wait(400), HEARD_TARGET, Wait(333), HEARD_TARGET, expire("cam")],
    ],
    "cam receiver": [
        [*COMMITTED, ACCEPTANCE_ACKED, expire("cam")],
        [*COMMITTED, ACCEPTANCE_ACKED, Wait(400), HEARD_THEM, expire("cam")],
        [*COMMITTED, ACCEPTANCE_ACKED, HEARD_THEM, FINISHED, *AGAIN, expire("cam")],
    ],
    "lease prescriber": [
        [*ACTING, expire("lease")],
        [*CHOOSING, PAUSE, PRESCRIBE, Wait(250), ACCEPTED, PAUSE, expire("lease")],
        [*PRESCRIBING, PAUSE, PRESCRIPTION_ACKED, PAUSE, ACCEPTED, ACCEPTED, expire("lease")],
        [*PRESCRIBING, PAUSE, REFUSED, PAUSE, PRESCRIBE_2, PAUSE, ACCEPTED_2, expire("lease")],
    ],
    "lease receiver": [
        [*COMMITTED, ACCEPTANCE_ACKED, expire("lease")],
        [ADVERTISED, PAUSE, INSTRUCTED, PAUSE, ACCEPT, PAUSE, ACCEPTANCE_ACKED, expire("lease")],
        [*VERIFYING, PAUSE, ACCEPT, PAUSE, INSTRUCTED, ACCEPTANCE_ACKED, expire("lease")],
        [*VERIFYING, REFUSE, PAUSE, INSTRUCTED_2, PAUSE, ACCEPT_2, PAUSE, HEARD_THEM]
        + [received("Ack", THEIRS, of=("Acceptance", n)) for n in (1, 2)]
        + [expire("lease")],
    ],
    "giveup Intention": [[ADVERTISED, expire("giveup", entry("Intention", Y, THEIRS))]],
    "giveup Prescription": [[*PRESCRIBING, expire("giveup", entry("Prescription", Y, MINE))]],
    "giveup Acceptance": [[*VERIFYING, REFUSE, expire("giveup", entry("Acceptance", Y, THEIRS))]],
    "giveup Fin": [[*ACTING, COMPLETE, expire("giveup", entry("Fin", Y, MINE))]],
    "giveup Cancel": [[*ACTING, ABORT, expire("giveup", entry("Cancel", Y, MINE))]],
    "quarantine": [[RESTART, expire("quarantine")]],
    "forget": [
        [*WAITING, FINISHED, expire("forget", Y)],
        [*WAITING, Wait(5000), FINISHED, expire("forget", Y)],
    ],
    "backoff": [[REQUEST, WINDOW, expire("backoff"), REQUEST]],
}
"""Scripts that arm each timer; each ends with its expiry."""

_INTENTION, _PRESCRIPTION = (entry("Intention", Y, THEIRS), entry("Prescription", Y, MINE))
_DUE: list[tuple[Script, spec.Timer, Sequence[spec.Input]]] = [
    (
        [ADVERTISED],
        ("giveup", _INTENTION),
        [INTENTION_ACKED, LEAVE, INSTRUCTED, CANCELLED, RESTART],
    ),
    ([ADVERTISED], ("resend", _INTENTION), [INTENTION_ACKED, LEAVE, REQUEST, RESTART]),
    (WAITING, ("hold",), [INSTRUCTED, LEAVE, CANCELLED, REQUEST, ADVERTISED, RESTART]),
    (VERIFYING, ("decide",), [ACCEPT, REFUSE, LEAVE, CANCELLED, INSTRUCTED, RESTART]),
    ([*COMMITTED, ACCEPTANCE_ACKED], ("cam",), [HEARD_THEM, LEAVE, CANCELLED, REQUEST, RESTART]),
    ([*COMMITTED, ACCEPTANCE_ACKED], ("lease",), [FINISHED, LEAVE, CANCELLED, REQUEST, RESTART]),
    ([*WAITING, FINISHED], ("forget", Y), [ADVERTISED, REQUEST, RESTART]),
    ([REQUEST], ("advertise",), [INTENDED, ABORT, REQUEST, RESTART]),
    ([REQUEST, INTENDED], ("advertise",), [WITHDRAWN, CLOSE, ABORT, REQUEST, RESTART]),
    ([REQUEST], ("resend", entry("Advertisement", 0, MINE)), [ABORT, INTENDED, RESTART]),
    ([REQUEST, WINDOW], ("backoff",), [REQUEST, ADVERTISED, RESTART]),
    (CHOOSING, ("decide",), [PRESCRIBE, ABORT, PROCEED, WITHDRAWN, RESTART]),
    (PRESCRIBING, ("giveup", _PRESCRIPTION), [PRESCRIPTION_ACKED, ACCEPTED, ABORT, RESTART]),
    (PRESCRIBING, ("resend", _PRESCRIPTION), [PRESCRIPTION_ACKED, REFUSED, ABORT, RESTART]),
    ([*PRESCRIBING, REFUSED], ("decide",), [PRESCRIBE_2, ABORT, RESTART]),
    (
        [*PRESCRIBING, PRESCRIPTION_ACKED],
        ("answer",),
        [ACCEPTED, REFUSED, ABORT, WITHDRAWN, RESTART],
    ),
    (ACTING, ("cam",), [COMPLETE, HEARD_TARGET, ABORT, WITHDRAWN, REQUEST, RESTART]),
    (ACTING, ("lease",), [HEARD_TARGET, COMPLETE, ABORT, WITHDRAWN, REQUEST, RESTART]),
    ([*ACTING, COMPLETE], ("giveup", entry("Fin", Y, MINE)), [INTENDED, REQUEST, RESTART]),
    ([*ACTING, ABORT], ("resend", entry("Cancel", Y, MINE)), [INTENDED, REQUEST, RESTART]),
]
"""An armed timer, and inputs at the very time of its expiry."""

_LATE: list[Script] = [
    [ADVERTISED, Late(250), PAUSE, INTENTION_ACKED],
    [REQUEST, Late(250), Wait(200)],
    [REQUEST, INTENDED, Late(2600), Wait(100), PRESCRIBE],
    [*PRESCRIBING, Late(2150), Wait(200)],
    [*VERIFYING, Late(650), Wait(200), INSTRUCTED],
    [*COMMITTED, Late(250, ACCEPTANCE_ACKED), PAUSE, Late(1600), Wait(200)],
]
"""Timers that fire late: what they arm, themselves included, lasts from then."""

_UNTIL_CAM = With({"lease_ms": USUAL["t_cam_loss"]}, INSTRUCTED)
_UNTIL_ANSWER = With({"lease_ms": USUAL["t_decide"] + GIVEUP_MS}, PRESCRIBE)
_UNTIL_GIVEUP = With({"lease_ms": GIVEUP_MS}, PRESCRIBE)
_TIES: list[Script] = [
    [*WAITING, _UNTIL_CAM, ACCEPT, ACCEPTANCE_ACKED, Wait(2000)],
    [*CHOOSING, _UNTIL_ANSWER, PRESCRIPTION_ACKED, Wait(3000)],
    [*CHOOSING, _UNTIL_GIVEUP, Wait(2500)],
    [*VERIFYING, REFUSE, INSTRUCTED_2, ACCEPT_2, Wait(250)],
    [ADVERTISED, LEAVE, received("Advertisement", NEXT), Wait(250)],
]
"""Two timers at the same instant, by a lease that makes it so: cam, answer and giveup beside lease,
and copies of two messages. They fire in the order of section 3."""

CONTENT: dict[str, list[Script]] = {
    "Advertisement": [[REQUEST, Wait(200)]],
    "Intention": [[ADVERTISED, Wait(200), INTENTION_ACKED]],
    "Prescription": [
        [*PRESCRIBING, Wait(200), REFUSED],
        [*CHOOSING, With({"hold_ms": 0}, PRESCRIBE), Wait(200)],
    ],
    "Acceptance": [[*COMMITTED, Wait(200), INSTRUCTED], [*VERIFYING, REFUSE, Wait(200)]],
    "Fin": [[*ACTING, COMPLETE, Wait(200), ACCEPTED, INTENDED]],
    "Cancel": [[*ACTING, ABORT, Wait(200), INTENDED], [*CHOOSING, ABORT, Wait(100)]],
    "Ack": [[*VERIFYING, INSTRUCTED, FINISHED, FINISHED], [REQUEST, INTENDED, INTENDED]],
}
"""Exchanges in which a message of the type is sent, sent again, or answered."""

RECEIVED: dict[str, tuple[Script, spec.Input, Script]] = {
    "Advertisement": ([], ADVERTISED, [INTENTION_ACKED]),
    "Intention": ([REQUEST], INTENDED, [WINDOW, PRESCRIBE]),
    "Prescription": (WAITING, INSTRUCTED, [ACCEPT, Wait(200)]),
    "Acceptance": (PRESCRIBING, ACCEPTED, [Wait(200), COMPLETE]),
    "Fin": (COMMITTED, FINISHED, [FINISHED]),
    "Cancel": (COMMITTED, received("Cancel", THEIRS), [received("Cancel", THEIRS)]),
    "Ack": ([ADVERTISED], INTENTION_ACKED, [INSTRUCTED]),
    "CAM": ([*COMMITTED, ACCEPTANCE_ACKED, PAUSE], HEARD_THEM, [Wait(700)]),
}
"""Scripts to a state in which a message of the type has an effect, that message, and its
followers."""


def _older(cam: spec.Cam) -> Sequence[Script]:
    """CAMs that do not count, from the last one back to time 0."""
    again = cam._replace(newer=False)
    steps: Script = [Older(ms, again) for ms in (0, 1, 50, 100, 101, 10**9)]
    return [[step] for step in steps] + [steps[::-1]]


def _ahead(cam: spec.Cam) -> Sequence[Script]:
    """CAMs at the latest generation time that may count, and beyond it."""
    again = cam._replace(newer=False)
    beyond: list[Script] = [[Ahead(ms, again)] for ms in (1, 1000, LIMIT)]
    return [
        *beyond,
        *([*script, Wait(100), cam] for script in beyond),
        [Ahead(0, cam), Ahead(1, again), Wait(1), Ahead(0, cam), Wait(450), cam],
        # A late CAM does not lower the bound.
        [Wait(800), Older(-1, cam), Wait(100), cam, Ahead(1, again)],
    ]


_INTENDED_3 = received("Intention", MINE, source=3)
_BOTH_RECORDED: list[spec.Input] = [REQUEST, _INTENDED_3, INTENDED, WINDOW]
_TO_3 = entry("Cancel", 3, MINE)
_CANCEL_ACKED = received("Ack", MINE, of=("Cancel", 1))
_CANCEL_ACKED_3 = received("Ack", MINE, of=("Cancel", 1), source=3)
_WITHDRAWN_3 = received("Cancel", MINE, source=3)
_LEAVE_NEXT = command("abort", NEXT)
_TWO_LEFT: list[spec.Input] = [ADVERTISED, LEAVE, received("Advertisement", NEXT), _LEAVE_NEXT]
ROOM: list[Script] = [
    [*_TWO_LEFT, REQUEST],
    [REQUEST, INTENDED, ABORT, ADVERTISED, LEAVE, received("Advertisement", NEXT), REQUEST],
    [ADVERTISED, LEAVE, REQUEST, INTENDED, ABORT, received("Advertisement", NEXT), REQUEST],
    [ADVERTISED, LEAVE, received("Advertisement", NEXT), PAUSE],
    [*_TWO_LEFT, received("Ack", NEXT, of=("Cancel", 1)), REQUEST, PAUSE],
]
"""Sessions that begin with one or two entries in the outbox."""

_AGAIN = [received("Ack", MINE, of=("Fin", 1)), *as_prescriber(AFTER, Y, False)[:6]]
"""Another own session, from the end of the first one to ACTUATING."""


def _anew(first: spec.Cam, between: Script, cam: spec.Cam) -> list[Script]:
    """In each of two sessions a first CAM, of which one is generated long before the other."""
    found: list[Script] = []
    for one, other in ((0, 10**9), (10**9, 0)):
        heard = With({"generation_ms": one}, first)
        heard_next = With({"generation_ms": other}, cam)
        found.append([heard, *between, heard_next, Wait(100), cam, expire("cam")])
    return found


def _cams(
    role: str, begin: Script, heard: spec.Cam, between: Script, next_heard: spec.Cam
) -> dict[str, Sequence[Script]]:
    """CAMs that do not count, in ACTUATING. ``between``: the inputs from there to the next
    session's."""
    twice = [*begin, Wait(400), heard, Wait(300), heard, Wait(300)]
    older = [[*twice, *steps, expire("cam")] for steps in _older(heard)]
    older += [[*begin, *steps] for steps in _anew(heard, between, next_heard)]
    ahead = [[*twice, *steps, expire("cam")] for steps in _ahead(heard)]
    return {f"cam older {role}": older, f"cam ahead {role}": ahead}


_CANCELS = tuple(reason for reason in get_args(CancelReason) if reason not in ANSWER_REASONS)

_OVERHEARD: list[spec.Input] = [
    spec.Receive("receive", value.message._replace(dst=STRANGER, session=MINE), True)
    for value in (
        INTENDED,
        INSTRUCTED,
        ACCEPTED,
        FINISHED,
        CANCELLED,
        received("Ack", MINE, of=("Cancel", 1)),
    )
]
"""Messages to another station."""
_ECHOED = {"src": VALUES.ids[ME], "session": [VALUES.ids[ME], 1]}

PLAIN: dict[str, Sequence[Script]] = {
    # An input at the very time of an expiry: the timer comes first; also if both are late.
    "same instant": [
        *([*script, At(timer, v), PAUSE] for script, timer, vs in _DUE for v in vs if v != RESTART),
        *_LATE,
        *_TIES,
    ],
    # In every phase of a session, and while a Fin is not acknowledged.
    "cam marks": [
        [Wait(250), *(step for value in script for step in (value, Wait(250)))]
        for script in (
            [*_RECEIVING, FINISHED],
            [*ACTING, COMPLETE, received("Ack", MINE, of=("Fin", 1))],
            [*ACTING, ABORT],
        )
    ],
    "echoes": [
        [*script, Wait(30), *(With(_ECHOED, message) for message in _OVERHEARD)]
        for script in ([], WAITING, COMMITTED, [REQUEST, INTENDED], PRESCRIBING, ACTING)
    ],
    "reasons receiver": [
        [*script, With({"reason": reason}, CANCELLED), CANCELLED]
        for script in ([ADVERTISED], WAITING, VERIFYING, COMMITTED)
        for reason in _CANCELS
    ],
    "reasons prescriber": [
        [*script, With({"reason": reason}, WITHDRAWN), WITHDRAWN]
        for script in (PRESCRIBING, [*PRESCRIBING, PRESCRIPTION_ACKED], ACTING)
        for reason in _CANCELS
    ]
    + [
        [*script, With({"reason": reason}, REFUSED), PRESCRIBE_2]
        for script in (PRESCRIBING, [*PRESCRIBING, PRESCRIPTION_ACKED])
        for reason in COPY_REASONS
    ],
    "two receivers": [
        [*_BOTH_RECORDED, PRESCRIBE, PRESCRIPTION_ACKED, expire("giveup", _TO_3)],
        [*_BOTH_RECORDED, PRESCRIBE, PRESCRIPTION_ACKED, PAUSE, _INTENDED_3, Wait(2500)],
        [*_BOTH_RECORDED, PRESCRIBE, ACCEPTED, PAUSE, _CANCEL_ACKED, _CANCEL_ACKED_3, COMPLETE],
        [*_BOTH_RECORDED, PROCEED, Wait(250), _CANCEL_ACKED, Wait(2500)],
        [*_BOTH_RECORDED, ABORT, Wait(250), _CANCEL_ACKED_3, Wait(2500)],
        [*_BOTH_RECORDED, ABORT, Wait(2500)],
        [*_BOTH_RECORDED, expire("decide"), Wait(2500)],
    ],
    "two withdrawn": [
        [REQUEST, INTENDED, _INTENDED_3, WITHDRAWN, _WITHDRAWN_3, INTENDED, _INTENDED_3, WINDOW],
        [REQUEST, _WITHDRAWN_3, WITHDRAWN, _INTENDED_3, INTENDED, WINDOW],
    ],
    "restart at a deadline": [[*script, At(timer, RESTART), Wait(500)] for script, timer, _ in _DUE]
    + [[RESTART, At(("quarantine",), value), PAUSE] for value in (ADVERTISED, RESTART)]
    + [[*script, Late(250, RESTART), Wait(250)] for script in (WAITING, COMMITTED, ACTING)],
    "bounds Ack": [
        [ADVERTISED]
        + [With({"of": of}, received("Ack", THEIRS, of=("Fin", 1))) for of in named_by_acks()]
        + [INTENTION_ACKED]
    ],
    **_cams("receiver", _RECEIVING, HEARD_THEM, [FINISHED, *AGAIN[:-1]], cam(Y, NEXT)),
    **_cams("prescriber", ACTING, HEARD_TARGET, [COMPLETE, *_AGAIN], cam(Y, AFTER)),
}
"""Cases that consist only of scripts."""
