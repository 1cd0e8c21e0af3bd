"""The bridge among peers that flood, stall or send rubbish, and its errors."""

from __future__ import annotations

import asyncio
import base64
import contextlib
import os
import socket
import struct
import subprocess
import sys
from collections.abc import Callable, Iterator
from typing import Any

import pytest
from bridge_stage import (
    BRIDGED,
    OTHER,
    PATIENCE,
    TOKEN,
    Operator,
    Recorder,
    World,
    client,
    committed,
    holds,
    now_ms,
    plans,
    points,
)
from websockets.asyncio.client import connect
from websockets.exceptions import ConnectionClosed, InvalidStatus

from automcm.bridge import autoware
from automcm.bridge import rosbridge as ros
from automcm.bridge.bounded_socket import MAX_HALF_OPEN, MAX_OF_ADDRESS
from automcm.bridge.websocket_bridge import WebSocketBridge
from automcm.links.link import LinkError
from automcm.service.application import Proposal
from automcm_simulation.road.remote_application import RemoteApplication
from automcm_simulation.road.simulation import Simulation
from automcm_simulation.road.straight_lane import LANE_CHANGE
from automcm_spec.vocabulary.messages import Trajectory

# -- clear errors


@pytest.mark.parametrize("host", ["0.0.0.0", "192.168.7.9", "::", "", "example.org"])
def test_only_loopback(host: str) -> None:
    with pytest.raises(LinkError, match=f"'{host}' is not a loopback address"):
        WebSocketBridge(host)
    with pytest.raises(LinkError, match=f"'{host}' .* needs a token"):
        WebSocketBridge(host, allow_remote=True)
    WebSocketBridge(host, allow_remote=True, token=TOKEN)


@pytest.mark.parametrize("host", ["127.0.0.1", "::1", "localhost", "127.9.9.9"])
def test_loopback(host: str) -> None:
    WebSocketBridge(host)


def test_no_such_port() -> None:
    with pytest.raises(LinkError, match="not 65536"):
        WebSocketBridge(port=65_536)


async def test_port_in_use() -> None:
    async with World(Recorder()) as world:
        port = world.bridge.port
        with pytest.raises(LinkError, match=f"cannot listen on ws://127.0.0.1:{port}: "):
            await World(Recorder(), WebSocketBridge(port=port)).bridge.open()


@pytest.mark.parametrize(
    ("uri", "problem"),
    [
        ("ws://127.0.0.1:1", "cannot reach the bridge at ws://127.0.0.1:1: "),
        ("nonsense", "expected the address"),
    ],
)
async def test_unreachable(uri: str, problem: str) -> None:
    application = RemoteApplication(Recorder(), uri, attempts=2, backoff_ms=(1, 2))
    with pytest.raises(LinkError, match=problem):
        await application.run()


@pytest.mark.slow
def test_without_websockets_it_says_what_to_install() -> None:
    code = "import sys; sys.modules['websockets'] = None; import {}"
    for module in ("automcm.bridge.websocket_bridge", "automcm_simulation.road.remote_application"):
        command = [sys.executable, "-c", code.format(module)]
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        last = done.stderr.splitlines()[-1]
        assert done.returncode == 1 and "pip install 'automcm[ws]'" in last, done.stderr
        assert "LinkError" in last


# -- peers that flood, stall or send rubbish

ABORT = "/v2x/mcm/input/abort"


def operator() -> Operator:
    """Of a bridge in virtual time."""
    bridge = WebSocketBridge()
    Simulation().add(BRIDGED, bridge)
    return Operator(bridge)


FULL_POINT = {"time_from_start": {}, "pose": {"position": {"x": 0.0, "y": 0.0}}}
FULL_POSE = {
    "position": {"x": 1 / 3, "y": 1 / 3, "z": 1 / 3},
    "orientation": {"x": 1 / 3, "y": 1 / 3, "z": 1 / 3, "w": 1 / 3},
}


@pytest.mark.parametrize(
    ("sent", "problem"),
    [
        ("", "not JSON"),
        ("[]", "a JSON object"),
        ("[" * 30_000, "not JSON"),
        ('{"op":' + '{"a":' * 5000 + "1" + "}" * 5001, "not JSON"),
        ('{"op":' + "9" * 5000 + "}", "not JSON"),
        ('{"op":NaN}', "not JSON"),
        ("[" + "[]," * 300_000 + "[]]", "commas and brackets"),
        (b'{"op":"subscribe"}', "binary"),
        ("{}", "op"),
        ('{"op":1}', "op"),
        ('{"op":"call_service"}', "'call_service' is not supported"),
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
    it = operator()
    if isinstance(sent, str | bytes):
        it.bridge._take(it.client, sent)
    else:
        it.publish("abort", **sent) if sent is not None else it.op(op="publish", topic=ABORT)
    (status,) = it.statuses()
    assert problem in status


@pytest.mark.parametrize(
    ("point", "problem"),
    [
        ({"time_from_start": {"sec": 2**31}}, "time_from_start.sec"),
        ({"time_from_start": {"nanosec": 10**9}}, "time_from_start.nanosec"),
        ({"time_from_start": {"sec": 1.5}}, "time_from_start.sec"),
        ({"pose": {"position": {"x": 1.1e9, "y": 0.0}}}, "pose.position.x"),
        ({"pose": {"position": {"x": 0.0, "y": "1"}}}, "pose.position.y"),
        ({"longitudinal_velocity_mps": True}, "longitudinal_velocity_mps"),
        ({"front_wheel_angle_rad": 10**400}, "front_wheel_angle_rad"),
        ({"speed": 1.0}, "speed: Extra"),
    ],
)
def test_a_point_out_of_bounds(point: dict[str, Any], problem: str) -> None:
    it = operator()
    it.publish("plan", scenarios=["a"], trajectory={"points": [FULL_POINT | point]})
    (status,) = it.statuses()
    assert f"msg.trajectory.points.0.{problem}" in status


async def test_infinity_by_exponent_is_refused() -> None:
    async with World(Recorder()) as world, client(world, drives=False) as it:
        await it.socket.send(
            '{"op":"publish","id":"mine","topic":"/v2x/mcm/input/kinematics",'
            '"msg":{"pose":{"pose":{"position":{"x":1e400}}}}}'
        )
        status = await it.read(lambda fields: fields["op"] == "status")
        assert "msg.pose.pose.position.x" in status["msg"] and status["id"] == "mine"
        await it.subscribe("state")
        await it.until("state", driver=False)


def test_times_must_grow_and_points_and_details_are_bounded() -> None:
    it = operator()
    standing = points((0, 0.0, 0.0), (1, 1.0, 0.0), (1, 2.0, 0.0))
    many = points(*((n, 0.0, 0.0) for n in range(autoware.MAX_POINTS + 1)))
    for way in (standing, many):
        it.publish("plan", scenarios=["a"], trajectory=way)
    for details in ({"a": ["x" * 100] * 100}, {"a": 1.5}):
        it.publish("request", scenario="a", details=details)
    where = [status.partition(":")[0] for status in it.statuses()]
    assert where == [
        *("msg.trajectory.points.2.time_from_start", "msg.trajectory.points"),
        *("msg.details", "msg.details.a"),
    ]


async def test_the_most_points_fit_a_message() -> None:
    async with World(Recorder()) as world, client(world, "state", drives=False) as it:
        full = {"time_from_start": {"sec": 0, "nanosec": 0}, "pose": FULL_POSE} | dict.fromkeys(
            list(autoware.TrajectoryPoint.model_fields)[2:], 1 / 3
        )
        way = [full | {"time_from_start": {"sec": n}} for n in range(autoware.MAX_POINTS)]
        await it.publish("plan", scenarios=["a"], trajectory=points(ms=now_ms()) | {"points": way})
        await it.until("state", driver=True, phase="STANDALONE")


async def test_too_long_a_message_ends_the_connection_only() -> None:
    async with World(Recorder()) as world:
        async with client(world, drives=False) as it:
            await it.socket.send("x" * (ros.MAX_IN + 1))
            with pytest.raises(ConnectionClosed, match="1009"):
                await it.status()
        async with client(world, "state", drives=False) as it:
            await it.until("state")


async def test_web_pages_are_refused() -> None:
    async with World(Recorder(), WebSocketBridge(port=0, origins=["https://ours"])) as world:
        with pytest.raises(InvalidStatus, match="403"):
            await connect(world.uri, additional_headers={"Origin": "https://theirs"})
        async with connect(world.uri, additional_headers={"Origin": "https://ours"}):
            pass


@pytest.mark.parametrize("of_address", [MAX_OF_ADDRESS, MAX_HALF_OPEN + 1])
async def test_half_open_connections_lock_nobody_out(
    of_address: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Neither those of one address nor those of all: a new connection displaces the oldest."""
    monkeypatch.setattr("automcm.bridge.websocket_bridge.HANDSHAKE_S", 3 * PATIENCE)
    monkeypatch.setattr("automcm.bridge.bounded_socket.MAX_OF_ADDRESS", of_address)
    most = min(of_address, MAX_HALF_OPEN)
    async with World(Recorder()) as world:
        server = world.bridge._server
        assert server is not None
        with contextlib.ExitStack() as silent:
            many = range(most + 20)
            sockets = [silent.enter_context(raw(world, handshake=False)) for _ in many]
            await holds(lambda: all(map(cut_off, sockets[:20])))
            await holds(lambda: len(server.handler_tasks) == most)
            async with client(world, "state", drives=False) as it:
                await it.until("state")
            assert not any(map(cut_off, sockets[21:]))
        await holds(lambda: len(server.handler_tasks) == 0)


async def test_clients_are_bounded() -> None:
    async with World(Recorder(), WebSocketBridge(port=0, max_clients=2)) as world:
        async with client(world, drives=False), client(world, "state", drives=False) as it:
            await it.until("state")
            with pytest.raises(InvalidStatus, match="503"):
                await connect(world.uri)
        async with client(world, "state", drives=False) as it:
            await it.until("state")


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


@pytest.mark.slow
async def test_a_session_during_a_flood() -> None:
    """The flood is never answered, so it goes on, and goes on during a whole session."""

    other = Recorder()
    async with World(other) as world, client(world, "state", "drive", "proposal") as it:
        with flooding(world, QUIET_FLOOD, QUIET_FLOOD) as lost:
            await holds(lambda: len(world.bridge._clients) == 3)
            await committed(world, it)
            await it.until("drive", mode="alone", reason="finished")
            assert lost() == 0


async def test_who_floods_and_does_not_read_is_cut_off(monkeypatch: pytest.MonkeyPatch) -> None:
    """What is rubbish is answered; who does not read the answers has no room for more."""
    monkeypatch.setattr(ros, "MAX_OUT", 2**18)

    async with World(Recorder()) as world, client(world, "state") as it:
        with flooding(world, RUBBISH, frame(b"x" * 125, opcode=9) * 100) as lost:
            async with asyncio.timeout(2 * PATIENCE):
                while lost() < 2:
                    await it.until("state")
        await it.until("state", driver=True)
        await holds(lambda: len(world.bridge._clients) == 1)


@pytest.mark.slow
async def test_who_stalls_is_cut_off_and_nobody_else() -> None:
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


# -- what does not fit


async def test_a_proposal_that_cannot_be_shown_is_refused() -> None:
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
