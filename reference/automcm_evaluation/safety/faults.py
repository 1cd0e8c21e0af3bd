"""Faults of a simulated maneuver: cuts, aborts, restarts, crashes, a second prescriber."""

from __future__ import annotations

import random
from collections.abc import Sequence
from dataclasses import dataclass

from automcm_simulation.road.hazard_measures import Watched
from automcm_spec.vocabulary.application import Abort

CUTS = {"cut forth": (True, False), "cut back": (False, True), "cut both ways": (True, True)}
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
    for fault in faults:
        if fault.kind in CUTS:
            _cut(fault, watched, roles)
        elif fault.kind == "second prescriber":
            watched.request(roles.second, fault.at_ms)
        else:
            _hit(fault, watched, roles)
    return max((fault.until_ms for fault in faults), default=0)


def _cut(fault: Injected, watched: Watched, roles: Roles) -> None:
    forth, back = CUTS[fault.kind]

    def cut() -> None:
        if forth:
            watched.radio.cut(roles.prescriber, roles.target)
        if back:
            watched.radio.cut(roles.target, roles.prescriber)

    watched.clock.at(fault.at_ms, cut)
    watched.clock.at(fault.until_ms, watched.radio.mend)


def _hit(fault: Injected, watched: Watched, roles: Roles) -> None:
    who, what = fault.kind.split()
    station_id = roles.target if who == "target" else roles.prescriber
    if what == "aborts":
        watched.clock.at(fault.at_ms, lambda: _abort(watched, station_id))
    elif what == "restarts":
        watched.clock.at(fault.at_ms, lambda: _restart(watched, station_id))
    else:
        watched.clock.at(fault.at_ms, lambda: watched.crash(station_id))
        watched.clock.at(fault.until_ms, lambda: watched.recover(station_id))


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
