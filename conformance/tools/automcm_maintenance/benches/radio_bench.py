"""The speed of ``TableRadio`` beside the plainest loss: a coin for each receiver."""

from __future__ import annotations

import random
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass
from typing import Any

from automcm_evaluation.radio.radio_traffic import STEP_MS, FourLanes, positions
from automcm_simulation.radio.radio import Arrival
from automcm_simulation.radio.table_radio import TableRadio

SIZE_BYTES, PERIOD_MS = 159, 100
"""A CAM in JSON at 10 Hz."""
VEHICLES = (10, 50, 100, 200)
ROAD_KM = 1.0


@dataclass(frozen=True)
class RadioRate:
    """Simulated seconds a second on one core, of the table and of coins."""

    vehicles: int
    receptions: int
    """In a simulated second, by the table."""
    table: float
    coins: float


@dataclass(frozen=True)
class RadioFigures:
    """A rate for each number of vehicles."""

    rates: list[RadioRate]

    def as_dict(self) -> dict[str, Any]:
        """As JSON."""
        return asdict(self)


def run(seconds: float, notify: Callable[[str], None]) -> RadioFigures:
    """Measure for about this long."""
    rates = []
    for vehicles in VEHICLES:
        notify(f"{vehicles} vehicles")
        each = seconds / len(VEHICLES) / 2
        table, receptions = _rate(_Table(vehicles), vehicles, each)
        coins, _ = _rate(_Coins(vehicles, receptions), vehicles, each)
        rates.append(RadioRate(vehicles, round(receptions), table, coins))
    return RadioFigures(rates)


class _Table:
    def __init__(self, vehicles: int) -> None:
        self._radio = TableRadio(1)
        self._places = positions(FourLanes(name="", per_km=vehicles / ROAD_KM, seconds=0))
        self._vehicles = vehicles

    def step(self, now_ms: int) -> int:
        """The number of receptions in a step, in which every vehicle sends once."""
        self._radio.move(next(self._places))
        for sender in range(1, self._vehicles + 1):
            self._radio.transmit(sender, SIZE_BYTES, now_ms, sender)
        return _received(self._radio.advance(now_ms + STEP_MS))


class _Coins:
    def __init__(self, vehicles: int, receptions: float) -> None:
        self._ids = range(1, vehicles + 1)
        self._share = receptions / (1000 / PERIOD_MS) / (vehicles * (vehicles - 1))
        self._random = random.Random(1)

    def step(self, now_ms: int) -> int:
        """As ``_Table.step``, with as many receptions on average."""
        coin, share = self._random.random, self._share
        found = [
            Arrival(now_ms + 1, sender, [r for r in self._ids if r != sender and coin() < share])
            for sender in self._ids
        ]
        return _received(found)


def _received(arrivals: list[Arrival]) -> int:
    return sum(len(each.receivers) for each in arrivals)


def _rate(radio: _Table | _Coins, vehicles: int, seconds: float) -> tuple[float, float]:
    """Simulated seconds a second of CPU, and receptions a simulated second."""
    received = steps = 0
    begun = time.process_time()
    while (spent := time.process_time() - begun) < seconds or steps < 20:
        received += radio.step(steps * STEP_MS)
        steps += 1
    simulated = steps * STEP_MS / 1000
    return simulated / spent, received / simulated
