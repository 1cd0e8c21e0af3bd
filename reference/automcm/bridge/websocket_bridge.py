"""The router's side of the bridge: driving software connects over a WebSocket with rosbridge v2
(section V-A of the paper; docs/bridge.md).

``WebSocketBridge`` is an application.  It publishes the service's questions on topics, and turns
publications of the driving software into commands.  It makes two decisions itself: it aborts the
session of a vehicle whose driving software has been silent for ``t_cam_loss``, and it declines
questions that it cannot represent in ROS messages.
"""

from __future__ import annotations

import asyncio
import logging
from collections import OrderedDict
from collections.abc import Sequence
from functools import partial
from http import HTTPStatus
from typing import Any, Self
from urllib.parse import parse_qs, urlsplit

from pydantic import ValidationError

from automcm.bridge import access, autoware
from automcm.bridge import rosbridge as ros
from automcm.bridge.bounded_socket import BoundedSocket, Outbox
from automcm.bridge.driven_trajectory import own_trajectory
from automcm.bridge.driver_role import DriverRole
from automcm.links.link import LinkError
from automcm.service import application
from automcm.service.service import McService
from automcm_spec.vocabulary import application as commands
from automcm_spec.vocabulary.messages import MessageError, Session, Trajectory, refusal, short

# After bounded_socket, whose import error names the extra to install.
# isort: split
from websockets.asyncio.server import Server, ServerConnection, serve
from websockets.exceptions import ConnectionClosed
from websockets.http11 import Request as HttpRequest
from websockets.http11 import Response
from websockets.typing import Origin

MAX_CLIENTS = 8
QUEUE = 256
"""Maximum messages that wait for one client; it is disconnected beyond that."""
QUEUE_BYTES = 2 * ros.MAX_OUT
AHEAD_MS = 100
"""A stamp may be this far ahead of the service's clock (APP-6)."""
MAX_ID = 64
"""Maximum characters of an id of an operation; a longer one is not repeated."""
MAX_IDS = 16
"""Maximum subscriptions of one client to one topic."""
HANDSHAKE_S = 3
CLOSE_S = 1


_SILENT_LOGGER = logging.getLogger("automcm.bridge.websockets")
_SILENT_LOGGER.setLevel(logging.CRITICAL)
"""The library would log a traceback for each failed handshake."""


class _Client:
    """A connection, the client that it belongs to, and the topics to which it has subscribed."""

    def __init__(self, connection: ServerConnection, name: str = "") -> None:
        self.client: object = name or self
        """The name, or without one the connection itself."""
        self.outbox = Outbox(connection, QUEUE, QUEUE_BYTES)
        self.topics: dict[str, set[str]] = {}
        """For each topic the ids of the subscriptions; "" for one without an id."""

    def subscribe(self, topic: str, id_: str) -> None:
        ids = self.topics.setdefault(topic, set())
        if len(ids | {id_}) > MAX_IDS:
            raise MessageError(f"id: more than {MAX_IDS} subscriptions of {topic}")
        ids.add(id_)

    def unsubscribe(self, topic: str, id_: str) -> None:
        """End this subscription; without an id, each of the topic."""
        ids = self.topics.pop(topic, set()) - {id_}
        if id_ and ids:
            self.topics[topic] = ids

    def status(self, error: MessageError, id_: Any = None) -> None:
        fields: dict[str, Any] = {"op": "status", "level": "error", "msg": str(error)}
        if isinstance(id_, str) and len(id_) <= MAX_ID:
            fields["id"] = id_
        self.outbox.put(ros.operation(**fields))


class WebSocketBridge:
    """The application interface for driving software in another process or on another computer.

    Give it to an ``McService`` as its application, start the service, and ``await open()``.
    ``host`` must be a loopback address, or ``allow_remote`` and a ``token`` be given; clients then
    present the token (``Authorization: Bearer``).  A web page is refused unless its origin is one
    of ``origins``.  A plan is valid for ``plan_ms``.  A peer that answers no ping for ``ping_ms``
    is disconnected.  ``return_ms``: see ``DriverRole``.
    """

    def __init__(
        self,
        host: str = "127.0.0.1",
        port: int = ros.PORT,
        *,
        allow_remote: bool = False,
        token: str | None = None,
        origins: Sequence[str] = (),
        plan_ms: int = 1000,
        return_ms: int = 5000,
        ping_ms: int = 5000,
        max_clients: int = MAX_CLIENTS,
    ) -> None:
        access.check_listening(host, token, allow_remote)
        if not 0 <= port <= 65_535:
            raise LinkError(f"port must be between 0 and 65535, not {port}")
        self._host, self._port = host, port
        self._token = None if token is None else access.checked(token, "token")
        self._origins = [*map(Origin, origins), None]
        self._plan_ms, self._ping_ms, self._max_clients = plan_ms, ping_ms, max_clients
        self._return_ms = return_ms
        self._server: Server | None = None
        self._service: McService
        self._turn = asyncio.Lock()
        self._clients: set[_Client] = set()
        self._role: DriverRole
        self._kinematics: application.Kinematics | None = None
        self._kinematics_ms = 0
        """The time of the kinematics: their stamp, or if that is 0 their arrival; without any, the
        time since which they are missed."""
        self._missed: object | None = None
        """The driver that knows that there are no present kinematics."""
        self._plans: OrderedDict[str, tuple[Trajectory, int]] = OrderedDict()
        """For each scenario the planned trajectory, and the time from which it was planned."""
        self._question: application.Choice | application.Proposal | None = None
        self._asked = ""
        """The publication of that question."""
        self._drive = ""
        """The last publication of ``Drive``."""
        self._bound: Session | None = None
        self._ended: Session | None = None
        self._given_up: tuple[Session, str] | None = None
        """The session that the bridge has aborted, and the reason."""
        self._shown: tuple[Any, ...] = ()

    # -- the server

    @property
    def port(self) -> int:
        """The port it listens on; once open, the actual one even if 0 was requested."""
        if self._server is not None:
            port: int = next(iter(self._server.sockets)).getsockname()[1]
            return port
        return self._port

    async def open(self) -> None:
        """Listen; it must have a service.  Raises LinkError, which names host and port."""
        if not hasattr(self, "_service"):
            raise RuntimeError("the bridge has no service yet: give it to an McService first")
        socket = partial(BoundedSocket, half_open={})
        try:
            self._server = await serve(
                self._handle,
                self._host,
                self._port,
                process_request=self._admit,
                origins=self._origins,
                compression=None,
                max_size=ros.MAX_IN,
                max_queue=2,
                open_timeout=HANDSHAKE_S,
                close_timeout=CLOSE_S,
                ping_interval=self._ping_ms / 1000,
                ping_timeout=self._ping_ms / 1000,
                create_connection=socket,  # type: ignore[arg-type]  # any factory will do
                logger=_SILENT_LOGGER,
            )
        except OSError as error:
            where = f"ws://{self._host}:{self._port}"
            raise LinkError(f"cannot listen on {where}: {error.strerror or error}") from None

    async def close(self) -> None:
        """Disconnect every client and stop listening."""
        if self._server is not None:
            self._server.close()
            await self._server.wait_closed()
            self._server = None

    async def __aenter__(self) -> Self:
        await self.open()
        return self

    async def __aexit__(self, *exc: object) -> None:
        await self.close()

    def _admit(self, connection: ServerConnection, request: HttpRequest) -> Response | None:
        given = request.headers.get_all("Authorization")
        if self._token is not None and not access.authorized(given, self._token):
            text = "the header Authorization: Bearer TOKEN is missing or has another token\n"
            response = connection.respond(HTTPStatus.UNAUTHORIZED, text)
            response.headers["WWW-Authenticate"] = "Bearer"
            return response
        if len(self._clients) >= self._max_clients:
            return connection.respond(HTTPStatus.SERVICE_UNAVAILABLE, "too many clients\n")
        return None

    async def _handle(self, connection: ServerConnection) -> None:
        assert isinstance(connection, BoundedSocket)
        connection.finished()
        client = _Client(connection, _name(connection))
        self._clients.add(client)
        sending = asyncio.create_task(client.outbox.send())
        try:
            async for data in connection:
                await self._slice(client, data)
        except ConnectionClosed:
            pass
        except Exception as error:  # of an observer: the client did not cause it
            asyncio.get_running_loop().call_exception_handler(
                {"message": "a command from the bridge failed", "exception": error}
            )
        finally:
            self._clients.discard(client)
            if all(other.client != client.client for other in self._clients):
                self._role.leave(client.client)
                self._forget_plans()
            sending.cancel()
            await asyncio.gather(sending, return_exceptions=True)

    async def _slice(self, client: _Client, data: str | bytes) -> None:
        """Process one message, then yield the loop for as long as that took.

        Clients take turns, so that together they use at most half of the loop's time.
        """
        loop = asyncio.get_running_loop()
        async with self._turn:
            begun = loop.time()
            self._take(client, data)
            await asyncio.sleep(loop.time() - begun)

    # -- operations of clients

    def _take(self, client: _Client, data: str | bytes) -> None:
        fields: dict[str, Any] = {}
        try:
            fields = ros.opened(data)
            self._operate(client, fields)
        except MessageError as error:
            client.status(error, fields.get("id"))

    def _operate(self, client: _Client, fields: dict[str, Any]) -> None:
        match op := fields.get("op"):
            case "publish":
                self._published(
                    client, ros.read(ros.addressed(fields, ros.INPUTS), fields.get("msg"))
                )
            case "subscribe":
                if fields.get("compression", "none") != "none":
                    raise MessageError("compression: only none is supported")
                topic = ros.addressed(fields, ros.OUTPUTS).topic
                client.subscribe(topic, _id(fields))
                self._send_again(client, topic)
            case "unsubscribe":
                client.unsubscribe(ros.addressed(fields, ros.OUTPUTS).topic, _id(fields))
            case "advertise" | "unadvertise":
                ros.addressed(fields, ros.INPUTS)
            case str():
                raise MessageError(short("op", f"{op!r} is not supported"))
            case _:
                raise MessageError("op: must be a string")

    def _published(self, client: _Client, message: ros.Input) -> None:
        now = self._service.now()
        content = self._content(message, now)
        before = self._role.driver
        if not self._role.publish(client.client, now, self._service.state.bound):
            raise MessageError("topic: another connection is the driver")
        if self._role.driver != before:
            self._plans.clear()
            if self._position(now) is None:  # a new driver has time to say where the vehicle is
                self._kinematics, self._kinematics_ms, self._missed = None, now, None
        match message:
            case ros.OdometryIn():
                self._kinematics, self._kinematics_ms = content
                self._missed = None
            case ros.PlanMsg():
                self._keep(message.scenarios, content)
            case ros.AcceptMsg():
                self._accept(message)
            case _:
                self._command(content)
        self._show()

    def _content(self, message: ros.Input, now: int) -> Any:
        """The command in a message, or the kinematics or the plan and its time.  Raises
        MessageError."""
        try:
            match message:
                case ros.OdometryIn():
                    at_ms = message.header.stamp.ms or now
                    _check_age(now - at_ms, application.CURRENT_MS, "msg")
                    return autoware.kinematics(message), at_ms
                case ros.PlanMsg():
                    return self._own(message.trajectory, "msg.trajectory", now)
                case ros.RequestMsg():
                    own = self._own(message.planned, "msg.planned", now)
                    return message.command(own and own[0])
                case ros.AcceptMsg():
                    return message.key
            return message.command()
        except ValidationError as error:
            raise refusal(error, "msg") from None

    def _own(
        self, planned: autoware.AutowareTrajectory, place: str, now: int
    ) -> tuple[Trajectory, int] | None:
        if not planned.points:
            return None
        at = self._position(now)
        way, planned_ms = own_trajectory(planned, place, at, self._kinematics_ms)
        _check_age(now - planned_ms, self._plan_ms, place)
        return way, planned_ms

    def _position(self, now: int) -> application.Kinematics | None:
        """The last kinematics, unless they are too old (ACT-2)."""
        young = now - self._kinematics_ms < application.CURRENT_MS
        return self._kinematics if young else None

    def _keep(self, scenarios: list[str], planned: tuple[Trajectory, int] | None) -> None:
        for scenario in scenarios:
            self._plans.pop(scenario, None)
            if planned is not None:
                self._plans[scenario] = planned
        while len(self._plans) > ros.MAX_SCENARIOS:
            self._plans.popitem(last=False)

    def _accept(self, message: ros.AcceptMsg) -> None:
        asked = self._question
        if isinstance(asked, application.Proposal) and (asked.session, asked.proposal) == (
            message.key,
            message.proposal,
        ):
            self._command(asked.accept())
        else:
            self.refused("accept", "PRE-5")

    def _command(self, command: commands.Command) -> None:
        self._service.command(command)
        self._look(_OWN.get(command.name, "left"))

    # -- the driver

    def _forget_plans(self) -> None:
        """Without a driver, no maneuver concerns the vehicle."""
        if self._role.driver is None:
            self._plans.clear()

    def _give_up(self, session: Session, reason: str) -> None:
        self._given_up = session, reason
        self._service.command(commands.Abort(session=session))

    def _look(self, reason: str) -> None:
        """Publish the end of a session that the service does not indicate."""
        before, self._bound = self._bound, self._service.state.session
        if before is not None and before not in (self._bound, self._ended):
            if self._given_up is not None and self._given_up[0] == before:
                reason = self._given_up[1]
            self._alone(before, reason)

    # -- publishing

    def _publish(self, topic: str, text: str) -> None:
        for client in tuple(self._clients):
            if topic in client.topics:
                client.outbox.put(text)

    def _send_again(self, client: _Client, topic: str) -> None:
        """Send a new subscriber the current messages (like ROS's transient local)."""
        self._look("left")
        if topic == ros.StateMsg.topic:
            client.outbox.put(self._state())
        elif topic == ros.SurroundingsMsg.topic:
            client.outbox.put(self._surroundings())
        elif topic == ros.DriveMsg.topic:
            client.outbox.put(self._drive)
        elif self._question is not None and self._is_open():
            asks_choice = isinstance(self._question, application.Choice)
            if topic == (ros.ChoiceMsg if asks_choice else ros.ProposalMsg).topic:
                client.outbox.put(self._asked)

    def _is_open(self) -> bool:
        """Whether the last question still waits for its answer."""
        st = self._service.state
        if self._question is None or self._question.session != st.session:
            return False
        if isinstance(self._question, application.Choice):
            return st.phase == "CHOOSING" or st.deciding
        return (st.role, st.phase) == ("receiver", "NEGOTIATING")

    def _state(self) -> str:
        st, service = self._service.state, self._service
        return ros.publication(
            ros.StateMsg(
                header=ros.stamped(service.now()),
                station_id=service.station_id,
                phase=st.phase,
                role=st.role,
                session=ros.to_session(st.session),
                driver=self._role.driver is not None,
                lost_after_ms=service.parameters.t_cam_loss,
            )
        )

    def _surroundings(self) -> str:
        service = self._service
        heard = [ros.HeardMsg.of(each, service.state.session) for each in service.heard()]
        return ros.publication(ros.SurroundingsMsg(header=ros.stamped(service.now()), heard=heard))

    def _show_surroundings(self) -> None:
        if any(ros.SurroundingsMsg.topic in client.topics for client in self._clients):
            self._publish(ros.SurroundingsMsg.topic, self._surroundings())

    def _show(self, always: bool = False) -> None:
        """Publish the state if it has changed, or ``always``."""
        st = self._service.state
        shown = (st.phase, st.role, st.session, self._role.driver is not None)
        if always or shown != self._shown:
            self._shown = shown
            self._publish(ros.StateMsg.topic, self._state())

    def _alone(self, session: Session | None, reason: str) -> None:
        self._ended = session
        over = ros.to_session(session)
        header = ros.stamped(self._service.now())
        message = ros.DriveMsg(header=header, mode="alone", session=over, reason=reason)
        self._drive = ros.publication(message)
        self._publish(ros.DriveMsg.topic, self._drive)
        self._show()

    # -- the application interface

    def attach(self, service: application.Service) -> None:
        """As ``Application.attach``; the service must be an ``McService``."""
        if not isinstance(service, McService):
            raise TypeError("the bridge needs an McService: it publishes the station's state")
        self._service = service
        self._role = DriverRole(service.parameters.t_cam_loss, self._return_ms)
        self._alone(None, "")

    def kinematics(self, now_ms: int) -> application.Kinematics | None:
        """The last published kinematics, unless they are too old.  Also checks for a silent driver,
        at every CAM."""
        self._look("left")
        at = self._position(now_ms)
        if self._role.silent(now_ms):
            self._role.release()
            self._forget_plans()
            self._end("no_driver")
        elif at is None and self._role.driver is not None:
            self._say_missed(self._role.driver)
            if now_ms - self._kinematics_ms >= self._service.parameters.t_cam_loss:
                self._end("no_position")
        self._show(always=True)
        self._show_surroundings()
        return at

    def _end(self, reason: str) -> None:
        """End the session, if there is one."""
        session = self._service.state.session
        if session is not None and (self._given_up or ((0, 0), ""))[0] != session:
            self._give_up(session, reason)

    def _say_missed(self, driver: object) -> None:
        """Tell the driver once that the station sends no CAM."""
        if driver == self._missed:
            return
        self._missed = driver
        why = f"none of the last {application.CURRENT_MS} ms; the station sends no CAM (ACT-2)"
        for client in self._clients:
            if client.client == driver:
                client.status(MessageError(short(ros.OdometryIn.topic, why)))

    def concerned(self, advertised: application.Advertised) -> Trajectory | None:
        """The driving software's last plan for this scenario, if it is still valid.

        Publishes the advertised maneuver, unless the station is in a session.
        """
        now = self._service.now()
        planned, since = self._plans.get(advertised.scenario, (None, now))
        if now - since >= self._plan_ms:
            planned = None
        if not self._service.state.bound:
            try:
                message = ros.AdvertisedMsg.of(advertised, planned is not None, now)
            except ValueError:  # its trajectory fits no message
                return planned
            self._publish(message.topic, ros.publication(message))
        return planned

    def choose(self, choice: application.Choice) -> None:
        """Ask the driving software, after it got the surroundings (APP-1)."""
        self._show_surroundings()
        self._ask(choice, ros.ChoiceMsg.of)

    def verify(self, proposal: application.Proposal) -> None:
        """Ask the driving software."""
        self._ask(proposal, ros.ProposalMsg.of)

    def _ask(self, question: Any, of: Any) -> None:
        self._question, self._asked = None, ""
        try:
            message = of(question, self._service.now())
            text = ros.publication(message)
            if len(text) > ros.MAX_OUT:
                raise MessageError("message: too long")
        except ValueError:
            if isinstance(question, application.Proposal):
                self._service.command(question.refuse())
            else:
                self._give_up(question.session, "unreadable")
            return
        self._question, self._asked = question, text
        self._publish(message.topic, text)
        self._show()

    def load(self, maneuver: application.AgreedManeuver) -> None:
        """Publish the agreed maneuver."""
        try:
            self._drive = ros.publication(ros.DriveMsg.of(maneuver, self._service.now()))
        except ValueError:
            self._give_up(maneuver.session, "unreadable")
            return
        self._publish(ros.DriveMsg.topic, self._drive)
        self._show()

    def fallback(self, session: Session, reason: str) -> None:
        """Publish that the vehicle drives alone."""
        self._alone(session, reason)

    def finished(self, session: Session) -> None:
        """Publish that the vehicle drives alone."""
        self._alone(session, "finished")

    def refused(self, command: str, rule: str) -> None:
        """Publish the refused command and the rule."""
        message = ros.RefusedMsg(
            header=ros.stamped(self._service.now()), command=command, rule=rule
        )
        self._publish(message.topic, ros.publication(message))


_OWN = {"complete": "completed", "proceed": "proceeded", "abort": "aborted"}
"""The reason of ``alone`` after a command of the driving software, which has no indication."""
OWN_REASONS = frozenset(_OWN.values())


def _check_age(age_ms: int, limit_ms: int, place: str) -> None:
    """Raise MessageError for a stamp that is older than this, or ahead of the service's clock."""
    if not -AHEAD_MS <= age_ms < limit_ms:
        where = f"{abs(age_ms)} ms {'behind' if age_ms > 0 else 'ahead of'} the service's clock"
        why = f"{where}; it must be less than {limit_ms} ms behind, at most {AHEAD_MS} ms ahead"
        raise MessageError(short(f"{place}.header.stamp", why))


def _id(fields: dict[str, Any]) -> str:
    """The id of a subscription, "" without one.  Raises MessageError."""
    id_ = fields.get("id", "")
    if not isinstance(id_, str) or len(id_) > MAX_ID:
        raise MessageError(f"id: must be a string of at most {MAX_ID} characters")
    return id_


def _name(connection: ServerConnection) -> str:
    """The client's name: ``planner`` in ws://127.0.0.1:9090/?client=planner, or none."""
    path = connection.request.path if connection.request else ""
    return parse_qs(urlsplit(path).query).get("client", [""])[0]
