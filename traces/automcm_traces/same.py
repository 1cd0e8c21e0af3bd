"""Whether two values of JSON are the same."""

from __future__ import annotations

from typing import Any

Json = Any


def same(one: Json, other: Json) -> bool:
    """Equal, and of the same types: 1 is neither 1.0 nor true."""
    if type(one) is not type(other):
        return False
    if type(one) is dict:
        return one.keys() == other.keys() and all(same(v, other[k]) for k, v in one.items())
    if type(one) is list:
        return len(one) == len(other) and all(map(same, one, other))
    return bool(one == other)
