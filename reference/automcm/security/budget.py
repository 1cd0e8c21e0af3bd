"""A number of verifications, or of other work, per second, shared by rank."""

from __future__ import annotations

from collections.abc import Callable
from typing import Literal

Rank = Literal[0, 1, 2]
"""0: the peer of the own session; 1: a station nearby; 2: any other."""
Ranking = Callable[[tuple[int, ...]], Rank]
"""The best rank of these station ids."""

PER_SECOND = 1000
"""By default: as 100 vehicles at 10 Hz."""
_RESERVED = (0.0, 0.25, 0.5)
"""The part of the budget of one second that a rank leaves to those before it."""


class Budget:
    """At most ``per_second`` in a second on average.

    What is unused accumulates for up to one second.  A flood of one rank therefore leaves half of a
    second's budget to the peer and a quarter to stations nearby.
    """

    def __init__(self, per_second: int = PER_SECOND) -> None:
        self._per_second = per_second
        self._left = per_second * 1000
        """In thousandths."""
        self._at_ms = 0

    def spend(self, rank: Rank, now_ms: int) -> bool:
        """Whether one more is within the budget; if so, it counts."""
        full = self._per_second * 1000
        elapsed = max(0, now_ms - self._at_ms)
        self._left = min(full, self._left + elapsed * self._per_second)
        self._at_ms = max(self._at_ms, now_ms)
        if self._left < max(1000, full * _RESERVED[rank]):
            return False
        self._left -= 1000
        return True
