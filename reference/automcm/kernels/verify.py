"""KIN-6: checks whether a prescribed trajectory is safe to drive (IV-B-3)."""

from __future__ import annotations

from dataclasses import dataclass, fields
from enum import StrEnum

import numpy as np

from automcm.kernels.collide import closest_approach
from automcm.kernels.convert import closest_points
from automcm.kernels.thin import POSITION, SPEED
from automcm.kernels.trajectory import NANOMETRE, Floats, Trajectory, TrajectoryError, number
from automcm_spec.vocabulary.parameters import DEFAULTS, derived

_TIMES = DEFAULTS | derived(DEFAULTS)

TOGETHER = 64
"""Number of samples that are compared at a time with the planned segments near them."""
WINDOW = 0.1
"""Speeds are means over at least this time, s."""
TURN = 1.0
"""The lateral acceleration is that of three positions this time apart, s: thinning changes it by at
most 4 POSITION / TURN²."""
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
    LATERAL = "lateral"
    """Its lateral acceleration is too great."""
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
    lateral: float = 3.0
    """m/s², to the side: less than what overturns a lorry (about 3.5)."""
    path: float = 0.3
    """Metres to the side of the planned path."""
    position_error: float = 2 * POSITION
    """Metres that the thinning of the plan and of the prescription may add to that (KIN-2)."""
    speed_error: float = SPEED
    """m/s, likewise, for the speed."""
    start: float = 1.0
    """Metres between the start of the prescription and the vehicle's position then."""
    age: float = (_TIMES["t_giveup"] + _TIMES["t_decide"]) / 1000
    """Seconds."""

    def __post_init__(self) -> None:
        for field in fields(self):
            least = 0.01 if field.name in ("reaction", "path") else 0
            number(field.name, getattr(self, field.name), least)
        if self.v_max < self.v_min:
            why = f"must be at least v_min ({self.v_min}), not {self.v_max}"
            raise TrajectoryError("v_max", why)


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
    the vehicle drives its planned speed, after the last the last speed, or 0 if it stopped.  Both
    trajectories may be thinned (KIN-2).  Not judged: jerk.

    Raises TrajectoryError only if ``now`` is not finite.
    """
    time = number("now", now)
    left = prescribed.stopped or (len(prescribed) > 1 and time < prescribed.t[-1])
    expired = not left or time - prescribed.t[0] > limits.age
    checks = {
        Reason.EXPIRED: expired,
        Reason.START: not _starts(prescribed, planned, time, limits.start),
        Reason.PATH: not _follows(prescribed, planned, limits.path + limits.position_error),
        Reason.SPEED: not _speed(prescribed, limits),
        Reason.ACCELERATION: not _acceleration(prescribed, planned, limits),
        Reason.LATERAL: bool((lateral(prescribed) > limits.lateral).any()),
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
    """Whether it stays within ``limit`` of the planned path, and the part of that path which it
    covers within ``limit`` of it, without going back by more than ``limit``.

    Between the samples of either both are straight, so that the distance is greatest at one.  The
    closest points of the whole path count: a path that comes within ``limit`` of itself may be
    refused although it is the same.
    """
    plan, drive = _moving(planned.xy), _moving(prescribed.xy)
    steps = np.diff(plan, axis=0)
    whole = np.concatenate([[0.0], np.cumsum(np.hypot(steps[:, 0], steps[:, 1]))])
    # The boxes that contain all positions within the limit of each planned segment.
    ends = plan[:-1].T, plan[1:].T
    (left, lower), (right, upper) = np.minimum(*ends) - limit, np.maximum(*ends) + limit
    feet = []
    for begin in range(0, len(drive), TOGETHER):
        xy = drive[begin : begin + TOGETHER]
        (x0, y0), (x1, y1) = xy.min(axis=0), xy.max(axis=0)
        near = np.flatnonzero((left <= x1) & (right >= x0) & (lower <= y1) & (upper >= y0))
        if len(near) == 0 and len(plan) > 1:
            return False
        found = closest_points(plan, xy, near)
        if (found.distance > limit + NANOMETRE).any():
            return False
        off = found.place - plan[found.segment]
        feet.append(whole[found.segment] + np.hypot(off[:, 0], off[:, 1]))
    foot = np.concatenate(feet)
    if (np.maximum.accumulate(foot) - foot > limit).any():
        return False
    # The planned samples between the feet of each prescribed segment, and their distance from it.
    first = np.searchsorted(whole, np.minimum(foot[1:], foot[:-1]))
    counts = np.maximum(np.searchsorted(whole, np.maximum(foot[1:], foot[:-1])) - first, 0)
    k = np.repeat(np.arange(len(counts)), counts)
    passed = np.arange(len(k)) + (first - np.cumsum(counts) + counts)[k]
    away, step = plan[passed] - drive[k], np.diff(drive, axis=0)[k]
    square = (step * step).sum(axis=1)
    share = np.clip((away * step).sum(axis=1) / np.where(square > 0, square, 1), 0, 1)
    off = away - share[:, None] * step
    return bool((np.hypot(off[:, 0], off[:, 1]) <= limit + NANOMETRE).all())


def _moving(xy: Floats) -> Floats:
    """Without the places that repeat the one before: in a stand each is as near as each."""
    moved: Floats = xy[np.concatenate([[True], (xy[1:] != xy[:-1]).any(axis=1)])]
    return moved


def _speed(prescribed: Trajectory, limits: Limits) -> bool:
    _, low, high = _speeds(prescribed, limits.speed_error)
    return bool((low <= limits.v_max).all() and (high >= limits.v_min).all())


def lateral(trajectory: Trajectory) -> Floats:
    """The lateral accelerations, m/s²: of the positions A, B, C at t - TURN, t, t + TURN, the part
    of A - 2 B + C across C - A, over TURN².  t is TURN before, at and after each sample, where all
    three are known.
    """
    t = trajectory.t
    times = np.concatenate([t - TURN, t, t + TURN])
    times = times[(times >= t[0] + TURN) & (trajectory.stopped | (times <= t[-1] - TURN))]
    a, b, c = (
        np.stack([np.interp(times + by, t, along) for along in trajectory.xy.T])
        for by in (-TURN, 0.0, TURN)
    )
    (x, y), (bend_x, bend_y) = c - a, a - 2 * b + c
    length = np.hypot(x, y)
    across: Floats = np.abs(x * bend_y - y * bend_x) / np.where(length > NANOMETRE, length, np.inf)
    return across / TURN**2


def _speeds(trajectory: Trajectory, error: float) -> tuple[Floats, Floats, Floats]:
    """Times (m,), and the lowest and the highest speed (m - 1,) between them, given ``error`` (m/s)
    and ROUNDING.

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
    either_way = error + (v + 1) * ROUNDING / spans
    return t[kept], v - either_way, v + either_way


def _acceleration(prescribed: Trajectory, planned: Trajectory, limits: Limits) -> bool:
    """Check v(t + reaction) - v(t) for every t: it only changes when one of the two times passes a
    step of v."""
    steps, low, high = _speeds(prescribed, limits.speed_error)
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
