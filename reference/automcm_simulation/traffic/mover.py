"""Movers: what moves every road user by one step.

SUMO is one (sumo_mover.py); tests use the small road of automcm_simulation.road.road.  SI units; x
and y in the plane, of the middle of the road user.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal, NamedTuple, Protocol

from automcm.applications.vehicle import STEP_S, Driving
from automcm.kernels.road_line import RoadLine
from automcm_spec.vocabulary.messages import CAR_MM

STEP_MS = round(STEP_S * 1000)
AUTOMATED = Driving()
"""The distance control of an equipped vehicle; APP-3 assumes the same of others."""


class TrafficError(Exception):
    """Traffic cannot be simulated; the text says why, and what to do."""


@dataclass(frozen=True, kw_only=True)
class RoadUser:
    """One road user at the start.  ``number`` is also the id of its station."""

    number: int
    route: tuple[str, ...]
    """Names of edges of the network."""
    lane: int
    """From the right, from 0."""
    at_m: float
    """Position of the front on the first edge."""
    speed: float
    desired: float
    equipped: bool
    length: float = CAR_MM[0] / 1000
    width: float = CAR_MM[1] / 1000
    kind: Literal["vehicle", "person"] = "vehicle"
    """A person walks along the route and has no station."""
    begins_s: float = 0.0
    """When it appears."""


class Body(NamedTuple):
    """The state of one road user; the heading includes the slip of a lane change, rad."""

    x: float
    y: float
    heading: float
    speed: float
    acceleration: float


class Mover(Protocol):
    """Moves all road users in steps of STEP_MS."""

    def bodies(self) -> Mapping[int, Body]:
        """The road users that are on the road now, by number."""

    def line(self, route: tuple[str, ...]) -> RoadLine:
        """The middle of the rightmost lane along these edges; the same object for the same route.

        Lane n is n · LANE_WIDTH to its left.  After ``close`` the lines of all vehicles' routes
        are known.
        """

    def control(
        self, number: int, speed: float | None, aside: float, limit: float | None = None
    ) -> None:
        """For the next step of an equipped vehicle: the speed that its control sets, m/s (None: it
        drives as its distance control does), and how far to the left it steers, m.

        For ``speed`` it brakes with at most ``AUTOMATED.comfortable``; it does not exceed
        ``limit``, m/s, however hard it must brake.  It keeps the distance to the vehicle ahead.
        """

    def step(self) -> None:
        """Advance by STEP_MS."""

    def close(self) -> None:
        """End the simulation."""
