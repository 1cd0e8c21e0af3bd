"""The Trajectory type: positions over time."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from automcm_spec.vocabulary import messages

Floats = NDArray[np.float64]
LIMIT = 9e12
"""The largest time (s) or coordinate (m): a message can carry it, and its square is finite."""
NANOMETRE = 1e-9
"""Distances that differ by no more (m) are equal, so that rounding does not decide ties."""
STAND = 1.0
"""Seconds after which the message of a stopped trajectory repeats its last position."""


class TrajectoryError(ValueError):
    """An invalid trajectory, path or parameter: its name, and the index of the wrong entry."""

    def __init__(self, name: str, why: str, *index: int) -> None:
        place = f"[{', '.join(map(str, index))}]" if index else ""
        super().__init__(f"{name}{place}: {why}")
        self.name, self.index = name, index


@dataclass(frozen=True, slots=True, eq=False)
class Trajectory:
    """Positions over time; between samples the vehicle moves straight and evenly.

    ``t``: shape (n,), seconds, strictly increasing.  ``xy``: shape (n, 2), metres.  n >= 1.  Both
    are copied and made read-only.  ``stopped``: it stands at the last place from the last time
    on (KIN-1); else nothing is known of it after ``t[-1]``.

    Raises TrajectoryError for wrong shapes, NaN, infinity or what is beyond LIMIT, or times that
    do not increase, naming the first index that is wrong.
    """

    t: Floats
    xy: Floats
    stopped: bool = False

    def __post_init__(self) -> None:
        t = array("t", self.t, 1)
        xy = array("xy", self.xy, 2)
        if len(t) == 0:
            raise TrajectoryError("t", "must have at least one point")
        if xy.shape != (len(t), 2):
            raise TrajectoryError("xy", f"must have shape ({len(t)}, 2), not {xy.shape}")
        late = np.flatnonzero(np.diff(t) <= 0)
        if len(late):
            n = int(late[0]) + 1
            raise TrajectoryError("t", f"{t[n]} s is not after {t[n - 1]} s", n)
        for name, value in (("t", t), ("xy", xy)):
            value.flags.writeable = False
            object.__setattr__(self, name, value)

    def __len__(self) -> int:
        return len(self.t)

    def at(self, times: ArrayLike) -> Floats:
        """Places at these times, shape (m, 2).

        Raises TrajectoryError for a time outside of ``t[0]`` to ``t[-1]`` (after which a stopped
        vehicle is where it was).
        """
        when = array("times", times, 1)
        last = np.inf if self.stopped else self.t[-1]
        wrong = np.flatnonzero((when < self.t[0]) | (when > last))
        if len(wrong):
            n = int(wrong[0])
            raise TrajectoryError("times", f"{when[n]} s is outside of the trajectory", n)
        return np.stack([np.interp(when, self.t, self.xy[:, axis]) for axis in (0, 1)], axis=1)

    def since(self, time: float) -> Trajectory:
        """The trajectory from ``time`` on.  Raises TrajectoryError as ``at``."""
        first = self.at([time])
        left = self.t > time
        t = np.concatenate([[time], self.t[left]])
        return Trajectory(t, np.concatenate([first, self.xy[left]]), self.stopped)

    def speeds(self) -> Floats:
        """The speed of each segment, m/s, shape (n - 1,)."""
        steps = np.diff(self.xy, axis=0)
        speeds: Floats = np.hypot(steps[:, 0], steps[:, 1]) / np.diff(self.t)
        return speeds

    def arc(self) -> Floats:
        """The distance travelled at each sample, m, shape (n,), from 0."""
        steps = np.diff(self.xy, axis=0)
        return np.concatenate([[0.0], np.cumsum(np.hypot(steps[:, 0], steps[:, 1]))])


def array(name: str, value: ArrayLike, ndim: int) -> Floats:
    """A float copy.  Raises TrajectoryError for another number of dimensions, or the first entry
    that is not finite or beyond LIMIT."""
    try:
        made = np.array(value, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise TrajectoryError(name, f"must be an array of numbers: {error}") from None
    if made.ndim != ndim:
        raise TrajectoryError(name, f"must be {ndim}-dimensional, not {made.ndim}-dimensional")
    good = np.abs(made) <= LIMIT
    if not good.all():
        where = np.argwhere(~good)[0]
        problem = f"beyond {LIMIT:g}" if np.isfinite(made[tuple(where)]) else "not a finite number"
        raise TrajectoryError(name, problem, *where)
    return made


def path(name: str, value: ArrayLike, least: int = 1) -> Floats:
    """Points, shape (n, 2).  Raises TrajectoryError for another shape or fewer than ``least``."""
    made = array(name, value, 2)
    if made.shape[1] != 2 or len(made) < least:
        why = f"must have shape (n, 2) with n of at least {least}, not {made.shape}"
        raise TrajectoryError(name, why)
    return made


def pair(name: str, value: ArrayLike) -> Floats:
    """A place or a direction, shape (2,).  Raises TrajectoryError for another shape."""
    made = array(name, value, 1)
    if len(made) != 2:
        raise TrajectoryError(name, f"must have shape (2,), not {made.shape}")
    return made


def number(name: str, value: float, least: float = -LIMIT, *, above: bool = False) -> float:
    """Raises TrajectoryError unless finite and at least (``above``: more than) ``least``."""
    made = float(array(name, value, 0)) if not isinstance(value, float) else value
    if not abs(made) <= LIMIT:
        raise TrajectoryError(name, f"must be a finite number of at most {LIMIT:g}, not {made}")
    if made < least or (above and made == least):
        bound = f"{'above' if above else 'at least'} {least:g}"
        raise TrajectoryError(name, f"must be {bound}, not {made}")
    return made


def whole(name: str, value: int, least: int) -> int:
    """Raises TrajectoryError unless a whole number of at least ``least``."""
    if isinstance(value, bool) or not isinstance(value, int | np.integer) or value < least:
        raise TrajectoryError(name, f"must be a whole number of at least {least}, not {value!r}")
    return int(value)


def from_message(trajectory: messages.Trajectory) -> Trajectory:
    """From integers (ms, mm) to SI floats.

    ``stopped`` is no field of the wire: a vehicle that stands repeats its last place, so a
    trajectory whose last two places are one is stopped.  Raises TrajectoryError if the times do
    not increase.
    """
    rows = np.array(trajectory.points, dtype=np.float64)
    stopped = len(rows) > 1 and bool((rows[-1, 1:] == rows[-2, 1:]).all())
    return Trajectory((trajectory.t0 + rows[:, 0]) / 1000, rows[:, 1:] / 1000, stopped)


def to_message(trajectory: Trajectory) -> messages.Trajectory:
    """To integers, rounded to ms and mm; ``t0`` is the first time.

    A stopped one that does not yet repeat its last place does so STAND seconds later, which
    ``from_message`` takes for stopped.  Raises TrajectoryError if two samples are less than a
    millisecond apart, or for times beyond what a message carries.
    """
    t = np.rint(trajectory.t * 1000).astype(np.int64)
    late = np.flatnonzero(np.diff(t) <= 0)
    if len(late):
        raise TrajectoryError("t", "less than 1 ms after the one before", int(late[0]) + 1)
    rows = np.column_stack([t - t[0], np.rint(trajectory.xy * 1000).astype(np.int64)])
    points = [(int(dt), int(x), int(y)) for dt, x, y in rows]
    if trajectory.stopped and (len(points) == 1 or points[-1][1:] != points[-2][1:]):
        points.append((points[-1][0] + round(STAND * 1000), *points[-1][1:]))
    if points[-1][0] > messages.LIMIT:
        raise TrajectoryError("t", f"{points[-1][0]} ms exceeds the limit of a message")
    return messages.Trajectory(t0=int(t[0]), points=tuple(points))
