"""The cost of a drive in comfort, from the recorded samples of the road.  SI units."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from automcm.applications.vehicle import STEP_S
from automcm.kernels.trajectory import Floats
from automcm_simulation.road.road import Sample

LENGTH_M = 4.5
WIDTH_M = 2.0
"""Two vehicles conflict below this lateral distance, centre to centre: a car is about 1.8 m wide
(assumed)."""
JERK_S = 0.5
"""Jerk is the change of acceleration over this time: over one step of the road it would be the
step's, as its vehicles change their acceleration at once."""
SLOWER = 0.5
"""A vehicle counts as slowed down if it is slower by more than this, m/s."""
HARD = 4.0
"""Harder braking counts as hard, m/s²: twice the driver model's comfortable deceleration."""
FAR_S = 60.0
"""A longer time to collision is ignored, s."""


@dataclass(frozen=True)
class DrivenTrack:
    """One vehicle over time, each of shape (n,)."""

    t: Floats
    x: Floats
    y: Floats
    speed: Floats
    acceleration: Floats

    @property
    def braking(self) -> float:
        """The largest deceleration, m/s²; 0 if there is none."""
        return max(0.0, -float(self.acceleration.min()))

    @property
    def jerk(self) -> float:
        """The largest change of acceleration within JERK_S, m/s³, up or down."""
        steps = round(JERK_S / STEP_S)
        return float(np.abs(self.acceleration[steps:] - self.acceleration[:-steps]).max()) / JERK_S

    def lost(self, alone: DrivenTrack) -> float:
        """Its distance behind ``alone`` at the end, m."""
        return float(alone.x[-1] - self.x[-1])

    def slowed(self, alone: DrivenTrack) -> float:
        """The time for which it was slower than ``alone`` by more than SLOWER, s."""
        return int(np.count_nonzero(self.speed < alone.speed - SLOWER)) * STEP_S

    def first_slower(self, alone: DrivenTrack) -> float | None:
        """The first time at which it was slower than ``alone`` by more than SLOWER, s; None:
        never."""
        (when,) = np.nonzero(self.speed < alone.speed - SLOWER)
        return round(float(self.t[when[0]]), 1) if len(when) else None


Tracks = dict[int, DrivenTrack]
"""By station id."""


def tracks(samples: Sequence[Sample]) -> Tracks:
    """The tracks of all vehicles."""
    found = {}
    for station_id in sorted({s.station_id for s in samples}):
        of = [s for s in samples if s.station_id == station_id]
        rows = np.array([(s.t, s.x, s.y, s.speed, s.acceleration) for s in of])
        found[station_id] = DrivenTrack(*rows.T)
    return found


def distance(of: int, found: Tracks) -> tuple[float, float]:
    """To the next one ahead that is in the way: the smallest gap from bumper to bumper, m
    (negative: they touched), and the smallest time to collision, s, at most FAR_S."""
    me = found[of]
    gaps, speeds = [], []
    for station_id, other in found.items():
        if station_id == of:
            continue
        in_way = (np.abs(other.y - me.y) < WIDTH_M) & (other.x > me.x)
        gaps.append(np.where(in_way, other.x - me.x - LENGTH_M, np.inf))
        speeds.append(other.speed)
    next_, columns = np.argmin(gaps, axis=0), np.arange(len(me.t))
    gap = np.array(gaps)[next_, columns]
    closing = me.speed - np.array(speeds)[next_, columns]
    towards = (closing > 0) & np.isfinite(gap)
    times = np.maximum(gap[towards], 0) / closing[towards]
    return float(gap.min()), float(times.min(initial=FAR_S))
