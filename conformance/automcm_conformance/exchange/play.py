"""Plays a tour, and finds the shortest exchange that goes wrong in the same way."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from automcm_conformance.exchange.exchange import Exchange, Infeasible, Wrong
from automcm_conformance.exchange.tours import Pair, timetable
from automcm_conformance.exchange.wire import LONG, LONG_MS, SOON_MS
from automcm_spec.graph.oracle import Oracle
from automcm_spec.support.shortening import with_fewer_parts
from automcm_spec.vocabulary.station import Expire

LEASES = (LONG_MS, 1_000)
"""Leases without ``durations``: one that outlasts every other timer, and one that expires first."""
RUNS = 120
"""Exchanges tried in order to shorten one."""
Short = tuple[list[int], Wrong]
"""Inputs, and what goes wrong at the last of them."""


def play(
    x: Exchange, tour: Sequence[int], timed: bool, lease_ms: int = LONG_MS, soonest: str = ""
) -> Pair | None:
    """Give the inputs of a tour, up to the first that time does not allow; returns that pair.

    ``timed``: the station has ``durations``, so time allows every input. ``soonest``: of the timers
    that need not expire, the one with the earliest deadline. Raises Mismatch, Broken.
    """
    off = _timed(x, tour, soonest) if timed else _natural(x, tour, lease_ms)
    x.end_with_reset()
    return off


def _natural(x: Exchange, tour: Sequence[int], lease_ms: int) -> Pair | None:
    for place, i in enumerate(tour):
        x.place = place
        here = x.state, i
        if x.oracle.answer(*here) is None:
            return here
        try:
            if isinstance(x.oracle.inputs[i], Expire):
                x.expire(i)
            else:
                x.give(i, lease_ms=lease_ms)
        except Infeasible:
            return here
    return None


def _timed(x: Exchange, tour: Sequence[int], soonest: str) -> Pair | None:
    """Two timers of one name that are armed at once have the same duration, so they cannot expire
    one after the other."""
    lasting = LONG | ({soonest: SOON_MS} if soonest else {})
    x.durations({name: ms for name, ms in lasting.items() if name != "lease"})
    for place, slot in enumerate(timetable(x.oracle, tour, x.now, lasting)):
        x.place = place
        i, here = slot.answer.input, (slot.answer.state, slot.answer.input)
        new = {k: ms for k, ms in slot.durations.items() if x.overrides[k] != ms}
        if new:
            x.durations(new)
        value = x.oracle.inputs[i]
        try:
            if not isinstance(value, Expire):
                x.give(i, at=slot.at, lease_ms=slot.lease_ms)
            elif x.clock.deadline(value.timer) == slot.at:
                x.expire(i)
            else:
                return here
        except Infeasible:
            return here
    return None


def offered(oracle: Oracle, inputs: Sequence[int]) -> list[int]:
    """Those of the inputs that can be given one after the other."""
    state, kept = 0, []
    for i in inputs:
        answer = oracle.answer(state, i)
        if answer is not None:
            kept.append(i)
            state = answer.next
    return kept


def shortened(
    oracle: Oracle,
    inputs: Sequence[int],
    ways: Sequence[list[int] | None],
    attempt: Callable[[list[int]], Wrong | None],
    runs: int = RUNS,
) -> Short | None:
    """A short part of ``inputs`` after which the last answer is still wrong; None if even all of
    them do not lead to a wrong answer again.

    ``ways[k]`` leads to the state before input k; ``attempt`` plays inputs and returns the error.
    """

    def run(part: list[int]) -> Short | None:
        nonlocal runs
        if runs <= 0:
            return None
        runs -= 1
        given = offered(oracle, part)
        wrong = attempt(given)
        return None if wrong is None else (given[: wrong.steps[-1].place + 1], wrong)

    def without(found: Short, at: int, size: int) -> Short | None:
        *before, last = found[0]
        shorter = run([*before[:at], *before[at + size :], last])
        return shorter if shorter is not None and len(shorter[0]) < len(found[0]) else None

    best, length = None, 1
    while best is None and length < 4 * len(inputs):
        start = max(0, len(inputs) - length)
        way = [] if start == 0 else ways[start]
        best = None if way is None else run([*way, *inputs[start:]])
        length *= 4
    return best and with_fewer_parts(best, lambda found: len(found[0]) - 1, without)
