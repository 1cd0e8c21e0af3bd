"""The CAMs of the last seconds of each station, and whether its clock is in step (APP-6)."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from logging import getLogger

from automcm.links.clock_bounds import WINDOW_MS, Bounds, bounds, in_step
from automcm_spec.vocabulary.parameters import Known, longest_delay

CAMS = 32
"""Maximum number of CAMs kept of each station."""
OutOfStep = Callable[[int, Bounds], None]
"""Called with a station and the bounds on the offset of its clock."""


_logger = getLogger(__name__)


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
