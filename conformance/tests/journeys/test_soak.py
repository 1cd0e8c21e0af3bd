"""Stations for many sessions with loss, restarts and datagrams that are none: what they keep."""

from __future__ import annotations

import gc
import json
import os
import random
import tracemalloc
from pathlib import Path

import pytest

from automcm.links.simulated_radio import Channel
from automcm_simulation.road.simulation import Simulation
from automcm_simulation.road.straight_lane import Straight
from automcm_spec.vocabulary.parameters import Parameters
from automcm_traces.explain.explain import verdicts_of

STATIONS = (1001, 1002, 2002, 3003)
PART_MS = 60_000
"""Fifteen requests, among them for each station those after a restart."""
MOST_BYTES = 50_000
"""Memory may grow by so much from the second part to the last; one reference to each datagram would
take more."""


def datagram(chance: random.Random) -> bytes:
    """Random bytes, or an Ack in the name of a station."""
    if chance.random() < 0.5:
        return chance.randbytes(chance.randrange(200))
    src, dst = chance.sample(STATIONS, 2)
    of = {"type": "Intention", "seq": chance.randrange(9)}
    fields = {"v": 1, "type": "Ack", "src": src, "dst": dst, "seq": 0, "of": of}
    return json.dumps(fields | {"session": [dst, chance.randrange(1, 50)]}).encode()


@pytest.mark.slow
def test_memory_and_descriptors_stay_and_all_logs_are_allowed(tmp_path: Path) -> None:
    chance = random.Random(1)
    simulation = Simulation(seed=1, channel=Channel(loss=0.3), logs=tmp_path)
    for station in STATIONS:
        simulation.add(station, Straight(), Parameters(t_timeout=1000, t_cam=500))
    stranger = simulation.radio.link(9)
    kept = []
    tracemalloc.start()
    try:
        for part in range(5):
            began = part * PART_MS
            for n in range(15):
                simulation.request(STATIONS[n % 4], at=began + 500 + n * 4_000)
            for n, station in enumerate(STATIONS):
                simulation.restart(station, at=began + 10_000 * (n + 1))
            for n in range(300):
                simulation.clock.at(
                    began + 200 * n, lambda: stranger.send(datagram(chance), 0, "9:1")
                )
            simulation.clock.run(began + PART_MS)
            gc.collect()
            used, _ = tracemalloc.get_traced_memory()
            kept.append((used, len(os.listdir("/proc/self/fd"))))
    finally:
        tracemalloc.stop()
    simulation.run(until=5 * PART_MS)
    assert kept[-1][0] - kept[1][0] < MOST_BYTES and kept[-1][1] == kept[0][1], kept
    logs = [tmp_path / f"{station}.ndjson" for station in STATIONS]
    verdicts = verdicts_of(logs)
    assert {verdict.verdict for verdict in verdicts} == {"allowed"}
    assert min(verdict.events for verdict in verdicts) > 2_000
