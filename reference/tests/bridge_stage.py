"""A station behind a bridge, and an independent client that speaks rosbridge JSON to it over
real sockets."""

from __future__ import annotations

import asyncio
import contextlib
import json
import math
import time
from collections.abc import AsyncIterator, Callable
from types import SimpleNamespace
from typing import Any

from websockets.asyncio.client import ClientConnection, connect

from automcm.bridge.autoware import to_time
from automcm.bridge.websocket_bridge import WebSocketBridge, _Client
from automcm.links.clock import AsyncioClock
from automcm.links.simulated_radio import Channel, Radio
from automcm.service.application import AgreedManeuver, Application
from automcm.service.service import McService
from automcm_simulation.road.straight_lane import LANE_CHANGE, Straight
from automcm_spec.vocabulary.messages import Session
from automcm_spec.vocabulary.parameters import Parameters

BRIDGED, OTHER = 1001, 2002
QUICK = Parameters(t_timeout=300, t_resend=100, t_decide=1000, t_cam_loss=1100, t_cam=50)
TOKEN = "0123456789abcdef"
PATIENCE = 20
"""Seconds after which a test has failed; nothing is asserted about how long anything takes."""


class Recorder(Straight):
    """``Straight``, which records its callbacks."""

    def __init__(self, **more: Any) -> None:
        super().__init__(
            **({"think_ms": 5, "hold_ms": 0, "maneuver_ms": 100, "from_now": True} | more)
        )
        self.told: list[tuple[Any, ...]] = []

    def load(self, maneuver: AgreedManeuver) -> None:
        self.told.append(("load", maneuver))
        super().load(maneuver)

    def fallback(self, session: Session, reason: str) -> None:
        self.told.append(("fallback", session, reason))

    def finished(self, session: Session) -> None:
        self.told.append(("finished", session))

    def refused(self, command: str, rule: str) -> None:
        self.told.append(("refused", command, rule))

    def names(self) -> list[str]:
        return [told[0] for told in self.told]


class World:
    """A bridged station and one with an application of its own, on one radio."""

    def __init__(self, other: Application, bridge: WebSocketBridge | None = None) -> None:
        self.clock = AsyncioClock()
        self.radio = Radio(self.clock, Channel(delay_ms=(0, 2)))
        self.bridge = bridge or WebSocketBridge(port=0)
        self.bridged = self.add(BRIDGED, self.bridge)
        self.other = self.add(OTHER, other)

    def add(self, station_id: int, application: Application) -> McService:
        link = self.radio.link(station_id)
        return McService(station_id, application, link, self.clock, parameters=QUICK)

    @property
    def uri(self) -> str:
        return f"ws://127.0.0.1:{self.bridge.port}"

    async def __aenter__(self) -> World:
        await self.bridge.open()
        self.bridged.start()
        self.other.start()
        return self

    async def __aexit__(self, *exc: object) -> None:
        self.bridged.close()
        self.other.close()
        await self.bridge.close()


class Operator:
    """A connection without a socket, for virtual time."""

    def __init__(self, bridge: WebSocketBridge, name: str = "") -> None:
        self.bridge, self.texts = bridge, list[str]()
        socket = SimpleNamespace(transport=None)
        self.client = _Client(socket, name)  # type: ignore[arg-type]
        self.client.outbox.put = self.texts.append  # type: ignore[method-assign]

    def publish(self, topic: str, **msg: Any) -> None:
        self.op(op="publish", topic=f"/v2x/mcm/input/{topic}", msg=msg)

    def op(self, **fields: Any) -> None:
        self.bridge._take(self.client, json.dumps(fields))

    def statuses(self) -> list[str]:
        every = map(json.loads, self.texts)
        return [fields["msg"] for fields in every if fields["op"] == "status"]


class Client:
    """Driving software that knows nothing but rosbridge's JSON."""

    def __init__(self, socket: ClientConnection) -> None:
        self.socket = socket
        self.seen: list[dict[str, Any]] = []

    async def op(self, **fields: Any) -> None:
        await self.socket.send(json.dumps(fields))

    async def publish(self, topic: str, **msg: Any) -> None:
        await self.op(op="publish", topic=f"/v2x/mcm/input/{topic}", msg=msg)

    async def subscribe(self, *topics: str) -> None:
        for topic in topics:
            await self.op(op="subscribe", topic=f"/v2x/mcm/output/{topic}")

    async def read(self, wanted: Callable[[dict[str, Any]], bool]) -> dict[str, Any]:
        """The first operation from now on that is wanted."""
        async with asyncio.timeout(PATIENCE):
            while True:
                fields: dict[str, Any] = json.loads(await self.socket.recv())
                self.seen.append(fields)
                if wanted(fields):
                    return fields

    async def until(self, topic: str, **expected: Any) -> dict[str, Any]:
        """The first message on a topic, from now on, that has these fields."""

        def wanted(fields: dict[str, Any]) -> bool:
            on_topic = fields.get("topic") == f"/v2x/mcm/output/{topic}"
            return on_topic and expected.items() <= fields["msg"].items()

        msg: dict[str, Any] = (await self.read(wanted))["msg"]
        return msg

    async def status(self) -> str:
        fields = await self.read(lambda fields: fields["op"] == "status")
        assert fields["level"] == "error"
        return str(fields["msg"])


@contextlib.asynccontextmanager
async def client(
    world: World, *topics: str, drives: bool = True, name: str = ""
) -> AsyncIterator[Client]:
    """A client that has subscribed, and if it drives says all the time where it is."""
    uri = f"{world.uri}/?client={name}"
    async with connect(uri, compression=None, ping_interval=None) as connection:
        it = Client(connection)
        await it.subscribe(*topics)
        driving = asyncio.create_task(drive(it)) if drives else None
        try:
            yield it
        finally:
            if driving is not None:
                driving.cancel()
                await asyncio.gather(driving, return_exceptions=True)


def here(at_x: float, at_y: float, **orientation: float) -> dict[str, Any]:
    """An Odometry without a stamp, at 8.333 m/s."""
    pose = {"position": {"x": at_x, "y": at_y}, "orientation": orientation}
    return {
        "pose": {"pose": pose},
        "twist": {"twist": {"linear": {"x": 8.333, "y": 0.0}}},
    }


async def drive(it: Client) -> None:
    while True:
        await it.publish("kinematics", **here(12.5, -3.25, z=math.sin(0.05), w=1.0))
        await asyncio.sleep(0.05)


def points(*where: tuple[int, float, float], ms: int = 0) -> dict[str, Any]:
    """An Autoware trajectory by seconds, x and y, stamped with this time."""
    return {
        "header": {"stamp": to_time(ms).model_dump(), "frame_id": "map"},
        "points": [
            {"time_from_start": {"sec": s}, "pose": {"position": {"x": x, "y": y, "z": 0.0}}}
            for s, x, y in where
        ],
    }


SLOWER = points((0, 0.0, 0.0), (1, 5.5, 0.125))


def now_ms() -> int:
    """The host's time, which is the service's."""
    return time.time_ns() // 10**6


async def plans(it: Client) -> None:
    way = points((0, 0.0, 0.0), (1, 8.333, 0.0), ms=now_ms())
    await it.publish("plan", scenarios=["lane_change"], trajectory=way)


async def holds(condition: Callable[[], bool]) -> None:
    async with asyncio.timeout(PATIENCE):
        while not condition():
            await asyncio.sleep(0.01)


async def committed(world: World, it: Client) -> dict[str, Any]:
    """The bridged station becomes a receiver and accepts; the agreed maneuver."""
    await plans(it)
    await it.until("state", driver=True)
    world.other.command(LANE_CHANGE)
    asked = await it.until("proposal")
    await it.publish("accept", session=asked["session"], proposal=asked["proposal"])
    return await it.until("drive", mode="coordinated")
