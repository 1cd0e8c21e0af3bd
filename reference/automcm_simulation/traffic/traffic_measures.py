"""What is measured in traffic: safety, comfort, travel time, radio and sessions.

A record is plain JSON, and equal for equal seeds.
"""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from automcm.applications.occupancy import HARDEST
from automcm.kernels.trajectory import Floats
from automcm.links.simulated_radio import Channel
from automcm_simulation.road.hazard_measures import bound_ms, met
from automcm_simulation.traffic.mover import STEP_MS, Body, RoadUser
from automcm_spec.vocabulary.parameters import longest_delay

if TYPE_CHECKING:
    from automcm_simulation.traffic.traffic import Traffic

TTC_S = 1.5
"""A shorter time to collision counts as critical, s."""
OVER_STEPS = 5
"""Braking counts as hard if it is harder than HARDEST on average over so many steps: SUMO's own
drivers brake that hard for single steps."""
AFTER_MS = 5000
"""A collision so long after a maneuver of one of both counts as caused by it."""
NEAR_M = 100.0
"""The age of CAMs is that of vehicles nearer than this."""
AHEAD = 0.7
"""Cosine between headings from which on two drive in the same direction."""
KINDS = ("equipped", "others")
DELAY_MS = Channel().delay_ms[1]
"""D of theorem T-2, unless the radio was slower."""


class Histogram:
    """Counts of values from 0 on in bins, with percentiles at their upper ends."""

    def __init__(self, width: float, number: int) -> None:
        self._width = width
        self._counts = np.zeros(number, dtype=np.int64)
        self.greatest = 0.0

    def add(self, values: Floats) -> None:
        """Count these; the last bin takes all greater ones."""
        if len(values):
            at = np.minimum((values / self._width).astype(np.int64), len(self._counts) - 1)
            self._counts += np.bincount(at, minlength=len(self._counts))
            self.greatest = max(self.greatest, float(values.max()))

    def percentile(self, share: float) -> float | None:
        """The value that this share does not exceed; None without values."""
        total = int(self._counts.sum())
        if not total:
            return None
        at = int(np.searchsorted(np.cumsum(self._counts), share * total))
        return round(self._width * (at + 1), 6)


class Measures:
    """Sums and counts over the steps of one run."""

    def __init__(self, users: Mapping[int, RoadUser]) -> None:
        self._users = users
        self._touching: set[tuple[int, int]] = set()
        self._braking: frozenset[int] = frozenset()
        self._speeds: deque[dict[int, float]] = deque(maxlen=OVER_STEPS + 1)
        self._accelerations: dict[int, float] = {}
        self._maneuver_ms: dict[int, int] = {}
        """When each was last in a maneuver: changing lanes, or bound to a prescription."""
        self.collisions: list[dict[str, Any]] = []
        self.hard_brakings: Counter[str] = Counter()
        self.critical: Counter[str] = Counter()
        """Steps with a time to collision below TTC_S, by who follows."""
        self.least_ttc_s: float | None = None
        self._jerk = {kind: Histogram(0.1, 1000) for kind in KINDS}
        self._age = Histogram(10.0, 300)
        self._travel = {kind: [0.0] * 3 for kind in KINDS}
        """Seconds, metres, and seconds lost against the desired speed."""
        self._busy = Histogram(0.01, 101)

    def step(self, now_ms: int, bodies: Mapping[int, Body], traffic: Traffic) -> None:
        """Measure one step."""
        numbers = [n for n in bodies if n in self._users]
        if not numbers:
            return
        table = np.array([bodies[n] for n in numbers])
        users = [self._users[n] for n in numbers]
        size = np.array([(user.length, user.width) for user in users])
        for number, vehicle in traffic.vehicles.items():
            phase = (
                traffic.stations.services[number].state.phase
                if number in bodies and (number in traffic.stations.services)
                else ""
            )
            if vehicle.changing or phase == "ACTUATING":
                self._maneuver_ms[number] = now_ms
        self._collide(now_ms, numbers, table, size, bodies)
        self._follow(users, table, size)
        self._brake(users, table)
        self._drive(users, table)
        if now_ms % 1000 == 0:
            self._radio(now_ms, bodies, traffic)

    def _collide(
        self,
        now_ms: int,
        numbers: list[int],
        table: Floats,
        size: Floats,
        bodies: Mapping[int, Body],
    ) -> None:
        touching = set()
        for i, j in overlaps(table[:, :3], size):
            pair = numbers[i], numbers[j]
            touching.add(pair)
            if pair in self._touching:
                continue
            last = max(self._maneuver_ms.get(n, -AFTER_MS - 1) for n in pair)
            self.collisions.append(
                {
                    "ms": now_ms,
                    "users": list(pair),
                    "equipped": sum(self._users[n].equipped for n in pair),
                    "pedestrian": any(self._users[n].kind == "person" for n in pair),
                    "maneuver": now_ms - last <= AFTER_MS,
                    "speeds": [round(bodies[n].speed, 2) for n in pair],
                }
            )
        self._touching = touching

    def _follow(self, users: list[RoadUser], table: Floats, size: Floats) -> None:
        ttc = time_to_collision(table, size)
        least = float(ttc.min())
        if np.isfinite(least) and (self.least_ttc_s is None or least < self.least_ttc_s):
            self.least_ttc_s = least
        for k in np.flatnonzero(ttc < TTC_S):
            self.critical[_kind(users[k])] += 1

    def _brake(self, users: list[RoadUser], table: Floats) -> None:
        accelerations = dict(zip((u.number for u in users), table[:, 4].tolist(), strict=True))
        before = self._accelerations
        for kind, jerk in self._jerk.items():
            changes = [
                abs(a - before[n]) * (1000 / STEP_MS)
                for n, a in accelerations.items()
                if n in before and _kind(self._users[n]) == kind
            ]
            jerk.add(np.array(changes))
        self._accelerations = accelerations
        self._speeds.append(dict(zip(accelerations, table[:, 3].tolist(), strict=True)))
        first, last = self._speeds[0], self._speeds[-1]
        lost = HARDEST * (len(self._speeds) - 1) * STEP_MS / 1000
        full = len(self._speeds) > OVER_STEPS
        braking = frozenset(n for n, v in last.items() if full and first.get(n, 0.0) - v > lost)
        for number in braking - self._braking:
            self.hard_brakings[_kind(self._users[number])] += 1
        self._braking = braking

    def _drive(self, users: list[RoadUser], table: Floats) -> None:
        for user, speed in zip(users, table[:, 3].tolist(), strict=True):
            if user.kind == "vehicle":
                sums = self._travel[_kind(user)]
                sums[0] += STEP_MS / 1000
                sums[1] += speed * STEP_MS / 1000
                sums[2] += max(0.0, 1 - speed / user.desired) * STEP_MS / 1000

    def _radio(self, now_ms: int, bodies: Mapping[int, Body], traffic: Traffic) -> None:
        ages, busy = [], []
        for number in traffic.vehicles:
            if number not in bodies or number not in traffic.stations.services:
                continue
            own = bodies[number]
            busy.append(traffic.stations.links.radio.channel_busy_ratio(number))
            for other, heard in traffic.stations.services[number].neighbours.items():
                there = bodies.get(other)
                if there is not None and abs(there.x - own.x) + abs(there.y - own.y) <= NEAR_M:
                    ages.append(now_ms - heard.received_ms)
        self._age.add(np.array(ages, dtype=float))
        self._busy.add(np.array(busy, dtype=float))

    def record(self, traffic: Traffic) -> dict[str, Any]:
        """The record of the run so far."""
        stations, links = traffic.stations, traffic.stations.links
        services = stations.services.values()
        sent: Counter[str] = Counter()
        for service in services:
            sent.update(service.statistics.sent)
        parameters = next((service.parameters for service in services), None)
        hazards = None
        if parameters is not None:
            seed = traffic.setting.seed
            # From longest_delay on, T-2 does not hold.
            d = min(max(DELAY_MS, links.longest_ms), longest_delay(parameters.known) - 1)
            hazards = met([seed], [stations.over()], bound_ms(parameters, d))
        return {
            "collisions": {
                "between_equipped": sum(c["equipped"] == 2 for c in self.collisions),
                "by_maneuver": sum(c["maneuver"] for c in self.collisions),
                "with_pedestrian": sum(c["pedestrian"] * c["equipped"] for c in self.collisions),
                "all": len(self.collisions),
                "list": self.collisions[:20],
            },
            "hazards": hazards,
            "hard_brakings": dict(sorted(self.hard_brakings.items())),
            "critical_s": {
                k: round(n * STEP_MS / 1000, 1) for k, n in sorted(self.critical.items())
            },
            "least_ttc_s": None if self.least_ttc_s is None else round(self.least_ttc_s, 3),
            "jerk": {
                kind: {
                    "p95": jerk.percentile(0.95),
                    "p99": jerk.percentile(0.99),
                    "greatest": round(jerk.greatest, 2),
                }
                for kind, jerk in self._jerk.items()
            },
            "travel": {
                kind: {"s": round(s, 1), "m": round(m, 1), "lost_s": round(lost, 2)}
                for kind, (s, m, lost) in self._travel.items()
            },
            "sessions": {
                "requested": stations.requested,
                "agreed": len(stations.agreed),
                "completed": len(stations.completed),
                "ended": dict(sorted(stations.ended.items())),
            },
            "radio": {
                "sent": dict(sorted(sent.items())),
                "sent_bytes": sum(service.statistics.sent_bytes for service in services),
                "received": links.received,
                "too_long": links.lost["too_long"],
                "longest_delay_ms": links.longest_ms,
                "busy": {"p50": self._busy.percentile(0.5), "p95": self._busy.percentile(0.95)},
                "cam_age_ms": {
                    "p50": self._age.percentile(0.5),
                    "p95": self._age.percentile(0.95),
                    "p99": self._age.percentile(0.99),
                },
            },
            "outcome": traffic.scenario.outcome(traffic),
        }


def _kind(user: RoadUser) -> str:
    return KINDS[0] if user.equipped else KINDS[1]


def overlaps(poses: Floats, size: Floats) -> list[tuple[int, int]]:
    """The pairs of rectangles (x, y, heading; length, width) that overlap, by separating axes."""
    xy = poses[:, :2]
    away = xy[None] - xy[:, None]
    radius = np.hypot(size[:, 0], size[:, 1]) / 2
    near = np.hypot(away[..., 0], away[..., 1]) < radius[None] + radius[:, None]
    i, j = np.nonzero(np.triu(near, 1))
    if not len(i):
        return []
    heading = poses[:, 2]
    axis = np.stack([np.cos(heading), np.sin(heading)], axis=1)
    side = np.stack([-axis[:, 1], axis[:, 0]], axis=1)
    apart = np.zeros(len(i), dtype=bool)
    for along in (axis[i], side[i], axis[j], side[j]):
        distance = np.abs((away[i, j] * along).sum(axis=1))
        reach = np.zeros(len(i))
        for k in (i, j):
            reach += size[k, 0] / 2 * np.abs((axis[k] * along).sum(axis=1))
            reach += size[k, 1] / 2 * np.abs((side[k] * along).sum(axis=1))
        apart |= distance >= reach
    return [(int(a), int(b)) for a, b, off in zip(i, j, apart, strict=True) if not off]


def time_to_collision(table: Floats, size: Floats) -> Floats:
    """The time to collision, s, of each with the next one ahead whose sides overlap with its own
    and that drives in the same direction, at constant speeds; infinite if it is not slower.

    ``table`` has rows of ``Body``.
    """
    heading, speed = table[:, 2], table[:, 3]
    away = table[None, :, :2] - table[:, None, :2]
    cos, sin = np.cos(heading)[:, None], np.sin(heading)[:, None]
    along = away[..., 0] * cos + away[..., 1] * sin
    across = np.abs(away[..., 1] * cos - away[..., 0] * sin)
    gap = along - (size[:, 0][None] + size[:, 0][:, None]) / 2
    ahead = (along > 0) & (across < (size[:, 1][None] + size[:, 1][:, None]) / 2)
    ahead &= np.cos(heading[None] - heading[:, None]) > AHEAD
    gap = np.where(ahead, gap, np.inf)
    leader = gap.argmin(axis=1)
    rows = np.arange(len(table))
    closing = speed - speed[leader]
    least = np.maximum(gap[rows, leader], 0.0)
    found: Floats = np.where(
        np.isfinite(least) & (closing > 0), least / np.where(closing > 0, closing, 1.0), np.inf
    )
    return found
