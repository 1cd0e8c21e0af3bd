"""Many stations within each other's range: how many answers one of them gets, and how many agree if
all of them ask.  No vehicle needs the road: this is the protocol and the radio alone."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from random import Random

from automcm.applications.vehicle import LANE_WIDTH
from automcm.service.application import AgreedManeuver, Choice, CloseWindow, all_answered
from automcm_evaluation.framework.experiment import Values
from automcm_evaluation.framework.intervals import quantile
from automcm_evaluation.loss.loss_sessions import messages
from automcm_simulation.radio.table_radio import TableRadio
from automcm_simulation.road.hazard_measures import bound_ms, met
from automcm_simulation.road.straight_lane import LANE_CHANGE, Straight
from automcm_simulation.traffic.traffic import Stations
from automcm_simulation.traffic.traffic_measures import DELAY_MS
from automcm_spec.vocabulary.messages import Session
from automcm_spec.vocabulary.parameters import Parameters

STEP_MS = 100
"""Applications look whether they can ask at drawn times, which are at most so far apart."""
SETTLED_MS = 1000
"""The first request comes after this time, when CAMs have been heard."""
LANES = 4
PER_KM = 200.0
SPEED_M_S = 25.0


@dataclass
class Asks(Straight):
    """Asks until it has had one agreement; as a receiver it accepts everything."""

    answers: int | None = None
    """The receivers at its first choice."""
    chose_ms: int | None = None
    agreed_ms: int | None = None

    def choose(self, choice: Choice) -> None:
        """As ``Application.choose``."""
        if self.chose_ms is None:
            self.answers, self.chose_ms = len(choice.planned), self.service.now()
        super().choose(choice)

    def load(self, maneuver: AgreedManeuver) -> None:
        """As ``Application.load``."""
        if maneuver.role == "prescriber":
            self.agreed_ms = self.service.now()
        super().load(maneuver)

    def fallback(self, session: Session, reason: str) -> None:
        """As ``Application.fallback``: the next session may have another target."""
        self.target = 0


class Crowd(Stations):
    """``number`` stations on a road of LANES lanes at PER_KM, which all drive at SPEED_M_S."""

    def __init__(self, number: int, seed: int, close_window: CloseWindow | None = None) -> None:
        super().__init__(TableRadio(seed), seed, None)
        self._service = partial(self._service, close_window=close_window)
        self._random = Random(seed)
        self.applications = {n: Asks() for n in range(1, number + 1)}
        self._move()
        for station_id, application in self.applications.items():
            self.add(station_id, application)

    def _move(self) -> None:
        now = self.clock.now()
        ahead = SPEED_M_S * now / 1000
        self.links.move(
            {n: (ahead + 1000 * n / PER_KM, n % LANES * LANE_WIDTH) for n in self.applications}
        )
        self.clock.at(now + STEP_MS, self._move)

    def ask(self, station_id: int) -> None:
        """Let this station ask now, and whenever it can, until it has agreed."""
        service = self.services[station_id]
        if self.applications[station_id].agreed_ms is not None:
            return
        if not service.state.bound and not service.state.backoff:
            service.command(LANE_CHANGE)
        again = self.clock.now() + 1 + self._random.randrange(STEP_MS)
        self.clock.at(again, partial(self.ask, station_id))


def answers(values: Values, seed: int) -> Values:
    """One station in the middle asks ``receivers`` others, all of whom it concerns.

    ``joined`` are the receivers, ``recorded`` those whose answers it has at its choice.
    ``chose_ms``, ``agreed_ms`` and ``free_ms`` are times since its request: of these events, and
    from when on only its target is bound; None for what did not happen.
    """
    asker = values["receivers"] // 2 + 1
    crowd = Crowd(values["receivers"] + 1, seed % 2**31, all_answered if values["early"] else None)
    own = crowd.applications[asker]
    crowd.run(SETTLED_MS)
    before = messages(crowd.services.values())
    crowd.services[asker].command(LANE_CHANGE)
    free_ms = None
    while crowd.clock.now() < values["run_ms"]:
        crowd.clock.run(crowd.clock.now() + STEP_MS)
        two = asker, own.target
        bound = [n for n, s in crowd.services.items() if s.state.bound and n not in two]
        if free_ms is None and own.chose_ms is not None and not bound:
            free_ms = crowd.clock.now()

    def after(at: int | None) -> int | None:
        return None if at is None else at - SETTLED_MS

    return {
        "joined": sum(n != asker for n in set().union(*crowd.partners.values())),
        "recorded": own.answers or 0,
        "chose_ms": after(own.chose_ms),
        "agreed_ms": after(own.agreed_ms),
        "free_ms": after(free_ms),
        "messages": messages(crowd.services.values()) - before,
        "busy": round(crowd.links.radio.channel_busy_ratio(asker), 3),
    }


def all_ask(values: Values, seed: int) -> Values:
    """All stations ask, each from a moment on that is drawn within ``spread_ms``.

    ``agreed`` of them have had an agreement as prescriber at the end, ``first`` of them in their
    first session; ``median_ms`` and ``last_ms`` are their times from the wish on.
    """
    crowd = Crowd(values["stations"], seed % 2**31)
    random = Random(seed)
    wishes = {n: SETTLED_MS + random.randrange(values["spread_ms"] + 1) for n in crowd.applications}
    for station_id, from_ms in wishes.items():
        crowd.clock.at(from_ms, partial(crowd.ask, station_id))
    crowd.run(values["run_ms"])
    times = sorted(
        a.agreed_ms - wishes[n] for n, a in crowd.applications.items() if a.agreed_ms is not None
    )
    first: dict[int, Session] = {}
    for session in sorted(crowd.began, key=crowd.began.__getitem__):
        first.setdefault(session[0], session)
    agreed_first = sum(session in crowd.agreed for session in first.values())
    hazards = met([seed], [crowd.over()], bound_ms(Parameters(), DELAY_MS))
    return {
        "requested": crowd.requested,
        "first": agreed_first,
        "agreed": len(times),
        "median_ms": round(quantile(times, 0.5)) if times else None,
        "last_ms": times[-1] if times else None,
        "ended": dict(sorted(crowd.ended.items())),
        "busy": round(crowd.links.radio.channel_busy_ratio(1), 3),
        "hazards": hazards["lengths"],
        "bound_ms": hazards["bound_ms"],
        "wrong": hazards["wrong"],
    }
