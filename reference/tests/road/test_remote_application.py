"""The vehicle's side of the bridge, with an application of application.py."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import AsyncIterator
from typing import Any

import pytest
from bridge_stage import BRIDGED, OTHER, PATIENCE, Recorder, World, holds

from automcm.bridge.websocket_bridge import WebSocketBridge
from automcm.service.application import Application, Kinematics
from automcm_simulation.road.remote_application import RemoteApplication
from automcm_simulation.road.straight_lane import LANE_CHANGE
from automcm_spec.vocabulary.application import Abort

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


async def test_remote_prescriber() -> None:
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


@pytest.mark.sweep(1)
@pytest.mark.parametrize("expect", [(), (LANE_CHANGE,)])
async def test_remote_receiver(expect: Any) -> None:
    other, mine = Recorder(), Recorder()
    async with World(other) as world, remote(world, mine, expect=expect) as it:
        await holds(lambda: [each.station_id for each in it.heard() or ()] == [OTHER])
        world.other.command(LANE_CHANGE)
        await holds(lambda: "finished" in mine.names())
        assert mine.names() == ["load", "finished"] and other.names() == ["load"]
        assert mine.told[0][1].selected == other.told[0][1].selected
        await holds(lambda: world.other.neighbours[BRIDGED].speed_mm_s == mine.speed_mm_s)


async def test_remote_reconnects_within_a_commitment() -> None:
    other, mine = Recorder(maneuver_ms=60_000), Recorder()
    async with World(other) as world, remote(world, mine, expect=[LANE_CHANGE]) as it:
        world.other.command(LANE_CHANGE)
        await holds(lambda: mine.names() == ["load"])
        before, driver = it._socket, world.bridge._role.driver
        before.transport.abort()
        await holds(lambda: it._socket not in (None, before) and it.connected.is_set())
        await holds(lambda: other.names() == ["load"])
        assert isinstance(driver, str), "it has given itself a name"
        await holds(lambda: world.bridge._role.driver == driver)
        world.other.command(other.told[0][1].complete())
        await holds(lambda: "finished" in mine.names())
        assert mine.names() == ["load", "finished"]


@pytest.mark.slow
async def test_remote_that_let_go_says_so() -> None:
    """The bridge goes quiet, but hears: the vehicle drives alone, so the session must end."""

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


async def test_an_answer_that_was_lost_is_said_again() -> None:
    class Deaf(WebSocketBridge):
        deaf = True

        def _accept(self, message: Any) -> None:
            if self.deaf:
                self.deaf = False
                it._socket.transport.abort()
            else:
                super()._accept(message)

    other, mine = Recorder(), Recorder()
    async with World(other, Deaf(port=0)) as world, remote(world, mine, expect=[LANE_CHANGE]) as it:
        world.other.command(LANE_CHANGE)
        await holds(lambda: mine.names() == ["load", "finished"])


async def test_an_exception_of_the_application_ends_the_run() -> None:
    class Broken(Recorder):
        def kinematics(self, now_ms: int) -> Kinematics:
            if now_ms > 200:
                raise RuntimeError("no position")
            return Kinematics(0, 0, 0, 0)

    async with World(Recorder()) as world:
        with pytest.raises(RuntimeError, match="no position"):
            await RemoteApplication(Broken(), world.uri).run()
