"""The drivers of the seeded drives: some do not answer, or not drive what they accepted, and some
prescribers lack a mechanism."""

from __future__ import annotations

from dataclasses import replace

from automcm.applications.lane_change import SCENARIO, Coordinated, LaneChange, PaperLaneChange
from automcm.applications.occupancy import LENGTH_M, Seen
from automcm.applications.vehicle import LANE_WIDTH, Vehicle
from automcm.kernels.road_line import RoadLine
from automcm.service.application import Advertised, AgreedManeuver, Choice, Heard
from automcm_spec.vocabulary.application import Request
from automcm_spec.vocabulary.messages import Session, Trajectory


class Binder(Coordinated):
    """Keeps ``station_id`` bound to a session of its own."""

    def __init__(self, vehicle: Vehicle, station_id: int) -> None:
        super().__init__(vehicle)
        self._bound = station_id

    def ask(self) -> None:
        """Open the session."""
        self.service.command(Request(scenario=SCENARIO, details={"lane": 1}))

    def concerned(self, advertised: Advertised) -> None:
        """Never."""

    def choose(self, choice: Choice) -> None:
        """Prescribe what is planned."""
        if choice.proposal == 1 and (same := choice.planned.get(self._bound)) is not None:
            command = choice.prescribe(self._bound, same, hold_ms=0, lease_ms=60_000)
            self.service.command(command)
        else:
            self.service.command(choice.abort())

    def verify(self, proposal: object) -> None:
        """Never asked."""

    def load(self, maneuver: AgreedManeuver) -> None:
        """Keep it."""

    def tick(self, now_ms: int) -> None:
        """Drives straight on."""


class CamOnly(LaneChange):
    """Sends CAMs and does not answer."""

    def concerned(self, advertised: Advertised) -> Trajectory | None:
        """Never."""
        return None


class DoesNotSlow(LaneChange):
    """Accepts a trajectory and does not drive it."""

    def load(self, maneuver: AgreedManeuver) -> None:
        """Drive on as before."""
        super().load(maneuver)
        self.vehicle.follow(None)


class WithoutCams(LaneChange):
    """Counts answers only."""

    def _known(self, heard: tuple[Heard, ...] | None, session: Session | None) -> list[Seen] | None:
        answered = tuple(each for each in heard or () if each.station_id in self._others)
        return super()._known(answered, session)


class WithoutLengths(LaneChange):
    """Takes every other vehicle for a car."""

    def _in_lane(
        self, lane: int | None, heard: tuple[Heard, ...] | None, session: Session | None
    ) -> list[Seen] | None:
        known = super()._in_lane(lane, heard, session)
        return known and [replace(each, length=LENGTH_M) for each in known]


class WithoutSigma(LaneChange):
    """Takes every position for exact."""

    def _own(self, lane: int | None) -> Seen:
        return replace(super()._own(lane), sigma=None)

    def _in_lane(
        self, lane: int | None, heard: tuple[Heard, ...] | None, session: Session | None
    ) -> list[Seen] | None:
        exact = tuple(replace(each, sigma_mm=0) for each in heard or ())
        return super()._in_lane(lane, exact, session)


class WithoutCurvature(LaneChange):
    """Takes the road for the x axis."""

    AXIS = RoadLine([(0, 0), (1, 0)], reach=1e6)

    def _line(self, lane: int | None) -> RoadLine:
        assert lane is not None
        return self.AXIS.parallel(lane * LANE_WIDTH)


class WithoutLookBefore(LaneChange):
    """Moves over when the time has come."""

    def _look(self, now_ms: int) -> str:
        return super()._look(now_ms) if self.vehicle.changing else ""


class WithoutLookWhile(LaneChange):
    """Completes whatever it has begun."""

    def _look(self, now_ms: int) -> str:
        return "" if self.vehicle.changing else super()._look(now_ms)


PERCEPTION = "perception"
WITHOUT: dict[str, type[LaneChange]] = {
    "CAMs": WithoutCams,
    PERCEPTION: LaneChange,
    "lengths": WithoutLengths,
    "sigma": WithoutSigma,
    "curvature": WithoutCurvature,
    "look before": WithoutLookBefore,
    "look while": WithoutLookWhile,
    "any": PaperLaneChange,
}
"""The prescriber without a mechanism of APP-2 to APP-5, by the mechanism's name."""
