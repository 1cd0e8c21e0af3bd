"""Cases that no graph carries: how long timers last, what happens at the same instant, malformed
messages, contents, CAMs, the back-off.  Each is a list of exchanges in natural time.

A script is a list of inputs in the oracle's values, and ``["wait", ms]``.  What must be answered
comes from the oracle as in a tour; a script only says how to get where the case begins.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from itertools import pairwise
from typing import Any

from pydantic_core import from_json

from automcm_conformance.clock import UNKNOWN
from automcm_conformance.exchange import Exchange, Infeasible, Mismatch
from automcm_conformance.protocol import DEFAULTS
from automcm_conformance.wire import LARGE, LONG_MS
from automcm_spec.oracle import canonical

Json = Any
Script = list[Json]
Fresh = Callable[..., Exchange]
"""A fresh exchange: ``fresh(parameters)``, ``fresh(parameters, rich=True)``."""
USUAL = DEFAULTS | {"backoff_min": 750, "backoff_max": 750}
SETS: tuple[dict[str, int], ...] = (
    {},
    {"t_timeout": 1000, "t_decide": 170},
    {"t_timeout": 0, "t_cam_loss": 1001},
    {"t_timeout": 250, "t_resend": 60, "t_decide": 2500, "t_cam_loss": 3000},
)
"""Parameters that the timing cases run with, besides the defaults."""
SEEDS = 8
LEASE_MS = 900
Y, MINE, THEIRS = 2, [1, 1], [2, 1]


def _from(type_: str, session: Json, k: int = 1, accepted: bool = False, of: Json = None) -> Json:
    """A message of the peer; ``seq`` is that of the oracle."""
    proposal = k if type_ in ("Prescription", "Acceptance") else 0
    refused = type_ == "Cancel" or (type_ == "Acceptance" and not accepted)
    to = 0 if type_ == "Advertisement" else 1
    seq = 0 if type_ == "Ack" else k
    reason = "as_sent" if refused else "none"
    message = [type_, Y, to, session, seq, proposal, accepted, reason, of or ["none", 0]]
    return ["receive", message, type_ != "Ack"]


def _command(name: str, session: Json, k: int = 0, target: int = 0) -> Json:
    return ["command", name, session, k, target]


def _entry(type_: str, to: int, session: Json, k: int = 1, accepted: bool = False) -> Json:
    return [type_, to, session, k, accepted]


ADVERTISED = _from("Advertisement", THEIRS)
INTENTION_ACKED = _from("Ack", THEIRS, of=["Intention", 1])
INSTRUCTED = _from("Prescription", THEIRS)
ACCEPT, REFUSE = _command("accept", THEIRS, 1), _command("refuse", THEIRS, 1)
ACCEPTANCE_ACKED = _from("Ack", THEIRS, of=["Acceptance", 1])
HEARD_THEM = ["cam", Y, [THEIRS], True]
FINISHED = _from("Fin", THEIRS)
REQUEST = _command("request", [0, 0])
INTENDED = _from("Intention", MINE)
WINDOW = ["expire", ["advertise"]]
PRESCRIBE = _command("prescribe", MINE, 1, Y)
PRESCRIPTION_ACKED = _from("Ack", MINE, of=["Prescription", 1])
ACCEPTED, REFUSED = _from("Acceptance", MINE, accepted=True), _from("Acceptance", MINE)
HEARD_TARGET = ["cam", Y, [MINE], True]
COMPLETE, ABORT = _command("complete", MINE), _command("abort", MINE)

NEXT = [2, 2]
AGAIN = [
    _from("Advertisement", NEXT),
    _from("Ack", NEXT, of=["Intention", 1]),
    _from("Prescription", NEXT),
    _command("accept", NEXT, 1),
    _from("Ack", NEXT, of=["Acceptance", 1]),
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
        [REQUEST, ["expire", ["resend", _entry("Advertisement", 0, MINE)]]],
    ],
    "resend Intention": [[ADVERTISED, ["expire", ["resend", _entry("Intention", Y, THEIRS)]]]],
    "resend Prescription": [
        [*PRESCRIBING, ["expire", ["resend", _entry("Prescription", Y, MINE)]]]
    ],
    "resend Acceptance": [
        [*COMMITTED, ["expire", ["resend", _entry("Acceptance", Y, THEIRS, accepted=True)]]],
        [*VERIFYING, REFUSE, ["expire", ["resend", _entry("Acceptance", Y, THEIRS)]]],
    ],
    "resend Fin": [[*ACTING, COMPLETE, ["expire", ["resend", _entry("Fin", Y, MINE)]]]],
    "resend Cancel": [[*ACTING, ABORT, ["expire", ["resend", _entry("Cancel", Y, MINE)]]]],
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
    "lease prescriber": [[*ACTING, ["expire", ["lease"]]]],
    "lease receiver": [[*COMMITTED, ACCEPTANCE_ACKED, ["expire", ["lease"]]]],
    "giveup Intention": [[ADVERTISED, ["expire", ["giveup", _entry("Intention", Y, THEIRS)]]]],
    "giveup Prescription": [
        [*PRESCRIBING, ["expire", ["giveup", _entry("Prescription", Y, MINE)]]]
    ],
    "giveup Acceptance": [
        [*VERIFYING, REFUSE, ["expire", ["giveup", _entry("Acceptance", Y, THEIRS)]]]
    ],
    "giveup Fin": [[*ACTING, COMPLETE, ["expire", ["giveup", _entry("Fin", Y, MINE)]]]],
    "giveup Cancel": [[*ACTING, ABORT, ["expire", ["giveup", _entry("Cancel", Y, MINE)]]]],
    "quarantine": [[["restart"], ["expire", ["quarantine"]]]],
    "forget": [
        [*WAITING, FINISHED, ["expire", ["forget", Y]]],
        [*WAITING, ["wait", 5000], FINISHED, ["expire", ["forget", Y]]],
    ],
    "backoff": [[REQUEST, WINDOW, ["expire", ["backoff"]], REQUEST]],
}
"""What leads to the arming of each timer; it ends with its expiry."""

SAME_INSTANT: list[Script] = [
    [ADVERTISED, ["at", ["giveup", _entry("Intention", Y, THEIRS)], INTENTION_ACKED]],
    [ADVERTISED, ["at", ["resend", _entry("Intention", Y, THEIRS)], INTENTION_ACKED]],
    [*WAITING, ["at", ["hold"], INSTRUCTED]],
    [*VERIFYING, ["at", ["decide"], ACCEPT]],
    [*COMMITTED, ACCEPTANCE_ACKED, ["at", ["cam"], HEARD_THEM]],
    [*COMMITTED, ACCEPTANCE_ACKED, ["at", ["lease"], FINISHED]],
    [REQUEST, ["at", ["advertise"], INTENDED]],
    [*CHOOSING, ["at", ["decide"], PRESCRIBE]],
    [*PRESCRIBING, PRESCRIPTION_ACKED, ["at", ["answer"], ACCEPTED]],
    [*ACTING, ["at", ["cam"], COMPLETE]],
    [REQUEST, WINDOW, ["at", ["backoff"], REQUEST]],
]
"""An input at the very time at which a timer expires: the timer comes first."""

TIES: list[tuple[Script, int]] = [
    ([*COMMITTED, ACCEPTANCE_ACKED, ["wait", 2000]], USUAL["t_cam_loss"]),
    ([*PRESCRIBING, PRESCRIPTION_ACKED, ["wait", 3000]], USUAL["t_decide"] + 2100),
    ([*PRESCRIBING, ["wait", 2500]], 2100),
]
"""Two timers at the same instant, with the lease that makes it so: cam, answer and giveup beside
lease.  They fire in the order of section 3."""

CONTENT: dict[str, list[Script]] = {
    "Advertisement": [[REQUEST, ["wait", 200]]],
    "Intention": [[ADVERTISED, ["wait", 200], INTENTION_ACKED]],
    "Prescription": [[*PRESCRIBING, ["wait", 200], REFUSED]],
    "Acceptance": [[*COMMITTED, ["wait", 200], INSTRUCTED], [*VERIFYING, REFUSE, ["wait", 200]]],
    "Fin": [[*ACTING, COMPLETE, ["wait", 200], ACCEPTED, INTENDED]],
    "Cancel": [[*ACTING, ABORT, ["wait", 200], INTENDED], [*CHOOSING, ABORT, ["wait", 100]]],
    "Ack": [[*VERIFYING, INSTRUCTED, FINISHED, FINISHED], [REQUEST, INTENDED, INTENDED]],
}
"""Exchanges in which a message of the type is sent, sent again, or answered."""

MALFORMED: dict[str, tuple[Script, Json]] = {
    "Advertisement": ([], ADVERTISED),
    "Intention": ([REQUEST], INTENDED),
    "Prescription": (WAITING, INSTRUCTED),
    "Acceptance": (PRESCRIBING, ACCEPTED),
    "Fin": (COMMITTED, FINISHED),
    "Cancel": (COMMITTED, _from("Cancel", THEIRS)),
    "Ack": ([ADVERTISED], INTENTION_ACKED),
    "CAM": ([*COMMITTED, ACCEPTANCE_ACKED], HEARD_THEM),
}
"""Where a message of the type would have an effect, and that message."""


def play(x: Exchange, script: Script, lease_ms: int = LONG_MS) -> None:
    """A script; the last expiry is approached to the millisecond.  Raises Infeasible."""
    if REFUSED in script and x.parameters["max_rounds"] < 2:
        raise Infeasible  # there is no second round
    for n, value in enumerate(script):
        if value[0] == "wait":
            x.wait(x.now + value[1])
        elif value[0] == "at":
            _before(x, value[1])
            x.give(x.oracle.input_index[canonical(value[2])], at=x.deadline(value[1]))
        elif value[0] == "expire":
            if n >= len(script) - 2:
                _before(x, value[1])
            x.expire(x.oracle.input_index[canonical(value)])
        else:
            x.give(x.oracle.input_index[canonical(value)], lease_ms=lease_ms)
    x.flush()


def _before(x: Exchange, timer: Json) -> None:
    """One millisecond before a timer expires, and nothing happens.  Raises Infeasible if another
    one than a resend ends before it, or at the same time and first."""
    deadline = x.deadline(timer)
    if deadline is None or deadline == UNKNOWN:
        raise Infeasible
    while (due := x.next_due) is not None and due < deadline:
        fired = x.advance(due)
        if any(x.oracle.inputs[i][1][0] != "resend" for i in fired):
            raise Infeasible
    if x.first_timer != timer:
        raise Infeasible
    x.wait(deadline - 1)


def timer(fresh: Fresh, name: str) -> Iterator[Exchange]:
    """``timer NAME``: nothing a millisecond before, everything at the deadline, with several sets
    of parameters.  Those with which it cannot expire first are left out."""
    lease = LEASE_MS if name.startswith("lease") else LONG_MS
    for changed in SETS:
        for script in TIMERS[name]:
            x = fresh(USUAL | changed)
            try:
                play(x, script, lease)
            except Infeasible:
                continue
            yield x


def sendings(fresh: Fresh, t_timeout: int) -> Iterator[Exchange]:
    """``sendings N``: every message is sent as often as section 3 says, and no more."""
    for name in ("Intention", "Prescription", "Acceptance", "Fin", "Cancel"):
        for script in TIMERS[f"giveup {name}"]:
            x = fresh(USUAL | {"t_timeout": t_timeout})
            try:
                play(x, [*script, ["wait", 1000]])
            except Infeasible:
                continue
            yield x


def same_instant(fresh: Fresh) -> Iterator[Exchange]:
    """``same instant``: the timer comes first, then the input."""
    for script in SAME_INSTANT:
        x = fresh(USUAL)
        try:
            play(x, script, LEASE_MS if ["lease"] in [v[1] for v in script] else LONG_MS)
        except Infeasible:
            continue
        yield x
    for script, lease in TIES:
        x = fresh(USUAL)
        try:
            play(x, script, lease)
        except Infeasible:
            continue
        yield x


def content(fresh: Fresh, type_: str) -> Iterator[Exchange]:
    """``content TYPE``: what the application gave arrives untouched, in every copy."""
    for rich in (False, True):
        for script in CONTENT[type_]:
            x = fresh(USUAL, rich=rich)
            try:
                play(x, script)
            except Infeasible:
                continue
            yield x


# -- malformed


def malformed(fresh: Fresh, type_: str) -> Iterator[Exchange]:
    """``malformed TYPE``: each is discarded and changes nothing; then the good one counts."""
    script, good = MALFORMED[type_]
    x = fresh(USUAL)
    play(x, script)
    command = x.wire.command(good)
    for message in bent(command["message"]):
        x.malformed(message)
    x.flush()
    x.give(x.oracle.input_index[canonical(good)])
    x.flush()
    yield x


def bent(message: dict[str, Json]) -> Iterator[dict[str, Json]]:
    """The message with one thing wrong with it, in every way that is tried."""
    yield message | {"unknown": 1}
    yield message | {"type": "Proposal"}
    for name, value in message.items():
        without = dict(message)
        del without[name]
        yield without
        yield message | {name: None}
        if name == "type":
            yield message | {"type": 7}
        else:
            yield from (message | {name: other} for other in _wrong(name, value))
    yield from (message | change for change in _UNFIT.get(message["type"], ()))


_UNFIT: dict[str, list[dict[str, Json]]] = {
    "Intention": [{"seq": 0}],
    "Prescription": [{"seq": 0}],
    "Acceptance": [{"seq": 0}, {"reason": "unsafe"}, {"accepted": False}],
    "Fin": [{"seq": 0}],
    "Cancel": [{"seq": 0}, {"reason": "closed"}],
    "Ack": [{"seq": 1}],
}
"""Fields that do not fit together."""


def _wrong(name: str, value: Json) -> Iterable[Json]:
    """Values that a field must not have."""
    trajectory = {"t0": 0, "points": [[0, 0, 0]]}
    match name:
        case "v":
            return (0, 2, "1", True)
        case "src":
            return (0, -1, 2**32, "1702", 1702.0, True, [])
        case "dst":
            return (0, -1, 2**32, "4711", True)
        case "session":
            p = value[0]
            return ([], [p], [p, 0], [0, 1], [p, 1, 1], [p, "1"], [p, 1.0], {"a": 1}, 5)
        case "seq" | "proposal":
            return (-1, LARGE + 1, 1.0, "1", True) + ((0,) if name == "proposal" else ())
        case "hold_ms" | "lease_ms" | "generation_ms":
            return (-1, LARGE + 1, 0.5, "1") + ((0,) if name == "lease_ms" else ())
        case "planned" | "prescribed" | "selected":
            return (
                [],
                {"t0": 0},
                {"points": [[0, 0, 0]]},
                {"t0": 0, "points": []},
                {"t0": 0, "points": [[0, 0]]},
                {"t0": 0, "points": [[0, 0, 0.5]]},
                {"t0": "0", "points": [[0, 0, 0]]},
                trajectory | {"speed": 1},
            )
        case "scenario":
            return (5, ["lane_change"])
        case "details":
            return (5, [], {"a": 1.5}, {"a": None}, {"a": [LARGE + 1]})
        case "accepted":
            return (0, 1, "true")
        case "reason":
            return ("whim", 5)
        case "of":
            return (5, {}, {"type": "Fin"}, {"type": "CAM", "seq": 1}, {"type": "Fin", "seq": -1})
        case "marks":
            return (5, [[1]], [[1, 0]], [[0, 1]], [["1", 1]], {"a": 1})
    return (0.5, "0", True, LARGE + 1)


# -- CAMs and the back-off


def cam_marks(fresh: Fresh) -> Iterator[Exchange]:
    """``cam marks``: in every phase of a session, and while a Fin is not acknowledged."""
    for script in (
        [*COMMITTED, ACCEPTANCE_ACKED, FINISHED],
        [*ACTING, COMPLETE, _from("Ack", MINE, of=["Fin", 1])],
        [*ACTING, ABORT],
    ):
        x = fresh(USUAL)
        x.wait(x.now + 250)
        try:
            for value in script:
                play(x, [value])
                x.wait(x.now + 250)
        except Infeasible:
            continue
        x.flush()
        yield x


def cam_rate(fresh: Fresh) -> Iterator[Exchange]:
    """``cam rate``: one every ``t_cam`` (half as much more or less), whatever the phase."""
    for t_cam in (100, 400):
        for script in ([], WAITING):
            x = fresh(USUAL | {"t_cam": t_cam})
            play(x, script)
            x.wait(x.now + 12 * x.parameters["t_cam"])
            x.flush()
            times = [
                cam["generation_ms"]
                for step in x.done
                for cam in from_json(step.answer).get("cams", [])
            ]
            gaps = [later - earlier for earlier, later in pairwise(times)]
            period = x.parameters["t_cam"]
            if len(times) < 10 or any(abs(gap - period) > period / 2 for gap in gaps):
                text = f"a CAM every {period} ms is expected, they came at {times}"
                raise Mismatch(x.done, [("cams", text)])
            yield x


def back_off(fresh: Fresh) -> Iterator[Exchange]:
    """``back-off``: within its bounds, the same for the same seed, not always the same."""
    parameters = USUAL | {"backoff_min": 500, "backoff_max": 2000}
    found: dict[int, int] = {}
    for seed in [*range(1, SEEDS + 1), *range(1, SEEDS + 1)]:
        x = fresh(parameters, seed=seed)
        x.give(x.oracle.input_index[canonical(REQUEST)])
        x.expire(x.oracle.input_index[canonical(WINDOW)])
        x.flush()
        deadline = from_json(x.done[-1].answer)["deadline"]
        low, high = x.parameters["backoff_min"], x.parameters["backoff_max"]
        lasts = -1 if deadline is None else deadline - x.now
        text = ""
        if not low <= lasts <= high:
            text = f"a back-off of {low} to {high} ms is expected, not one of {lasts} ms"
        elif found.setdefault(seed, lasts) != lasts:
            text = f"seed {seed}: a back-off of {found[seed]} ms before, now one of {lasts} ms"
        elif len(found) == SEEDS and low < high and len(set(found.values())) == 1:
            text = f"a back-off of {lasts} ms whatever the seed is"
        if text:
            raise Mismatch(x.done, [("deadline", text)])
        x.learn(["backoff"], deadline)
        x.give(x.oracle.input_index[canonical(REQUEST)])
        play(x, [["expire", ["backoff"]], REQUEST])
        yield x


def exchanges(case: str, fresh: Fresh) -> Iterator[Exchange]:
    """The exchanges of a case, each played to its end.  Raises Mismatch, Broken, and KeyError for
    a case that is not known."""
    name, _, about = case.partition(" ")
    if case in _PLAIN:
        return _PLAIN[case](fresh)
    if name == "sendings":
        return sendings(fresh, int(about))
    return _ABOUT[name](fresh, about)


_ABOUT: dict[str, Callable[[Fresh, str], Iterator[Exchange]]] = {
    "timer": timer,
    "malformed": malformed,
    "content": content,
}
_PLAIN: dict[str, Callable[[Fresh], Iterator[Exchange]]] = {
    "same instant": same_instant,
    "cam rate": cam_rate,
    "cam marks": cam_marks,
    "back-off": back_off,
}


def needs(case: str) -> set[str]:
    """The features without which a case says nothing."""
    name, _, about = case.partition(" ")
    if case in ("cam rate", "cam marks"):
        return {"cam", "receiver"} | ({"prescriber"} if about == "marks" else set())
    if case == "back-off" or about == "backoff":
        return {"prescriber"}
    match name:
        case "timer":
            scripts = TIMERS[about]
        case "content":
            scripts = CONTENT[about]
        case "malformed":
            scripts = [MALFORMED[about][0], [MALFORMED[about][1]]]
        case "sendings":
            scripts = [ACTING, COMMITTED]
        case _:
            scripts = SAME_INSTANT
    values = [value for script in scripts for value in script]
    found = set()
    if REQUEST in values:
        found.add("prescriber")
    if ADVERTISED in values:
        found.add("receiver")
    if ["restart"] in values:
        found.add("restart")
    return found
