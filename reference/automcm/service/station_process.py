"""One station as a process: a service on a UDP link, with reports of its events."""

from __future__ import annotations

import asyncio
import re
import signal
from collections.abc import Callable, Iterator
from contextlib import (
    AbstractAsyncContextManager,
    AsyncExitStack,
    contextmanager,
    nullcontext,
    suppress,
)
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from automcm.core.outcome import Expiry, Received
from automcm.core.state import QUARANTINE, State
from automcm.core.station import Effects
from automcm.encoding.codec import Codec
from automcm.links.clock import SLEW, AsyncioClock
from automcm.links.link import Link, LinkError
from automcm.links.udp_link import UdpLink
from automcm.service.application import Application, CloseWindow
from automcm.service.datagram_log import Both
from automcm.service.event_log import open_log
from automcm.service.line_output import LineOutput, create
from automcm.service.service import McService
from automcm_spec.log_format.writer import LogWriter, Sink
from automcm_spec.support import files
from automcm_spec.vocabulary.application import Command, Refused
from automcm_spec.vocabulary.messages import LIMIT, MessageError
from automcm_spec.vocabulary.parameters import Parameters

if TYPE_CHECKING:
    from automcm.service.station_keys import StationKeys

Report = Callable[[dict[str, Any]], None]
"""Takes one event, as JSON values."""
STOP_MS = 1000
"""How long a stopping station waits, at most, for the Ack of its Cancel."""
FINISH_S = 0.5
"""How long to wait at the end for a log that is written slowly."""
_SIGNED = re.compile(rb"\x84.{1,3}\xa2\x01\x26", re.DOTALL)
"""The beginning of an envelope (``automcm.security.envelope``, which needs an extra)."""


class NumberError(Exception):
    """The file with the session number cannot be used; the text names the file."""


@dataclass(frozen=True)
class NumberFile:
    """Stores the last session number in a file, so that it survives a restart (END-8).

    If the file exists, the station ran before.
    """

    path: Path

    def last(self) -> int | None:
        """The stored number, or None if there is no file.  Raises NumberError for a bad file."""
        try:
            with self.path.open() as file:
                text = file.read(100).strip()
        except FileNotFoundError:
            return None
        except (OSError, UnicodeDecodeError) as error:
            raise NumberError(f"{self.path}: {error}") from None
        if not (text.isascii() and text.isdecimal() and int(text) < LIMIT):
            raise NumberError(f"{self.path}: expected a session number below {LIMIT}")
        return int(text)

    def keep(self, number: int) -> None:
        """Store a number.  Raises NumberError; the number must then not be sent."""
        try:
            files.write(self.path, f"{number}\n", named=True, durable=True)
        except OSError as error:
            raise NumberError(f"{self.path}: {error.strerror}") from None


@dataclass(kw_only=True)
class StationProcess:
    """A station and its settings.  ``commands`` are (delay in ms after the start, command)."""

    station_id: int
    application: Application
    link: Callable[[], UdpLink]
    codec: Codec
    parameters: Parameters
    report: Report
    log: Path | None = None
    log_to: Sink | None = None
    """Where the log is sent, besides the file or instead of it."""
    name: str = ""  # in the log
    number_file: NumberFile | None = None
    number: int = 0
    """Without a number file: the last session number that it may have used before."""
    restarted: bool = False
    """Without a number file: whether it may have run before (END-8)."""
    commands: list[tuple[int, Command]] = field(default_factory=list)
    serving: AbstractAsyncContextManager[Any] = field(default_factory=nullcontext)
    """Open while the station runs, such as the WebSocket server of a bridge with its ``port``."""
    listen_ms: int = 1100
    """How long to listen for another station with the same id before the start, in ms; a CAM comes
    at least every 1000 ms."""
    for_ms: int | None = None
    close_window: CloseWindow | None = None
    """As in ``McService`` (ADV-9)."""
    zero: float | None = None
    """The time of the host's monotonic clock, in s, that counts as 0 ms, instead of UNIX time."""
    keys: StationKeys | None = None
    """With them, it signs its messages and only takes signed ones (docs/secured.md)."""
    complain: Callable[[str], None] = lambda text: None
    """Takes a line about lost records, keys or unsigned messages while the station runs; also from
    another thread."""
    _idle: asyncio.Future[None] | None = field(default=None, init=False)
    """Done when a stopping station has no message left to send."""

    async def run(self) -> None:
        """Run until a signal (SIGTERM, SIGINT, SIGHUP), the end of ``for_ms``, or an exception.

        Then leave the session with a Cancel (END-1) and end, at the latest ``STOP_MS`` later, or at
        once on a second signal.

        Raises LinkError, NumberError, OSError for a log that cannot be created or has lost records,
        and exceptions of the application.
        """
        over, at_once = stopping(None), asyncio.get_running_loop().create_future()
        number, restarted = self._before()
        async with AsyncExitStack() as stack:
            udp, clock = self.link(), AsyncioClock(self.zero, self._stepped)
            stack.callback(udp.close)
            link: Link = udp if self.keys is None else self.keys.link(udp, clock)
            await _free(link, self.codec, self.station_id, self.listen_ms, over)
            service = McService(
                self.station_id,
                self.application,
                link,
                clock,
                parameters=self.parameters,
                number=number,
                keep_number=self.number_file.keep if self.number_file else lambda number: None,
                seed=self.station_id,
                codec=self.codec,
                observers=(self._observe,),
                out_of_step=self._out_of_step,
                close_window=self.close_window,
            )
            self._service = service
            udp.unread = partial(self._unread, udp)
            if self.keys is not None:
                self.keys.attach(service, self.complain, partial(self._report, service))
            await stack.enter_async_context(self.serving)
            log = stack.enter_context(self._logging(service))
            stack.callback(self._end, service, udp)
            stack.callback(service.close)
            service.start()
            if restarted:
                service.restart()
            about = {"session_number": number, "bridge": getattr(self.serving, "port", None)}
            about |= {} if self.keys is None else self.keys.about()
            self._report(service, event="start", log=log and str(log), **about)
            for after_ms, command in self.commands:
                service.command(command, max(after_ms, 1))
            if self.for_ms is not None:
                asyncio.get_running_loop().call_later(self.for_ms / 1000, _end, over)
            try:
                await over
            finally:
                on_signals(_end, at_once)
                await self._leave(service, at_once)

    async def _leave(self, service: McService, at_once: asyncio.Future[None]) -> None:
        """END-1, then wait until no message is left to send, or until the time limit.

        The loop continues after an exception, so that the peer still gets the Cancel.
        """
        with suppress(Exception):
            service.stop()
        if service.state.outbox:
            self._idle = asyncio.get_running_loop().create_future()
            await asyncio.wait(
                {self._idle, at_once},
                timeout=STOP_MS / 1000,
                return_when=asyncio.FIRST_COMPLETED,
            )

    def _before(self) -> tuple[int, bool]:
        """The last number used, and whether the station ran before; marks it as having run."""
        if self.number_file is None:
            return self.number, self.restarted
        last = self.number_file.last()
        self.number_file.keep(last or 0)
        return last or 0, last is not None

    def _out_of_step(self, station_id: int, offset_ms: tuple[int, int]) -> None:
        about = {"src": station_id, "offset_ms": list(offset_ms)}
        self._report(self._service, event="out_of_step", **about)

    def _unread(self, udp: UdpLink, data: bytes) -> None:
        """Report once if only one of this station and another one signs its messages.

        Nobody vouches for these bytes, so they are not decoded.
        """
        if bool(_SIGNED.match(data)) is (self.keys is not None):
            return
        self.complain(
            "receives signed messages, which it cannot read; give it keys with --keys"
            if self.keys is None
            else "discards messages that are not signed; give their sender keys with --keys"
        )
        udp.unread = lambda data: None

    def _stepped(self, ms: int) -> None:
        self.complain(
            f"the host's clock has stepped by {ms} ms; the station follows it by at most "
            f"{SLEW * 1000:.0f} ms per second, and sends wrong times until then"
        )

    def _end(self, service: McService, link: UdpLink) -> None:
        statistics = service.statistics.as_dict()
        self._report(service, event="end", statistics=statistics, unsent=link.unsent)

    @contextmanager
    def _logging(self, service: McService) -> Iterator[Path | None]:
        """Write the log, if one is requested; yields its path.

        Records that cannot be written appear in the log as a gap of ``seq`` and in its end record.
        """
        if self.log is None:
            with nullcontext() if self.log_to is None else self._writer(self.log_to) as sent:
                if sent is not None:
                    service.log_to(sent)
                yield None
            return
        fd, path = create(self.log)

        def trouble(why: str) -> None:
            self.complain(f"{path}: {why}; current log records are lost, the station continues")

        output = LineOutput(fd, owned=True, trouble=trouble)
        log = self._writer(output if self.log_to is None else Both(output, self.log_to))
        output.drain(FINISH_S)
        if output.lost:  # without its header, a log cannot be read
            output.finish(FINISH_S)
            if path.is_file():
                path.unlink()
            raise OSError(f"{path}: the log cannot be written")
        service.log_to(log)
        reason = "crash"
        try:
            yield path
            reason = "clean"
        finally:
            output.drain(FINISH_S)
            log.end(reason, output.lost)
            output.finish(FINISH_S)
        if output.lost:
            raise OSError(f"{path}: {output.lost} log records were lost")

    def _writer(self, sink: Sink) -> LogWriter:
        return open_log(sink, self.station_id, self.parameters, run="live", name=self.name)

    def _observe(self, before: State, effects: Effects) -> None:
        """Report messages, changes of phase and indications."""
        service = self._service
        if isinstance(effects.input, Received):
            m = effects.input.message
            self._report(service, event="received", type=m.type, src=m.src, rule=effects.rule)
        for message in effects.messages:
            more = {"reason": message.reason} if message.type in ("Acceptance", "Cancel") else {}
            self._report(service, event="sent", type=message.type, dst=message.dst, **more)
        if (before.phase, before.role) != (effects.state.phase, effects.state.role):
            self._report(service, event="phase", rule=effects.rule, target=effects.state.target)
        if isinstance(effects.input, Expiry) and effects.input.timer.name == "giveup":
            self._report(service, event="given_up", rule=effects.rule)
        for indication in effects.indications:
            if indication.name != "discarded":
                about = {"name": indication.name, "reason": getattr(indication, "reason", "")}
                if isinstance(indication, Refused):
                    left_ms = (
                        service.station.timers.get(QUARANTINE, effects.now_ms) - effects.now_ms
                    )
                    about |= {"rule": effects.rule, "quarantine_ms": left_ms}
                self._report(service, event="told", **about)
        if self._idle is not None and not effects.state.outbox:
            _end(self._idle)

    def _report(self, service: McService, **fields: Any) -> None:
        st = service.state
        self.report(
            {"t_ms": service.now(), "station": self.station_id}
            | fields
            | {"phase": st.phase, "role": st.role, "session": st.session and list(st.session)}
            | {"sending": len(st.outbox)}
        )


async def _free(
    link: Link, codec: Codec, station_id: int, ms: int, over: asyncio.Future[None]
) -> None:
    """Listen for ``ms``.  Raises LinkError if another station uses this id."""
    if ms <= 0:
        return
    taken = False

    def look(data: bytes, tx: str | None) -> None:
        nonlocal taken
        with suppress(MessageError):
            taken = taken or codec.decode(data).src == station_id

    link.open(look)
    await asyncio.wait([over], timeout=ms / 1000)
    if taken:
        raise LinkError(f"station_id {station_id} is in use by another station; choose another id")


def stopping(for_ms: int | None = None) -> asyncio.Future[None]:
    """A future that is done on SIGTERM, SIGINT or SIGHUP, or after ``for_ms``.

    An exception in the event loop becomes its exception.
    """
    loop = asyncio.get_running_loop()
    over: asyncio.Future[None] = loop.create_future()

    def failed(loop: asyncio.AbstractEventLoop, context: dict[str, Any]) -> None:
        error = context.get("exception") or RuntimeError(context["message"])
        if "socket" in context and isinstance(error, OSError):
            return  # no free descriptor for a client; the listener tries again
        if not over.done():
            over.set_exception(error)

    loop.set_exception_handler(failed)
    on_signals(_end, over)
    if for_ms is not None:
        loop.call_later(for_ms / 1000, _end, over)
    return over


def on_signals(do: Callable[[asyncio.Future[None]], None], over: asyncio.Future[None]) -> None:
    """Call ``do`` on SIGTERM, SIGINT, and on SIGHUP unless it is ignored (nohup)."""
    hangup = signal.getsignal(signal.SIGHUP) is not signal.SIG_IGN
    for signum in (signal.SIGTERM, signal.SIGINT, *([signal.SIGHUP] if hangup else [])):
        asyncio.get_running_loop().add_signal_handler(signum, do, over)


def _end(over: asyncio.Future[None]) -> None:
    if not over.done():
        over.set_result(None)
