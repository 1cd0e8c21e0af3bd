"""Seeded drives that look for lane changes into an occupied lane: ``automcm simulate drives``.

Beside the prescriber are A, B and C of Fig. 6.  Some answer, some are bound elsewhere, some only
send CAMs, some have no radio and are only seen, and some accept a trajectory and do not drive it.
The radio loses evenly or in bursts; the road bends; the vehicles are 4 to 18 m long; measured
positions have errors.
"""

from __future__ import annotations

import math
import random
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from automcm.applications.lane_change import LaneChange, Plan
from automcm.applications.occupancy import HARDEST, LEAST_M, LENGTH_M, WIDTH_M, Seen
from automcm.applications.planning import LIMITS
from automcm.applications.vehicle import (
    LANE_WIDTH,
    STEP_S,
    STRAIGHT,
    Driving,
    PositionError,
    Vehicle,
)
from automcm.kernels.road_line import RoadLine
from automcm.kernels.trajectory import Floats
from automcm.links.simulated_radio import Channel
from automcm_simulation.road.drive import STEP_MS, SimulatedDrive
from automcm_simulation.road.road import Sample
from automcm_simulation.road.simulation import Simulation
from automcm_simulation.road.sweep_drivers import PERCEPTION, WITHOUT, Binder, CamOnly, DoesNotSlow

KINDS = (
    *("answers", "bound elsewhere", "CAM only", "seen only", "does not slow"),
    "cuts in",
)
"""What B does.  ``cuts in``: B answers, and a vehicle from the third lane moves into the gap
without looking."""
LOSSES = (0.0, 0.2, 0.4, 0.6)
BURSTS_MS = (0.0, 300.0, 1000.0, 2000.0)
SPEEDS_KMH = (30.0, 130.0)
RADII_M = (100.0, 1500.0)
"""Of the bends; a third of the roads is straight."""
LATERAL = LIMITS.lateral - 0.5
"""The highest lateral acceleration of a driver, m/s²: thinning may add 0.4 (KIN-6)."""
LENGTHS_M = (4.0, 18.0)
LORRY_M = 6.0
"""From this length on a vehicle is LORRY_WIDTH_M wide."""
LORRY_WIDTH_M = 2.5
SIGMAS_M = (0.0, 0.3, 0.6, 1.0)
SEEN_SHARE = 0.2
"""The share of sigma by which the own perception errs: it measures from the vehicle."""
OFFSETS_MS = (-10_000, 10_000)
"""Of the clock of every third A, B and C."""
BESIDE_M = (-12.0, 28.0)
"""B's distance behind the prescriber when it signals, centre to centre, at even speeds."""
FASTER = (-4.0, 4.0)
"""By how much A, B and C are faster than the prescriber, m/s."""
SIGHT_M = 100.0
"""Range of the perception."""
BINDS_MS, SIGNAL_MS, UNTIL_S = 8200, 12_000, 90.0
"""When B is bound elsewhere, when the prescriber signals, and the latest end.  Up to the signal it
has heard CAMs for some seconds."""
RETRIES = 2
"""How often the prescriber requests again."""
AFTER_S = 3.0
"""The room is measured until this time after the lane change."""
SETTLED_S = 5.0
"""A drive ends this time after the last lane change or request."""


@dataclass(frozen=True, slots=True)
class Drawn:
    """What is drawn for one drive.  Tuples are of the prescriber, A, B, C, and the vehicle that
    cuts in."""

    seed: int
    kind: str
    loss: float
    burst_ms: float
    speed: float
    """m/s."""
    faster: float
    """A, B and C: m/s."""
    radius_m: float
    """The least; infinite for a straight road."""
    left: bool
    """Whether the first bend is to the left."""
    sigma: float
    lengths: tuple[float, ...]
    beside: float
    """At the signal, m."""
    behind: float
    """The gap of A, B and C, as a multiple of what their drivers want."""
    sees: bool
    hows: tuple[str, str, str]
    """What A, B and C do."""
    offsets_ms: tuple[int, int, int]
    """Of the clocks of A, B and C."""
    cuts_in: tuple[float, float]
    """How far ahead of the prescriber (m) and how long after its begin (s)."""


def setting(seed: int, kind: str = "", sigma: float | None = None) -> Drawn:
    """What this seed draws; ``kind`` and ``sigma`` replace what is drawn."""
    draw = random.Random(seed)
    kind = kind or draw.choice(KINDS)
    loss, burst_ms = draw.choice(LOSSES), draw.choice(BURSTS_MS)
    least, most = (math.log(radius) for radius in RADII_M)
    radius = math.inf if draw.random() < 1 / 3 else math.exp(draw.uniform(least, most))
    fastest = min(SPEEDS_KMH[1] / 3.6, math.sqrt(LATERAL * (radius - 2 * LANE_WIDTH)))
    speed = draw.uniform(SPEEDS_KMH[0] / 3.6, fastest)
    faster = min(speed + draw.uniform(*FASTER), fastest) - speed
    sees = draw.random() < 0.5 or kind in ("seen only", "cuts in")
    hows = []
    for one in "ABC":
        how = draw.choice(("answers", "answers", "CAM only", "seen only"))
        how = kind if one == "B" else "answers" if kind == "answers" else how
        hows.append("answers" if how == "seen only" and not sees else how)
    return Drawn(
        seed,
        kind,
        loss,
        burst_ms,
        speed,
        faster,
        radius,
        left=draw.random() < 0.5,
        sigma=draw.choice(SIGMAS_M) if sigma is None else sigma,
        lengths=tuple(
            draw.uniform(4.0, 5.0) if draw.random() < 0.6 else draw.uniform(*LENGTHS_M)
            for _ in range(5)
        ),
        beside=draw.uniform(*BESIDE_M),
        behind=draw.uniform(1.2, 4.0),
        sees=sees,
        hows=(hows[0], hows[1], hows[2]),
        offsets_ms=(_offset(draw), _offset(draw), _offset(draw)),
        cuts_in=(draw.uniform(-6.0, 2.0), draw.uniform(0.0, 1.0)),
    )


def _offset(draw: random.Random) -> int:
    return draw.randint(*OFFSETS_MS) if draw.random() < 1 / 3 else 0


def bends(radius: float, left: bool, length: float) -> RoadLine:
    """A road of quarter turns to either side by turns, so that it does not cross itself.

    Every other one has twice the radius.  Its chords are within 5 mm of the arcs.
    """
    if math.isinf(radius):
        return STRAIGHT
    s, heading, side, steps, turns = 0.0, 0.0, 1 if left else -1, [], [0.0]
    while s < length:
        for r in (radius, 2 * radius):
            quarter = r * math.pi / 2
            count = math.ceil(quarter / math.sqrt(8 * r * 0.005))
            for _ in range(count):
                heading += side * math.pi / 2 / count
                steps.append(quarter / count)
                turns.append(heading)
            side, s = -side, s + quarter
    step, h = np.array(steps), np.array(turns[:-1])
    xy = np.cumsum(np.stack([step * np.cos(h), step * np.sin(h)], axis=1), axis=0)
    return RoadLine(np.concatenate([np.zeros((1, 2)), xy]))


@dataclass(frozen=True, slots=True)
class SweptDrive:
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
    radius_m: float | None
    """The least; None for a straight road."""
    sigma: float

    @property
    def bad(self) -> bool:
        """Less than LEAST_M of room, or braking harder than HARDEST."""
        tight = self.room_m is not None and self.room_m < LEAST_M
        return tight or self.braking > HARDEST + 1e-6


def drive(seed: int, without: str = "", kind: str = "", sigma: float | None = None) -> SweptDrive:
    """The drive of this seed, without a mechanism of WITHOUT, with B of this kind, and with
    positions of this standard deviation.

    By default with all mechanisms, and of a drawn kind and error.
    """
    made, prescriber = made_of(setting(seed, kind, sigma), without)
    clock = made.simulation.clock
    settled_ms, end_ms = clock.now() + SIGNAL_MS, UNTIL_S * 1000
    while clock.now() < min(settled_ms + SETTLED_S * 1000, end_ms):
        clock.run(clock.now() + 1000)
        if prescriber.busy:
            settled_ms = clock.now()
    made.run(clock.now() / 1000)
    return _driven(made, prescriber, setting(seed, kind, sigma))


def made_of(drawn: Drawn, without: str = "") -> tuple[SimulatedDrive, LaneChange]:
    """The drive before its start, and the prescriber."""
    driving = Driving()
    line = bends(drawn.radius_m, drawn.left, (drawn.speed + FASTER[1]) * UNTIL_S)

    def vehicle(station_id: int, s: float, lane: int, speed: float, length: float) -> Vehicle:
        made = Vehicle(station_id, s, lane, speed, speed, length, driving, line=line)
        made.width = LORRY_WIDTH_M if length >= LORRY_M else WIDTH_M
        if drawn.sigma:
            made.error = PositionError(drawn.sigma, f"{drawn.seed}/{station_id}")
        return made

    theirs = drawn.speed + drawn.faster
    own = vehicle(1, 0.0, 0, drawn.speed, drawn.lengths[0])
    gap = drawn.behind * (driving.standstill + theirs * driving.headway_s)
    beside = -drawn.beside - drawn.faster * SIGNAL_MS / 1000
    _, a, b, c, _ = drawn.lengths
    places = (beside + gap + (a + b) / 2, beside, beside - gap - (b + c) / 2)
    prescriber = WITHOUT.get(without, LaneChange)(own, Plan(retries=RETRIES))
    unlike = {"CAM only": CamOnly, "does not slow": DoesNotSlow}
    drivers: list[LaneChange | Binder] = [prescriber]
    unheard: list[Vehicle] = []
    for n, (place, how) in enumerate(zip(places, drawn.hows, strict=True), 1):
        one = vehicle(n + 1, place, 1, theirs, drawn.lengths[n])
        if how == "seen only":
            unheard.append(one)
        else:
            drivers.append(unlike.get(how, LaneChange)(one))
    binder = Binder(vehicle(9, -500.0, 7, drawn.speed, LENGTH_M), 3)
    if drawn.kind == "bound elsewhere":
        drivers.append(binder)
    ahead, after_s = drawn.cuts_in
    cutter = vehicle(5, ahead, 2, drawn.speed, drawn.lengths[4])
    cutter.driving = Driving(hardest=0.0)  # its driver looks at nobody
    if drawn.kind == "cuts in":
        unheard.append(cutter)
    channel = Channel(loss=drawn.loss, burst_ms=drawn.burst_ms)
    simulation = Simulation(seed=drawn.seed, channel=channel)
    made = SimulatedDrive(
        drivers, simulation=simulation, others=unheard, offsets_ms=_offsets(drawn)
    )
    if drawn.sees and without not in (PERCEPTION, "any"):
        prescriber.occupied = sight(own, made.road.vehicles, drawn.seed)
    clock = simulation.clock
    clock.at(BINDS_MS, binder.ask if drawn.kind == "bound elsewhere" else lambda: None)
    clock.at(SIGNAL_MS, lambda: prescriber.signal(1))
    if drawn.kind == "cuts in":
        cut_in(made, cutter, after_s, SIGNAL_MS)
    return made, prescriber


def _offsets(drawn: Drawn) -> dict[int, int]:
    """By how much each clock is ahead of the road's, ms; none is below 0."""
    zero = OFFSETS_MS[1]
    offsets = (0, *drawn.offsets_ms, 0)
    return {station: zero + off for station, off in zip((1, 2, 3, 4, 9), offsets, strict=True)}


def sight(
    own: Vehicle, vehicles: Sequence[Vehicle], seed: int = 0
) -> Callable[[Floats, int, int], list[Seen]]:
    """Perception that sees every vehicle within SIGHT_M.

    It measures from the vehicle's own measured position, with errors of SEEN_SHARE of its sigma.
    """
    sigma = SEEN_SHARE * own.error.sigma if own.error is not None else 0.0
    errors = {v.station_id: PositionError(sigma, f"{seed}/seen/{v.station_id}") for v in vehicles}
    last_ms = 0

    def occupied(region: Floats, t0_ms: int, t1_ms: int) -> list[Seen]:
        nonlocal last_ms
        found = []
        for v in vehicles:
            error = errors[v.station_id]
            if sigma:
                error.step((t0_ms - last_ms) / 1000)
            if v is own or math.hypot(v.x - own.x, v.y - own.y) > SIGHT_M:
                continue
            s, d = own.measured
            s, d = v.s + s - own.s + error.along, v.d + d - own.d + error.across
            x, y, heading = v.line.pose(s, d)
            vx, vy = v.speed * math.cos(heading), v.speed * math.sin(heading)
            found.append(Seen(x=x, y=y, vx=vx, vy=vy, length=v.length, width=v.width, sigma=sigma))
        last_ms = t0_ms
        return found

    return occupied


def cut_in(made: SimulatedDrive, cutter: Vehicle, after_s: float, from_ms: int) -> None:
    """Let it cut in ``after_s`` after the first vehicle began, unless that is over the marking.

    ``from_ms``: when to begin looking at the first vehicle.
    """
    own, clock = made.road.vehicles[0], made.simulation.clock
    waited = 0

    def look() -> None:
        nonlocal waited
        waited += STEP_MS * own.changing
        if waited <= after_s * 1000:
            clock.at(clock.now() + STEP_MS, look)
        elif own.moved_m < (LANE_WIDTH - WIDTH_M) / 2:
            cutter.change_lane(1, clock.now() / 1000)

    clock.at(from_ms, look)


def _driven(made: SimulatedDrive, prescriber: LaneChange, drawn: Drawn) -> SweptDrive:
    own = prescriber.vehicle
    words = [what for _, what in prescriber.story]
    hardest = max(0.0, -min(s.acceleration for s in made.road.samples))
    left = room(made, own)
    return SweptDrive(
        drawn.seed,
        drawn.kind,
        drawn.loss,
        drawn.burst_ms,
        changed=own.lane == 1 and not own.changing,
        agreed=any("is accepted" in what for what in words),
        returned=any(what.startswith("returns") for what in words),
        room_m=None if left is None else round(left, 2),
        braking=0.0 if drawn.kind == "cuts in" else round(hardest, 3),
        radius_m=None if math.isinf(drawn.radius_m) else drawn.radius_m,
        sigma=drawn.sigma,
    )


def room(made: SimulatedDrive, own: Vehicle) -> float | None:
    """The least distance to a vehicle that shared a lane with ``own`` while it changed, m."""
    mine = made.road.of(own.station_id)
    moved = [n for n, (p, q) in enumerate(pairwise(mine)) if p.y != q.y]
    if not moved:
        return None
    first, last = moved[0], min(moved[-1] + round(AFTER_S / STEP_S), len(mine) - 1)
    begins = set(moved) - {n + 1 for n in moved}
    rooms = []
    for v in made.road.vehicles:
        if v is own:
            continue
        length, width = (v.length + own.length) / 2, (v.width + own.width) / 2
        for n, other in enumerate(made.road.of(v.station_id)[first : last + 1], first):
            there = n in begins and abs(other.y - LANE_WIDTH) < (LANE_WIDTH + v.width) / 2
            if there or abs(other.y - mine[n].y) < width:
                rooms.append(_apart(own.line, mine[n], other) - length)
    return min(rooms, default=None)


def _apart(line: RoadLine, one: Sample, other: Sample) -> float:
    """The distance along the other lane, m."""
    return abs(other.x - one.x) * line.scale((one.x + other.x) / 2, LANE_WIDTH)
