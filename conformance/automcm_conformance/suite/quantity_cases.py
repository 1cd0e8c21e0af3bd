"""Cases ``quantity …``: many sessions, participants, rounds and messages, and values near their
bounds. A counter, list or text of the station that is too small shows only here.

The compiled station gives the expected answers (growing_graph.py). Each case is about one role.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import permutations

from automcm_conformance.adapter.protocol import DEFAULTS, read_answer
from automcm_conformance.exchange.exchange import Exchange, Infeasible, Mismatch
from automcm_conformance.exchange.malformed_messages import TRICKY
from automcm_conformance.exchange.wire import LONG_MS, PLAIN, Values
from automcm_conformance.suite.scripted import Fresh, Played, inputs, number, play, played
from automcm_conformance.suite.scripts import (
    ABORT,
    ACCEPTANCE_ACKED,
    ACCEPTED,
    ACTING,
    ADVERTISED,
    CHOOSING,
    CLOSE,
    COMMITTED,
    COMPLETE,
    FINISHED,
    HEARD_TARGET,
    HEARD_THEM,
    INSTRUCTED,
    INTENDED,
    INTENTION_ACKED,
    MINE,
    PRESCRIBE,
    PRESCRIPTION_ACKED,
    PROCEED,
    REQUEST,
    RESTART,
    THEIRS,
    TIMERS,
    USUAL,
    VERIFYING,
    WAITING,
    WINDOW,
    WITHDRAWN,
    Script,
    Wait,
    With,
    Y,
    as_prescriber,
    as_receiver,
    cam,
    command,
    expire,
    received,
)
from automcm_spec.graph.growing_graph import GrowingGraph
from automcm_spec.vocabulary.messages import LIMIT
from automcm_spec.vocabulary.parameters import LIMITS
from automcm_spec.vocabulary.station import Input

SESSIONS, ROUNDS, PARTICIPANTS, RECEPTIONS = 300, 8, 32, 10_000
MANY_ROUNDS = {"max_rounds": 260, "outbox_limit": 300}
"""More than a byte can count."""
MESSAGES = 33_000
"""More than 16 bits with a sign can count."""
MEMORY = 4
"""A memory_limit that is soon reached."""
BULK = 500
"""The number of receptions whose lines are written together."""
STEP_MS, PAUSE_MS = 50, 7
SHORT = USUAL | {"t_timeout": 300}
STARTS_MS = (2**31 - 1200, 2**32 - 1200, LIMIT - 2 * LONG_MS)
LEASES_MS = (
    *(2**bits + more for bits in (24, 31, 32) for more in (-1, 0, 1)),
    0x0AAA_AAAA_AAAA_AA,
    0x1555_5555_5555_55,
    LIMIT - 10**6,
    LIMIT,
)
"""Around the bounds of 32 bits and of single-precision floats; each bit set and not set. The last
one ends beyond 2^53."""
FAR_MS = LIMIT - 10**5
"""A t_cam_loss with which the lease is the next deadline."""
_LIMITS = {name: DEFAULTS[name] for name in LIMITS}


def _station(p: int) -> int:
    """An id; the order of ids is not that of ``p``, nor that of their texts."""
    return p * 37_639 % 100_003


MANY = Values(
    {**PLAIN.ids} | {p: _station(p) for p in range(2, PARTICIPANTS + 3)},
    {p: tuple(range(SESSIONS + 2)) for p in range(2, PARTICIPANTS + 3)},
)


def exchanges(fresh: Fresh, about: str) -> Played:
    """``quantity WHAT ROLE``. Raises Mismatch and Broken, and KeyError for an unknown case."""

    def limited(
        *of: dict[str, int], values: Values = MANY, limits: dict[str, int] = _LIMITS, **more: bool
    ) -> Exchange:
        x = fresh(*of, values=values, limits=limits, **more)
        assert isinstance(x.oracle, GrowingGraph)
        x.oracle.limited(x.parameters)
        return x

    what, _, role = about.partition(" ")
    yield from _CASES[what](limited, role == "prescriber")


def scripts(about: str) -> list[Script]:
    """A script of the role, for the features that the case needs."""
    return [ACTING if about.endswith("prescriber") else COMMITTED]


def _session(n: int, prescriber: bool) -> list[Input]:
    """The n-th session as a whole, with a message of the one before."""
    if prescriber:
        p = 2 + n % 3
        first, *rest = as_prescriber((1, n), p, False, command("close", (1, n)))
        old = [received("Intention", (1, n - 1), source=p)] if n > 1 else []
        return [first, *old, *rest]
    late = [received("Advertisement", (Y, n - 1))] if n > 1 else []
    return [*late, *as_receiver((Y, n), False)]


def _sessions(fresh: Fresh, prescriber: bool) -> Played:
    x = fresh(USUAL, logged=False)
    for n in range(1, SESSIONS + 1):
        _given(x, _session(n, prescriber))
    yield x
    if not prescriber:
        many = range(2, PARTICIPANTS + 2)
        yield _given(fresh(USUAL), [*_of_prescribers(many), *map(_advertised, many)])


def _prescribers(fresh: Fresh, _: bool) -> Played:
    """Two sessions of each that a station can remember, and one of another between (MEM-1)."""
    few, one_more = range(2, MEMORY + 2), MEMORY + 2
    x = fresh(USUAL, limits=_LIMITS | {"memory_limit": MEMORY})
    script = [*_of_prescribers(few), _advertised(one_more), *_of_prescribers(few, 2)]
    yield _given(x, script) if x.parameters["memory_limit"] == MEMORY else None


def _advertised(p: int, n: int = 1) -> Input:
    return received("Advertisement", (p, n), source=p)


def _of_prescribers(of: Sequence[int], n: int = 1) -> list[Input]:
    """The n-th session of each prescriber; after it, its Advertisement is a late copy (ADV-8)."""
    return [v for p in of for v in (_advertised(p, n), received("Fin", (p, n), source=p))]


def _given(x: Exchange, values: Sequence[Input]) -> Exchange:
    """The exchange after these inputs. Raises Mismatch and Broken."""
    for value in values:
        x.give(number(x, value), at=x.now + PAUSE_MS)
        if len(x.unwritten_steps) >= BULK:
            x.flush()
    x.flush()
    return x


def _participants(fresh: Fresh, _: bool) -> Played:
    x = fresh(SHORT)
    peers = range(2, 2 + min(PARTICIPANTS, x.parameters["max_participants"]))
    intentions = [received("Intention", MINE, source=p) for p in (*peers[::2], *peers[1::2])]
    one_more = received("Intention", MINE, source=peers[-1] + 1)
    cancels: list[Input] = [received("Cancel", MINE, source=p) for p in peers]
    acks = [received("Ack", MINE, of=("Cancel", 1), source=p) for p in peers]
    recorded: Script = [REQUEST, *intentions, one_more, Wait(20), intentions[0]]
    target = peers[len(peers) // 2]
    ends: list[Script] = [
        [CLOSE, command("prescribe", MINE, 1, target), Wait(150), *acks[::3], Wait(500)],
        [CLOSE, command("prescribe", MINE, 1, target), *acks, Wait(500)],
        [ABORT, Wait(150), *acks[1::2], Wait(500)],
        [CLOSE, ABORT, Wait(500)],
        [CLOSE, PROCEED, *acks[::2], Wait(500)],
        [WINDOW, expire("decide"), Wait(500)],
        [*cancels, *intentions, WINDOW],
        [CLOSE, *cancels[::-1], Wait(100)],
    ]
    for end in ends:
        yield played(fresh(SHORT), [*recorded, *end])
    stranger = received("Cancel", MINE, source=peers[-1] + 1)
    yield played(fresh(SHORT), [REQUEST, *cancels, stranger, one_more, intentions[0], WINDOW])


def _orders(fresh: Fresh, _: bool) -> Played:
    orders: list[tuple[int, ...]] = [*permutations((2, 3, 4)), (5, 3, 2, 6, 4), (6, 5, 4, 3, 2)]
    for order in orders:
        for target in order:
            others = [p for p in order if p != target]
            recorded: Script = [REQUEST, *(received("Intention", MINE, source=p) for p in order)]
            prescribes = command("prescribe", MINE, 1, target)
            leaves = received("Cancel", MINE, source=others[0])
            acks = [received("Ack", MINE, of=("Cancel", 1), source=p) for p in others]
            ends: list[Script] = [[prescribes, Wait(120), *acks], [leaves, prescribes]]
            for end in ends:
                x = fresh(SHORT)
                records_all = x.parameters["max_participants"] >= len(order)
                script = [*recorded, CLOSE, *end, Wait(500)]
                yield played(x, script) if records_all else None


def _receptions(fresh: Fresh, prescriber: bool) -> Played:
    x = fresh(USUAL, logged=False)
    begin, heard = [*COMMITTED, ACCEPTANCE_ACKED], HEARD_THEM
    others: list[Input] = [INSTRUCTED, ADVERTISED, INTENTION_ACKED, WITHDRAWN, cam(3, (3, 1))]
    if prescriber:
        begin, heard = ACTING, HEARD_TARGET
        others = [ACCEPTED, INTENDED, PRESCRIPTION_ACKED, INSTRUCTED, received("Fin", (3, 1))]
    others += [received("Advertisement", (3, 1), source=3), received("Cancel", (3, 1), source=3)]
    play(x, begin)
    for n in range(RECEPTIONS):
        value = others[n // 2 % len(others)] if n % 2 else heard
        x.give(number(x, value), at=x.now + STEP_MS)
        if n % BULK == 0:
            x.flush()
    play(x, [COMPLETE if prescriber else FINISHED, Wait(STEP_MS)])
    yield x


def _rounds(fresh: Fresh, prescriber: bool) -> Played:
    for rounds in range(1, ROUNDS + 1):
        for agree in (False, True):
            x = fresh(USUAL, limits=_LIMITS | {"max_rounds": rounds})
            values = (_asked if prescriber else _instructed)(rounds, agree)
            yield _given(x, values) if x.parameters["max_rounds"] == rounds else None
    x = fresh(USUAL, limits=_LIMITS | MANY_ROUNDS, logged=False)
    if not MANY_ROUNDS.items() <= x.parameters.items():
        yield None
    elif prescriber:
        yield _given(x, _asked(MANY_ROUNDS["max_rounds"], True))
    else:
        yield _late_acks(x, MANY_ROUNDS["max_rounds"])


def _late_acks(x: Exchange, rounds: int) -> Exchange:
    """The exchange after as many refusals. Each is sent when the copies of the two before it are
    due, the older one first (section 3). Raises Mismatch and Broken."""
    _given(x, WAITING)
    for k in range(1, rounds + 1):
        x.give(number(x, received("Prescription", THEIRS, k)), at=x.now + x.parameters["t_resend"])
        x.give(number(x, command("refuse", THEIRS, k)))
        if k > 2:
            x.give(number(x, received("Ack", THEIRS, of=("Acceptance", k - 2))))
    x.flush()
    return x


def _messages(fresh: Fresh, prescriber: bool) -> Played:
    """As many reliable messages in one life: a prescriber's in one session, a receiver's in many.
    Of the receiver's copies that are due at the same time, the older comes first (section 3)."""
    changed = {"t_timeout": 2 * USUAL["t_resend"]}
    limits = {"max_rounds": MESSAGES, "outbox_limit": 2 * MESSAGES} if prescriber else {}
    values = replace(MANY, numbers={Y: tuple(range(MESSAGES))})
    x = fresh(USUAL | changed, values=values, limits=_LIMITS | limits, logged=False)
    if not (changed | limits).items() <= x.parameters.items():
        yield None
    elif prescriber:
        yield _given(x, _asked(MESSAGES, True, acked=False))
    else:
        for n in range(1, MESSAGES // 2 + 1):
            x.give(number(x, _advertised(Y, n)), at=x.now + x.parameters["t_resend"])
            x.give(number(x, command("abort", (Y, n))))
            if n % BULK == 0:
                x.flush()
        yield x


def _asked(rounds: int, agree: bool, acked: bool = True) -> list[Input]:
    """A prescriber proposes as often as it may; ``agree``: the last proposal is accepted."""
    script: list[Input] = [REQUEST, INTENDED, CLOSE]
    for k in range(1, rounds + 1):
        script.append(command("prescribe", MINE, k, Y))
        script += [received("Ack", MINE, of=("Prescription", k))] * acked
        script.append(received("Acceptance", MINE, k, accepted=agree and k == rounds))
    return script


def _instructed(rounds: int, agree: bool) -> list[Input]:
    """A receiver refuses; ``agree``: but the last proposal. There is none after it (END-5)."""
    beyond = received("Prescription", THEIRS, rounds + 1)
    script: list[Input] = [*WAITING, beyond]
    for k in range(1, rounds + 1):
        accepts = agree and k == rounds
        script += [
            received("Prescription", THEIRS, k),
            command("accept" if accepts else "refuse", THEIRS, k),
            received("Ack", THEIRS, of=("Acceptance", k)),
        ]
    return [*script, beyond]


def _times(fresh: Fresh, prescriber: bool) -> Played:
    first = REQUEST if prescriber else ADVERTISED
    for start_ms in STARTS_MS:
        for script in (each for timer in TIMERS.values() for each in timer):
            if first in inputs(script) and RESTART not in inputs(script):
                yield played(fresh(USUAL, values=replace(PLAIN, start_ms=start_ms)), script)


def _leases(fresh: Fresh, prescriber: bool) -> Played:
    for lease_ms in LEASES_MS:
        fields = {"lease_ms": lease_ms}
        script: Script = [*VERIFYING[:-1], With(fields, INSTRUCTED), command("accept", THEIRS, 1)]
        end: Script = [ACCEPTANCE_ACKED, Wait(PAUSE_MS), FINISHED]
        if prescriber:
            script, end = [*CHOOSING, With(fields, PRESCRIBE), Wait(PAUSE_MS), ACCEPTED], [COMPLETE]
        yield played(fresh(USUAL | {"t_cam_loss": FAR_MS}), [*script, Wait(PAUSE_MS), *end])


def _texts(fresh: Fresh, _: bool) -> Played:
    every = {text: n for n, text in enumerate(TRICKY)}
    contents = [every, {"in": [every]}, *({text: {text: [text]}} for text in TRICKY)]
    for details in contents:
        yield played(fresh(USUAL), [With({"details": details}, REQUEST), Wait(120)])
    for text in TRICKY:
        yield _named(fresh(USUAL), text)


def _named(x: Exchange, scenario: str) -> Exchange | None:
    """A request of this scenario; None if the station refuses it, as it does not know it."""
    try:
        play(x, [With({"scenario": scenario}, REQUEST), Wait(120)])
    except Infeasible:
        return None
    except Mismatch as wrong:
        answer = read_answer(wrong.steps[-1].answer)
        if not answer.messages and [i["name"] for i in answer.indications] == ["refused"]:
            return None
        raise
    return x


_CASES = {
    "sessions": _sessions,
    "prescribers": _prescribers,
    "participants": _participants,
    "orders": _orders,
    "receptions": _receptions,
    "rounds": _rounds,
    "messages": _messages,
    "times": _times,
    "leases": _leases,
    "texts": _texts,
}
