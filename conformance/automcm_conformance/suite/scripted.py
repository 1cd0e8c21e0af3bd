"""Plays a script (scripts.py) in natural time."""

from __future__ import annotations

from collections.abc import Callable, Iterator

from automcm_conformance.adapter.protocol import ROOM
from automcm_conformance.exchange.armed_timers import UNKNOWN
from automcm_conformance.exchange.exchange import Exchange, Infeasible
from automcm_conformance.exchange.wire import LONG_MS
from automcm_conformance.suite import scripts as s
from automcm_spec.vocabulary.messages import LIMIT
from automcm_spec.vocabulary.parameters import cam_lead
from automcm_spec.vocabulary.station import Expire, Input, Receive, Timer

_AROUND = (s.At, s.Late, s.With, s.Older, s.Ahead)
"""Steps that have an input."""
Fresh = Callable[..., Exchange]
"""Makes a new exchange: ``fresh(parameters)``, ``fresh(parameters, rich=True)``."""
Played = Iterator[Exchange | None]
"""The exchanges of a case, each played to its end; None for one that time does not allow."""


def play(x: Exchange, script: s.Script, lease_ms: int = LONG_MS) -> None:
    """Play a script; the last expiry is approached to the millisecond.

    Raises Infeasible, Mismatch and Broken.
    """
    if {s.REFUSED, s.INSTRUCTED_2} & {*inputs(script)} and x.parameters["max_rounds"] < 2:
        raise Infeasible  # there is no second round
    if sum(map(_begins, inputs(script))) > 1 and room(x) < ROOM:
        raise Infeasible  # what the first session leaves in the outbox keeps out the second
    for n, item in enumerate(script):
        match item:
            case s.Wait(ms):
                x.wait(x.now + ms)
            case s.At(timer, value):
                _before(x, timer)
                x.give(number(x, value), at=x.clock.deadline(timer), lease_ms=lease_ms)
            case s.Late(ms, value) if value is not None:
                x.give(number(x, value), at=x.now + ms, lease_ms=lease_ms)
            case s.Late(ms):
                x.advance(x.now + ms)
            case s.With(fields, value):
                x.give(number(x, value), lease_ms=lease_ms, fields=fields)
            case s.Older(ms, value):
                generation_ms = max(0, (x.wire.heard_ms or 0) - ms)
                x.give(number(x, value), fields={"generation_ms": generation_ms})
            case s.Ahead(ms, value):
                generation_ms = min(_latest(x) + ms, LIMIT)
                x.give(number(x, value), fields={"generation_ms": generation_ms})
            case Expire(timer=timer):
                if n >= len(script) - 2:
                    _before(x, timer)
                x.expire(number(x, item))
            case _:
                x.give(number(x, item), lease_ms=lease_ms)
    x.flush()


def _latest(x: Exchange) -> int:
    """The latest generation time of a CAM that may count now (ACT-5)."""
    assert x.wire.first_cam_ms is not None
    generated, received = x.wire.first_cam_ms
    drift = x.parameters.get("clock_drift", 0)
    return generated + cam_lead(drift, x.parameters["t_resend"], x.now - received)


def played(x: Exchange, script: s.Script, lease_ms: int = LONG_MS) -> Exchange | None:
    """The exchange after the script; None if time does not allow it."""
    try:
        play(x, script, lease_ms)
    except Infeasible:
        return None
    return x


def number(x: Exchange, value: Input) -> int:
    """The oracle's number of an input. Raises KeyError."""
    return x.oracle.input_index[value]


def room(x: Exchange) -> int:
    """The most outbox entries that may exist when a session begins (MEM-1)."""
    p = x.parameters
    return p["outbox_limit"] - 1 - max(p["max_participants"], p["max_rounds"])


def _begins(value: Input) -> bool:
    advertised = isinstance(value, Receive) and value.message.type == "Advertisement"
    return advertised or value == s.REQUEST


def inputs(script: s.Script) -> list[Input]:
    """The inputs of a script, without its steps of time and fields."""
    found = [item.input if isinstance(item, _AROUND) else item for item in script]
    return [value for value in found if not isinstance(value, s.Wait | None)]


def _before(x: Exchange, timer: Timer) -> None:
    """Advance to one millisecond before a timer expires; nothing must happen. Raises Infeasible if
    another timer than a resend expires before it, or at the same time and first."""
    deadline = x.clock.deadline(timer)
    if deadline is None or deadline == UNKNOWN:
        raise Infeasible
    while (due := x.next_due) is not None and due < deadline:
        if any(x.expires(i)[0] != "resend" for i in x.advance(due)):
            raise Infeasible
    if x.clock.due(deadline) != timer:
        raise Infeasible
    x.wait(deadline - 1)
