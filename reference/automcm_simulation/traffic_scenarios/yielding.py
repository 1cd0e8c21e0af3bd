"""Yielding at a place: the application that intersections, crossings and road-side units share.

The prescriber asks the first vehicle on the way to a place to arrive there later.  The trajectory
is a speed profile on the receiver's own path, of which it needs no map: x is the distance from the
place, negative before it, and y is 0.  As in speed_advice the receiver stays on its path and slows
down at most comfortably, and nobody relies on more than what he sees: a prescriber without an
agreement waits before the place.  SI units, unless the name says otherwise.
"""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np

from automcm.applications.lane_change import FRESH_MS, MARGIN_S, Coordinated
from automcm.applications.ramp_merge import BRAKE
from automcm.applications.vehicle import LANE_WIDTH, Vehicle
from automcm.kernels.road_line import RoadLine
from automcm.kernels.trajectory import Trajectory
from automcm.service.application import (
    Advertised,
    AgreedManeuver,
    Choice,
    Proposal,
    heard_by,
)
from automcm_spec.vocabulary import messages
from automcm_spec.vocabulary.application import Request
from automcm_spec.vocabulary.messages import Session

PATIENCE_MS = 20_000
"""A receiver is delayed at most until so long after the Prescription."""
NEAR_M = 5.0
"""The way in a Prescription may differ so much from the receiver's own."""
AGAIN_MS = 3000
"""The wait between two requests."""
STEP_S = 1.0


def arriving(t0_ms: int, way: float, after_ms: int) -> messages.Trajectory:
    """Arrive in ``after_ms`` at the place that is ``way`` m ahead."""
    return messages.Trajectory(t0=t0_ms, points=((0, -round(way * 1000), 0), (after_ms, 0, 0)))


def arrival_in(trajectory: messages.Trajectory) -> tuple[float, int] | None:
    """The way, m, and the time of arrival, ms, of such a trajectory; None for another form."""
    way, after_ms = -trajectory.points[0][1] / 1000, trajectory.points[-1][0]
    if way <= 0 or after_ms <= 0 or trajectory != arriving(trajectory.t0, way, after_ms):
        return None
    return way, trajectory.t0 + after_ms


@lru_cache(maxsize=1024)
def position(line: RoadLine, place: tuple[float, float]) -> tuple[float, float]:
    """The position (s, d), m, on a line of a place that does not move: asked at every step."""
    found = line.project([place])
    return float(found.s[0]), float(found.d[0])


def at_speed(speed: float, now: float) -> Trajectory:
    """This speed for the next second, for ``Vehicle.follow``."""
    xy = np.array([(0.0, 0.0), (max(speed, 0.0) * STEP_S, 0.0)])
    return Trajectory(np.array([now, now + STEP_S]), xy)


class Yielding(Coordinated):
    """Yields as it has agreed, and asks others to.  Call ``tick`` about every 0.1 s.

    A scenario with a prescriber of its own overrides ``_wanted`` and ``_held``.
    """

    def __init__(self, vehicle: Vehicle, scenario: str, place: tuple[float, float]) -> None:
        """``place``: in the plane, m: the place at which this station asks others to yield."""
        super().__init__(vehicle)
        self.scenario, self.place = scenario, place
        self.story: list[tuple[int, str]] = []
        """Its actions, with times in ms."""
        self.target: int | None = None
        """The station that has agreed to yield."""
        self.until_ms: int | None = None
        """The time before which the receiver does not arrive."""
        self._asked: tuple[int, int] | None = None
        self._answers: tuple[float, float] | None = None
        self._yields: tuple[float, float] | None = None
        self._drive: AgreedManeuver | None = None
        self._next_ms = 0

    def way(self, place: tuple[float, float]) -> float | None:
        """The way from its front to the place, m; None if that is not on its path ahead."""
        v = self.vehicle
        s, d = position(v.line, place)
        way = s - v.s - v.length / 2
        return way if abs(d - v.d) <= LANE_WIDTH / 2 and way > 0 else None

    # -- prescriber

    def _wanted(self, now_ms: int) -> tuple[int, int] | None:
        """When others should not arrive, from and until, ms; None: nobody need yield."""
        return None

    def _until(self, window: tuple[int, int], arrives_ms: int, way: float) -> int:
        """When the target may arrive, ms.  It is ``way`` m away, and would arrive in the window."""
        return window[1]

    def choose(self, choice: Choice) -> None:
        """As ``Application.choose``: the first that would arrive in the window."""
        now = self.service.now()
        window = self._wanted(now) or (0, 0)
        read = {station: arrival_in(t) for station, t in choice.planned.items()}
        known = {s: at for s, at in read.items() if at is not None}
        there = {s: at for s, at in known.items() if max(now, window[0]) < at[1] < window[1]}
        if choice.proposal > 1 or not there:
            self._note("asks nobody")
            self.service.command(choice.abort())
            return
        target = min(there, key=lambda s: (there[s][1], s))
        way, arrives = there[target]
        left = way * (arrives - now) / (arrives - choice.planned[target].t0)
        until = self._until(window, arrives, left)
        self._asked = target, until
        lease_ms = until - now + round(MARGIN_S * 1000)
        self._note(f"asks {target} to arrive after {until - now} ms")
        asked = arriving(now, left, until - now)
        self.service.command(choice.prescribe(target, asked, hold_ms=0, lease_ms=lease_ms))

    def promised_ms(self) -> int | None:
        """When the target arrives at the earliest; None unless its CAM is fresh and bound."""
        if self._drive is None or self._drive.role != "prescriber":
            return None
        now, session = self.service.now(), self._drive.session
        for heard in heard_by(self.service) or ():
            fresh = now - heard.received_ms <= FRESH_MS and session in heard.marks
            if heard.station_id == self.target and fresh:
                return self.until_ms
        return None

    # -- receiver

    def concerned(self, advertised: Advertised) -> messages.Trajectory | None:
        """As ``Application.concerned``: when it would arrive at the place."""
        x, y = (advertised.details.get(name) for name in ("x_mm", "y_mm"))
        if advertised.scenario != self.scenario or type(x) is not int or type(y) is not int:
            return None
        place = x / 1000, y / 1000
        way = self.way(place)
        if way is None or way < self._stops_in():
            return None
        self._answers = place
        after_ms = round(1000 * way / max(self.vehicle.speed, 1.0))
        return arriving(self.service.now(), way, max(after_ms, 1))

    def _stops_in(self) -> float:
        """The way in which it can stop comfortably, with the delay of its control, m."""
        v = self.vehicle
        return v.speed / v.driving.gain + v.speed**2 / (2 * BRAKE)

    def verify(self, proposal: Proposal) -> None:
        """Accept to arrive later, if it can even stop before the place, and not wait too long."""
        now, asked, place = self.service.now(), arrival_in(proposal.prescribed), self._answers
        way = self.way(place) if place is not None else None
        if (
            asked is None
            or way is None
            or way < self._stops_in()
            or abs(asked[0] - way) > NEAR_M
            or not 0 < asked[1] - now <= PATIENCE_MS
        ):
            self._note("refuses to yield")
            self.service.command(proposal.refuse())
            return
        self._note("accepts to yield")
        self._asked, self._yields = (self.vehicle.station_id, asked[1]), place
        self.service.command(proposal.accept())

    # -- both

    def load(self, maneuver: AgreedManeuver) -> None:
        """As ``Application.load``."""
        assert self._asked is not None
        self._drive = maneuver
        self.target, self.until_ms = self._asked
        self._note("yields" if maneuver.role == "receiver" else f"{self.target} yields")

    def tick(self, now_ms: int) -> None:
        """The control loop: hold before the place, yield as agreed, or drive freely."""
        v, drive = self.vehicle, self._drive
        if self._wanted(now_ms) is not None and drive is None and now_ms >= self._next_ms:
            self._next_ms = now_ms + AGAIN_MS
            self._note("requests")
            details: dict[str, messages.Plain] = {
                "x_mm": round(1000 * self.place[0]),
                "y_mm": round(1000 * self.place[1]),
            }
            self.service.command(Request(scenario=self.scenario, details=details))
        if drive is not None and drive.role == "prescriber" and self._through(now_ms):
            self._note("is through")
            self.service.command(drive.complete())
            self._drive = None
        speeds = []
        if drive is not None and drive.role == "receiver" and self._yields is not None:
            way = self.way(self._yields)
            assert self.until_ms is not None
            if way is not None and now_ms < self.until_ms:
                speeds.append(1000 * way / (self.until_ms - now_ms))
        if (left := self._held(now_ms)) is not None and v.speed**2 >= 2 * BRAKE * left:
            brake = max(v.speed**2 / (2 * max(left, 0.1)), BRAKE)
            speeds.append(v.speed - brake / v.driving.gain)
        least = min(speeds, default=math.inf)
        v.follow(at_speed(least, now_ms / 1000) if least < math.inf else None)

    def _held(self, now_ms: int) -> float | None:
        """The way to where it must stand, m; None if it need not."""
        return None

    def _through(self, now_ms: int) -> bool:
        """Whether the prescriber needs the place no longer."""
        return self.until_ms is None or now_ms >= self.until_ms

    def fallback(self, session: Session, reason: str) -> None:
        """As ``Application.fallback``."""
        self._note(f"drives alone: {reason}")
        super().fallback(session, reason)

    def _over(self, how: str) -> None:
        super()._over(how)
        self._drive = self._asked = self.target = self.until_ms = self._yields = None

    def _note(self, what: str) -> None:
        self.story.append((self.service.now(), what))
