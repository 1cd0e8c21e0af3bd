"""All steps of a compiled station from all reachable states, for few ids and low limits."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TypeAlias

from automcm_spec.vocabulary.station import Expire, Input, OpenStation, Outcome, State

Step: TypeAlias = tuple[State, Input, Outcome]


def steps(station: OpenStation, recorded: OpenStation | None = None) -> Iterator[Step]:
    """Each reachable state with each input offered there, and the outcome, always in this order.

    ``recorded``, if given, computes the outcomes (automcm_spec.vocabulary.conditions.recording).
    """
    stepper = recorded or station
    given = sorted((i for i in station.alphabet if not isinstance(i, Expire)), key=repr)
    seen, following = {station.initial}, [station.initial]
    while following:
        st = following.pop()
        armed = sorted(station.armed(station.me, st), key=repr)
        expiries = [Expire("expire", timer) for timer in armed]
        for i in (*given, *expiries):
            if station.offered(st, i):
                outcome = stepper.step(station.me, st, i)
                yield st, i, outcome
                if outcome.st not in seen:
                    seen.add(outcome.st)
                    following.append(outcome.st)
