"""KIN-5: the prescribed trajectory (V-E, Table I)."""

from __future__ import annotations

from bisect import bisect

import numpy as np

from automcm.kernels.trajectory import NANOMETRE, Floats, Trajectory, TrajectoryError, number

GAIN = 20.0
"""D_add, m (Table I)."""
DELTA_V = 20 / 3.6
"""ΔV, m/s (Table I)."""
V_MIN = 1.0
"""A prescription has no lower speed than this, m/s (the paper has no bound)."""
TOLERANCE = 1e-6
"""Tolerance of the gain, m: positions and times are doubles, and times may be since 1970."""
SPACING = 1e-3
"""A bend or planned sample this close (s) to another is omitted, because messages count in ms."""


def prescribe(
    planned: Trajectory,
    start: float,
    *,
    hold: float,
    delta_v: float = DELTA_V,
    gain: float = GAIN,
    v_min: float = V_MIN,
) -> Trajectory:
    """As planned until ``start`` + ``hold`` (Δt1), then slower by ΔV until ``gain`` metres are
    gained, then at the planned speed again, on the same path (KIN-5).

    The way covered is that of the planned speed reduced by min(ΔV, v - v_min), or by nothing where
    v < v_min, at each time.  So for an even v the action lasts Δt2 = D_add/ΔV, or, clamped,
    D_add/(v - v_min).  After it the vehicle is ``gain`` behind its plan (to TOLERANCE) and drives
    the speed planned for that *time*.  It ends when the plan ends, ``gain`` earlier on the path.

    ``start``, ``hold``: s.  ``delta_v``, ``v_min``: m/s.  Exact samples are the
    start, the beginning and the end of the action and the end of the plan.  The others are where
    the planned speed may change and where the path bends, except within SPACING of another.

    Contradictory in the paper: Δt2 is D/V in V-E and D/ΔV in Table I; D contains d or d_0.  Here
    only the distance to be gained counts.  Open: a vehicle slower than ΔV, a plan whose speed
    varies (also while holding: as planned).

    Raises TrajectoryError if ``start`` lies outside of the plan, or the plan ends before ``gain``
    metres are gained.
    """
    begin = number("start", start)
    number("hold", hold, 0)
    slower = number("delta_v", delta_v, 0, above=True)
    number("gain", gain, 0)
    number("v_min", v_min, 0)
    if not planned.t[0] <= begin <= planned.t[-1]:
        raise TrajectoryError("start", f"{begin} s is outside of the planned trajectory")

    # Times since the start, at which the planned speed or the phase of the action changes.
    plan, way = planned.t - begin, planned.arc()
    end = plan[-1]
    times = np.unique(np.clip(np.concatenate([plan, [0.0, hold]]), 0, end))
    spans = np.diff(times)
    v = np.diff(np.interp(times, plan, way)) / spans
    reduced = np.where(times[:-1] >= hold, np.clip(v - v_min, 0, slower), 0)
    gained = np.concatenate([[0.0], np.cumsum(reduced * spans)])
    if gained[-1] < gain - NANOMETRE:
        raise TrajectoryError("planned", f"too short to gain {gain:g} m: only {gained[-1]:.3f} m")
    k = min(int(np.searchsorted(gained, gain)), len(times) - 1)
    over = times[k]
    if gained[k] > gain:
        over = times[k - 1] + (gain - gained[k - 1]) / reduced[k - 1]
        times, gained = np.insert(times, k, over), np.insert(gained, k, gain)
    ways = np.interp(times, plan, way) - np.minimum(gained, gain)
    ways = np.maximum.accumulate(ways)

    # The vehicle now reaches the bends of the path later.
    arcs = _bends(planned, way)
    arcs = arcs[(arcs > ways[0]) & (arcs < ways[-1])]
    firm = np.unique(np.clip([0.0, hold, over, end], 0, end))
    samples = _spaced(firm, np.concatenate([times, np.interp(arcs, ways, times)]))
    along = np.interp(samples, times, ways)
    xy = np.stack([np.interp(along, way, planned.xy[:, axis]) for axis in (0, 1)], axis=1)
    t = begin + samples
    later = np.concatenate([[True], np.diff(t) > 0])
    return Trajectory(t[later], xy[later], planned.stopped)


def _bends(planned: Trajectory, way: Floats) -> Floats:
    """The distances along the path at which it is not straight."""
    on = np.concatenate([[True], np.diff(way) > 0])
    steps = np.diff(planned.xy[on], axis=0)
    steps /= np.hypot(steps[:, 0], steps[:, 1])[:, None]
    turn = np.diff(steps, axis=0)
    bends: Floats = way[on][1:-1][np.hypot(turn[:, 0], turn[:, 1]) > NANOMETRE]
    return bends


def _spaced(firm: Floats, others: Floats) -> Floats:
    """All of ``firm``, and those of ``others`` that are not within SPACING of one that is kept."""
    kept = [float(each) for each in firm]
    for each in np.sort(others):
        i = bisect(kept, each)
        near = kept[max(i - 1, 0) : i + 1]
        if all(abs(each - other) >= SPACING for other in near):
            kept.insert(i, float(each))
    return np.array(kept)
