"""A second, independent implementation of the kernels (KIN-1 to KIN-7): slow and exact.

The expected outputs of the test vectors are computed here, never by the kernels under test.  All
numbers are fractions; an input has exactly its decimal value.  A square root is exact if it is
rational, and otherwise truncated after 60 decimals.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from fractions import Fraction
from itertools import pairwise
from math import isqrt
from typing import Any

Json = Any
Place = tuple[Fraction, Fraction]
DIGITS = 60


class Refused(ValueError):
    """An invalid input: its name, the index of the first invalid entry if any, and the reason."""

    def __init__(self, name: str, index: int | None, why: str) -> None:
        super().__init__(why)
        self.name, self.index, self.why = name, index, why


def number(value: float) -> Fraction:
    """The exact decimal value of a JSON number."""
    return Fraction(str(value))


def root(value: Fraction) -> Fraction:
    """The square root, exact if it is rational."""
    top, bottom = isqrt(value.numerator), isqrt(value.denominator)
    if top * top == value.numerator and bottom * bottom == value.denominator:
        return Fraction(top, bottom)
    scale = 10**DIGITS
    return Fraction(isqrt(value.numerator * scale * scale // value.denominator), scale)


def place(value: Sequence[float]) -> Place:
    """The exact value of a place in JSON."""
    return number(value[0]), number(value[1])


def minus(a: Place, b: Place) -> Place:
    """The vector from ``b`` to ``a``."""
    return a[0] - b[0], a[1] - b[1]


def dot(a: Place, b: Place) -> Fraction:
    """The inner product."""
    return a[0] * b[0] + a[1] * b[1]


def between(a: Place, b: Place, share: Fraction) -> Place:
    """The place at the fraction ``share`` of the way from ``a`` to ``b``."""
    return a[0] + share * (b[0] - a[0]), a[1] + share * (b[1] - a[1])


def distance(a: Place, b: Place) -> Fraction:
    """The distance of two places."""
    return root(dot(minus(a, b), minus(a, b)))


@dataclass(frozen=True, slots=True)
class Trajectory:
    """Places over time, with constant velocity between them; ``stopped``: stays at the last."""

    t: list[Fraction]
    xy: list[Place]
    stopped: bool

    @property
    def end(self) -> Fraction | None:
        """The last time at which the place is known; None if it is known forever."""
        return None if self.stopped else self.t[-1]

    def at(self, when: Fraction) -> Place:
        """The place at this time."""
        for n in range(len(self.t) - 1):
            if when <= self.t[n + 1]:
                share = (when - self.t[n]) / (self.t[n + 1] - self.t[n])
                return between(self.xy[n], self.xy[n + 1], share)
        return self.xy[-1]

    def speeds(self) -> list[Fraction]:
        """The speed of each segment."""
        return [
            distance(self.xy[n], self.xy[n + 1]) / (self.t[n + 1] - self.t[n])
            for n in range(len(self.t) - 1)
        ]

    def as_json(self) -> Json:
        """The trajectory as in a vector."""
        return {"t": self.t, "xy": [list(each) for each in self.xy], "stopped": self.stopped}


def trajectory(value: Json) -> Trajectory:
    """Raises Refused for no points, an unequal number of places, or times that do not ascend."""
    t = [number(each) for each in value["t"]]
    xy = [place(each) for each in value["xy"]]
    if not t:
        raise Refused("t", None, "must have at least one point")
    if len(xy) != len(t):
        raise Refused("xy", None, "must have as many places as there are times")
    for n, (before, after) in enumerate(pairwise(t), 1):
        if after <= before:
            raise Refused("t", n, "must be after the previous time")
    return Trajectory(t, xy, value.get("stopped", False))


# KIN-1


def projection(path: list[Place], position: Place) -> tuple[int, Place]:
    """The last point up to the first closest place of the path, and that place."""
    best, found = None, (0, path[0])
    for n, (a, b) in enumerate(pairwise(path)):
        along = minus(b, a)
        share = Fraction(0)
        if dot(along, along):
            share = dot(minus(position, a), along) / dot(along, along)
        share = min(max(share, Fraction(0)), Fraction(1))
        point = between(a, b, share)
        away = dot(minus(point, position), minus(point, position))
        if best is None or away < best:
            best, found = away, (n + (share == 1), point)
    return found


def convert(given: Json) -> Json:
    """KIN-1: converts a path with speeds to places over time."""
    path = [place(each) for each in given["xy"]]
    speed = [number(each) for each in given["speed"]]
    v_eps = number(given["v_eps"])
    if not path:
        raise Refused("xy", None, "must have at least one point")
    if len(speed) != len(path):
        raise Refused("speed", None, "must have as many speeds as there are points")
    for n, v in enumerate(speed):
        if v < 0:
            raise Refused("speed", n, "must not be negative")
    if v_eps <= 0:
        raise Refused("v_eps", None, "must be above 0")
    first, here = projection(path, place(given["position"]))
    now = number(given["t0"])
    t, xy = [now], [here]
    v = speed[first]
    for n in range(first + 1, len(path)):
        if v < v_eps:
            break
        length = distance(here, path[n])
        if length:
            now += length / v
            t.append(now)
            xy.append(path[n])
        here, v = path[n], speed[n]
    return Trajectory(t, xy, v < v_eps).as_json()


# KIN-2


def changes(drive: Trajectory) -> list[int]:
    """The points at which the speed changes."""
    speeds = drive.speeds()
    return [n for n in range(1, len(drive.t) - 1) if speeds[n - 1] != speeds[n]]


def thin(given: Json) -> Json:
    """KIN-2.  If the budget is too small, only the first and the last point are determined."""
    drive = trajectory(given)
    every, budget = given["every"], given["budget"]
    overhead, each = given["size"]["overhead"], given["size"]["per_point"]
    if every < 1:
        raise Refused("every", None, "must be at least 1")
    last = len(drive.t) - 1
    kept = sorted({*range(0, last + 1, every), 0, last, *changes(drive)})
    most = (budget - overhead) // each
    if len(kept) <= most:
        return {"kept": kept}
    if most < len({0, last}):
        raise Refused("budget", None, "must have room for the first and the last point")
    return {"includes": sorted({0, last}), "at_most": most}


# KIN-3


def common(a: Trajectory, b: Trajectory) -> list[Fraction]:
    """The times of both, limited to those at which both places are known."""
    low = max(a.t[0], b.t[0])
    ends = [end for end in (a.end, b.end) if end is not None]
    high = min(ends) if ends else max(low, a.t[-1], b.t[-1])
    inside = {when for when in (*a.t, *b.t) if low <= when <= high}
    return sorted(inside | {low, high}) if low <= high else []


def closest(a: Trajectory, b: Trajectory) -> tuple[Fraction, Fraction] | None:
    """The earliest time at which they are closest, and the square of the distance then."""
    best = None
    grid = common(a, b)
    for begin, end in pairwise(grid if len(grid) > 1 else grid * 2):
        apart = minus(a.at(begin), b.at(begin))
        change = minus(minus(a.at(end), b.at(end)), apart)
        share = Fraction(0)
        if dot(change, change):
            share = min(max(-dot(apart, change) / dot(change, change), Fraction(0)), Fraction(1))
        least = between(apart, (apart[0] + change[0], apart[1] + change[1]), share)
        if best is None or dot(least, least) < best[1]:
            best = begin + share * (end - begin), dot(least, least)
    return best


def first_below(a: Trajectory, b: Trajectory, limit: Fraction) -> Fraction | None:
    """The time at which they first come as close as ``limit``, if they come closer."""
    grid = common(a, b)
    for begin, end in pairwise(grid if len(grid) > 1 else grid * 2):
        apart = minus(a.at(begin), b.at(begin))
        if dot(apart, apart) < limit * limit:
            return begin
        change = minus(minus(a.at(end), b.at(end)), apart)
        square, half = dot(change, change), dot(apart, change)
        if not square:
            continue
        under = half * half - square * (dot(apart, apart) - limit * limit)
        if under <= 0 or half >= 0:
            continue
        share = (-half - root(under)) / square
        if share < 1:
            return begin + share * (end - begin)
    return None


def greatest(drive: Trajectory) -> Fraction:
    """The greatest speed of a trajectory; 0 if it has one sample."""
    return max(drive.speeds(), default=Fraction(0))


def collide(given: Json) -> Json:
    """KIN-3: the closest approach of two, and the start of the collision."""
    a, b = trajectory(given["a"]), trajectory(given["b"])
    threshold, clock_error = number(given["threshold"]), number(given["clock_error"])
    if threshold < 0:
        raise Refused("threshold", None, "must not be negative")
    if clock_error < 0:
        raise Refused("clock_error", None, "must not be negative")
    found = closest(a, b)
    if found is None:
        return {"approach": None, "collision": None}
    when, square = found
    limit = threshold + (greatest(a) + greatest(b)) * clock_error
    since = first_below(a, b, limit) if square < limit * limit else None
    return {
        "approach": {"time": when, "distance": root(square), **places(a, b, when)},
        "collision": None if since is None else {"time": since, **places(a, b, since)},
    }


def places(a: Trajectory, b: Trajectory, when: Fraction) -> Json:
    """The places of both at a time."""
    return {"place_a": list(a.at(when)), "place_b": list(b.at(when))}


# KIN-4


def inside(zone: list[Place], point: Place) -> bool:
    """Whether a point is in the polygon or on its boundary."""
    inside = False
    for a, b in zip(zone, zone[1:] + zone[:1], strict=True):
        along, to = minus(b, a), minus(point, a)
        if a == b:
            continue
        if along[0] * to[1] == along[1] * to[0] and 0 <= dot(to, along) <= dot(along, along):
            return True
        if (a[1] > point[1]) != (b[1] > point[1]):
            crossing = a[0] + (point[1] - a[1]) * along[0] / along[1]
            inside ^= point[0] < crossing
    return inside


def discover(given: Json) -> Json:
    """KIN-4: the foremost of the colliding vehicles in the zone."""
    zone = [place(each) for each in given["zone"]]
    if zone[:1] == zone[1:][-1:]:
        zone.pop()  # the last corner repeats the first
    if len(zone) < 3:
        raise Refused("zone", None, "must have at least three corners")
    leader = None
    for one in given["candidates"]:
        if not inside(zone, place(one["xy"])):
            continue
        if leader is None:
            leader = one
            continue
        ahead = dot(place(leader["direction"]), minus(place(one["xy"]), place(leader["xy"])))
        if ahead > 0 or (ahead == 0 and one["station_id"] < leader["station_id"]):
            leader = one
    return {"target": None if leader is None else leader["station_id"]}


# KIN-5


def prescribe(given: Json) -> Json:
    """KIN-5 from ``start`` to the end of a plan that has a constant speed from ``start`` on.

    The rule leaves open plans with several speeds, and the motion after the end of the plan.
    """
    planned = trajectory(given["planned"])
    start, hold, gain = (number(given[name]) for name in ("start", "hold", "gain"))
    delta_v, v_min = number(given["delta_v"]), number(given["v_min"])
    if hold < 0:
        raise Refused("hold", None, "must not be negative")
    if delta_v <= 0:
        raise Refused("delta_v", None, "must be above 0")
    if not planned.t[0] <= start <= planned.t[-1]:
        raise Refused("start", None, "must be within the planned trajectory")
    end = planned.t[-1]
    later = [n for n, when in enumerate(planned.t) if when > start]
    v = planned.speeds()[later[0] - 1]
    slow = max(v - delta_v, v_min)
    if slow >= v:
        raise Refused("planned", None, "is too slow to gain a gap")
    action = start + hold
    over = action + gain / (v - slow)
    if over > end:
        raise Refused("planned", None, "ends before the gap is gained")
    path = [planned.at(start), *(planned.xy[n] for n in later)]
    t, xy = [start], [path[0]]
    for begin, until, speed in ((start, action, v), (action, over, slow), (over, end, v)):
        left = speed * (until - begin)
        if not speed:
            t.append(until)
            xy.append(xy[-1])
        while left > 0:
            length = distance(path[0], path[1])
            step = min(left, length)
            t.append(t[-1] + step / speed)
            xy.append(between(path[0], path[1], step / length))
            path[:2] = [xy[-1], path[1]] if step < length else [path[1]]
            left -= step
    return {"t": t, "xy": [list(each) for each in xy]}


# KIN-6

PARTS = 64
"""Each segment is divided into this many parts to measure its distance from a path.  The answer of
a vector must not depend on a finer division."""


def known(drive: Trajectory, when: Fraction) -> bool:
    """Whether the place of the vehicle is known at that time."""
    return drive.t[0] <= when and (drive.end is None or when <= drive.end)


def follows(prescribed: Trajectory, planned: Trajectory, limit: Fraction) -> bool:
    """Whether it is never more than ``limit`` from the path, nor moves back by more than that."""
    furthest = Fraction(0)
    for n in range(max(len(prescribed.xy) - 1, 1)):
        for part in range(PARTS + 1):
            ends = prescribed.xy[n], prescribed.xy[min(n + 1, len(prescribed.xy) - 1)]
            here = between(*ends, Fraction(part, PARTS))
            corner, foot = projection(planned.xy, here)
            if distance(here, foot) > limit:
                return False
            way = sum(map(distance, planned.xy[:corner], planned.xy[1 : corner + 1]), Fraction(0))
            way += distance(planned.xy[corner], foot)
            if way < furthest - limit:
                return False
            furthest = max(way, furthest)
    return True


def steps(prescribed: Trajectory, planned: Trajectory, reaction: Fraction) -> list[Fraction]:
    """The changes of speed within ``reaction``, at all times.

    The planned speed comes before the start; the last one, or 0 if stopped, after the end.
    """
    speeds = prescribed.speeds()
    n = sum(when <= prescribed.t[0] for when in planned.t)
    before = planned.speeds()[n - 1] if 0 < n < len(planned.t) else speeds[0]
    speeds = [before, *speeds, Fraction(0) if prescribed.stopped else speeds[-1]]

    def speed(when: Fraction) -> Fraction:
        return speeds[sum(t <= when for t in prescribed.t)]

    turns = sorted({*prescribed.t, *(t - reaction for t in prescribed.t)})
    middles = [(a + b) / 2 for a, b in pairwise(turns)]
    return [speed(when + reaction) - speed(when) for when in middles]


def near(prescribed: Trajectory, other: Trajectory, since: Fraction, gap: Fraction) -> bool:
    """Whether the two come closer than ``gap`` from ``since`` on."""
    at = prescribed.at(since)
    later = [(t, x) for t, x in zip(prescribed.t, prescribed.xy, strict=True) if t > since]
    rest = Trajectory(
        [since, *(t for t, _ in later)], [at, *(x for _, x in later)], prescribed.stopped
    )
    found = closest(rest, other)
    return found is not None and found[1] < gap * gap


def verify(given: Json) -> Json:
    """KIN-6: every reason not to drive the prescribed trajectory."""
    prescribed, planned = trajectory(given["prescribed"]), trajectory(given["planned"])
    now = number(given["now"])
    limits = {name: number(value) for name, value in given["limits"].items()}
    for name, value in limits.items():
        if value < 0:
            raise Refused(name, None, "must not be negative")
    reasons = set()
    since = max(now, prescribed.t[0])
    if now - prescribed.t[0] > limits["age"]:
        reasons.add("expired")
    if prescribed.end is not None and now >= prescribed.end:
        reasons.add("expired")
    there = known(prescribed, since) and known(planned, since)
    if not there or distance(prescribed.at(since), planned.at(since)) > limits["start"]:
        reasons.add("start")
    if not follows(prescribed, planned, limits["path"]):
        reasons.add("path")
    if any(not limits["v_min"] <= v <= limits["v_max"] for v in prescribed.speeds()):
        reasons.add("speed")
    for step in steps(prescribed, planned, limits["reaction"]):
        if step > limits["acceleration"] * limits["reaction"]:
            reasons.add("acceleration")
        if step < -limits["deceleration"] * limits["reaction"]:
            reasons.add("acceleration")
    for name in ("leader", "follower"):
        if given[name] is None:
            continue
        if near(prescribed, trajectory(given[name]), since, limits[f"{name}_gap"]):
            reasons.add(f"{name}_gap")
    return {"reasons": sorted(reasons)}


# KIN-7


def success(given: Json) -> Json:
    """KIN-7: the number of sendings, and the success of a message, an exchange and a session."""
    t_timeout, t_resend = given["t_timeout"], given["t_resend"]
    loss = number(given["loss"])
    if t_timeout < 0:
        raise Refused("t_timeout", None, "must not be negative")
    if t_resend <= 0:
        raise Refused("t_resend", None, "must be above 0")
    if not 0 <= loss <= 1:
        raise Refused("loss", None, "must be from 0 to 1")
    sendings = 1 + t_timeout // t_resend
    both = (1 - loss) ** 2
    exchange = 1 - (1 - both) ** sendings
    return {
        "sendings": sendings,
        "message": 1 - loss**sendings,
        "exchange": exchange,
        "session": exchange**3,
    }


KERNELS: dict[str, Callable[[Json], Json]] = {
    "convert": convert,
    "thin": thin,
    "collide": collide,
    "discover": discover,
    "prescribe": prescribe,
    "verify": verify,
    "success": success,
}


def call(kernel: str, inputs: Json) -> Json:
    """The expected outputs of the kernel, or the error, as plain JSON."""
    try:
        return plain(KERNELS[kernel](inputs))
    except Refused as error:
        refusal: dict[str, Json] = {"name": error.name}
        if error.index is not None:
            refusal["index"] = error.index
        return {"error": refusal | {"why": error.why}}


def plain(value: Json) -> Json:
    """The value with the nearest float for each fraction."""
    if isinstance(value, Fraction):
        return float(value)
    if isinstance(value, dict):
        return {name: plain(each) for name, each in value.items()}
    if isinstance(value, list | tuple):
        return [plain(each) for each in value]
    return value
