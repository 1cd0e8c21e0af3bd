"""Cases ``quantity …``: many sessions, participants, rounds and messages, and values near their
bounds. A counter, list or text of the station that is too small shows only here.

The compiled station gives the expected answers (growing_graph.py). Each case is about one role.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import permutations

from automcm_conformance.adapter.protocol import DEFAULTS
from automcm_conformance.exchange.exchange import Exchange, Mismatch
from automcm_conformance.exchange.malformed_messages import TRICKY
from automcm_conformance.exchange.wire import LONG_MS, PLAIN, Values
from automcm_conformance.suite import scripts as s
from automcm_conformance.suite.scripted import Fresh, Played, inputs, number, play, played
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
SHORT = s.USUAL | {"t_timeout": 300}
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


def scripts(about: str) -> list[s.Script]:
    """A script of the role, for the features that the case needs."""
    return [s.ACTING if about.endswith("prescriber") else s.COMMITTED]


def _session(n: int, prescriber: bool) -> list[Input]:
    """The n-th session as a whole, with a message of the one before."""
    if prescriber:
        p = 2 + n % 3
        first, *rest = s.as_prescriber((1, n), p, False, s.command("close", (1, n)))
        old = [s.received("Intention", (1, n - 1), source=p)] if n > 1 else []
        return [first, *old, *rest]
    late = [s.received("Advertisement", (s.Y, n - 1))] if n > 1 else []
    return [*late, *s.as_receiver((s.Y, n), False)]


def _sessions(fresh: Fresh, prescriber: bool) -> Played:
    x = fresh(s.USUAL, logged=False)
    for n in range(1, SESSIONS + 1):
        _given(x, _session(n, prescriber))
    yield x
    if not prescriber:
        many = range(2, PARTICIPANTS + 2)
        yield _given(fresh(s.USUAL), [*_of_prescribers(many), *map(_advertised, many)])


def _prescribers(fresh: Fresh, _: bool) -> Played:
    """Two sessions of each that a station can remember, and one of another between (MEM-1)."""
    few, one_more = range(2, MEMORY + 2), MEMORY + 2
    x = fresh(s.USUAL, limits=_LIMITS | {"memory_limit": MEMORY})
    script = [*_of_prescribers(few), _advertised(one_more), *_of_prescribers(few, 2)]
    yield _given(x, script) if x.parameters["memory_limit"] == MEMORY else None


def _advertised(p: int, n: int = 1) -> Input:
    return s.received("Advertisement", (p, n), source=p)


def _of_prescribers(of: Sequence[int], n: int = 1) -> list[Input]:
    """The n-th session of each prescriber; after it, its Advertisement is a late copy (ADV-8)."""
    return [v for p in of for v in (_advertised(p, n), s.received("Fin", (p, n), source=p))]


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
    intentions = [s.received("Intention", s.MINE, source=p) for p in (*peers[::2], *peers[1::2])]
    one_more = s.received("Intention", s.MINE, source=peers[-1] + 1)
    cancels: list[Input] = [s.received("Cancel", s.MINE, source=p) for p in peers]
    acks = [s.received("Ack", s.MINE, of=("Cancel", 1), source=p) for p in peers]
    recorded: s.Script = [s.REQUEST, *intentions, one_more, s.Wait(20), intentions[0]]
    target = peers[len(peers) // 2]
    ends: list[s.Script] = [
        [s.CLOSE, s.command("prescribe", s.MINE, 1, target), s.Wait(150), *acks[::3], s.Wait(500)],
        [s.CLOSE, s.command("prescribe", s.MINE, 1, target), *acks, s.Wait(500)],
        [s.ABORT, s.Wait(150), *acks[1::2], s.Wait(500)],
        [s.CLOSE, s.ABORT, s.Wait(500)],
        [s.CLOSE, s.PROCEED, *acks[::2], s.Wait(500)],
        [s.WINDOW, s.expire("decide"), s.Wait(500)],
        [*cancels, *intentions, s.WINDOW],
        [s.CLOSE, *cancels[::-1], s.Wait(100)],
    ]
    for end in ends:
        yield played(fresh(SHORT), [*recorded, *end])
    stranger = s.received("Cancel", s.MINE, source=peers[-1] + 1)
    yield played(fresh(SHORT), [s.REQUEST, *cancels, stranger, one_more, intentions[0], s.WINDOW])


def _orders(fresh: Fresh, _: bool) -> Played:
    orders: list[tuple[int, ...]] = [*permutations((2, 3, 4)), (5, 3, 2, 6, 4), (6, 5, 4, 3, 2)]
    for order in orders:
        for target in order:
            others = [p for p in order if p != target]
            intentions = [s.received("Intention", s.MINE, source=p) for p in order]
            prescribes = s.command("prescribe", s.MINE, 1, target)
            leaves = s.received("Cancel", s.MINE, source=others[0])
            acks = [s.received("Ack", s.MINE, of=("Cancel", 1), source=p) for p in others]
            ends: list[s.Script] = [[prescribes, s.Wait(120), *acks], [leaves, prescribes]]
            for end in ends:
                x = fresh(SHORT)
                records_all = x.parameters["max_participants"] >= len(order)
                script = [s.REQUEST, *intentions, s.CLOSE, *end, s.Wait(500)]
                yield played(x, script) if records_all else None


def _receptions(fresh: Fresh, prescriber: bool) -> Played:
    x = fresh(s.USUAL, logged=False)
    begin, heard, other = [*s.COMMITTED, s.ACCEPTANCE_ACKED], s.HEARD_THEM, (3, 1)
    others: list[Input] = [s.INSTRUCTED, s.ADVERTISED, s.INTENTION_ACKED, s.WITHDRAWN]
    others.append(s.cam(3, other))
    if prescriber:
        begin, heard = s.ACTING, s.HEARD_TARGET
        others = [s.ACCEPTED, s.INTENDED, s.PRESCRIPTION_ACKED, s.INSTRUCTED]
        others.append(s.received("Fin", other))
    others += [s.received(type_, other, source=3) for type_ in ("Advertisement", "Cancel")]
    play(x, begin)
    for n in range(RECEPTIONS):
        value = others[n // 2 % len(others)] if n % 2 else heard
        x.give(number(x, value), at=x.now + STEP_MS)
        if n % BULK == 0:
            x.flush()
    play(x, [s.COMPLETE if prescriber else s.FINISHED, s.Wait(STEP_MS)])
    yield x


def _rounds(fresh: Fresh, prescriber: bool) -> Played:
    for rounds in range(1, ROUNDS + 1):
        for agree in (False, True):
            x = fresh(s.USUAL, limits=_LIMITS | {"max_rounds": rounds})
            values = (_asked if prescriber else _instructed)(rounds, agree)
            yield _given(x, values) if x.parameters["max_rounds"] == rounds else None
    x = fresh(s.USUAL, limits=_LIMITS | MANY_ROUNDS, logged=False)
    if not MANY_ROUNDS.items() <= x.parameters.items():
        yield None
    elif prescriber:
        yield _given(x, _asked(MANY_ROUNDS["max_rounds"], True))
    else:
        yield _late_acks(x, MANY_ROUNDS["max_rounds"])


def _late_acks(x: Exchange, rounds: int) -> Exchange:
    """The exchange after as many refusals. Each is sent when the copies of the two before it are
    due, the older one first (section 3). Raises Mismatch and Broken."""
    _given(x, s.WAITING)
    for k in range(1, rounds + 1):
        prescription = number(x, s.received("Prescription", s.THEIRS, k))
        x.give(prescription, at=x.now + x.parameters["t_resend"])
        x.give(number(x, s.command("refuse", s.THEIRS, k)))
        if k > 2:
            x.give(number(x, s.received("Ack", s.THEIRS, of=("Acceptance", k - 2))))
    x.flush()
    return x


def _messages(fresh: Fresh, prescriber: bool) -> Played:
    """As many reliable messages in one life: a prescriber's in one session, a receiver's in many.
    Of the receiver's copies that are due at the same time, the older comes first (section 3)."""
    changed = {"t_timeout": 2 * s.USUAL["t_resend"]}
    limits = {"max_rounds": MESSAGES, "outbox_limit": 2 * MESSAGES} if prescriber else {}
    values = replace(MANY, numbers={s.Y: tuple(range(MESSAGES))})
    x = fresh(s.USUAL | changed, values=values, limits=_LIMITS | limits, logged=False)
    if not (changed | limits).items() <= x.parameters.items():
        yield None
    elif prescriber:
        yield _given(x, _asked(MESSAGES, True, acked=False))
    else:
        for n in range(1, MESSAGES // 2 + 1):
            x.give(number(x, _advertised(s.Y, n)), at=x.now + x.parameters["t_resend"])
            x.give(number(x, s.command("abort", (s.Y, n))))
            if n % BULK == 0:
                x.flush()
        yield x


def _asked(rounds: int, agree: bool, acked: bool = True) -> list[Input]:
    """A prescriber proposes as often as it may; ``agree``: the last proposal is accepted."""
    script: list[Input] = [s.REQUEST, s.INTENDED, s.CLOSE]
    for k in range(1, rounds + 1):
        script.append(s.command("prescribe", s.MINE, k, s.Y))
        script += [s.received("Ack", s.MINE, of=("Prescription", k))] * acked
        script.append(s.received("Acceptance", s.MINE, k, accepted=agree and k == rounds))
    return script


def _instructed(rounds: int, agree: bool) -> list[Input]:
    """A receiver refuses; ``agree``: but the last proposal. There is none after it (END-5)."""
    beyond = s.received("Prescription", s.THEIRS, rounds + 1)
    script: list[Input] = [*s.WAITING, beyond]
    for k in range(1, rounds + 1):
        accepts = agree and k == rounds
        script += [
            s.received("Prescription", s.THEIRS, k),
            s.command("accept" if accepts else "refuse", s.THEIRS, k),
            s.received("Ack", s.THEIRS, of=("Acceptance", k)),
        ]
    return [*script, beyond]


def _times(fresh: Fresh, prescriber: bool) -> Played:
    first = s.REQUEST if prescriber else s.ADVERTISED
    for start_ms in STARTS_MS:
        for script in (each for timer in s.TIMERS.values() for each in timer):
            if first in inputs(script) and s.RESTART not in inputs(script):
                yield played(fresh(s.USUAL, values=replace(PLAIN, start_ms=start_ms)), script)


def _leases(fresh: Fresh, prescriber: bool) -> Played:
    for lease_ms in LEASES_MS:
        fields = {"lease_ms": lease_ms}
        script: s.Script = [*s.WAITING, s.With(fields, s.INSTRUCTED), s.ACCEPT]
        end: s.Script = [s.ACCEPTANCE_ACKED, s.Wait(PAUSE_MS), s.FINISHED]
        if prescriber:
            script = [*s.CHOOSING, s.With(fields, s.PRESCRIBE), s.Wait(PAUSE_MS), s.ACCEPTED]
            end = [s.COMPLETE]
        yield played(fresh(s.USUAL | {"t_cam_loss": FAR_MS}), [*script, s.Wait(PAUSE_MS), *end])


def _texts(fresh: Fresh, _: bool) -> Played:
    every = {text: n for n, text in enumerate(TRICKY)}
    contents = [every, {"in": [every]}, *({text: {text: [text]}} for text in TRICKY)]
    for details in contents:
        yield played(fresh(s.USUAL), [s.With({"details": details}, s.REQUEST), s.Wait(120)])
    for text in TRICKY:
        yield _named(fresh(s.USUAL), text)


def _named(x: Exchange, scenario: str) -> Exchange | None:
    """A request of this scenario; None if the station refuses it, as it does not know it."""
    try:
        return played(x, [s.With({"scenario": scenario}, s.REQUEST), s.Wait(120)])
    except Mismatch as wrong:
        names = [i["name"] for i in wrong.answer.indications]
        if not wrong.answer.messages and names == ["refused"]:
            return None
        raise


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
