"""Whether a lane is free for a lane change: rules APP-2 to APP-4 (docs/protocol.md, section 6).

Every vehicle known near the lane is a track: from its CAM, whether it answered or not, or from the
vehicle's own perception.  SI units; x forward.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from automcm.kernels.discover import inside
from automcm.kernels.trajectory import Floats
from automcm.scenarios.road import Driving
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
"""Error of the position of a vehicle that has not answered, m."""
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
class Track:
    """A vehicle as it was last heard or seen."""

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

    @property
    def name(self) -> str:
        """For the story."""
        if not self.station_id:
            return "a vehicle that is only seen"
        return f"{self.station_id}{', bound elsewhere,' * self.bound}"


Perception = Callable[[Floats, int, int], Sequence[Track]]
"""``occupied(region, t0_ms, t1_ms)``: the vehicles seen that may be in the polygon ``region``,
(m, 2), between these times (APP-1)."""


def nothing_seen(region: Floats, t0_ms: int, t1_ms: int) -> tuple[Track, ...]:
    """The perception of a vehicle that has none."""
    return ()


def tracks(
    heard: Iterable[Heard],
    seen: Sequence[Track],
    answered: Iterable[int],
    session: Session | None,
    now: int,
) -> list[Track]:
    """Every vehicle known (APP-1) at ``now`` (ms).  What is seen replaces the CAM of the station at
    that place."""
    left, replied, found = list(seen), frozenset(answered), []
    for each in heard:
        age_s = (now - each.received_ms) / 1000
        speed, heading = each.speed_mm_s / 1000, each.heading_mrad / 1000
        vx, vy = speed * math.cos(heading), speed * math.sin(heading)
        track = Track(
            x=each.x_mm / 1000 + vx * age_s,
            y=each.y_mm / 1000 + vy * min(age_s, LATERAL_S),
            vx=vx,
            vy=vy,
            age_s=age_s,
            station_id=each.station_id,
            answered=each.station_id in replied,
            bound=each.bound_elsewhere(session),
        )
        for other in left:
            if abs(other.x - track.x) <= SAME_M[0] and abs(other.y - track.y) <= SAME_M[1]:
                left.remove(other)
                track = replace(
                    other,
                    age_s=0.0,
                    station_id=track.station_id,
                    answered=track.answered,
                    bound=track.bound,
                )
                break
        found.append(track)
    return found + left


def in_lane(track: Track, zone: Floats) -> bool:
    """Whether it touches the lane, or will soon."""
    sides = [track.y + off for off in (-WIDTH_M / 2, 0.0, WIDTH_M / 2)]
    points = [(track.x, y + track.vy * after) for y in sides for after in (0.0, LATERAL_S)]
    return bool(inside(np.array(points), zone).any())


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


def margin(track: Track, after_s: float) -> float:
    """The error in m of its position predicted ``after_s`` from now at constant speed (APP-3)."""
    unknown = 0.0 if track.answered else ERROR_M + CHANGE * min(after_s, CHANGE_S) ** 2 / 2
    return unknown + CHANGE * track.age_s**2 / 2


def clear(
    own: Track, other: Track, begins_s: float, ends_s: float, hardest: float = FORCED
) -> bool:
    """Whether both keep the needed gap from ``begins_s`` to ``ends_s`` from now, at constant speeds
    (APP-3)."""
    sides = set()
    for after in (begins_s, ends_s):
        ahead = other.x - own.x + (other.vx - own.vx) * after
        gap = abs(ahead) - (own.length + other.length) / 2 - margin(other, after)
        if ahead > 0:
            rear, front = own.vx, other.vx
        else:
            rear, front = other.vx, own.vx
            gap -= rear * LATENCY_S
        if gap < needed_gap(rear, front, hardest):
            return False
        sides.add(ahead > 0)
    return len(sides) == 1
