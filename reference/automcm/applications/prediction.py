"""The vehicles ahead of and behind a receiver, for the gaps of KIN-6."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from automcm.applications.occupancy import LEAST_M, Seen
from automcm.applications.vehicle import LANE_WIDTH, Driving, idm
from automcm.kernels.road_line import RoadLine
from automcm.kernels.trajectory import Trajectory

AHEAD_S = 8.0
"""The time for which others are predicted, about that of an action (KIN-5); after it each driver
keeps the distance as before."""
GRID_S = 0.2


@dataclass(frozen=True, slots=True)
class Neighbour:
    """A predicted trajectory, and the least distance to keep from it, m, middle to middle."""

    trajectory: Trajectory
    apart: float


def neighbours(
    own: Seen, known: Sequence[Seen], prescribed: Trajectory, line: RoadLine, now: float
) -> tuple[Neighbour | None, Neighbour | None]:
    """The next vehicle ahead in the lane whose middle is ``line``, at constant speed, and the next
    behind, which follows ``prescribed`` as a driver does (``idm``), from ``now`` (s) on.

    The errors of positions do not count, because each driver sees the vehicle ahead: those whose
    measured middle is in the lane.
    """
    times = now + np.arange(0.0, AHEAD_S + GRID_S / 2, GRID_S)
    times = times[times <= prescribed.t[-1]]
    there = [t for t in known if abs(t.y) <= LANE_WIDTH / 2]
    leader = min((t for t in there if t.x > own.x), key=lambda t: t.x, default=None)
    follower = max((t for t in there if t.x <= own.x), key=lambda t: t.x, default=None)

    def neighbour(other: Seen, s: Sequence[float]) -> Neighbour:
        apart = (own.length + other.length) / 2 + LEAST_M
        return Neighbour(Trajectory(times, line.place(s, 0.0)), apart)

    first = last = None
    if leader is not None:
        first = neighbour(leader, (leader.x + leader.vx * (times - now)).tolist())
    if follower is not None:
        front = line.project(prescribed.at(times)).s.tolist()
        last = neighbour(follower, _following(own, follower, front))
    return first, last


def _following(own: Seen, follower: Seen, front: Sequence[float]) -> list[float]:
    """Where it is at each time of ``front``, the positions of the vehicle that it follows."""
    driving = Driving()
    s, v = [follower.x], follower.vx
    between = (own.length + follower.length) / 2
    for before, after in pairwise(front):
        ahead = (after - before) / GRID_S
        a = idm(before - s[-1] - between, v, ahead, follower.vx, driving)
        faster = max(0.0, v + max(a, -driving.hardest) * GRID_S)
        s.append(s[-1] + (v + faster) / 2 * GRID_S)
        v = faster
    return s
