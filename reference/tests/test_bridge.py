"""The WebSocket bridge: an independent client speaks rosbridge JSON to it over real sockets."""

from __future__ import annotations

import asyncio
import base64
import contextlib
import json
import math
import os
import socket
import struct
import subprocess
import sys
from collections.abc import AsyncIterator, Callable, Coroutine, Iterator
from itertools import accumulate
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from websockets.asyncio.client import ClientConnection, connect
from websockets.exceptions import ConnectionClosed, InvalidStatus

from automcm import autoware
from automcm.application import Application, Drive, Kinematics, Proposal
from automcm.clock import AsyncioClock
from automcm.interface import Abort
from automcm.links import LinkError
from automcm.links import rosbridge as ros
from automcm.links.bridge import MAX_SOCKETS, WebSocketBridge
from automcm.links.remote import RemoteApplication
from automcm.links.simulated import Channel, Radio
from automcm.messages import MessageError, Session, Trajectory
from automcm.parameters import Parameters
from automcm.service import McService
from automcm.simulation import Simulation
from automcm.straight import LANE_CHANGE, Straight

BRIDGED, OTHER = 1001, 2002
QUICK = Parameters(t_timeout=300, t_resend=100, t_decide=1000, t_cam_loss=1100, t_cam=50)
PATIENCE = 20
"""Seconds after which a test has failed; nothing is asserted about how long anything takes."""


def run(test: Coroutine[Any, Any, None]) -> None:
    asyncio.run(asyncio.wait_for(test, 3 * PATIENCE))


class Recorder(Straight):
    """Straight, and what it was told."""

    def __init__(self, **more: Any) -> None:
        super().__init__(**({"think_ms": 5, "hold_ms": 0, "maneuver_ms": 300} | more))
        self.told: list[tuple[Any, ...]] = []

    def load(self, drive: Drive) -> None:
        self.told.append(("load", drive))
        super().load(drive)

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
async def client(world: World, *topics: str, drives: bool = True) -> AsyncIterator[Client]:
    """A client that has subscribed, and if it drives says all the time where it is."""
    async with connect(world.uri, compression=None, ping_interval=None) as connection:
        it = Client(connection)
        await it.subscribe(*topics)
        driving = asyncio.create_task(drive(it)) if drives else None
        try:
            yield it
        finally:
            if driving is not None:
                driving.cancel()
                await asyncio.gather(driving, return_exceptions=True)


async def drive(it: Client) -> None:
    pose = {"position": {"x": 12.5, "y": -3.25}, "orientation": {"z": math.sin(0.05), "w": 1.0}}
    while True:
        twist = {"linear": {"x": 8.333}}
        await it.publish("kinematics", pose={"pose": pose}, twist={"twist": twist})
        await asyncio.sleep(0.05)


def points(*where: tuple[int, float, float]) -> dict[str, Any]:
    """An Autoware trajectory by seconds, x and y."""
    return {
        "header": {"stamp": {"sec": 0, "nanosec": 0}, "frame_id": "map"},
        "points": [
            {"time_from_start": {"sec": s}, "pose": {"position": {"x": x, "y": y, "z": 0.0}}}
            for s, x, y in where
        ],
    }


STRAIGHT_ON = points((0, 0.0, 0.0), (1, 8.333, 0.0))
SLOWER = points((0, 0.0, 0.0), (1, 5.5, 0.125))


async def plans(it: Client) -> None:
    await it.publish("plan", scenarios=["lane_change"], trajectory=STRAIGHT_ON)


async def holds(condition: Callable[[], bool]) -> None:
    async with asyncio.timeout(PATIENCE):
        while not condition():
            await asyncio.sleep(0.01)


async def committed(world: World, it: Client) -> dict[str, Any]:
    """The bridged station becomes a receiver and accepts; what it is to drive."""
    await plans(it)
    await it.until("state", driver=True)
    world.other.command(LANE_CHANGE)
    asked = await it.until("proposal")
    await it.publish("accept", session=asked["session"], proposal=asked["proposal"])
    return await it.until("drive", mode="coordinated")


# -- whole sessions


def test_prescriber() -> None:
    async def test() -> None:
        other = Recorder()
        async with World(other) as world, client(world, "state", "drive", "choice") as it:
            await it.until("drive", mode="alone", session={"prescriber": 0, "number": 0})
            await it.until("state", driver=True)
            await it.publish("request", scenario="lane_change", details={"lane": 2})
            choice = await it.until("choice")
            (planned,) = choice["planned"]
            assert (planned["station_id"], choice["proposal"]) == (OTHER, 1)
            first, second = planned["trajectory"]["points"]
            assert second["pose"]["position"] == {"x": 8.333, "y": 0.0, "z": 0.0}
            assert first["longitudinal_velocity_mps"] == pytest.approx(8.333)
            session = choice["session"]
            assert session == {"prescriber": BRIDGED, "number": 1}
            await it.publish(
                "prescribe",
                session=session,
                proposal=1,
                target=OTHER,
                prescribed=SLOWER,
                hold_ms=0,
                lease_ms=20_000,
            )
            drive = await it.until("drive", mode="coordinated", role="prescriber")
            last = drive["selected"]["points"][-1]
            assert last["pose"]["position"] == {"x": 5.5, "y": 0.125, "z": 0.0}
            assert last["time_from_start"] == {"sec": 1, "nanosec": 0}
            await it.until("state", phase="ACTUATING", session=session)
            await it.publish("complete", session=session)
            await it.until("drive", mode="alone", session=session, reason="completed")
            await holds(lambda: "finished" in other.names())
            assert other.names() == ["load", "finished"]
            assert other.told[0][1].selected == Trajectory(
                t0=0, points=((0, 0, 0), (1000, 5500, 125))
            )
            cam = world.other.neighbours[BRIDGED]
            assert (cam.x_mm, cam.y_mm, cam.heading_mrad, cam.speed_mm_s) == (
                12500,
                -3250,
                100,
                8333,
            )

    run(test())


def test_receiver() -> None:
    async def test() -> None:
        other = Recorder()
        topics = ("state", "drive", "proposal", "advertised")
        async with World(other) as world, client(world, *topics) as it:
            drive = await committed(world, it)
            session = {"prescriber": OTHER, "number": 1}
            assert drive["session"] == session and drive["role"] == "receiver"
            selected = autoware.trajectory(ros.read(ros.Drive, drive).selected)
            assert selected == other.trajectory(70)
            times = [autoware.Time(**drive[name]).ms for name in ("start", "until")]
            assert times[1] - times[0] == other.lease_ms
            await it.until("drive", mode="alone", session=session, reason="finished")
            told = [f["msg"] for f in it.seen if f.get("topic", "").endswith("advertised")]
            assert told[0]["concerned"] and told[0]["details"] == {"lane": 2}
            assert other.names() == ["load"]

    run(test())


def test_refuse_and_proceed() -> None:
    async def test() -> None:
        other = Recorder(refuse_first=1)
        topics = ("state", "drive", "proposal", "choice", "refused")
        async with World(other) as world, client(world, *topics) as it:
            await plans(it)
            await it.until("state", driver=True)
            world.other.command(LANE_CHANGE)
            asked = await it.until("proposal", proposal=1)
            await it.publish("refuse", session=asked["session"], proposal=1)
            asked = await it.until("proposal", proposal=2)
            await it.publish("accept", session=asked["session"], proposal=1)  # not this one
            await it.until("refused", command="accept", rule="PRE-5")
            await it.publish("abort", session=asked["session"])
            await it.until("drive", mode="alone", session=asked["session"], reason="aborted")
            await holds(lambda: other.told[-1:] == [("fallback", (OTHER, 1), "abort")])
            await it.publish("request", scenario="lane_change")
            choice = await it.until("choice")
            await it.publish("proceed", session=choice["session"])
            await it.until("drive", mode="alone", session=choice["session"], reason="proceeded")
            await it.publish("complete", session=choice["session"])
            await it.until("refused", command="complete", rule="CMD-1")

    run(test())


def test_without_a_fresh_plan_nothing_concerns_it() -> None:
    async def test() -> None:
        other = Recorder()
        bridge = WebSocketBridge(port=0, plan_ms=0)
        async with World(other, bridge) as world, client(world, "state", "advertised") as it:
            await plans(it)
            await it.until("state", driver=True)
            world.other.command(LANE_CHANGE)
            assert not (await it.until("advertised"))["concerned"]
            await holds(lambda: other.told == [("fallback", (OTHER, 1), "no_participants")])

    run(test())


# -- connections that are lost


class Forgetful(WebSocketBridge):
    """The latches are missing."""

    def _send_again(self, client: Any, topic: str) -> None:
        pass


async def learns(bridge: WebSocketBridge) -> dict[str, Any]:
    """Drops out of a commitment, which ends meanwhile; what it is told when it is back."""
    other = Recorder(maneuver_ms=60_000)
    async with World(other, bridge) as world:
        async with client(world, "state", "drive", "proposal") as it:
            await committed(world, it)
        world.other.command(Abort(session=(OTHER, 1)))
        await holds(lambda: not world.bridged.state.bound)
        async with client(world, "drive") as it, asyncio.timeout(3):
            return await it.until("drive")


def test_reconnects_and_learns_that_it_has_fallen_back() -> None:
    async def test() -> None:
        told = await learns(WebSocketBridge(port=0))
        assert (told["mode"], told["reason"]) == ("alone", "abort")
        assert told["session"] == {"prescriber": OTHER, "number": 1}

    run(test())


def test_a_bridge_without_latches_would_not_tell() -> None:
    async def test() -> None:
        with pytest.raises(TimeoutError):
            await learns(Forgetful(port=0))

    run(test())


def test_reconnects_and_goes_on() -> None:
    async def test() -> None:
        other = Recorder(maneuver_ms=60_000)
        async with World(other) as world:
            async with client(world, "state", "drive", "proposal") as it:
                before = await committed(world, it)
            async with client(world, "drive") as it:
                assert await it.until("drive", mode="coordinated") == before
                await holds(lambda: other.names() == ["load"])
                world.other.command(other.told[0][1].complete())
                await it.until("drive", mode="alone", reason="finished")

    run(test())


def test_an_open_question_is_asked_again() -> None:
    async def test() -> None:
        async with World(Recorder(maneuver_ms=60_000)) as world:
            async with client(world, "state", "proposal") as it:
                await plans(it)
                await it.until("state", driver=True)
                world.other.command(LANE_CHANGE)
                asked = await it.until("proposal")
            async with client(world, "proposal", "drive") as it:
                assert await it.until("proposal") == asked
                await it.publish("accept", session=asked["session"], proposal=asked["proposal"])
                await it.until("drive", mode="coordinated")
            async with client(world, "state", "proposal", "drive") as it:
                await it.until("drive", mode="coordinated")
                assert not [f for f in it.seen if f.get("topic", "").endswith("proposal")]

    run(test())


class Patient(WebSocketBridge):
    """Nobody watches whether the driving software is there."""

    def _silent(self, now: int) -> bool:
        return False


@pytest.mark.parametrize("connected", [False, True])
@pytest.mark.parametrize("bridge", [WebSocketBridge, Patient])
def test_silent_driving_software_frees_the_peer(
    bridge: type[WebSocketBridge], connected: bool
) -> None:
    """END-1, whether it is gone or only says nothing any more."""

    async def test() -> None:
        other = Recorder(maneuver_ms=60_000)
        async with World(other, bridge(port=0)) as world:
            async with client(world, "state", "drive", "proposal") as it:
                await committed(world, it)
            async with contextlib.AsyncExitStack() as stack:
                if connected:
                    silent = client(world, "drive", drives=False)
                    await (await stack.enter_async_context(silent)).publish("kinematics", pose={})
                if bridge is Patient:
                    await asyncio.sleep(1.5)
                    assert world.bridged.state.bound
                    return
                await holds(lambda: other.names() == ["load", "fallback"])
                assert other.told[-1] == ("fallback", (OTHER, 1), "abort")
                await holds(lambda: not world.bridged.state.bound)
            async with client(world, "drive") as it:
                await it.until("drive", mode="alone", reason="no_driver")

    run(test())


def test_nobody_ever_drove() -> None:
    """In virtual time: a session of a vehicle without driving software ends at the next CAM."""
    simulation = Simulation()
    simulation.add(BRIDGED, WebSocketBridge())
    simulation.request(BRIDGED, 500)
    simulation.run(500)
    assert simulation.services[BRIDGED].state.phase == "ADVERTISING"
    simulation.run(601)
    assert simulation.services[BRIDGED].state.phase == "STANDALONE"


def test_one_connection_drives() -> None:
    async def test() -> None:
        async with World(Recorder()) as world, client(world, "state", drives=False) as watcher:
            async with client(world, "state") as it:
                await it.until("state", driver=True)
                await watcher.publish("request", scenario="lane_change")
                assert "another connection is the driver" in await watcher.status()
                await watcher.until("state", phase="STANDALONE", driver=True)
            await watcher.until("state", driver=False)
            await watcher.publish("request", scenario="lane_change")
            await watcher.until("state", phase="ADVERTISING", driver=True)

    run(test())


# -- the far side, with an application of application.py


@contextlib.asynccontextmanager
async def remote(world: World, application: Application, **more: Any) -> AsyncIterator[Any]:
    it = RemoteApplication(application, world.uri, backoff_ms=(10, 50), **more)
    running = asyncio.create_task(it.run())
    try:
        async with asyncio.timeout(PATIENCE):
            await it.connected.wait()
        yield it
    finally:
        running.cancel()
        result = (await asyncio.gather(running, return_exceptions=True))[0]
        assert isinstance(result, asyncio.CancelledError)


def test_remote_prescriber() -> None:
    async def test() -> None:
        other, mine = Recorder(refuse_first=1), Recorder(target=OTHER)
        async with World(other) as world, remote(world, mine) as it:
            it.command(LANE_CHANGE)
            await holds(lambda: "finished" in other.names())
            assert other.names() == ["load", "finished"]
            assert mine.names() == ["load"]
            assert mine.told[0][1].selected == mine.trajectory(40) == other.told[0][1].selected
            await holds(lambda: not world.bridged.state.bound)
            it.command(Abort(session=(BRIDGED, 1)))
            await holds(lambda: ("refused", "abort", "CMD-1") in mine.told)

    run(test())


@pytest.mark.parametrize("expect", [(), (LANE_CHANGE,)])
def test_remote_receiver(expect: Any) -> None:
    async def test() -> None:
        other, mine = Recorder(), Recorder()
        async with World(other) as world, remote(world, mine, expect=expect):
            world.other.command(LANE_CHANGE)
            await holds(lambda: "finished" in mine.names())
            assert mine.names() == ["load", "finished"] and other.names() == ["load"]
            assert mine.told[0][1].selected == other.told[0][1].selected
            await holds(lambda: world.other.neighbours[BRIDGED].speed_mm_s == mine.speed_mm_s)

    run(test())


def test_remote_reconnects_within_a_commitment() -> None:
    async def test() -> None:
        other, mine = Recorder(maneuver_ms=60_000), Recorder()
        async with World(other) as world, remote(world, mine, expect=[LANE_CHANGE]) as it:
            world.other.command(LANE_CHANGE)
            await holds(lambda: mine.names() == ["load"])
            before = it._socket
            before.transport.abort()
            await holds(lambda: it._socket not in (None, before) and it.connected.is_set())
            await holds(lambda: other.names() == ["load"])
            world.other.command(other.told[0][1].complete())
            await holds(lambda: "finished" in mine.names())
            assert mine.names() == ["load", "finished"]

    run(test())


def test_remote_falls_back_by_itself() -> None:
    async def test() -> None:
        other, mine = Recorder(maneuver_ms=60_000), Recorder()
        async with World(other) as world, remote(world, mine, expect=[LANE_CHANGE]) as it:
            world.other.command(LANE_CHANGE)
            await holds(lambda: mine.names() == ["load"])
            port = world.bridge.port
            await world.bridge.close()
            await holds(lambda: len(mine.told) == 2)
            assert mine.told[-1] == ("fallback", (OTHER, 1), "bridge_loss")
            await holds(lambda: other.told[-1:] == [("fallback", (OTHER, 1), "abort")])
            it.command(LANE_CHANGE)
            await holds(lambda: mine.told[-1:] == [("refused", "request", "unreachable")])
            world.bridge._port = port
            await world.bridge.open()
            await asyncio.wait_for(it.connected.wait(), PATIENCE)
            it.command(LANE_CHANGE)
            await holds(lambda: world.bridged.state.bound)
            assert len(mine.told) == 3  # the bridge's "alone" is no news

    run(test())


def test_remote_that_let_go_says_so() -> None:
    """The bridge goes quiet, but hears: the vehicle drives alone, so the session must end."""

    async def test() -> None:
        class Quiet(WebSocketBridge):
            quiet = False

            def _publish(self, topic: str, text: str) -> None:
                if not self.quiet:
                    super()._publish(topic, text)

        other, mine, bridge = Recorder(maneuver_ms=60_000), Recorder(), Quiet(port=0)
        async with World(other, bridge) as world, remote(world, mine, expect=[LANE_CHANGE]) as it:
            world.other.command(LANE_CHANGE)
            await holds(lambda: mine.names() == ["load"])
            bridge.quiet, before = True, it._socket
            await holds(lambda: mine.told[-1:] == [("fallback", (OTHER, 1), "bridge_loss")])
            await holds(lambda: other.told[-1:] == [("fallback", (OTHER, 1), "abort")])
            await holds(lambda: it._socket not in (None, before))

    run(test())


def test_an_answer_that_was_lost_is_said_again() -> None:
    async def test() -> None:
        class Deaf(WebSocketBridge):
            deaf = True

            def _accept(self, message: Any) -> None:
                if self.deaf:
                    self.deaf = False
                    it._socket.transport.abort()
                else:
                    super()._accept(message)

        other, mine = Recorder(), Recorder()
        async with (
            World(other, Deaf(port=0)) as world,
            remote(world, mine, expect=[LANE_CHANGE]) as it,
        ):
            world.other.command(LANE_CHANGE)
            await holds(lambda: mine.names() == ["load", "finished"])

    run(test())


def test_an_exception_of_the_application_ends_the_run() -> None:
    async def test() -> None:
        class Broken(Recorder):
            def kinematics(self, now_ms: int) -> Kinematics:
                if now_ms > 200:
                    raise RuntimeError("no position")
                return Kinematics()

        async with World(Recorder()) as world:
            with pytest.raises(RuntimeError, match="no position"):
                await RemoteApplication(Broken(), world.uri).run()

    run(test())


# -- clear errors


@pytest.mark.parametrize("host", ["0.0.0.0", "192.168.7.9", "::", "", "example.org"])
def test_only_loopback(host: str) -> None:
    with pytest.raises(LinkError, match=f"'{host}' is not a loopback address"):
        WebSocketBridge(host)
    WebSocketBridge(host, allow_remote=True)


@pytest.mark.parametrize("host", ["127.0.0.1", "::1", "localhost", "127.9.9.9"])
def test_loopback(host: str) -> None:
    WebSocketBridge(host)


def test_no_such_port() -> None:
    with pytest.raises(LinkError, match="port 65536"):
        WebSocketBridge(port=65_536)


def test_port_in_use() -> None:
    async def test() -> None:
        async with World(Recorder()) as world:
            port = world.bridge.port
            with pytest.raises(LinkError, match=f"cannot listen on ws://127.0.0.1:{port}: "):
                await World(Recorder(), WebSocketBridge(port=port)).bridge.open()

    run(test())


@pytest.mark.parametrize(
    ("uri", "problem"),
    [
        ("ws://127.0.0.1:1", "cannot reach the bridge at ws://127.0.0.1:1: "),
        ("nonsense", "no addr"),
    ],
)
def test_unreachable(uri: str, problem: str) -> None:
    async def test() -> None:
        application = RemoteApplication(Recorder(), uri, attempts=2, backoff_ms=(1, 2))
        with pytest.raises(LinkError, match=problem):
            await application.run()

    run(test())


def test_without_websockets_it_says_what_to_install() -> None:
    code = "import sys; sys.modules['websockets'] = None; import automcm.links.{}"
    for module in ("bridge", "remote"):
        command = [sys.executable, "-c", code.format(module)]
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        last = done.stderr.splitlines()[-1]
        assert done.returncode == 1 and "pip install 'automcm[ws]'" in last, done.stderr
        assert "LinkError" in last


# -- peers that flood, stall or send rubbish

FULL_POINT = {"time_from_start": {}, "pose": {}}
FULL_POSE = {
    "position": {"x": 1 / 3, "y": 1 / 3, "z": 1 / 3},
    "orientation": {"x": 1 / 3, "y": 1 / 3, "z": 1 / 3, "w": 1 / 3},
}


@pytest.mark.parametrize(
    ("sent", "problem"),
    [
        ("", "no JSON"),
        ("{", "no JSON"),
        ("[]", "a JSON object"),
        ("null", "a JSON object"),
        ("[" * 30_000, "no JSON"),
        ('{"op":' + '{"a":' * 5000 + "1" + "}" * 5001, "no JSON"),
        ('{"op":' + "9" * 5000 + "}", "no JSON"),
        ('{"op":NaN}', "no JSON"),
        ("[" + "[]," * 300_000 + "[]]", "commas and brackets"),
        (b'{"op":"subscribe"}', "binary"),
        ("{}", "op"),
        ('{"op":1}', "op"),
        ('{"op":"call_service"}', "'call_service' is not supported"),
        ('{"op":"fragment"}', "not supported"),
        ('{"op":"png"}', "not supported"),
        ('{"op":"subscribe"}', "topic"),
        ('{"op":"subscribe","topic":["a"]}', "topic"),
        ('{"op":"subscribe","topic":"/v2x/mcm/input/plan"}', "topic"),
        ('{"op":"subscribe","topic":"/v2x/mcm/output/state","type":"x"}', "type"),
        ('{"op":"subscribe","topic":"/v2x/mcm/output/state","compression":"png"}', "compression"),
        ('{"op":"unsubscribe","topic":"x"}', "topic"),
        ('{"op":"advertise","topic":"x"}', "topic"),
        ('{"op":"publish","topic":"/v2x/mcm/output/drive","msg":{}}', "topic"),
        ({}, "msg.session: Field required"),
        ({"session": {"prescriber": 0, "number": 1}}, "msg.session"),
        ({"session": {"prescriber": 1, "number": -1}}, "msg.session.number"),
        ({"session": {"prescriber": True, "number": 1}}, "msg.session.prescriber"),
        ({"session": {"prescriber": 1, "number": 1}, "more": 1}, "msg.more"),
        ({"session": {"prescriber": 1, "number": 1}, "header": {"frame_id": "odom"}}, "frame_id"),
        (None, "msg"),
    ],
)
def test_rubbish(sent: Any, problem: str) -> None:
    async def test() -> None:
        async with World(Recorder()) as world, client(world, drives=False) as it:
            if isinstance(sent, str | bytes):
                await it.socket.send(sent)
            else:
                await it.op(op="publish", topic="/v2x/mcm/input/abort", msg=sent)
            assert problem in await it.status()
            await it.subscribe("state")
            await it.until("state", driver=False)

    run(test())


@pytest.mark.parametrize(
    ("point", "problem"),
    [
        ({"time_from_start": {"sec": 2**31}}, "time_from_start.sec"),
        ({"time_from_start": {"nanosec": 10**9}}, "time_from_start.nanosec"),
        ({"time_from_start": {"sec": 1.5}}, "time_from_start.sec"),
        ({"pose": {"position": {"x": 1.1e9}}}, "pose.position.x"),
        ({"pose": {"position": {"y": "1"}}}, "pose.position.y"),
        ({"longitudinal_velocity_mps": True}, "longitudinal_velocity_mps"),
        ({"front_wheel_angle_rad": 10**400}, "front_wheel_angle_rad"),
        ({"speed": 1.0}, "speed: Extra"),
    ],
)
def test_a_point_out_of_bounds(point: dict[str, Any], problem: str) -> None:
    async def test() -> None:
        async with World(Recorder()) as world, client(world, drives=False) as it:
            trajectory = {"points": [FULL_POINT | point]}
            await it.publish("plan", scenarios=["a"], trajectory=trajectory)
            assert f"msg.trajectory.points.0.{problem}" in await it.status()

    run(test())


def test_infinity_by_exponent_is_refused() -> None:
    async def test() -> None:
        async with World(Recorder()) as world, client(world, drives=False) as it:
            await it.socket.send(
                '{"op":"publish","id":"mine","topic":"/v2x/mcm/input/kinematics",'
                '"msg":{"pose":{"pose":{"position":{"x":1e400}}}}}'
            )
            status = await it.read(lambda fields: fields["op"] == "status")
            assert "msg.pose.pose.position.x" in status["msg"] and status["id"] == "mine"

    run(test())


def test_times_must_grow_and_points_are_bounded() -> None:
    async def test() -> None:
        async with World(Recorder()) as world, client(world, drives=False) as it:
            standing = points((0, 0.0, 0.0), (1, 1.0, 0.0), (1, 2.0, 0.0))
            await it.publish("plan", scenarios=["a"], trajectory=standing)
            assert "msg.trajectory.points.2.time_from_start" in await it.status()
            many = points(*((n, 0.0, 0.0) for n in range(autoware.MAX_POINTS + 1)))
            await it.publish("plan", scenarios=["a"], trajectory=many)
            assert "msg.trajectory.points" in await it.status()
            full = {"time_from_start": {"sec": 0, "nanosec": 0}, "pose": FULL_POSE} | dict.fromkeys(
                list(autoware.TrajectoryPoint.model_fields)[2:], 1 / 3
            )
            way = [full | {"time_from_start": {"sec": n}} for n in range(autoware.MAX_POINTS)]
            await it.publish("plan", scenarios=["a"], trajectory={"points": way})
            await it.publish("request", scenario="a", details={"a": ["x" * 100] * 100})
            assert "msg.details" in await it.status()
            await it.publish("request", scenario="a", details={"a": 1.5})
            assert "msg.details.a" in await it.status()
            await it.subscribe("state")
            await it.until("state", driver=True, phase="STANDALONE")

    run(test())


def test_too_long_a_message_ends_the_connection_only() -> None:
    async def test() -> None:
        async with World(Recorder()) as world:
            async with client(world, drives=False) as it:
                await it.socket.send("x" * (ros.MAX_IN + 1))
                with pytest.raises(ConnectionClosed, match="1009"):
                    await it.status()
            async with client(world, "state", drives=False) as it:
                await it.until("state")

    run(test())


def test_web_pages_are_refused() -> None:
    async def test() -> None:
        async with World(Recorder(), WebSocketBridge(port=0, origins=["https://ours"])) as world:
            with pytest.raises(InvalidStatus, match="403"):
                await connect(world.uri, additional_headers={"Origin": "https://theirs"})
            async with connect(world.uri, additional_headers={"Origin": "https://ours"}):
                pass

    run(test())


def test_clients_are_bounded(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("automcm.links.bridge.HANDSHAKE_S", 3 * PATIENCE)

    async def test() -> None:
        async with World(Recorder(), WebSocketBridge(port=0, max_clients=2)) as world:
            async with client(world, drives=False), client(world, "state", drives=False) as it:
                await it.until("state")
                with pytest.raises(InvalidStatus, match="503"):
                    await connect(world.uri)
            server = world.bridge._server
            assert server is not None
            with contextlib.ExitStack() as silent:
                many = range(MAX_SOCKETS + 20)
                sockets = [silent.enter_context(raw(world, handshake=False)) for _ in many]
                await holds(lambda: sum(map(cut_off, sockets)) >= 20)
                await holds(lambda: len(server.handler_tasks) <= MAX_SOCKETS)
            await holds(lambda: len(server.handler_tasks) == 0)
            async with client(world, "state", drives=False) as it:
                await it.until("state")

    run(test())


def raw(world: World, handshake: bool = True) -> socket.socket:
    """A TCP connection, and the beginning of a WebSocket on it; nothing is read."""
    connection = socket.socket()
    connection.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
    connection.connect(("127.0.0.1", world.bridge.port))
    if handshake:
        key = base64.b64encode(os.urandom(16)).decode()
        connection.sendall(
            f"GET / HTTP/1.1\r\nHost: 127.0.0.1:{world.bridge.port}\r\nUpgrade: websocket\r\n"
            "Connection: Upgrade\r\nSec-WebSocket-Version: 13\r\n"
            f"Sec-WebSocket-Key: {key}\r\n\r\n".encode()
        )
    return connection


def cut_off(connection: socket.socket) -> bool:
    connection.setblocking(False)
    try:
        return connection.recv(1) == b""
    except BlockingIOError:
        return False
    except ConnectionError:
        return True


def frame(payload: bytes, opcode: int = 1) -> bytes:
    """A frame, masked with zeros."""
    size = len(payload)
    head = bytes([0x80 | opcode])
    if size < 126:
        head += bytes([0x80 | size])
    else:
        head += bytes([0x80 | 126]) + struct.pack("!H", size)
    return head + bytes(4) + payload


@contextlib.contextmanager
def flooding(world: World, *contents: bytes) -> Iterator[Callable[[], int]]:
    """A process for each content, which sends it as fast as it can; how many were cut off."""
    code = (
        "import socket, sys\n"
        "s = socket.socket(fileno=int(sys.argv[1])); s.settimeout(None)\n"
        "data = sys.stdin.buffer.read()\n"
        "try:\n"
        "    while True: s.sendall(data)\n"
        "except OSError: sys.exit(3)\n"
    )
    processes = []
    for content in contents:
        connection = raw(world)
        processes.append(
            subprocess.Popen(
                [sys.executable, "-c", code, str(connection.fileno())],
                stdin=subprocess.PIPE,
                pass_fds=[connection.fileno()],
            )
        )
        connection.close()
        pipe = processes[-1].stdin
        assert pipe is not None
        pipe.write(content)
        pipe.close()
    try:
        yield lambda: sum(process.poll() == 3 for process in processes)
    finally:
        for process in processes:
            process.kill()
            process.wait()


RUBBISH = frame(b"rubbish") * 200
QUIET_FLOOD = frame(b'{"op":"unadvertise","topic":"/v2x/mcm/input/plan"}') * 200


def test_a_session_during_a_flood() -> None:
    """The flood is never answered, so it goes on, and goes on during a whole session."""

    async def test() -> None:
        other = Recorder()
        async with World(other) as world, client(world, "state", "drive", "proposal") as it:
            with flooding(world, QUIET_FLOOD, QUIET_FLOOD) as lost:
                await holds(lambda: len(world.bridge._clients) == 3)
                await committed(world, it)
                await it.until("drive", mode="alone", reason="finished")
                assert lost() == 0

    run(test())


def test_who_floods_and_does_not_read_is_cut_off(monkeypatch: pytest.MonkeyPatch) -> None:
    """What is rubbish is answered; who does not read the answers has no room for more."""
    monkeypatch.setattr(ros, "MAX_OUT", 2**18)

    async def test() -> None:
        async with World(Recorder()) as world, client(world, "state") as it:
            with flooding(world, RUBBISH, frame(b"x" * 125, opcode=9) * 100) as lost:
                async with asyncio.timeout(2 * PATIENCE):
                    while lost() < 2:
                        await it.until("state")
            await it.until("state", driver=True)
            await holds(lambda: len(world.bridge._clients) == 1)

    run(test())


def test_who_stalls_is_cut_off_and_nobody_else() -> None:
    async def test() -> None:
        async with World(Recorder()) as world, client(world, "proposal", "state") as it:
            stalled = raw(world)
            stalled.sendall(frame(b'{"op":"subscribe","topic":"/v2x/mcm/output/proposal"}'))
            await holds(lambda: len(world.bridge._clients) == 2)
            await holds(lambda: all(each.topics for each in world.bridge._clients))
            way = Trajectory(t0=0, points=tuple((n, n, n) for n in range(autoware.MAX_POINTS)))
            asked = 0
            while len(world.bridge._clients) == 2:
                asked += 1
                assert asked < 100
                world.bridge.verify(Proposal((OTHER, 1), asked, way, 0, 1000))
                await it.until("proposal", proposal=asked)
            stalled.close()
            await it.until("state", driver=True)

    run(test())


# -- what does not fit


def test_a_proposal_that_cannot_be_shown_is_refused() -> None:
    async def test() -> None:
        class Winding(Recorder):
            def trajectory(self, per_cent: int = 100) -> Trajectory:
                return Trajectory(t0=0, points=tuple((n, 0, 0) for n in range(1001)))

            def _proposal(self, choice: Any) -> Any:
                self.told.append(("choose", choice.proposal))
                return super()._proposal(choice)

        other = Winding()
        async with World(other) as world, client(world, "state", "proposal", "drive") as it:
            await plans(it)
            await it.until("state", driver=True)
            world.other.command(LANE_CHANGE)
            await holds(lambda: "fallback" in other.names())
            assert other.names() == ["choose", "choose", "choose", "fallback"]
            await it.until("drive", mode="alone", reason="no_agreement")
            await it.publish("request", scenario="lane_change")  # and so is what it plans
            await it.until("drive", mode="alone", reason="unreadable")

    run(test())


# -- conversion

COORDINATE = st.integers(-(10**12), 10**12)
TRAJECTORY = st.builds(
    lambda t0, start, steps, places: Trajectory(
        t0=t0,
        points=tuple(
            (t, *place) for t, place in zip(accumulate(steps, initial=start), places, strict=False)
        ),
    ),
    st.integers(-(2**31) * 1000, 2**31 * 1000 - 1),
    st.integers(-(10**6), 10**6),
    st.lists(st.integers(1, 10**6), max_size=20),
    st.lists(st.tuples(COORDINATE, COORDINATE), min_size=1, max_size=20),
)


@given(TRAJECTORY)
def test_trajectories_come_back_as_they_were(trajectory: Trajectory) -> None:
    try:
        form = autoware.to_trajectory(trajectory)
    except MessageError as error:  # a speed beyond 10^9 m/s
        assert "longitudinal_velocity_mps" in str(error)
        return
    again = autoware.AutowareTrajectory.model_validate(json.loads(form.model_dump_json()))
    assert autoware.trajectory(again) == trajectory


@given(st.integers(-3141, 3141), COORDINATE, COORDINATE, COORDINATE)
def test_kinematics_come_back_as_they_were(heading: int, x: int, y: int, speed: int) -> None:
    at = Kinematics(x_mm=x, y_mm=y, heading_mrad=heading, speed_mm_s=speed)
    form = autoware.to_odometry(at, 5).model_dump_json()
    assert autoware.kinematics(autoware.Odometry.model_validate(json.loads(form))) == at


def test_velocity_and_heading_are_those_to_the_next_point() -> None:
    way = Trajectory(t0=0, points=((0, 0, 0), (500, 0, 2000), (1000, 0, 2000), (2000, -1000, 2000)))
    form = autoware.to_trajectory(way)
    speeds = [point.longitudinal_velocity_mps for point in form.points]
    assert speeds == [4.0, 0.0, 1.0, 1.0]
    yaws = [point.pose.orientation.yaw for point in form.points]
    assert yaws == pytest.approx([math.pi / 2, math.pi / 2, math.pi, math.pi])


@pytest.mark.parametrize(
    ("way", "problem"),
    [
        (Trajectory(t0=0, points=((0, 10**13, 0),)), "there.points.0|there.x"),
        (Trajectory(t0=2**31 * 1000, points=((0, 0, 0),)), "sec"),
        (Trajectory(t0=0, points=((5, 0, 0), (5, 0, 0))), "there.points.1.time_from_start"),
    ],
)
def test_what_autoware_cannot_hold(way: Trajectory, problem: str) -> None:
    with pytest.raises(MessageError, match=problem):
        autoware.to_trajectory(way, "there")


def test_a_largest_trajectory_fits_a_message() -> None:
    from automcm.codec import MAX_BYTES
    from automcm.messages import LIMIT, Prescription, encode

    far = -(10**12)
    points = tuple((-(2**31) * 1000 + n, far, far) for n in range(autoware.MAX_POINTS))
    largest = Prescription(
        src=2**32 - 1,
        dst=2**32 - 1,
        session=(2**32 - 1, LIMIT),
        seq=LIMIT,
        proposal=LIMIT,
        prescribed=Trajectory(t0=-(2**31) * 1000, points=points),
        hold_ms=LIMIT,
        lease_ms=LIMIT,
    )
    assert len(encode(largest)) + ros.MAX_DETAILS + 6 * 256 < MAX_BYTES
