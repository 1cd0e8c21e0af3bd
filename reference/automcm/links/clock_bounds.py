"""How far another station's clock is ahead of the own one, from its CAMs (APP-6).

A CAM generated at g on its sender's clock and received at r on the own one was on its way for 0 to
``delay`` ms, so the sender's clock is ahead by g - r to g - r + delay.  This holds for each CAM of
the last seconds; the bounds of an older one are wider by what the clocks may have drifted since.

No CAM arrives before it is sent, but one may be late.  So of two CAMs that contradict each other,
the one with the lower bounds was late and does not count.
"""

from __future__ import annotations

from collections.abc import Iterable

from automcm_spec.vocabulary.parameters import CLOCK_MS

WINDOW_MS = 2000
"""CAMs received earlier do not count any more."""

Bounds = tuple[int, int]
"""The least and the greatest offset in ms."""


def bounds(cams: Iterable[tuple[int, int]], now_ms: int, delay_ms: int, drift: int) -> Bounds:
    """The bounds from these CAMs: when each was generated and received, in ms.

    ``drift`` is the largest difference in rate between two clocks, in percent.  Raises ValueError
    if no CAM is of the last seconds.
    """
    each = [
        (generated - received - wider, generated - received + delay_ms + wider)
        for generated, received in cams
        if now_ms - received <= WINDOW_MS
        for wider in [-((received - now_ms) * drift // 100)]
    ]
    if not each:
        raise ValueError("none of the last seconds")
    low = max(least for least, _ in each)
    return low, min(most for _, most in each if most >= low)


def in_step(found: Bounds) -> bool:
    """Whether the clocks may be in step."""
    low, high = found
    return low <= CLOCK_MS and high >= -CLOCK_MS
