"""Whether a lane is free for a lane change: rules APP-2 to APP-4 (docs/protocol.md, section 6).

Every vehicle known near the lane is a track: from its CAM, whether it answered or not, or from the
vehicle's own perception.  SI units.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from automcm.applications.vehicle import LANE_WIDTH, Driving, Vehicle
from automcm.kernels.extents import Extent
from automcm.kernels.road_line import RoadLine
from automcm.kernels.trajectory import Floats
from automcm.service.application import Heard
from automcm_spec.vocabulary.messages import CAR_MM, Session

LENGTH_M, WIDTH_M = (mm / 1000 for mm in CAR_MM)
"""Assumed length and width of a vehicle that does not state its own, m."""
FORCED = 3.0
"""The lane change begins only if it forces nobody to brake harder than this, m/s²."""
HARDEST = 4.0
"""A lane change that has begun is broken off rather than force anybody to brake harder, m/s²."""
LEAST_M = 2.0
"""Least gap, bumper to bumper, whatever the speeds."""
ERROR_M = 1.0
"""Error of the position of a vehicle that has not answered and states none, m."""
SURE = 3.0
"""Stated errors count with so many standard deviations: both errors last for seconds, so that a
lane change meets few independent ones, and one in 740 exceeds this to the unsafe side."""
CHANGE = 0.5
"""Assumed change of speed, m/s², of a vehicle that has not answered, for at most CHANGE_S; and of
every vehicle since it was last heard."""
CHANGE_S = 4.0
LATENCY_S = 0.15
"""The delay and the sampling of a CAM, which its age does not include: a vehicle behind is nearer
by this time at its speed."""
SAME_M = (5.0, 1.5)
"""What is seen this close to a station (along, across) is that station."""
LATERAL_S = 1.0
"""A vehicle that will touch the lane within this time is in it."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Seen:
    """A vehicle as it was last heard or seen: from perception in the plane, from ``tracks`` along
    (x) and across (y) the middle of a lane."""

    x: float
    y: float
    vx: float
    vy: float = 0.0
    age_s: float = 0.0
    station_id: int = 0
    """0: only seen."""
    answered: bool = False
    bound: bool = False
    """Whether its marks name another session."""
    length: float = LENGTH_M
    width: float = WIDTH_M
    sigma: float | None = None
    """Standard deviation of x and of y, m; None if unknown."""
    seen: bool = False
    """Whether it is from perception, to whose position the own error adds nothing."""

    @property
    def extent(self) -> Extent:
        """Its rectangle."""
        return Extent(self.length, self.width)

    @property
    def name(self) -> str:
        """For the story."""
        if not self.station_id:
            return "a vehicle that is only seen"
        return f"{self.station_id}{', bound elsewhere,' * self.bound}"


Perception = Callable[[Floats, int, int], Sequence[Seen]]
"""``occupied(region, t0_ms, t1_ms)``: the vehicles seen that may be in the polygon ``region``,
(m, 2), between these times (APP-1)."""


def nothing_seen(region: Floats, t0_ms: int, t1_ms: int) -> tuple[Seen, ...]:
    """The perception of a vehicle that has none."""
    return ()


def on_line(found: Sequence[Seen], line: RoadLine) -> list[Seen]:
    """These tracks, given in the plane, along and across ``line``; those clear of it are left out.

    Where the road comes back to itself, x and y are NaN: such a track is in every lane, and clear
    of nobody.
    """
    at = line.project(np.array([(t.x, t.y) for t in found]).reshape(-1, 2))
    rows = zip(found, at.s.tolist(), at.d.tolist(), at.heading.tolist(), at.scale, strict=True)
    return [
        replace(
            t,
            x=s,
            y=d,
            vx=(t.vx * math.cos(heading) + t.vy * math.sin(heading)) / float(scale),
            vy=t.vy * math.cos(heading) - t.vx * math.sin(heading),
        )
        for t, s, d, heading, scale in rows
        if d != math.inf
    ]


def own_track(vehicle: Vehicle, line: RoadLine) -> Seen:
    """The vehicle's own track on ``line``, as it measures its position; x and y are NaN if that is
    not on the road."""
    x, y, heading = vehicle.line.pose(*vehicle.measured)
    track = Seen(
        x=x,
        y=y,
        vx=vehicle.speed * math.cos(heading),
        vy=vehicle.speed * math.sin(heading),
        length=vehicle.length,
        width=vehicle.width,
        sigma=vehicle.error.sigma if vehicle.error is not None else None,
    )
    return next(iter(on_line([track], line)), replace(track, x=math.nan, y=math.nan))


def extent_of(heard: Heard | None) -> Extent:
    """The extent that its CAM states, or the assumed one."""
    if heard is None:
        return Extent(LENGTH_M, WIDTH_M)
    return Extent((heard.length_mm or CAR_MM[0]) / 1000, (heard.width_mm or CAR_MM[1]) / 1000)


def tracks(
    heard: Iterable[Heard],
    seen: Sequence[Seen],
    answered: Iterable[int],
    session: Session | None,
    now: int,
    line: RoadLine,
    own_sigma: float = 0.0,
) -> list[Seen]:
    """Every vehicle known on the road at ``now`` (ms), along and across ``line`` (APP-1).

    What is seen replaces the CAM of the station that is nearest to that place.
    """
    replied, said = frozenset(answered), []
    for each in heard:
        speed, heading = each.speed_mm_s / 1000, each.heading_mrad / 1000
        extent = extent_of(each)
        said.append(
            Seen(
                x=each.x_mm / 1000,
                y=each.y_mm / 1000,
                vx=speed * math.cos(heading),
                vy=speed * math.sin(heading),
                age_s=(now - each.received_ms) / 1000,
                station_id=each.station_id,
                answered=each.in_step and each.station_id in replied,
                bound=each.bound_elsewhere(session),
                length=extent.length,
                width=extent.width,
                sigma=None if each.sigma_mm is None else each.sigma_mm / 1000,
            )
        )
    left, found = on_line(seen, line), []
    for track in on_line(said, line):
        x = track.x + track.vx * track.age_s
        track = replace(track, x=x, y=track.y + track.vy * min(track.age_s, LATERAL_S))
        error = SURE * math.hypot(own_sigma, track.sigma or 0.0)
        same = [
            t
            for t in left
            if abs(t.x - track.x) <= SAME_M[0] + error and abs(t.y - track.y) <= SAME_M[1] + error
        ]
        if same:
            other = min(same, key=lambda t: math.hypot(t.x - track.x, t.y - track.y))
            left.remove(other)
            track = replace(
                other,
                age_s=0.0,
                station_id=track.station_id,
                answered=track.answered,
                bound=track.bound,
                seen=True,
            )
        found.append(track)
    return found + [replace(track, seen=True) for track in left]


def error(own: Seen, other: Seen) -> float:
    """How wrong the distance of the two along the lane may be, m: SURE standard deviations."""
    mine = 0.0 if other.seen else own.sigma or 0.0
    return SURE * math.hypot(mine, other.sigma or 0.0)


def in_lane(own: Seen, other: Seen) -> bool:
    """Whether the side of ``other`` may touch the lane along whose middle both are given, or will
    soon.

    The lane is in the map, so that the own error counts for what is seen from the vehicle.
    """
    mine = own.sigma or 0.0 if other.seen else 0.0
    reach = (LANE_WIDTH + other.width) / 2 + SURE * math.hypot(mine, other.sigma or 0.0)
    now, soon = other.y, other.y + other.vy * LATERAL_S
    return not (min(now, soon) > reach or max(now, soon) < -reach)


def needed_gap(rear: float, front: float, hardest: float = FORCED) -> float:
    """The gap in m, bumper to bumper, at which the rear vehicle need not brake harder than
    ``hardest``, from both speeds (APP-3).

    The rear driver is the intelligent driver model with the values of ``Driving``; this is the
    safety criterion of MOBIL (Kesting, Treiber and Helbing, 2007).  A slower rear vehicle counts as
    equally fast, because it may speed up.
    """
    d = Driving()
    faster = max(0.0, rear - front)
    approach = rear * faster / (2 * math.sqrt(d.acceleration * d.comfortable))
    wanted = d.standstill + rear * d.headway_s + approach
    return max(LEAST_M, wanted * math.sqrt(d.acceleration / hardest))


def margin(own: Seen, other: Seen, after_s: float) -> float:
    """The error, m, of their distance predicted ``after_s`` from now at constant speeds (APP-3)."""
    known = error(own, other) + CHANGE * other.age_s**2 / 2
    if other.answered:
        return known
    unstated = ERROR_M if other.sigma is None else 0.0
    return known + unstated + CHANGE * min(after_s, CHANGE_S) ** 2 / 2


def clear(own: Seen, other: Seen, begins_s: float, ends_s: float, hardest: float = FORCED) -> bool:
    """Whether both keep the needed gap from ``begins_s`` to ``ends_s`` from now, at constant speeds
    (APP-3)."""
    sides = set()
    for after in (begins_s, ends_s):
        ahead = other.x - own.x + (other.vx - own.vx) * after
        gap = abs(ahead) - (own.length + other.length) / 2 - margin(own, other, after)
        if ahead > 0:
            rear, front = own.vx, other.vx
        else:
            rear, front = other.vx, own.vx
            gap -= rear * LATENCY_S
        if not gap >= needed_gap(rear, front, hardest):  # also if the gap is NaN
            return False
        sides.add(ahead > 0)
    return len(sides) == 1
