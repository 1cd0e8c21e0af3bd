"""The session that docs/bridge.md shows, over a WebSocket."""

from __future__ import annotations

import asyncio
import json
import re
from pathlib import Path
from typing import Any

import pytest
from bridge_stage import Recorder, World, client

from automcm.bridge import autoware
from automcm.service.application import Choice
from automcm_simulation.road.straight_lane import LANE_CHANGE

POINT = (
    *("time_from_start", "pose", "longitudinal_velocity_mps", "lateral_velocity_mps"),
    *("acceleration_mps2", "heading_rate_rps", "front_wheel_angle_rad", "rear_wheel_angle_rad"),
)
"""The fields of autoware_planning_msgs/msg/TrajectoryPoint, by its public definition."""
PAGE = (Path(__file__).resolve().parents[3] / "docs" / "bridge.md").read_text(encoding="utf-8")
BLOCKS = re.findall(
    r"^```(\w+)\n(.*?)^```$", PAGE[PAGE.index("## A session") :], re.MULTILINE | re.DOTALL
)
SESSION = [
    (line[0], json.loads(line[1:])) for line in re.split(r"\n(?=[<>])", BLOCKS[0][1].strip())
]


def shows(shown: Any, whole: Any) -> bool:
    """Whether the page's shortened message has nothing that the whole one has not."""
    if isinstance(shown, dict):
        return isinstance(whole, dict) and all(
            name in whole and shows(value, whole[name]) for name, value in shown.items()
        )
    if isinstance(shown, list):
        return len(shown) == len(whole) and all(map(shows, shown, whole))
    return bool(shown == whole)


@pytest.mark.slow  # in real time
async def test_the_session_of_the_page() -> None:
    planned: list[Any] = []

    class Other(Recorder):
        def choose(self, choice: Choice) -> None:
            planned.extend(choice.planned.values())
            super().choose(choice)

    repeated: dict[str, Any] = {}
    async with World(Other()) as world, client(world, drives=False) as it:

        async def repeat() -> None:
            while True:
                for fields in repeated.values():
                    await it.op(**fields)
                await asyncio.sleep(0.05)

        repeating = asyncio.create_task(repeat())
        for direction, fields in SESSION:
            if direction == "<":
                await it.read(lambda got, fields=fields: shows(fields, got))
                if fields["msg"].get("driver"):
                    world.other.command(LANE_CHANGE)
            elif fields["topic"].endswith(("kinematics", "plan")):
                repeated[fields["topic"]] = fields
            else:
                await it.op(**fields)
        repeating.cancel()
        await asyncio.gather(repeating, return_exceptions=True)
    assert not [fields for fields in it.seen if fields["op"] == "status"]
    told = json.loads(BLOCKS[1][1])
    assert [list(point) for point in planned[0].points] == told


def test_the_trajectory_of_the_page_has_every_field() -> None:
    """Of the public definition and of autoware.py, with the values that it has on the wire."""
    (plan,) = [fields for _, fields in SESSION if fields["topic"].endswith("plan")]
    way = plan["msg"]["trajectory"]
    read = autoware.AutowareTrajectory.model_validate(way)
    assert read.model_dump() == way
    assert tuple(way) == ("header", "points")
    assert way["header"] == {
        "stamp": {"sec": 1763916000, "nanosec": 250_000_000},
        "frame_id": "map",
    }
    assert all(tuple(point) == POINT for point in way["points"])
    assert all(point.time_from_start.ms == 0 for point in read.points)
