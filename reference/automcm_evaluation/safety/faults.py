"""Faults of a simulated maneuver: cuts, aborts, restarts, crashes, a second prescriber."""

from __future__ import annotations

import random
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial

from automcm_simulation.road.hazard_measures import Watched
from automcm_spec.vocabulary.application import Abort

CUTS = {"cut forth": ("forth",), "cut back": ("back",), "cut both ways": ("forth", "back")}
"""forth: messages of the prescriber no longer reach the target; back: the other direction."""
KINDS = (
    *CUTS,
    "target aborts",
    "prescriber aborts",
    "target restarts",
    "prescriber restarts",
    "target crashes",
    "prescriber crashes",
    "second prescriber",
)
LASTS_MS = (500, 6000)
"""Range of the duration of a cut or a crash, uniformly distributed."""


@dataclass(frozen=True, slots=True)
class Injected:
    """One fault of KINDS.  ``until_ms``: the end of a cut, or the restart of a crashed station."""

    kind: str
    at_ms: int
    until_ms: int


@dataclass(frozen=True, slots=True)
class Roles:
    """The station ids of possible targets; ``second`` is 0 without a second prescriber."""

    prescriber: int
    target: int
    second: int = 0


def drawn(kinds: Sequence[str], window: tuple[int, int], draw: random.Random) -> list[Injected]:
    """A fault of each kind, at uniformly distributed times of the window, in ms."""
    faults = []
    for kind in kinds:
        at = draw.randint(*window)
        faults.append(Injected(kind, at, at + draw.randint(*LASTS_MS)))
    return faults


def inject(faults: Sequence[Injected], watched: Watched, roles: Roles) -> int:
    """Schedule the faults; returns the end of the last one, in ms.

    The first end of overlapping cuts ends all of them.
    """
    ways = {"forth": (roles.prescriber, roles.target), "back": (roles.target, roles.prescriber)}
    for fault in faults:
        at, until = (partial(watched.clock.at, ms) for ms in (fault.at_ms, fault.until_ms))
        who, what = fault.kind.split(maxsplit=1)
        station_id = roles.target if who == "target" else roles.prescriber
        if fault.kind in CUTS:
            for way in CUTS[fault.kind]:
                at(partial(watched.radio.cut, *ways[way]))
            until(watched.radio.mend)
        elif what == "aborts":
            at(partial(_abort, watched, station_id))
        elif what == "restarts":
            at(partial(_restart, watched, station_id))
        elif what == "crashes":
            at(partial(watched.crash, station_id))
            until(partial(watched.recover, station_id))
        else:  # a second prescriber
            watched.request(roles.second, fault.at_ms)
    return max((fault.until_ms for fault in faults), default=0)


def _abort(watched: Watched, station_id: int) -> None:
    """The application breaks off and drives alone (END-1) if it is in a session."""
    service = watched.services[station_id]
    session = service.state.session
    if session is not None and station_id not in watched.down:
        service.command(Abort(session=session))
        service.application.fallback(session, "abort")


def _restart(watched: Watched, station_id: int) -> None:
    if station_id not in watched.down:
        watched.services[station_id].restart()
