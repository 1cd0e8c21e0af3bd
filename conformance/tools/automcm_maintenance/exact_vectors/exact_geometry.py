"""Exact numbers, places, trajectories and their closest approach for exact_kernels: slow, and
independent of the reference.

All numbers are fractions; an input has exactly its decimal value.  A square root is exact if it is
rational, and otherwise truncated after 60 decimals.
"""

from __future__ import annotations

from collections.abc import Sequence
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
