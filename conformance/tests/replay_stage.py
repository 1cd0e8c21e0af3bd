"""Logs to be replayed, and the command that does it."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from cli_stage import automcm
from wrong_station import station

from automcm.links.simulated_radio import Channel
from automcm_simulation.road.simulation import Simulation
from automcm_simulation.road.straight_lane import Straight
from automcm_spec.log_format.writer import LogWriter
from automcm_traces.edit.log_diff import diff
from automcm_traces.explain.explain import verdicts_of

Json = Any
REFERENCE = station()
"""The same, which starts faster."""
STATIONS = (1001, 1002, 2002, 3003)


@pytest.fixture(scope="module")
def logs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Four stations, three of which request, one in five copies lost, two restarts (END-8)."""
    folder = tmp_path_factory.mktemp("logs")
    simulation = Simulation(seed=5, channel=Channel(loss=0.2), logs=folder)
    for each in STATIONS:
        simulation.add(each, Straight())
    for each, at in ((1001, 500), (1002, 700), (2002, 9_000), (1001, 13_000)):
        simulation.request(each, at=at)
    simulation.restart(3003, at=2_500)
    simulation.restart(1001, at=6_000)
    simulation.run(until=18_000)
    return folder


def replay(log: Path, command: list[str], tmp_path: Path, *more: str) -> tuple[int, Json]:
    """Exit code and report."""
    args = ["trace", "replay", str(log), "--out", str(tmp_path / "out"), "--json", "-", *more]
    done = automcm(*args, "--", *command)
    assert done.exception is None or isinstance(done.exception, SystemExit), done.exception
    return done.exit_code, json.loads(done.stdout)


def records(log: Path) -> list[Json]:
    return [json.loads(line) for line in log.read_text().splitlines()]


def written(path: Path, lines: list[Json]) -> Path:
    path.write_text("".join(json.dumps(line) + "\n" for line in lines))
    return path


def edited(log: Path, path: Path, edit: Callable[[Json], Json]) -> Path:
    """The log with each record as ``edit`` makes it."""
    return written(path, [edit(record) for record in records(log)])


def inputs(path: Path, *events: dict[str, Json], me: int = 7, **header: Json) -> Path:
    """A log of these inputs alone, each with its time."""
    more = {"parameters": {}, "complete": (), **header}
    with LogWriter(path, run="r", station=me, implementation="hand", version="1", **more) as log:
        for event in events:
            log.event(event.pop("ev"), event.pop("t"), **event)
    return path


def same(result: Json) -> bool:
    """Whether ``automcm trace diff`` finds no difference between the two logs."""
    return diff([Path(result["file"])], [Path(result["log"])]).same


def verdict(result: Json) -> str:
    """What ``automcm trace explain`` says of the new log."""
    return verdicts_of([Path(result["log"])])[0].verdict
