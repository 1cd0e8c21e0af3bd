"""The service of a station among many: received CAMs are cheap, and its log is short."""

from __future__ import annotations

from typing import Any

from automcm.service.application import Heard
from automcm.service.service import McService
from automcm_spec.vocabulary.messages import Cam, MessageError

KEPT = 1024


class TrafficService(McService):
    """A service that takes a CAM which cannot count (ACT-5) without a step of the station.

    Such a CAM changes only the neighbours and counters.  Observers and the log leave it out: of a
    hundred stations each receives a thousand a second.  ``recent`` is shared by the services of a
    run, which hear the same CAMs.
    """

    def __init__(
        self, *args: Any, recent: dict[tuple[int, int, int, bool], Heard], **more: Any
    ) -> None:
        self._recent = recent
        super().__init__(*args, **more)
        self._own = self.station_id

    def receive(self, data: bytes, tx: str | None = None) -> int | None:
        """As in McService."""
        alarm = self._alarm
        if alarm is None or not self._open or self._busy or self._pending:
            return super().receive(data, tx)
        try:
            message = self._codec.decode(data)
        except MessageError:
            return super().receive(data, tx)
        now = self._clock.now()
        if type(message) is not Cam or alarm[0] <= now:
            return super().receive(data, tx)
        src, state = message.src, self.station.state
        if (state.phase == "ACTUATING" and src == state.peer) or src == self._own:
            return super().receive(data, tx)
        self._time = max(self._time, now)
        statistics = self.statistics
        statistics.received_bytes += len(data)
        statistics.received["CAM"] += 1
        statistics.rules["ACT-5"] += 1
        self._hear(message, now)
        return src

    def _heard(self, cam: Cam, now_ms: int, in_step: bool) -> Heard:
        key = cam.src, cam.generation_ms, now_ms, in_step
        heard = self._recent.get(key)
        if heard is None:
            if len(self._recent) >= KEPT:
                self._recent.clear()
            heard = self._recent[key] = super()._heard(cam, now_ms, in_step)
        return heard
