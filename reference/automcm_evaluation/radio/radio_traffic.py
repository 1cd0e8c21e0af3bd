"""Vehicles that broadcast on a road, and what arrives over a radio: the measure of both radios."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from pydantic import BaseModel, ConfigDict, TypeAdapter

from automcm_simulation.radio.propagation import Propagation
from automcm_simulation.radio.radio import Arrival, RadioModel

Array = np.ndarray[Any, np.dtype[Any]]
STEP_MS = 100
WARM_MS = 1000
"""Before it, nothing is counted: nobody has measured a load."""
LAST_MS = 600
"""For the frames that still wait at the end."""
WIDTH_M, REACH_M = 25, 500
"""Rows are for distances at multiples of WIDTH_M, from half of it below to half of it above."""
LANE_M = 3.5
SPEEDS = (25.0, 35.0)
"""m/s; every second vehicle drives in the other direction."""
LONG = 3
"""Losses in a row that count as a long run."""


class MeasuredRadio(RadioModel, Protocol):
    """A radio whose mean powers are known."""

    propagation: Propagation


class FourLanes(BaseModel):
    """Vehicles on a straight road of four lanes, which all send with the same period."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    name: str
    per_km: float
    seconds: int
    """After WARM_MS."""
    period_ms: int = 100
    size_bytes: tuple[int, ...] = (150, 1300)
    """Each frame has one of these sizes."""
    shares: tuple[float, ...] = (0.9, 0.1)
    road_m: float = 1200.0
    fitted: bool = True
    """Whether the table was fitted to it."""
    jams: bool = False
    """If set, all vehicles are in the first and in the last fifth of the road."""
    seed: int = 1

    @property
    def vehicles(self) -> int:
        """Their number."""
        return round(self.per_km * self.road_m / 1000)


class DistanceRow(BaseModel):
    """The frames of the first size that were sent at about this distance."""

    distance_m: int
    frames: int
    arrived: int
    losses: int
    """Those that have a next frame of the same pair."""
    next_lost: int
    """How often that was lost too."""
    runs: int
    """Runs of losses."""
    long_runs: int
    """Of at least LONG."""


_, *COUNTED = DistanceRow.model_fields


class Measured(BaseModel):
    """What arrived of a traffic, and the mean channel busy ratio."""

    traffic: FourLanes
    busy: float
    rows: list[DistanceRow]


MEASUREMENTS = TypeAdapter(list[Measured])
NS3 = Path(__file__).with_name("radio_ns3.json")
"""What ns-3 measured (docs/radio.md)."""


def ns3_measured() -> list[Measured]:
    """The committed measurements of ns-3."""
    return MEASUREMENTS.validate_json(NS3.read_bytes())


def positions(traffic: FourLanes) -> Iterator[dict[int, tuple[float, float]]]:
    """Of each step; a vehicle that leaves the road enters it again at the other end."""
    random = np.random.default_rng((traffic.seed, 9))
    n, road = traffic.vehicles, traffic.road_m
    x = random.random(n) * road
    if traffic.jams:
        x = np.where(x < road / 2, x * 0.4, road - (road - x) * 0.4)
    speed = random.uniform(*SPEEDS, n) * (0.0 if traffic.jams else 1.0)
    speed[1::2] *= -1
    while True:
        yield {i + 1: (float(x[i]), LANE_M * (i % 4)) for i in range(n)}
        x = (x + speed * STEP_MS / 1000) % road


def _drive(radio: MeasuredRadio, traffic: FourLanes) -> tuple[Array, Array, Array, Array]:
    """Run the traffic over a radio.

    Returns the frames, of step, sender and index into ``size_bytes``; whether they arrived, by
    frame and receiver; the distances in m by step, sender and receiver; and the channel busy
    ratios by step and receiver.
    """
    random = np.random.default_rng((traffic.seed, 8))
    n = traffic.vehicles
    phase = random.integers(traffic.period_ms, size=n)
    steps = (WARM_MS + 1000 * traffic.seconds) // STEP_MS
    sent: list[tuple[int, int, int]] = []
    received: list[Arrival] = []
    distances, busy = [], []
    for step, places in zip(range(steps), positions(traffic), strict=False):
        radio.move(places)
        due = [
            (at, i)
            for again in range(0, STEP_MS, traffic.period_ms)
            for i, at in enumerate(phase + step * STEP_MS + again)
        ]
        sizes = random.choice(len(traffic.size_bytes), size=len(due), p=traffic.shares)
        for (at, i), size in zip(sorted(due), sizes, strict=True):
            radio.transmit(i + 1, traffic.size_bytes[size], int(at), len(sent))
            sent.append((step, i, int(size)))
        distances.append(radio.propagation.distances().astype(np.float32))
        received += radio.advance((step + 1) * STEP_MS)
        busy.append([radio.channel_busy_ratio(i + 1) for i in range(n)])
    received += radio.advance(steps * STEP_MS + LAST_MS)
    frames = np.array(sent)
    hits = np.zeros((len(sent), n), dtype=np.bool_)
    for _, frame, receivers in received:
        hits[frame, np.array(receivers) - 1] = True
    return frames, hits, np.array(distances), np.array(busy, dtype=np.float32)


def measured(radio: MeasuredRadio, traffic: FourLanes) -> Measured:
    """What arrives over a radio by distance, of the frames after WARM_MS."""
    frames, hits, distance_m, ratios = _drive(radio, traffic)
    step, senders, size = frames.T
    bins = REACH_M // WIDTH_M + 1
    counts = np.zeros((6, bins), dtype=np.int64)
    kept = (step >= WARM_MS // STEP_MS) & (size == 0)
    for sender in range(traffic.vehicles):
        (own,) = np.nonzero(kept & (senders == sender))
        apart = np.delete(distance_m[step[own], sender], sender, axis=1)
        place = np.floor(apart / WIDTH_M + 0.5).astype(np.intp)
        place[place >= bins] = 0  # row 0 is not reported
        lost = ~np.delete(hits[own], sender, axis=1)
        begins = np.concatenate([lost[:1], lost[1:] & ~lost[:-1]])
        long = begins[: 1 - LONG].copy()
        for more in range(1, LONG):
            long &= lost[more : len(lost) - LONG + 1 + more]
        within = begins[: 1 - LONG]  # a run that begins later may be cut off
        for row, which in enumerate(
            (np.ones_like(lost), ~lost, lost[:-1], lost[:-1] & lost[1:], within, long)
        ):
            counts[row] += np.bincount(place[: len(which)][which], minlength=bins)
    rows = [
        DistanceRow(distance_m=bin_ * WIDTH_M, **dict(zip(COUNTED, c.tolist(), strict=True)))
        for bin_, c in enumerate(counts.T)
        if bin_ and c[0]
    ]
    busy = float(ratios[WARM_MS // STEP_MS :].mean())
    return Measured(traffic=traffic, busy=round(busy, 4), rows=rows)


def summed(rows: Sequence[DistanceRow], distance_m: int) -> DistanceRow:
    """The sum of the counts, as of this distance."""
    sums = {name: sum(getattr(row, name) for row in rows) for name in COUNTED}
    return DistanceRow(distance_m=distance_m, **sums)


def pooled(parts: Sequence[Measured]) -> Measured:
    """Several runs of one traffic, with different seeds, as one."""
    rows = [summed(r, r[0].distance_m) for r in zip(*(part.rows for part in parts), strict=True)]
    busy = sum(part.busy for part in parts) / len(parts)
    return Measured(traffic=parts[0].traffic, busy=round(busy, 4), rows=rows)
