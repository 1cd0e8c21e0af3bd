"""KIN-6: checks whether a prescribed trajectory is safe to drive (IV-B-3)."""

from __future__ import annotations

from dataclasses import dataclass, fields
from enum import StrEnum

import numpy as np

from automcm.kernels.collide import closest_approach
from automcm.kernels.convert import closest_points
from automcm.kernels.trajectory import Floats, Trajectory, TrajectoryError, number
from automcm_spec.vocabulary.parameters import DEFAULTS, derived

_TIMES = DEFAULTS | derived(DEFAULTS)

TOGETHER = 256
"""Number of positions of the path that are compared at a time with the segments near them."""
WINDOW = 0.1
"""Speeds are means over at least this time, s."""
ROUNDING = 1e-3
"""A message rounds to s/1000 and m/1000."""


class Reason(StrEnum):
    """The reasons why a prescribed trajectory is not safe, in the order of ``verify``."""

    EXPIRED = "expired"
    """It has ended, or it began longer ago than ``Limits.age``."""
    START = "start"
    """It starts at another position than the vehicle's."""
    PATH = "path"
    """It leaves the planned path, goes back, or skips a part of it."""
    SPEED = "speed"
    ACCELERATION = "acceleration"
    LEADER_GAP = "leader_gap"
    FOLLOWER_GAP = "follower_gap"


@dataclass(frozen=True, kw_only=True, slots=True)
class Limits:
    """The limits of a vehicle.  The paper has no values; none of these is measured.

    Raises TrajectoryError for what is negative or not finite, ``reaction`` or ``path`` below
    0.01, or ``v_max`` below ``v_min``.
    """

    v_max: float = 50 / 3.6
    """m/s."""
    v_min: float = 0.0
    acceleration: float = 3.0
    """m/s², and ``deceleration``: of the mean change of speed over any time of ``reaction``."""
    deceleration: float = 3.0
    reaction: float = 2.0
    """Seconds in which the control smooths a step of the speed (Fig. 4)."""
    leader_gap: float = 7.0
    """Metres, centre to centre: a car and 2 m."""
    follower_gap: float = 7.0
    path: float = 0.5
    """Metres to the side of the planned path."""
    start: float = 1.0
    """Metres between the start of the prescription and the vehicle's position then."""
    age: float = (_TIMES["t_giveup"] + _TIMES["t_decide"]) / 1000
    """Seconds."""

    def __post_init__(self) -> None:
        for field in fields(self):
            least = 0.01 if field.name in ("reaction", "path") else 0
            number(field.name, getattr(self, field.name), least)
        if self.v_max < self.v_min:
            raise TrajectoryError(f"v_max: must be at least v_min ({self.v_min}), not {self.v_max}")


def verify(
    prescribed: Trajectory,
    planned: Trajectory,
    now: float,
    limits: Limits,
    leader: Trajectory | None = None,
    follower: Trajectory | None = None,
) -> tuple[Reason, ...]:
    """Every reason not to drive ``prescribed`` from ``now`` (s) on; none if it is safe (KIN-6).

    ``planned``: the vehicle's trajectory until it accepts.  ``leader``, ``follower``: the expected
    trajectories of the vehicles in front and behind; the follower's is its reaction to the
    prescription.  A gap is checked over the common times from now on; without common times it is
    not safe.

    Open in the paper: what "safe" is.  Bounded are the speed (mean over WINDOW or a segment, less
    what ROUNDING may add), and the mean acceleration over any time of ``reaction``: the prescribed
    speed is a step function, and the control smooths a step in that time.  Before the first sample
    the vehicle drives its planned speed, after the last the last speed, or 0 if it stopped.  Not
    judged: lateral acceleration, jerk.

    Raises TrajectoryError only if ``now`` is not finite.
    """
    time = number("now", now)
    left = prescribed.stopped or (len(prescribed) > 1 and time < prescribed.t[-1])
    expired = not left or time - prescribed.t[0] > limits.age
    checks = {
        Reason.EXPIRED: expired,
        Reason.START: not _starts(prescribed, planned, time, limits.start),
        Reason.PATH: not _follows(prescribed, planned, limits.path),
        Reason.SPEED: not _speed(prescribed, limits),
        Reason.ACCELERATION: not _acceleration(prescribed, planned, limits),
        Reason.LEADER_GAP: not _gap(prescribed, leader, time, limits.leader_gap),
        Reason.FOLLOWER_GAP: not _gap(prescribed, follower, time, limits.follower_gap),
    }
    return tuple(reason for reason, wrong in checks.items() if wrong)


def _known(trajectory: Trajectory, time: float) -> bool:
    return bool(trajectory.t[0] <= time and (trajectory.stopped or time <= trajectory.t[-1]))


def _starts(prescribed: Trajectory, planned: Trajectory, now: float, limit: float) -> bool:
    """Whether both are at the same position now, or when the prescription begins."""
    when = max(now, float(prescribed.t[0]))
    if not (_known(prescribed, when) and _known(planned, when)):
        return False
    off = prescribed.at([when])[0] - planned.at([when])[0]
    return bool(np.hypot(*off) <= limit)


def _follows(prescribed: Trajectory, planned: Trajectory, limit: float) -> bool:
    """Whether it stays within ``limit`` of the planned path without going back or skipping a part.

    It is checked every limit/4 of the distance; a position between two of these is at most limit/8
    further away, which is subtracted from the limit, so that no position beyond ``limit`` passes.
    A path that comes within ``limit`` of itself may be refused although it is the same.
    """
    way, whole = prescribed.arc(), planned.arc()
    if way[-1] > whole[-1] + 2 * limit:
        return False  # limits the cost of a long path
    spacing = limit / 4
    samples = np.unique(np.concatenate([way, np.arange(0, way[-1], spacing)]))
    # The boxes that contain all positions within the limit of each planned segment.
    ends = planned.xy[:-1], planned.xy[1:]
    low, high = np.minimum(*ends) - limit, np.maximum(*ends) + limit
    foot_ways = []
    for begin in range(0, len(samples), TOGETHER):
        part = samples[begin : begin + TOGETHER]
        xy = np.stack([np.interp(part, way, prescribed.xy[:, axis]) for axis in (0, 1)], axis=1)
        near = np.flatnonzero(((low <= xy.max(axis=0)) & (high >= xy.min(axis=0))).all(axis=1))
        if len(near) == 0 and len(planned) > 1:
            return False
        found = closest_points(planned.xy, xy, near)
        if (found.distance > limit - spacing / 2).any():
            return False
        off = found.place - planned.xy[found.segment]
        foot_ways.append(whole[found.segment] + np.hypot(off[:, 0], off[:, 1]))
    along = np.concatenate(foot_ways)
    back = np.maximum.accumulate(along) - along
    return bool((back <= limit).all() and (np.diff(along) <= spacing + 2 * limit).all())


def _speed(prescribed: Trajectory, limits: Limits) -> bool:
    _, low, high = _speeds(prescribed)
    return bool((low <= limits.v_max).all() and (high >= limits.v_min).all())


def _speeds(trajectory: Trajectory) -> tuple[Floats, Floats, Floats]:
    """Times (m,), and the lowest and the highest speed (m - 1,) between them, given ROUNDING.

    Samples less than WINDOW apart are merged; otherwise rounding would appear as speed.
    """
    t, kept = trajectory.t, [0]
    for n in range(1, len(t)):
        if t[n] - t[kept[-1]] >= WINDOW:
            kept.append(n)
    if len(t) > 1 and kept[-1] != len(t) - 1:
        kept[max(len(kept) - 1, 1) :] = [len(t) - 1]
    spans = np.diff(t[kept])
    v = np.diff(trajectory.arc()[kept]) / spans
    error = (v + 1) * ROUNDING / spans
    return t[kept], v - error, v + error


def _acceleration(prescribed: Trajectory, planned: Trajectory, limits: Limits) -> bool:
    """Check v(t + reaction) - v(t) for every t: it only changes when one of the two times passes a
    step of v."""
    steps, low, high = _speeds(prescribed)
    before = _speed_at(planned, float(steps[0]))
    low, high = (
        np.concatenate([v[:1] if before is None else [before], v, [0.0] if still else v[-1:]])
        for v, still in ((low, prescribed.stopped), (high, prescribed.stopped))
    )
    if len(low) <= len(steps):  # a single sample has no speed
        return True
    changes = np.unique(np.concatenate([steps, steps - limits.reaction]))
    between = (changes[1:] + changes[:-1]) / 2
    now = np.searchsorted(steps, between, side="right")
    then = np.searchsorted(steps, between + limits.reaction, side="right")
    faster, slower = low[then] - high[now], high[then] - low[now]
    most, least = limits.acceleration * limits.reaction, -limits.deceleration * limits.reaction
    return bool((faster <= most).all() and (slower >= least).all())


def _speed_at(trajectory: Trajectory, time: float) -> float | None:
    """The speed at this time, or None if it is unknown."""
    if not _known(trajectory, time):
        return None
    if time >= trajectory.t[-1] and trajectory.stopped:
        return 0.0
    speeds = trajectory.speeds()
    if len(speeds) == 0:
        return None
    k = int(np.searchsorted(trajectory.t, time, side="right")) - 1
    return float(speeds[min(k, len(speeds) - 1)])


def _gap(prescribed: Trajectory, other: Trajectory | None, now: float, limit: float) -> bool:
    if other is None:
        return True
    when = max(now, float(prescribed.t[0]))
    if not _known(prescribed, when):
        return False
    approach = closest_approach(prescribed.since(when), other)
    return approach is not None and approach.distance >= limit
