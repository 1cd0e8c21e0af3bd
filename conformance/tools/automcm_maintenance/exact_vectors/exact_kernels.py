"""A second, independent implementation of the kernels (KIN-1 to KIN-7, APP-6): slow and exact.

The expected outputs of the test vectors are computed here, never by the kernels under test.
"""

from __future__ import annotations

from collections.abc import Callable
from fractions import Fraction
from itertools import pairwise
from typing import Any

from automcm_maintenance.exact_vectors.exact_geometry import (
    Place,
    Refused,
    Trajectory,
    between,
    closest,
    common,
    distance,
    dot,
    first_below,
    minus,
    number,
    place,
    root,
    trajectory,
)

Json = Any
ORIGIN = (Fraction(0), Fraction(0))


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


def allowed(drive: Trajectory, begin: int, end: int, position: Fraction, speed: Fraction) -> bool:
    """Whether straight and even motion between two samples keeps the bounds."""
    a, b = drive.xy[begin], drive.xy[end]
    span = drive.t[end] - drive.t[begin]
    even = distance(a, b) / span
    for n in range(begin, end):
        here = between(a, b, (drive.t[n] - drive.t[begin]) / span)
        v = distance(drive.xy[n], drive.xy[n + 1]) / (drive.t[n + 1] - drive.t[n])
        if abs(v - even) > speed:
            return False
        if dot(minus(drive.xy[n], here), minus(drive.xy[n], here)) > position**2:
            return False
    return True


def fewest(drive: Trajectory, position: Fraction, speed: Fraction) -> list[int]:
    """The fewest samples, with the first and the last, that keep the bounds."""
    ways = [[0]]
    for end in range(1, len(drive.t)):
        shortest_first = sorted(range(end), key=lambda n: len(ways[n]))
        n = next(n for n in shortest_first if allowed(drive, n, end, position, speed))
        ways.append([*ways[n], end])
    return ways[-1]


def thin(given: Json) -> Json:
    """KIN-2.  The bounds are required if twice the fewest samples fit, or all."""
    drive = trajectory(given)
    position, speed = number(given["position"]), number(given["speed"])
    overhead, each = given["size"]["overhead"], given["size"]["per_point"]
    for name, bound in (("position", position), ("speed", speed)):
        if bound <= 0:
            raise Refused(name, None, "must be above 0")
    most = (given["budget"] - overhead) // each
    if most < min(len(drive.t), 2):
        raise Refused("budget", None, "must have room for the first and the last point")
    kept = fewest(drive, position, speed)
    enough = 2 * len(kept)
    required = min(enough, len(drive.t)) <= most
    loose = position, speed
    while len(kept) > most:
        loose = 2 * loose[0], 2 * loose[1]
        kept = fewest(drive, *loose)
    return {
        "kept": kept,
        "at_most": min(most, enough),
        "position": position if required else None,
        "speed": speed if required else None,
    }


# KIN-3


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


Discs = tuple[list[Fraction], Fraction, Fraction]
"""Discs on the axis of a vehicle: their offsets ahead of its middle, their radius, the error."""


def cover(drive: Trajectory, extent: Json) -> Discs:
    """So many discs that no part of the length is longer than wide; one if it never moves."""
    length, width = number(extent["length"]), number(extent["width"])
    for name, size in (("length", length), ("width", width)):
        if size <= 0:
            raise Refused(name, None, "must be above 0")
    if all(xy == drive.xy[0] for xy in drive.xy):
        radius = root(length**2 + width**2) / 2
        return [Fraction(0)], radius, radius - min(length, width) / 2
    count = -(-length // width)
    half, side = length / count / 2, width / 2
    radius = root(half**2 + side**2)
    return [half * (2 * n + 1 - count) for n in range(count)], radius, radius - min(half, side)


def heading(drive: Trajectory, since: Fraction) -> Place:
    """The direction from this time on; of a standing vehicle the last one, or else the next."""
    now = min(sum(t <= since for t in drive.t), len(drive.t) - 1) - 1
    for n in [*range(now, -1, -1), *range(max(now, 0), len(drive.t) - 1)]:
        length = distance(drive.xy[n], drive.xy[n + 1])
        if length > 0:
            return between(ORIGIN, minus(drive.xy[n + 1], drive.xy[n]), 1 / length)
    return ORIGIN


def extents(given: Json) -> Json:
    """KIN-3 for vehicles with a length and a width: the least clearance, and when it falls below
    the margin."""
    a, b = trajectory(given["a"]), trajectory(given["b"])
    margin = number(given["margin"])
    if margin < 0:
        raise Refused("margin", None, "must not be negative")
    discs_a, discs_b = cover(a, given["extent_a"]), cover(b, given["extent_b"])
    radii = discs_a[1] + discs_b[1]
    best, since = None, None
    grid = common(a, b)
    for begin, end in pairwise(grid if len(grid) > 1 else grid * 2):
        ahead_a, ahead_b = heading(a, begin), heading(b, begin)
        falls = []
        for p in discs_a[0]:
            for q in discs_b[0]:
                off = minus(between(ORIGIN, ahead_b, q), between(ORIGIN, ahead_a, p))
                ends = [minus(minus(a.at(t), b.at(t)), off) for t in (begin, end)]
                t = [begin, end] if begin < end else [begin]
                moving = Trajectory(t, ends[: len(t)], True)
                origin = Trajectory([begin], [ORIGIN], True)
                found = closest(moving, origin)
                if found and (best is None or (found[1], found[0]) < (best[1], best[0])):
                    best = found
                first = first_below(moving, origin, margin + radii)
                falls += [] if first is None else [first]
        if since is None and falls:
            since = min(falls)
    return {
        "error_a": discs_a[2],
        "error_b": discs_b[2],
        "clearance": best and {"time": best[0], "distance": root(best[1]) - radii},
        "since": since,
    }


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


def known(drive: Trajectory, when: Fraction) -> bool:
    """Whether the place of the vehicle is known at that time."""
    return drive.t[0] <= when and (drive.end is None or when <= drive.end)


def follows(prescribed: Trajectory, planned: Trajectory, limit: Fraction) -> bool:
    """Whether it and the part of the planned path that it covers are never more than ``limit``
    apart, and it never goes back by more than that.

    Between the samples of either both are straight, so that the distance is greatest at one.
    """
    arc = [Fraction(0)]
    for a, b in pairwise(planned.xy):
        arc.append(arc[-1] + distance(a, b))
    feet: list[Fraction] = []
    for n, here in enumerate(prescribed.xy):
        corner, foot = projection(planned.xy, here)
        if distance(here, foot) > limit:
            return False
        feet.append(arc[corner] + distance(planned.xy[corner], foot))
        if feet[n] < max(feet) - limit:
            return False
        part = prescribed.xy[n - 1 : n + 1]
        passed = [xy for w, xy in zip(arc, planned.xy, strict=True) if feet[n - 1] < w < feet[n]]
        if any(distance(xy, projection(part, xy)[1]) > limit for xy in passed):
            return False
    return True


TURN = Fraction(1)
"""The time between the three positions that tell the lateral acceleration, s."""


def lateral(drive: Trajectory) -> list[Fraction]:
    """The accelerations to the side around each sample, where the positions are known."""
    found = []
    for when in {t + by for t in drive.t for by in (-TURN, 0, TURN)}:
        if when - TURN < drive.t[0] or (drive.end is not None and when + TURN > drive.end):
            continue
        a, b, c = drive.at(when - TURN), drive.at(when), drive.at(when + TURN)
        along, bend = minus(c, a), minus(minus(c, b), minus(b, a))
        across = abs(along[0] * bend[1] - along[1] * bend[0])
        if across:
            found.append(across / distance(a, c) / TURN**2)
    return found


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
    if not follows(prescribed, planned, limits["path"] + limits["position_error"]):
        reasons.add("path")
    slowest, fastest = (
        limits["v_min"] - limits["speed_error"],
        limits["v_max"] + limits["speed_error"],
    )
    if any(not slowest <= v <= fastest for v in prescribed.speeds()):
        reasons.add("speed")
    for step in steps(prescribed, planned, limits["reaction"]):
        if step > limits["acceleration"] * limits["reaction"] + 2 * limits["speed_error"]:
            reasons.add("acceleration")
        if step < -limits["deceleration"] * limits["reaction"] - 2 * limits["speed_error"]:
            reasons.add("acceleration")
    if any(each > limits["lateral"] for each in lateral(prescribed)):
        reasons.add("lateral")
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


# APP-6, in integers


def clock(given: Json) -> Json:
    """APP-6: by how many ms the clock of the sender of these CAMs is ahead, and is it in step?"""
    now, delay, drift = given["now"], given["delay"], given["drift"]
    cams = given["cams"]
    least: int | None = None
    greatest: int | None = None
    for generated, received in cams:
        age = now - received
        if age <= 2000:
            low = generated - received - rounded_up(age * drift)
            least = low if least is None else max(least, low)
    if least is None:
        raise Refused("cams", None, "must have one of the last 2 s")
    for generated, received in cams:
        age = now - received
        high = generated - received + delay + rounded_up(age * drift)
        late = high < least
        if age <= 2000 and not late:
            greatest = high if greatest is None else min(greatest, high)
    assert greatest is not None
    in_step = least <= 100 and greatest >= -100
    return {"least": least, "greatest": greatest, "in_step": in_step}


def rounded_up(hundredths: int) -> int:
    """The least integer that is not below a number of hundredths."""
    return (hundredths + 99) // 100


KERNELS: dict[str, Callable[[Json], Json]] = {
    "convert": convert,
    "thin": thin,
    "collide": collide,
    "extents": extents,
    "discover": discover,
    "prescribe": prescribe,
    "verify": verify,
    "success": success,
    "clock": clock,
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
