"""Seeded drives that look for lane changes into an occupied lane: ``automcm simulate drives``.

Beside the prescriber are A, B and C of Fig. 6.  Some answer, some are bound elsewhere, some only
send CAMs, some have no radio and are only seen, and some accept a trajectory and do not drive it.
The radio loses evenly or in bursts.
"""

from __future__ import annotations

import random
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise

from automcm.kernels.trajectory import Floats
from automcm.links.simulated_radio import Channel
from automcm.scenarios.drive import STEP_MS, SimulatedDrive
from automcm.scenarios.lane_change import SCENARIO, Coordinated, LaneChange, PaperLaneChange
from automcm.scenarios.occupancy import HARDEST, LEAST_M, WIDTH_M, Track
from automcm.scenarios.road import LANE_WIDTH, STEP_S, Driving, Vehicle
from automcm.service.application import Advertised, AgreedManeuver, Choice, Heard
from automcm_spec.vocabulary.application import Request
from automcm_spec.vocabulary.messages import Session, Trajectory

KINDS = (
    *("answers", "bound elsewhere", "CAM only", "seen only", "does not slow"),
    "cuts in",
)
"""What B does.  ``cuts in``: B answers, and a vehicle from the third lane moves into the gap
without looking."""
LOSSES = (0.0, 0.2, 0.4, 0.6)
BURSTS_MS = (0.0, 300.0, 1000.0, 2000.0)
SPEEDS_KMH = (30.0, 130.0)
BESIDE_M = (-6.0, 20.0)
"""B's distance behind the prescriber when it signals, centre to centre, at even speeds."""
FASTER = (-4.0, 4.0)
"""By how much A, B and C are faster than the prescriber, m/s."""
SIGHT_M = 100.0
"""Range of the perception."""
BINDS_MS, SIGNAL_MS, UNTIL_S = 8200, 12_000, 50.0
"""When B is bound elsewhere, when the prescriber signals, and the end.  Up to the signal it has
heard CAMs for longer than a station is remembered."""
AFTER_S = 3.0
"""The room is measured until this time after the lane change."""


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

    def _known(
        self, heard: tuple[Heard, ...] | None, session: Session | None
    ) -> list[Track] | None:
        answered = tuple(each for each in heard or () if each.station_id in self._others)
        return super()._known(answered, session)


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
    "look before": WithoutLookBefore,
    "look while": WithoutLookWhile,
    "any": PaperLaneChange,
}
"""The prescriber without a mechanism of APP-2 to APP-5, by the mechanism's name."""


@dataclass(frozen=True, slots=True)
class Driven:
    """One drive: its settings and its outcome."""

    seed: int
    kind: str
    loss: float
    burst_ms: float
    changed: bool
    """Whether it is in the other lane at the end."""
    agreed: bool
    returned: bool
    room_m: float | None
    """The least distance along the road, bumper to bumper: at the beginning of the lane change to
    any vehicle in the other lane; then to any vehicle whose side overlaps with its own.  None
    without a lane change."""
    braking: float
    """The hardest deceleration of anybody, m/s²; 0 for ``cuts in``, because everybody brakes for
    the vehicle that cuts in, whatever the prescriber does."""

    @property
    def bad(self) -> bool:
        """Less than LEAST_M of room, or braking harder than HARDEST."""
        tight = self.room_m is not None and self.room_m < LEAST_M
        return tight or self.braking > HARDEST + 1e-6


def drive(seed: int, without: str = "", kind: str = "") -> Driven:
    """The drive of this seed, without a mechanism of WITHOUT, and with B of this kind.

    By default with all mechanisms, and of a drawn kind.
    """
    draw = random.Random(seed)
    drawn = draw.choice(KINDS)
    kind = kind or drawn
    channel = Channel(loss=draw.choice(LOSSES), burst_ms=draw.choice(BURSTS_MS))
    speed = draw.uniform(*SPEEDS_KMH) / 3.6
    theirs = speed + draw.uniform(*FASTER)
    behind, beside = draw.uniform(1.2, 4.0), draw.uniform(*BESIDE_M)
    sees = kind in ("seen only", "cuts in") or draw.random() < 0.5
    d = Driving()
    apart = 4.5 + behind * (d.standstill + speed * d.headway_s)

    def vehicle(station_id: int, x: float, lane: int, speed: float = speed) -> Vehicle:
        return Vehicle(station_id, x, lane, speed, speed)

    own = vehicle(1, 0.0, 0)
    beside += (theirs - speed) * SIGNAL_MS / 1000
    a, b, c = (vehicle(n, (3 - n) * apart - beside, 1, theirs) for n in (2, 3, 4))
    unlike = {"CAM only": CamOnly, "does not slow": DoesNotSlow}
    drivers: list[LaneChange | Binder] = [WITHOUT.get(without, LaneChange)(own)]
    unheard: list[Vehicle] = []
    for one in (a, b, c):
        how = kind if one is b else draw.choice(("answers", "answers", "CAM only", "seen only"))
        if kind == "answers" or (how == "seen only" and not sees):
            how = "answers"
        if how == "seen only":
            unheard.append(one)
        else:
            drivers.append(unlike.get(how, LaneChange)(one))
    binder = Binder(vehicle(9, -500.0, 7), 3)
    if kind == "bound elsewhere":
        drivers.append(binder)
    cutter = vehicle(5, draw.uniform(-6.0, 2.0), 2)
    cutter.driving = Driving(hardest=0.0)  # its driver looks at nobody
    cuts_s = draw.uniform(0.0, 1.0)
    if kind == "cuts in":
        unheard.append(cutter)
    made = SimulatedDrive(drivers, seed=seed, channel=channel, others=unheard)
    prescriber = drivers[0]
    assert isinstance(prescriber, LaneChange)
    if sees and without not in (PERCEPTION, "any"):
        prescriber.occupied = sight(own, made.road.vehicles)
    clock = made.simulation.clock
    clock.at(BINDS_MS, binder.ask if kind == "bound elsewhere" else lambda: None)
    clock.at(SIGNAL_MS, lambda: prescriber.signal(1))
    if kind == "cuts in":
        _cut_in(made, cutter, cuts_s)
    made.run(UNTIL_S)
    return _driven(made, prescriber, seed, kind, channel)


def sight(own: Vehicle, vehicles: Sequence[Vehicle]) -> Callable[[Floats, int, int], list[Track]]:
    """Perception that sees every vehicle within SIGHT_M, without errors."""

    def occupied(region: Floats, t0_ms: int, t1_ms: int) -> list[Track]:
        return [
            Track(x=v.x, y=v.y, vx=v.speed, length=v.length)
            for v in vehicles
            if v is not own and abs(v.x - own.x) <= SIGHT_M
        ]

    return occupied


def _cut_in(made: SimulatedDrive, cutter: Vehicle, after_s: float) -> None:
    """Let it cut in ``after_s`` after the prescriber began, unless that is over the marking."""
    own, clock = made.road.vehicles[0], made.simulation.clock
    waited = 0

    def look() -> None:
        nonlocal waited
        waited += STEP_MS * own.changing
        if waited <= after_s * 1000:
            clock.at(clock.now() + STEP_MS, look)
        elif own.moved_m < (LANE_WIDTH - WIDTH_M) / 2:
            cutter.change_lane(1, clock.now() / 1000)

    clock.at(SIGNAL_MS, look)


def _driven(
    made: SimulatedDrive, prescriber: LaneChange, seed: int, kind: str, channel: Channel
) -> Driven:
    own = prescriber.vehicle
    words = [what for _, what in prescriber.story]
    hardest = max(0.0, -min(s.acceleration for s in made.road.samples))
    return Driven(
        seed,
        kind,
        channel.loss,
        channel.burst_ms,
        changed=own.lane == 1 and not own.changing,
        agreed=any("is accepted" in what for what in words),
        returned=any(what.startswith("returns") for what in words),
        room_m=_room(made, own.station_id),
        braking=0.0 if kind == "cuts in" else round(hardest, 3),
    )


def _room(made: SimulatedDrive, station_id: int) -> float | None:
    of = {v.station_id: made.road.of(v.station_id) for v in made.road.vehicles}
    lengths = {v.station_id: v.length for v in made.road.vehicles}
    mine = of.pop(station_id)
    moved = [n for n, (p, q) in enumerate(pairwise(mine)) if p.y != q.y]
    if not moved:
        return None
    first, last = moved[0], min(moved[-1] + round(AFTER_S / STEP_S), len(mine) - 1)
    rooms = []
    for other_id, other in of.items():
        length = (lengths[other_id] + lengths[station_id]) / 2
        for n in range(first, last + 1):
            aside = abs(other[n].y - mine[n].y)
            there = n == first and abs(other[n].y - LANE_WIDTH) < (LANE_WIDTH + WIDTH_M) / 2
            if there or aside < WIDTH_M:
                rooms.append(abs(other[n].x - mine[n].x) - length)
    return round(min(rooms), 2) if rooms else None
