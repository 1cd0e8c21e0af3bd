"""The vehicle's side of the bridge: runs an application of application.py in another process.

It connects to a ``WebSocketBridge``, turns topics into calls of the application and its commands
into publications, and reconnects when the connection is lost (docs/bridge.md).
"""

from __future__ import annotations

import asyncio
import random
import secrets
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

from automcm.bridge import rosbridge as ros
from automcm.bridge.access import authorization
from automcm.bridge.autoware import NO_TRAJECTORY, to_odometry, to_trajectory
from automcm.bridge.bounded_socket import Outbox
from automcm.bridge.websocket_bridge import OWN_REASONS, QUEUE
from automcm.links.clock import AsyncioClock, Clock
from automcm.links.link import LinkError
from automcm.service.application import Advertised, AgreedManeuver, Application, Heard
from automcm_spec.vocabulary import application as commands
from automcm_spec.vocabulary.messages import MessageError, Session, Trajectory

# After bounded_socket, whose import error names the extra to install.
# isort: split
from websockets.asyncio.client import ClientConnection, connect
from websockets.exceptions import ConnectionClosed, InvalidHandshake, InvalidStatus, InvalidURI

OPEN_S = 3
CLOSE_S = 1


class RemoteApplication:
    """Runs ``application`` at the remote end of the bridge at ``uri``, and acts as its service.

    ``expect`` holds examples of expected Advertisements.  The application's plans for them are
    published regularly, so that the bridge can answer a first Advertisement.  One that resembles no
    example is answered when its next copy arrives, with the application's plan for it.

    Kinematics and plans are published every ``period_ms``.  ``run`` makes ``attempts`` attempts for
    the first connection, and reconnects without limit.  The waits grow from the first to the second
    value of ``backoff_ms``; ``seed`` randomizes them.  ``token`` is the bridge's.
    """

    def __init__(
        self,
        application: Application,
        uri: str = f"ws://127.0.0.1:{ros.PORT}",
        *,
        expect: Sequence[commands.Request] = (),
        period_ms: int = 100,
        attempts: int = 5,
        backoff_ms: tuple[int, int] = (100, 5000),
        ping_ms: int = 5000,
        clock: Clock | None = None,
        seed: int = 0,
        token: str | None = None,
    ) -> None:
        self._application, self._uri, self._expect = application, uri, tuple(expect)
        self._headers = authorization(token)
        self._named = uri if "?" in uri else f"{uri}?client={secrets.token_hex(8)}"
        """The address with a name, so that the bridge recognizes the client's next connection."""
        self._period_ms, self._attempts, self._backoff_ms = period_ms, attempts, backoff_ms
        self._ping_ms, self._random = ping_ms, random.Random(seed)
        self._given_clock = clock
        self._clock: Clock
        self.connected = asyncio.Event()
        """Set while there is a connection on which the bridge has sent its state."""
        self._outbox: Outbox | None = None
        self._socket: ClientConnection | None = None
        self._offset = 0
        self._time = 0
        self._received_ms = 0
        """The time of the bridge's last message, on the own clock, in ms."""
        self._lost_after_ms = 1500
        self._heard: tuple[Heard, ...] | None = None
        self._heard_ms = 0
        """The time of the last surroundings, on the own clock, in ms."""
        self._asked: tuple[Session, int] | None = None
        self._last: commands.Command | None = None
        """The last answer or ending command, which is repeated if it may have been lost."""
        self._loaded: Session | None = None
        self._over: Session | None = None

    async def run(self) -> None:
        """Serve until cancelled.  Raises LinkError if the bridge cannot be reached at first."""
        self._clock = self._given_clock or AsyncioClock()
        self._application.attach(self)
        socket = await self._connect(self._attempts)
        tasks = (asyncio.create_task(self._stay(socket)), asyncio.create_task(self._keep()))
        try:
            done, _ = await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
            for task in done:
                task.result()  # they end only by an exception of the application
        finally:
            for task in tasks:
                task.cancel()
            await asyncio.gather(*tasks, return_exceptions=True)

    # -- the connection

    async def _connect(self, attempts: int | None) -> ClientConnection:
        low, high = self._backoff_ms
        attempt = 0
        while True:
            attempt += 1
            try:
                return await connect(
                    self._named,
                    additional_headers=self._headers,
                    compression=None,
                    max_size=ros.MAX_OUT + 1024,
                    max_queue=4,
                    open_timeout=OPEN_S,
                    close_timeout=CLOSE_S,
                    ping_interval=self._ping_ms / 1000,
                    ping_timeout=self._ping_ms / 1000,
                    proxy=None,
                )
            except InvalidURI:
                raise LinkError(
                    f"expected the address of a bridge such as ws://127.0.0.1:{ros.PORT}, "
                    f"not {self._uri!r}"
                ) from None
            except (OSError, TimeoutError, InvalidHandshake, EOFError) as error:
                if attempts is not None and (attempt >= attempts or _is_unauthorized(error)):
                    why = str(error) or type(error).__name__
                    if _is_unauthorized(error):
                        why = "it has another token" if self._headers else "it requires a token"
                    raise LinkError(f"cannot reach the bridge at {self._uri}: {why}") from None
            wait = min(high, low * 2 ** min(attempt - 1, 30))
            await asyncio.sleep(wait * self._random.uniform(0.5, 1) / 1000)

    async def _stay(self, socket: ClientConnection) -> None:
        while True:
            await self._serve(socket)
            socket = await self._connect(None)

    async def _serve(self, socket: ClientConnection) -> None:
        """Serve one connection until it ends."""
        self._socket, self._outbox = socket, Outbox(socket, QUEUE, ros.MAX_OUT)
        sending = asyncio.create_task(self._outbox.send())
        try:
            for topic, model in ros.OUTPUTS.items():
                self._outbox.put(ros.operation(op="subscribe", topic=topic, type=model.type))
            async for data in socket:
                self._take(data)
        except ConnectionClosed:
            pass
        finally:
            self.connected.clear()
            self._socket = self._outbox = None
            sending.cancel()
            await socket.close()

    async def _keep(self) -> None:
        """Publish kinematics and plans, and check that the bridge is alive."""
        while True:
            await asyncio.sleep(self._period_ms / 1000)
            self._publish_present()
            if self._clock.now() - self._received_ms >= self._lost_after_ms:
                if self._loaded is not None:
                    self._fall_back(self._loaded)
                if self.connected.is_set() and self._socket is not None:
                    self._socket.transport.abort()

    # -- publications

    def _publish(self, message: ros.Input) -> None:
        if self._outbox is not None:
            self._outbox.put(ros.publication(message))

    def _publish_present(self) -> None:
        if not self.connected.is_set():
            return
        now = self.now()
        if (at := self._application.kinematics(now)) is not None:
            self._publish(ros.OdometryIn.model_construct(**dict(to_odometry(at, now))))
        for n, sample in enumerate(self._expect, 1):
            self._plan(Advertised((1, n), sample.scenario, sample.details, sample.planned))

    def _plan(self, advertised: Advertised) -> None:
        planned: Trajectory | None = self._application.concerned(advertised)
        form = NO_TRAJECTORY if planned is None else to_trajectory(planned)
        self._publish(ros.PlanMsg(scenarios=[advertised.scenario], trajectory=form))

    # -- the service, for the application

    def now(self) -> int:
        """The time in ms on the service's clock, as far as it is known.

        It can decrease only with a new connection, because the router may have restarted.
        """
        self._time = max(self._time, self._clock.now() + self._offset)
        return self._time

    def heard(self) -> tuple[Heard, ...] | None:
        """As ``Surroundings.heard``, with times on the clock of ``now`` (APP-1).

        None if the bridge has sent no surroundings within its ``lost_after_ms``.
        """
        fresh = self._clock.now() - self._heard_ms < self._lost_after_ms
        return self._heard if fresh else None

    def command(self, command: commands.Command, after_ms: int = 0) -> None:
        """Give a command, now or later.

        Without a connection, a request is refused as ``unreachable``.  Any other command is
        repeated on the next connection if it is still relevant.
        """
        if after_ms > 0:
            self._clock.at(self._clock.now() + after_ms, lambda: self.command(command))
            return
        message = ros.of_command(command)
        if not isinstance(command, commands.Request):
            self._last = command
        elif self._outbox is None:
            refused = lambda: self._application.refused("request", "unreachable")  # noqa: E731
            self._clock.at(self._clock.now(), refused)
            return
        self._publish(message)

    def _repeat_last(self) -> None:
        if self._last is not None:
            self._publish(ros.of_command(self._last))

    # -- messages of the bridge

    def _take(self, data: str | bytes) -> None:
        """Take one operation.  An invalid one is answered with a status and changes nothing."""
        try:
            fields = ros.opened(data, marks=ros.MAX_OUT)
            model = ros.OUTPUTS.get(str(fields.get("topic")))
            if fields.get("op") != "publish" or model is None:
                return
            self._received_ms = self._clock.now()
            message = ros.read(model, fields.get("msg"))
            if isinstance(message, ros.StateMsg):
                if not self.connected.is_set():
                    # The router may have restarted, and its clock with it.
                    self._time, self._heard = 0, None
                self._offset = message.header.stamp.ms - self._received_ms
                self._lost_after_ms = message.lost_after_ms
                if not self.connected.is_set():  # the first: the service's clock is known from now
                    self.connected.set()
                    self._publish_present()
            elif isinstance(message, ros.SurroundingsMsg):
                self._heard = tuple(each.value() for each in message.heard)
                self._heard_ms = self._received_ms
            elif isinstance(message, ros.RefusedMsg):
                self._application.refused(message.command, message.rule)
            elif (session := message.session.key) is not None:
                self._of_session(message, session)
            elif isinstance(message, ros.DriveMsg):
                self._forget_loaded()  # the router has restarted
        except MessageError as error:
            if self._outbox is not None:
                self._outbox.put(ros.operation(op="status", level="error", msg=str(error)))

    def _of_session(self, message: Any, session: Session) -> None:
        match message:
            case ros.AdvertisedMsg():
                self._plan(message.advertised(session))
            case ros.ChoiceMsg():
                choice = message.choice(session)
                if self._is_new(session, choice.proposal):
                    self._application.choose(replace(choice, heard=self.heard()))
            case ros.ProposalMsg():
                proposal = message.asked(session)
                if self._is_new(session, proposal.proposal):
                    self._application.verify(proposal)
            case ros.DriveMsg(mode="coordinated"):
                try:
                    self._coordinated(message.drive(session))
                except MessageError:
                    self._fall_back(session)
            case ros.DriveMsg():
                self._alone(session, message.reason)

    def _is_new(self, session: Session, proposal: int) -> bool:
        """Whether the question is new; the answer to an old one is repeated."""
        if self._asked != (session, proposal):
            self._asked = session, proposal
            return True
        if self._last is not None and _answers(self._last, session, proposal):
            self._repeat_last()
        return False

    def _coordinated(self, maneuver: AgreedManeuver) -> None:
        if maneuver.session == self._over:  # it has fallen back, and the bridge does not know yet
            self._fall_back(maneuver.session)
        elif maneuver.session != self._loaded:
            self._forget_loaded()
            self._loaded = maneuver.session
            self._application.load(maneuver)
        elif _ends(self._last, maneuver.session):
            self._repeat_last()

    def _alone(self, session: Session, reason: str) -> None:
        if self._loaded != session:
            self._forget_loaded()
        self._loaded = None
        if session == self._over:
            return
        self._over = session
        if reason == "finished":
            self._application.finished(session)
        elif not (reason in OWN_REASONS and _ends(self._last, session)):
            self._application.fallback(session, reason)

    def _forget_loaded(self) -> None:
        """Fall back from a session that ended while there was no connection."""
        if (session := self._loaded) is not None:
            self._loaded, self._over = None, session
            self._application.fallback(session, "bridge_loss")

    def _fall_back(self, session: Session) -> None:
        """Drive alone, because the bridge was silent for too long; inform it when possible."""
        if not _ends(self._last, session):
            self._last = commands.Abort(session=session)
        if session != self._over:
            self._loaded, self._over = None, session
            self._application.fallback(session, "bridge_loss")
        self._repeat_last()


def _is_unauthorized(error: Exception) -> bool:
    return isinstance(error, InvalidStatus) and error.response.status_code == 401


def _ends(command: commands.Command | None, session: Session) -> bool:
    ending = commands.Complete | commands.Proceed | commands.Abort
    return isinstance(command, ending) and command.session == session


def _answers(command: commands.Command, session: Session, proposal: int) -> bool:
    if _ends(command, session):
        return True
    answering = commands.Prescribe | commands.Accept | commands.Refuse
    return isinstance(command, answering) and (command.session, command.proposal) == (
        session,
        proposal,
    )
