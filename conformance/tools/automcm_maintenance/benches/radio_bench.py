"""The speed of ``TableRadio``, beside the plainest loss: a coin for each receiver."""

from __future__ import annotations

import random
from itertools import count

import pytest

from automcm_evaluation.radio.radio_traffic import STEP_MS, FourLanes, positions
from automcm_maintenance.benches.plugin import Timed
from automcm_simulation.radio.table_radio import TableRadio

SIZE_BYTES = 159
"""A CAM in JSON; each step of STEP_MS, every vehicle sends one."""
vehicles = pytest.mark.parametrize("vehicles", [50, 100, 200])


@vehicles
def bench_coins(vehicles: int, timed: Timed) -> None:
    """µs for a simulated step, as below; half of the receivers get a message."""
    ids, coin = range(vehicles), random.Random(1).random
    timed(lambda: [[r for r in ids if r != sender and coin() < 0.5] for sender in ids])


@vehicles
def bench_table(vehicles: int, timed: Timed) -> None:
    """The radio on a road of 1 km."""
    radio, now = TableRadio(1), count(0, STEP_MS)
    places = positions(FourLanes(name="", per_km=vehicles, seconds=0, road_m=1000.0))

    def step() -> None:
        now_ms = next(now)
        radio.move(next(places))
        for sender in range(1, vehicles + 1):
            radio.transmit(sender, SIZE_BYTES, now_ms, sender)
        radio.advance(now_ms + STEP_MS)

    timed(step, beside=("coins", 35))
