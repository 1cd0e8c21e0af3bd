"""The cost of judging logs, beside reading them."""

from __future__ import annotations

import json
import random
from collections.abc import Iterator
from pathlib import Path

import pytest

from automcm.links.simulated_radio import Channel
from automcm_maintenance.benches.plugin import Timed, beside
from automcm_simulation.road.simulation import Simulation
from automcm_simulation.road.straight_lane import Straight
from automcm_spec.log_format.reader import LogStream
from automcm_spec.vocabulary.parameters import Parameters
from automcm_traces.explain.explain import verdict_of

EVENTS, LOGS = 50, 40
"""Events in each log; logs."""


@pytest.fixture(scope="module")
def logs(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    """Logs of EVENTS events each, from lane changes with loss."""
    return [path for path, _ in zip(_logs(tmp_path_factory), range(LOGS), strict=False)]


def _logs(folders: pytest.TempPathFactory) -> Iterator[Path]:
    seed = 0
    while True:
        seed += 1
        chance, folder = random.Random(seed), folders.mktemp(str(seed))
        channel = Channel(loss=chance.choice([0.0, 0.2, 0.4]), duplicate=0.05)
        simulation = Simulation(seed=seed, channel=channel, logs=folder)
        for station in (1001, 2002, 3003, 4004):
            parameters = Parameters(t_cam=900, t_timeout=chance.choice([0, 1000, 2000]))
            simulation.add(station, Straight(target=3003, maneuver_ms=1500), parameters)
        simulation.request(1001, at=300)
        simulation.run(until=9_000)
        for path in sorted(folder.iterdir()):
            lines = path.read_bytes().splitlines(keepends=True)
            if len(lines) > EVENTS + 1:
                path.write_bytes(b"".join(lines[: EVENTS + 1]))
                yield path


def bench_json_loads(logs: list[Path], timed: Timed) -> None:
    """Every line; µs an event, as below."""
    lines = [line for path in logs for line in path.read_bytes().splitlines()]
    timed(lambda: [json.loads(line) for line in lines], per=LOGS * EVENTS)


@beside("json_loads", 5)
def bench_read(logs: list[Path], timed: Timed) -> None:
    """With a check of the format."""
    timed(lambda: [list(LogStream(path)) for path in logs], per=LOGS * EVENTS)


@beside("read", 6)
def bench_explain(logs: list[Path], timed: Timed) -> None:
    """Reading and judging."""

    def judge() -> None:
        assert all(verdict_of(path).verdict == "allowed" for path in logs)

    timed(judge, per=LOGS * EVENTS)
