"""Plays a script (scripts.py) in natural time."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from typing import Any

from automcm_conformance.clock import UNKNOWN
from automcm_conformance.exchange import Exchange, Infeasible
from automcm_conformance.purposes import ROOM
from automcm_conformance.scripts import REFUSED, REQUEST, Script
from automcm_conformance.wire import LONG_MS
from automcm_spec.oracle import canonical

Json = Any
Fresh = Callable[..., Exchange]
"""A fresh exchange: ``fresh(parameters)``, ``fresh(parameters, rich=True)``."""
Played = Iterator[Exchange | None]
"""The exchanges of a case, each played to its end; None for one that time forbids."""


def play(x: Exchange, script: Script, lease_ms: int = LONG_MS) -> None:
    """A script; the last expiry is approached to the millisecond.

    Raises Infeasible, Mismatch and Broken.
    """
    if REFUSED in inputs(script) and x.parameters["max_rounds"] < 2:
        raise Infeasible  # there is no second round
    if sum(map(_begins, inputs(script))) > 1 and room(x) < ROOM:
        raise Infeasible  # what the first session leaves in the outbox keeps out the second
    for n, value in enumerate(script):
        match value[0]:
            case "wait":
                x.wait(x.now + value[1])
            case "at":
                _before(x, value[1])
                x.give(number(x, value[2]), at=x.deadline(value[1]), lease_ms=lease_ms)
            case "with":
                x.give(number(x, value[2]), lease_ms=lease_ms, fields=value[1])
            case "older":
                heard = max(0, (x.wire.heard_ms or 0) - value[1])
                x.give(number(x, value[2]), fields={"generation_ms": heard})
            case "expire":
                if n >= len(script) - 2:
                    _before(x, value[1])
                x.expire(number(x, value))
            case _:
                x.give(number(x, value), lease_ms=lease_ms)
    x.flush()


def played(x: Exchange, script: Script, lease_ms: int = LONG_MS) -> Exchange | None:
    """The exchange with the script behind it; None if time forbids that."""
    try:
        play(x, script, lease_ms)
    except Infeasible:
        return None
    return x


def number(x: Exchange, value: Json) -> int:
    """Which input of the oracle it is.  Raises KeyError."""
    return x.oracle.input_index[canonical(value)]


def room(x: Exchange) -> int:
    """How many entries the outbox may have when a session begins (MEM-1)."""
    p = x.parameters
    return p["outbox_limit"] - 1 - max(p["max_participants"], p["max_rounds"])


def _begins(value: Json) -> bool:
    return bool(value == REQUEST or (value[0] == "receive" and value[1][0] == "Advertisement"))


def inputs(script: Iterable[Json]) -> list[Json]:
    """The inputs of a script, without what is about time and fields."""
    return [
        value[2] if value[0] in ("at", "with", "older") else value
        for value in script
        if value[0] != "wait"
    ]


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
