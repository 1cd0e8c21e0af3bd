"""Leaves out of something what its problem does not need: the search that all shorteners share."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeVar

Found = TypeVar("Found")


def with_fewer_parts(
    found: Found,
    number_of: Callable[[Found], int],
    without: Callable[[Found, int, int], Found | None],
) -> Found:
    """Leave out runs of consecutive parts, long runs first.

    ``without(found, at, size)`` leaves out the parts from ``at`` to before ``at + size``. It
    returns None if that has not the same problem, or if there are no more tries.
    """
    size = max(1, number_of(found) // 2)
    while size > 0:
        at = 0
        while at < number_of(found):
            shorter = without(found, at, size)
            if shorter is None:
                at += size
            else:
                found = shorter
        size //= 2
    return found
