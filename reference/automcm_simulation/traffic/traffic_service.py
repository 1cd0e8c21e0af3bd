"""The service of a station among many: received CAMs are cheap, and its log is short."""

from __future__ import annotations

from typing import Any

from automcm.service.application import Heard
from automcm.service.service import McService
from automcm_spec.vocabulary.messages import Cam, MessageError

KEPT = 1024

Shared = tuple[int, Heard]
"""When a CAM was generated, ms, and what its receivers hear at the time of ``received_ms``."""


class TrafficService(McService):
    """A service that takes a CAM which cannot count (ACT-5, ADV-9) without a step of the station.

    Such a CAM changes only the neighbours and counters.  Observers and the log leave it out: of a
    hundred stations each receives a thousand a second.  ``recent`` is shared by the services of a
    run, which hear the same CAMs.
    """

    def __init__(self, *args: Any, recent: dict[bytes, Shared], **more: Any) -> None:
        self._recent = recent
        super().__init__(*args, **more)
        self._own = self.station_id

    def receive(self, data: bytes, tx: str | None = None) -> int | None:
        """As in McService."""
        alarm, now = self._alarm, self._clock.now()
        if alarm is None or alarm[0] <= now or not self._open or self._busy or self._pending:
            return super().receive(data, tx)
        shared = self._recent.get(data)
        if shared is None or shared[1].received_ms != now:
            shared = self._share(data, now)
            if shared is None:
                return super().receive(data, tx)
        generated_ms, heard = shared
        src, state = heard.station_id, self.station.state
        counts = state.phase == "ACTUATING" and src == state.peer
        closes = state.phase == "ADVERTISING" and self._close_window is not None
        if counts or closes or src == self._own:
            return super().receive(data, tx)
        self._time = max(self._time, now)
        statistics = self.statistics
        statistics.received_bytes += len(data)
        statistics.received["CAM"] += 1
        statistics.rules["ACT-5"] += 1
        self._remember(generated_ms, heard)
        return src

    def _share(self, data: bytes, now_ms: int) -> Shared | None:
        """A CAM that arrives now, for all receivers; None for other bytes."""
        try:
            message = self._codec.decode(data)
        except MessageError:
            return None
        if type(message) is not Cam:
            return None
        if len(self._recent) >= KEPT:
            self._recent.clear()
        shared = self._recent[data] = message.generation_ms, Heard.of(message, now_ms)
        return shared
