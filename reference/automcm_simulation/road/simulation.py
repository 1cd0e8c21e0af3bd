"""Several services on a simulated radio, in virtual time.  The same seed gives the same bytes."""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

from automcm.encoding.codec import JSON, Codec
from automcm.links.clock import OffsetClock, VirtualClock
from automcm.links.link import Link
from automcm.links.simulated_radio import Channel, Radio
from automcm.service.application import Application
from automcm.service.event_log import open_log
from automcm.service.service import McService, Observer
from automcm_simulation.road.straight_lane import LANE_CHANGE
from automcm_spec.support import files
from automcm_spec.vocabulary.application import Command
from automcm_spec.vocabulary.parameters import Parameters


@contextmanager
def unwarned() -> Iterator[None]:
    """Without the services' warnings, for faults that are drawn on purpose."""
    logger = logging.getLogger("automcm.service")
    before = logger.level
    logger.setLevel(logging.ERROR)
    try:
        yield
    finally:
        logger.setLevel(before)


class Simulation:
    """Services, their applications and the radio between them; each can write a log.

    ``service`` makes each service, for experiments that disable a rule.
    """

    def __init__(
        self,
        *,
        seed: int = 0,
        channel: Channel | None = None,
        logs: Path | None = None,
        service: Callable[..., McService] = McService,
    ) -> None:
        self.clock = VirtualClock()
        self.radio = Radio(self.clock, channel, seed)
        self.services: dict[int, McService] = {}
        self._seed, self._logs, self._service = seed, logs, service
        self._stack = ExitStack()
        if logs is not None:
            files.folder(logs, named=True)

    def add(
        self,
        station_id: int,
        application: Application,
        parameters: Parameters | None = None,
        *,
        observers: tuple[Observer, ...] = (),
        codec: Codec = JSON,
        offset_ms: int = 0,
    ) -> McService:
        """Add a station, which sends CAMs from now on.  Its clock is ``offset_ms`` ahead, at least
        0.  Raises ValueError for a used id."""
        link = self.link(station_id)
        parameters = parameters or Parameters()
        log = None
        if self._logs is not None:
            path = self._logs / f"{station_id}.ndjson"
            files.refuse_links(path)
            log = self._stack.enter_context(
                open_log(
                    path,
                    station_id,
                    parameters,
                    run=f"seed-{self._seed}",
                )
            )
        service = self._service(
            station_id,
            application,
            link,
            OffsetClock(self.clock, offset_ms) if offset_ms else self.clock,
            parameters=parameters,
            seed=self._seed * 1000 + station_id,
            codec=codec,
            log=log,
            observers=(*observers, *self.watching(station_id)),
        )
        self.services[station_id] = service
        service.start()
        return service

    def link(self, station_id: int) -> Link:
        """The link of a new station; subclasses can wrap it."""
        return self.radio.link(station_id)

    def watching(self, station_id: int) -> tuple[Observer, ...]:
        """The observers of every station; subclasses can add some."""
        return ()

    def command(self, station_id: int, command: Command, at: int) -> None:
        """Give a command at this time in ms."""
        self.clock.at(at, lambda: self.services[station_id].command(command))

    def request(self, station_id: int, at: int) -> None:
        """Request a lane change at this time in ms."""
        self.command(station_id, LANE_CHANGE, at)

    def restart(self, station_id: int, at: int) -> None:
        """Restart a station at this time in ms (END-8)."""
        self.clock.at(at, lambda: self.services[station_id].restart())

    def run(self, until: int) -> None:
        """Run to this time in ms, and end the logs."""
        with self._stack:
            self.clock.run(until)
