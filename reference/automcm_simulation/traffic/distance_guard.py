"""The distance of equipped vehicles to vehicles that are in their way as these stand on the road.

SUMO's drivers take vehicles for rectangles along the lane.  One that changes lanes is turned, so
that its rear can be in the way of a vehicle that SUMO lets pass.  The sensors of an equipped
vehicle see it, and its control brakes.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping

import numpy as np

from automcm.applications.vehicle import STEP_S
from automcm_simulation.traffic.mover import AUTOMATED, Body, RoadUser
from automcm_simulation.traffic.traffic_measures import AHEAD

ASIDE_M = 0.1
"""The least distance to the sides, m."""
LEFT_M = 0.5
"""The least distance ahead, m."""
REAR = np.array([(-1.0, -1.0), (-1.0, 0.0), (-1.0, 1.0), (0.0, -1.0), (0.0, 1.0)])
"""Points of a rectangle that may be in the way of a follower, in half lengths and widths."""


def limits(
    of: Collection[int], bodies: Mapping[int, Body], users: Mapping[int, RoadUser], range_m: float
) -> dict[int, float]:
    """The speeds, m/s, that these vehicles must not exceed in the next step, where they would.

    A vehicle must be able to stop, braking as hard as it can, behind each point of another that is
    within its width, if that other one brakes as hard.  No limit asks for harder braking than that.
    ``range_m`` is the range of the sensors.
    """
    numbers = [n for n in bodies if n in users and users[n].kind != "person"]
    if len(numbers) < 2:
        return {}
    table = np.array([bodies[n] for n in numbers])
    half = np.array([(users[n].length, users[n].width) for n in numbers]) / 2
    xy, speed = table[:, :2], table[:, 3]
    axis = np.stack([np.cos(table[:, 2]), np.sin(table[:, 2])], axis=1)
    side = np.stack([-axis[:, 1], axis[:, 0]], axis=1)
    away = xy[None] - xy[:, None]
    follows = np.hypot(away[..., 0], away[..., 1]) < range_m
    follows &= (axis @ axis.T > AHEAD) & ((away * axis[:, None]).sum(axis=2) > 0)
    follows &= np.array([n in of for n in numbers])[:, None]
    i, j = np.nonzero(follows)
    corners = (REAR[None] * half[:, None])[j]
    points = away[i, j][:, None] + corners[..., :1] * axis[j][:, None]
    points = points + corners[..., 1:] * side[j][:, None]
    along = (points * axis[i][:, None]).sum(axis=2) - half[i, :1]
    across = np.abs((points * side[i][:, None]).sum(axis=2))
    gap = np.where(across < half[i, 1:] + ASIDE_M, along, np.inf).min(axis=1) - LEFT_M
    hardest = AUTOMATED.hardest
    slow = hardest * STEP_S
    stops = np.sqrt(slow**2 + speed[j] ** 2 + 2 * hardest * np.maximum(gap, 0.0)) - slow
    limit = np.full(len(numbers), np.inf)
    np.minimum.at(limit, i, np.maximum(stops, speed[i] - slow))
    due = np.flatnonzero(limit < speed + AUTOMATED.acceleration * STEP_S)
    return {numbers[n]: float(limit[n]) for n in due.tolist()}
