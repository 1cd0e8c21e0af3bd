"""How far another station's clock is ahead of the own one, from its CAMs (APP-6).

A CAM generated at g on its sender's clock and received at r on the own one was on its way for 0 to
``delay`` ms, so the sender's clock is ahead by g - r to g - r + delay.  This holds for each CAM of
the last seconds; the bounds of an older one are wider by what the clocks may have drifted since.

No CAM arrives before it is sent, but one may be late.  So of two CAMs that contradict each other,
the one with the lower bounds was late and does not count.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable
from logging import getLogger

from automcm_spec.vocabulary.parameters import CLOCK_MS, Known, longest_delay

WINDOW_MS = 2000
"""CAMs received earlier do not count any more."""

Bounds = tuple[int, int]
"""The least and the greatest offset in ms."""

CAMS = 32
"""Maximum number of CAMs kept of each station."""
OutOfStep = Callable[[int, Bounds], None]
"""Called with a station and the bounds on the offset of its clock."""
_logger = getLogger(__name__)


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


class ClockOffsets:
    """The CAMs of the last seconds of each station, until ``forget``.

    ``out_of_step`` is called once for each station whose clock is out of step, and for at most
    ``most``.  ``me`` is named in the log.
    """

    def __init__(self, me: int, most: int, p: Known, out_of_step: OutOfStep) -> None:
        self._me, self._most = me, most
        self._delay_ms, self._drift = longest_delay(p), p["clock_drift"]
        self._out_of_step = out_of_step
        self._cams: dict[int, deque[tuple[int, int]]] = {}
        self._off_ms: dict[int, int] = {}
        """When each of these stations last sent a CAM that alone leaves it in doubt."""
        self.reported: set[int] = set()
        """At most ``most`` stations that were out of step."""

    def heard(self, station_id: int, generated_ms: int, now_ms: int) -> bool:
        """Note a CAM received now.  Returns whether the clock of its sender may be in step."""
        cams = self._cams.get(station_id)
        if cams is None:
            cams = self._cams[station_id] = deque(maxlen=CAMS)
        cams.append((generated_ms, now_ms))
        # If each CAM of the window alone is in step, so are their common bounds.
        ahead = generated_ms - now_ms
        if not in_step((ahead, ahead + self._delay_ms)):
            self._off_ms[station_id] = now_ms
        elif station_id not in self._off_ms or now_ms - self._off_ms[station_id] > WINDOW_MS:
            return True
        found = bounds(cams, now_ms, self._delay_ms, self._drift)
        if in_step(found):
            return True
        if station_id not in self.reported and len(self.reported) < self._most:
            self.reported.add(station_id)
            _logger.warning(
                "%s: the clock of station %s is %d to %d ms ahead; it counts as one that did not "
                "answer (APP-6)",
                *(self._me, station_id, *found),
            )
            self._out_of_step(station_id, found)
        return False

    def forget(self, station_id: int) -> None:
        """Forget the CAMs of a station."""
        self._cams.pop(station_id, None)
        self._off_ms.pop(station_id, None)
