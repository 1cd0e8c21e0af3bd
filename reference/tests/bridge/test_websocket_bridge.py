"""The bridge (docs/bridge.md): whole sessions, and connections that are lost."""

from __future__ import annotations

import pytest
from bridge_stage import (
    BRIDGED,
    OTHER,
    SLOWER,
    Operator,
    Recorder,
    World,
    client,
    committed,
    here,
    holds,
    plans,
    points,
)

from automcm.bridge import autoware
from automcm.bridge import rosbridge as ros
from automcm.bridge.websocket_bridge import MAX_IDS, WebSocketBridge
from automcm_simulation.road.simulation import Simulation
from automcm_simulation.road.straight_lane import LANE_CHANGE
from automcm_spec.vocabulary.application import Abort
from automcm_spec.vocabulary.messages import Trajectory

# -- whole sessions


async def test_prescriber() -> None:
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
        assert other.told[0][1].selected == Trajectory(t0=0, points=((0, 0, 0), (1000, 5500, 125)))
        cam = world.other.neighbours[BRIDGED]
        assert (cam.x_mm, cam.y_mm, cam.heading_mrad, cam.speed_mm_s) == (12500, -3250, 100, 8333)


async def test_receiver() -> None:
    other = Recorder()
    topics = ("state", "drive", "proposal", "advertised")
    async with World(other) as world, client(world, *topics) as it:
        drive = await committed(world, it)
        session = {"prescriber": OTHER, "number": 1}
        assert drive["session"] == session and drive["role"] == "receiver"
        selected = autoware.trajectory(ros.read(ros.DriveMsg, drive).selected)
        assert selected == other.trajectory(70)
        times = [autoware.Time(**drive[name]).ms for name in ("start", "until")]
        assert times[1] - times[0] == other.lease_ms
        await it.until("drive", mode="alone", session=session, reason="finished")
        told = [f["msg"] for f in it.seen if f.get("topic", "").endswith("advertised")]
        assert told[0]["concerned"] and told[0]["details"] == {"lane": 2}
        assert other.names() == ["load"]


@pytest.mark.slow
async def test_refuse_and_proceed() -> None:
    other = Recorder(refuse_first=1)
    topics = ("state", "drive", "proposal", "choice", "refused")
    async with World(other) as world, client(world, *topics) as it:
        await plans(it)
        await it.until("state", driver=True)
        world.other.command(LANE_CHANGE)
        asked = await it.until("proposal", proposal=1)
        await it.publish("refuse", session=asked["session"], proposal=1)
        asked = await it.until("proposal", proposal=2)
        assert not [f for f in it.seen if f["op"] == "status"], "nothing was wrong with it"
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


async def test_without_a_fresh_plan_nothing_concerns_it() -> None:
    other = Recorder()
    bridge = WebSocketBridge(port=0, plan_ms=0)
    async with World(other, bridge) as world, client(world, "state", "advertised") as it:
        await plans(it)
        await it.until("state", driver=True)
        world.other.command(LANE_CHANGE)
        assert not (await it.until("advertised"))["concerned"]
        await holds(lambda: other.told == [("fallback", (OTHER, 1), "no_participants")])


# -- connections that are lost


async def test_reconnects_and_learns_that_it_has_fallen_back() -> None:
    """It drops out of a commitment, which ends meanwhile."""
    other = Recorder(maneuver_ms=60_000)
    async with World(other) as world:
        async with client(world, "state", "drive", "proposal") as it:
            await committed(world, it)
        world.other.command(Abort(session=(OTHER, 1)))
        await holds(lambda: not world.bridged.state.bound)
        async with client(world, "drive") as it:
            told = await it.until("drive")
    assert (told["mode"], told["reason"]) == ("alone", "abort")
    assert told["session"] == {"prescriber": OTHER, "number": 1}


async def test_an_open_question_is_asked_again() -> None:
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


def test_nobody_ever_drove() -> None:
    """In virtual time: a session of a vehicle without driving software ends at the next CAM."""
    simulation = Simulation()
    simulation.add(BRIDGED, WebSocketBridge())
    simulation.request(BRIDGED, 500)
    simulation.run(500)
    assert simulation.services[BRIDGED].state.phase == "ADVERTISING"
    simulation.run(601)
    assert simulation.services[BRIDGED].state.phase == "STANDALONE"


# -- the age of what is kept


class Driven:
    """A bridged station and another one in virtual time, and the driving software, which publishes
    a plan for its own time every 100 ms."""

    def __init__(self) -> None:
        self.simulation, self.bridge, self.now = Simulation(), WebSocketBridge(), 0
        self.simulation.add(BRIDGED, self.bridge)
        self.other = self.simulation.add(OTHER, Recorder(maneuver_ms=60_000))
        self.it = Operator(self.bridge)
        self.bridge._clients.add(self.it.client)

    def run(self, until: int) -> None:
        while self.now < until:
            self.now += 100
            self.simulation.run(self.now)
            way = points((0, 0.0, 0.0), (1, 8.333, 0.0), ms=self.now)
            self.it.publish("plan", scenarios=["lane_change"], trajectory=way)


def test_end_1_a_driver_that_falls_silent_frees_the_peer() -> None:
    road = Driven()
    road.it.op(op="subscribe", topic=ros.ProposalMsg.topic)
    road.simulation.request(OTHER, 500)
    while not any(ros.ProposalMsg.topic in text for text in road.it.texts):
        road.it.publish("kinematics", **here(0.0, 0.0))
        road.run(road.now + 100)
    session = {"prescriber": OTHER, "number": 1}
    road.it.publish("accept", session=session, proposal=1)
    road.it.publish("kinematics", **here(0.0, 0.0))
    road.simulation.run(road.now + 100)
    assert road.simulation.services[BRIDGED].state.phase == "ACTUATING"
    road.simulation.run(road.now + 5000)
    assert road.other.application.names() == ["load", "fallback"]
    assert road.other.application.told[-1] == ("fallback", (OTHER, 1), "abort")
    assert '"reason":"no_driver"' in road.bridge._drive


def test_act_2_before_the_first_position_no_cam_is_sent() -> None:
    road = Driven()
    road.run(2000)
    assert BRIDGED not in road.other.neighbours
    (status,) = road.it.statuses()
    assert status == (
        "/v2x/mcm/input/kinematics: none of the last 500 ms; the station sends no CAM (ACT-2)"
    )


def test_act_2_an_old_position_is_no_position() -> None:
    road = Driven()
    road.run(1000)
    road.it.publish("kinematics", **here(100.0, 0.0))
    road.it.texts.clear()
    road.simulation.request(OTHER, 1000)
    road.run(2400)
    last = road.other.neighbours[BRIDGED]
    assert last.x_mm == 100_000 and 1400 <= last.received_ms < 1500
    assert len(road.it.statuses()) == 1
    untimed = points((0, 0.0, 0.0), (0, 8.333, 0.0))
    road.it.publish("plan", scenarios=["lane_change"], trajectory=untimed)
    assert "kinematics must be published first" in road.it.statuses()[-1]
    assert road.simulation.services[BRIDGED].state.bound
    road.run(2700)
    assert not road.simulation.services[BRIDGED].state.bound
    assert '"reason":"no_position"' in road.bridge._drive
    road.it.texts.clear()
    road.it.publish("kinematics", **here(200.0, 0.0))
    road.run(2800)
    assert road.other.neighbours[BRIDGED].x_mm == 200_000 and road.it.statuses() == []


@pytest.mark.parametrize(
    ("ms", "problem"),
    [
        (0, "10000 ms behind"),
        (8_999, "1001 ms behind"),
        (9_001, ""),
        (10_100, ""),
        (10_101, "101 ms ahead of"),
        (1_763_916_000_000, "1763915990000 ms ahead of"),
    ],
)
def test_a_stamp_far_from_the_service_s_clock_is_refused(ms: int, problem: str) -> None:
    """Of another time base, such as a simulation's, or as good as none."""
    road = Driven()
    road.run(10_000)
    road.it.texts.clear()
    way = points((0, 0.0, 0.0), (1, 8.333, 0.0), ms=ms)
    road.it.publish("plan", scenarios=["merge"], trajectory=way)
    road.it.publish("request", scenario="lane_change", planned=way)
    if ms:  # without a stamp it is of now
        road.it.publish("kinematics", header=way["header"], **here(0.0, 0.0))
    places = ["trajectory.", "planned.", ""][: 3 if ms else 2]
    if not problem:
        (old,) = road.it.statuses() if ms < 9_600 else ["msg.header"]
        assert old.startswith("msg.header") and "merge" in road.bridge._plans
        return
    assert [status[: status.index(";")] for status in road.it.statuses()] == [
        f"msg.{place}header.stamp: {problem} the service's clock" for place in places
    ]
    assert "merge" not in road.bridge._plans and road.bridge._kinematics is None


# -- subscriptions and drivers


@pytest.mark.parametrize(("ended", "left"), [({"id": "a"}, True), ({"id": "c"}, True), ({}, False)])
def test_an_id_ends_one_subscription(ended: dict[str, str], left: bool) -> None:
    simulation, bridge = Simulation(), WebSocketBridge()
    simulation.add(BRIDGED, bridge)
    it = Operator(bridge)
    topic = ros.StateMsg.topic
    for id_ in "ab":
        it.op(op="subscribe", topic=topic, id=id_)
    it.op(op="unsubscribe", topic=topic, **ended)
    assert (topic in it.client.topics) == left
    it.op(op="unsubscribe", topic=topic, id="a")
    it.op(op="unsubscribe", topic=topic, id="b")
    assert topic not in it.client.topics and it.statuses() == []
    for n in range(MAX_IDS + 1):
        it.op(op="subscribe", topic=topic, id=str(n))
    it.op(op="subscribe", topic=topic, id=7)
    assert [status[:8] for status in it.statuses()] == ["id: more", "id: must"]


async def test_one_connection_drives() -> None:
    async with World(Recorder()) as world, client(world, "state", drives=False) as watcher:
        async with client(world, "state") as it:
            await it.until("state", driver=True)
            await watcher.publish("request", scenario="lane_change")
            assert "another connection is the driver" in await watcher.status()
            await watcher.until("state", phase="STANDALONE", driver=True)
        await watcher.until("state", driver=False)
        await watcher.publish("request", scenario="lane_change")
        await watcher.until("state", phase="ADVERTISING", driver=True)
