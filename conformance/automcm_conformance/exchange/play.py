"""Plays a tour, and finds the shortest exchange that goes wrong in the same way."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from automcm_conformance.exchange.exchange import Broken, Exchange, Infeasible, Mismatch
from automcm_conformance.exchange.tours import Pair, timetable
from automcm_conformance.exchange.wire import LONG_MS, long
from automcm_spec.graph.oracle import Oracle
from automcm_spec.vocabulary.station import Expire

LEASES = (LONG_MS, 1_000)
"""Leases without ``durations``: one that outlasts every other timer, and one that expires first."""
RUNS = 120
"""Exchanges tried in order to shorten one."""
Wrong = Mismatch | Broken


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
    lasting = long(soonest)
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
) -> tuple[list[int], Wrong] | None:
    """A short part of ``inputs`` after which the last answer is still wrong; None if even all of
    them do not lead to a wrong answer again.

    ``ways[k]`` leads to the state before input k; ``attempt`` plays inputs and returns the error.
    """
    best: tuple[list[int], Wrong] | None = None
    length = 1
    while best is None and runs > 0:
        start = max(0, len(inputs) - length)
        way = ways[start]
        if way is not None or start == 0:
            best = _run(oracle, [*(way or []), *inputs[start:]], attempt)
            runs -= 1
        if start == 0:
            break
        length *= 4
    size = len(best[0]) // 2 if best else 0
    while best and size > 0:
        at = 0
        while at + size < len(best[0]) and runs > 0:
            shorter = _run(oracle, best[0][:at] + best[0][at + size :], attempt)
            runs -= 1
            if shorter is not None and len(shorter[0]) < len(best[0]):
                best = shorter
            else:
                at += size
        size //= 2
    return best


def _run(
    oracle: Oracle, inputs: list[int], attempt: Callable[[list[int]], Wrong | None]
) -> tuple[list[int], Wrong] | None:
    inputs = offered(oracle, inputs)
    wrong = attempt(inputs)
    return None if wrong is None else (inputs[: wrong.steps[-1].place + 1], wrong)
