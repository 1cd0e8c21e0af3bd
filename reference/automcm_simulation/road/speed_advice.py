"""Speed advice: a scenario without trajectory calculations.

A receiver that only has adaptive cruise control can be asked to set another speed.  Its
"trajectory" is its position after one second, starting from 0, and so encodes its speed.

The rules of occupancy (APP-2 to APP-5) do not apply: nobody takes a place.  The receiver stays in
its lane, and keeps the distance to the vehicle ahead as before.  The vehicle behind has to keep its
distance, as behind anybody who slows down; therefore the receiver slows down at most comfortably.
It checks that the speed is not higher than its own and not a crawl.  The prescriber relies on no
gap, so who did not answer does not matter.
"""

from __future__ import annotations

import numpy as np

from automcm.applications.lane_change import MARGIN_S, Coordinated
from automcm.applications.vehicle import Vehicle
from automcm.kernels import trajectory as kernel
from automcm.service.application import Advertised, AgreedManeuver, Choice, Proposal
from automcm_spec.vocabulary.application import Request
from automcm_spec.vocabulary.messages import Trajectory

SCENARIO = "speed_advice"


def a_second_at(speed_mm_s: int, now_ms: int = 0) -> Trajectory:
    """A speed as a trajectory."""
    return Trajectory(t0=now_ms, points=((0, 0, 0), (1000, speed_mm_s, 0)))


def speed_in(trajectory: Trajectory) -> int | None:
    """The speed in such a trajectory, mm/s; None for a trajectory of another form."""
    speed = trajectory.points[-1][1]
    return speed if trajectory.points == a_second_at(speed).points and speed >= 0 else None


class SpeedAdvice(Coordinated):
    """Advises the fastest vehicle to drive ``advice_mm_s`` for ``advice_ms``, or takes advice."""

    def __init__(
        self, vehicle: Vehicle, advice_mm_s: int = 0, advice_ms: int = 5000, least_mm_s: int = 3000
    ) -> None:
        super().__init__(vehicle)
        self.advice_mm_s, self.advice_ms, self.least_mm_s = advice_mm_s, advice_ms, least_mm_s

    def signal(self) -> None:
        """Request that another vehicle slows down."""
        details = {"speed_mm_s": self.advice_mm_s}
        self.service.command(Request(scenario=SCENARIO, details=dict(details)))

    def concerned(self, advertised: Advertised) -> Trajectory | None:
        """As ``Application.concerned``."""
        speed = round(self.vehicle.speed * 1000)
        asked = advertised.details.get("speed_mm_s")
        fits = advertised.scenario == SCENARIO and type(asked) is int and asked < speed
        return a_second_at(speed, self.service.now()) if fits else None

    def choose(self, choice: Choice) -> None:
        """As ``Application.choose``."""
        if choice.proposal == 1:
            read = {station_id: speed_in(t) for station_id, t in choice.planned.items()}
            speeds = {s: speed for s, speed in read.items() if speed is not None}
            if not speeds:
                self.service.command(choice.abort())
                return
            self._target = max(speeds, key=lambda s: (speeds[s], -s))
            self._theirs = speeds[self._target]
        share = 1 / choice.proposal
        asked = round(self._theirs - (self._theirs - self.advice_mm_s) * share)
        advice = a_second_at(asked)
        lease_ms = self.advice_ms + round(MARGIN_S * 1000)
        self.service.command(choice.prescribe(self._target, advice, hold_ms=0, lease_ms=lease_ms))

    def verify(self, proposal: Proposal) -> None:
        """Accept a lower speed, but not a crawl."""
        speed = speed_in(proposal.prescribed)
        fits = speed is not None and self.least_mm_s <= speed <= self.vehicle.speed * 1000
        self.service.command(proposal.accept() if fits else proposal.refuse())

    def load(self, maneuver: AgreedManeuver) -> None:
        """As ``Application.load``."""
        if maneuver.role == "receiver":
            speed = speed_in(maneuver.selected)
            assert speed is not None
            now, until = self.service.now() / 1000, maneuver.until_ms / 1000
            way = np.array([(0.0, 0.0), (speed / 1000 * (until - now), 0.0)])
            self.vehicle.follow(kernel.Trajectory(np.array([now, until]), way))
        else:
            self.service.command(maneuver.complete(), self.advice_ms)

    def tick(self, now_ms: int) -> None:
        """Does nothing: the cruise control drives."""

    def _over(self, how: str) -> None:
        super()._over(how)
        self.vehicle.follow(None)
