"""One station as a process of its own: a service on a UDP link, and what it reports."""

from __future__ import annotations

import asyncio
import signal
from collections.abc import Callable
from contextlib import ExitStack, suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from automcm import logging
from automcm.application import Application
from automcm.clock import AsyncioClock
from automcm.codec import Codec
from automcm.interface import Command
from automcm.links import LinkError
from automcm.links.udp import UdpLink
from automcm.messages import MessageError
from automcm.outcome import Expiry, Heard
from automcm.parameters import Parameters
from automcm.service import McService
from automcm.state import State
from automcm.station import Effects
from automcm_traces.writer import LogWriter

Report = Callable[[dict[str, Any]], None]
"""Takes one event, as JSON values."""


class NumberError(Exception):
    """The file that keeps the session number cannot be used; the text names it."""


@dataclass(frozen=True)
class NumberFile:
    """Keeps the last session number over a restart (END-8), in a file."""

    path: Path

    def last(self) -> int | None:
        """None if the station never ran before.  Raises NumberError for anything else."""
        try:
            text = self.path.read_text()
        except FileNotFoundError:
            return None
        except (OSError, UnicodeDecodeError) as error:
            raise NumberError(f"{self.path}: {error}") from None
        if not text.strip().isdecimal():
            raise NumberError(f"{self.path}: holds no session number")
        return int(text)

    def keep(self, number: int) -> None:
        """Raises NumberError: without it, the number must not go on the air."""
        new = self.path.with_name(self.path.name + ".new")
        try:
            new.write_text(f"{number}\n")
            new.replace(self.path)
        except OSError as error:
            raise NumberError(f"{self.path}: {error.strerror}") from None


@dataclass(kw_only=True)
class StationProcess:
    """What ``run`` needs.  ``commands`` are given at the start, each after so many ms."""

    station_id: int
    application: Application
    link: Callable[[], UdpLink]
    codec: Codec
    parameters: Parameters
    report: Report
    log: Path | None = None
    run_name: str = "live"
    number_file: NumberFile | None = None
    commands: list[tuple[int, Command]] = field(default_factory=list)
    listen_ms: int = 1100
    """How long to listen for another station of the same id before the start; a CAM comes at
    least every 1000 ms."""
    for_ms: int | None = None
    zero: float = 0.0
    """What counts as 0 ms on the host's monotonic clock, in s."""

    async def run(self) -> None:
        """Until it is told to stop (SIGTERM, SIGINT) or ``for_ms`` are over.

        Raises LinkError, NumberError, or OSError for a log that cannot be written.
        """
        await _free(self.link, self.codec, self.station_id, self.listen_ms)
        last = self.number_file.last() if self.number_file else None
        with ExitStack() as stack:
            service = McService(
                self.station_id,
                self.application,
                self.link(),
                AsyncioClock(self.zero),
                parameters=self.parameters,
                number=last or 0,
                keep_number=self._keep if self.number_file else lambda number: None,
                seed=self.station_id,
                codec=self.codec,
                log=self._log(stack),
                observers=(self._observe,),
            )
            stack.callback(lambda: self._report(service, event="end", **_statistics(service)))
            stack.callback(service.close)
            self._service = service
            service.start()
            if last is not None:
                service.restart()
            self._report(service, event="start", session_number=last or 0)
            for after_ms, command in self.commands:
                service.command(command, max(after_ms, 1))
            await until_stopped(self.for_ms)

    def _keep(self, number: int) -> None:
        assert self.number_file is not None
        self.number_file.keep(number)

    def _log(self, stack: ExitStack) -> LogWriter | None:
        if self.log is None:
            return None
        return stack.enter_context(
            LogWriter(
                self.log,
                run=self.run_name,
                station=self.station_id,
                implementation="automcm",
                version="0.1.0",
                parameters=logging.parameters(self.parameters),
                complete=logging.COMPLETE,
            )
        )

    def _observe(self, before: State, effects: Effects) -> None:
        """Report messages, changes of phase and what the application is told."""
        service = self._service
        if isinstance(effects.input, Heard):
            m = effects.input.message
            self._report(service, event="received", type=m.type, src=m.src, rule=effects.rule)
        for message in effects.messages:
            more = {"reason": message.reason} if message.type in ("Acceptance", "Cancel") else {}
            self._report(service, event="sent", type=message.type, dst=message.dst, **more)
        if (before.phase, before.role) != (effects.state.phase, effects.state.role):
            self._report(service, event="phase", rule=effects.rule)
        if isinstance(effects.input, Expiry) and effects.input.timer.name == "giveup":
            self._report(service, event="given_up", rule=effects.rule)
        for told in effects.indications:
            if told.name != "discarded":
                self._report(service, event="told", name=told.name, reason=told.reason)

    def _report(self, service: McService, **fields: Any) -> None:
        st = service.state
        self.report(
            {"t_ms": service.now(), "station": self.station_id}
            | fields
            | {"phase": st.phase, "role": st.role, "session": st.session and list(st.session)}
            | {"sending": len(st.outbox)}
        )


def _statistics(service: McService) -> dict[str, Any]:
    return {"statistics": service.statistics.as_dict()}


async def _free(link: Callable[[], UdpLink], codec: Codec, station_id: int, ms: int) -> None:
    """Listen.  Raises LinkError if a station with this id is on the air already."""
    if ms <= 0:
        return
    taken = False

    def look(data: bytes, tx: str | None) -> None:
        nonlocal taken
        with suppress(MessageError):
            taken = taken or codec.decode(data).src == station_id

    listening = link()
    listening.open(look)
    try:
        await asyncio.sleep(ms / 1000)
    finally:
        listening.close()
    if taken:
        raise LinkError(f"station_id: {station_id} is on the air already")


async def until_stopped(for_ms: int | None = None) -> None:
    """Wait for SIGTERM, SIGINT or ``for_ms``.  An exception in the event loop ends the wait and
    is raised."""
    loop = asyncio.get_running_loop()
    over: asyncio.Future[None] = loop.create_future()

    def failed(loop: asyncio.AbstractEventLoop, context: dict[str, Any]) -> None:
        if not over.done():
            over.set_exception(context.get("exception") or RuntimeError(context["message"]))

    def stop() -> None:
        if not over.done():
            over.set_result(None)

    loop.set_exception_handler(failed)
    for signum in (signal.SIGTERM, signal.SIGINT):
        loop.add_signal_handler(signum, stop)
    if for_ms is not None:
        loop.call_later(for_ms / 1000, stop)
    await over
