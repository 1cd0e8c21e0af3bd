"""A ``Radio`` that draws from a table fitted to ns-3, with numpy alone.

The table has the share of frames that arrive, by mean received power, load and size.  The load is
the airtime that the receiver hears and the sender does not, in units of an evenly used road, where
it is the load at the receiver.

Two processes make losses come in bursts: the shadowing of each pair, which both radios share
(``propagation``), and hidden stations that send at the same time again and again, which is a
two-state chain for each direction (Gilbert, 1960; Elliott, 1963).
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from functools import cache
from pathlib import Path

import numpy as np
from pydantic import BaseModel, ConfigDict

from automcm.kernels.trajectory import Floats
from automcm_simulation.radio.propagation import OfferedLoad, Propagation, airtime_us, sensed
from automcm_simulation.radio.radio import Arrival, Sequence


class Bursts(BaseModel):
    """Repeated collisions: a share of the losses by load falls into bad states, which last
    ``mean_ms`` and lose ``loss`` of the frames.

    The share is ``far`` up to the power ``far_dbm``, and from ``near_dbm`` on it is ``near``, less
    its product with ``fade`` and the load; in between it changes evenly with the power.
    """

    model_config = ConfigDict(extra="forbid", frozen=True)

    far_dbm: float
    near_dbm: float
    far: float
    near: float
    fade: float
    loss: float
    mean_ms: float

    def share(self, power_dbm: Floats, load: Floats) -> Floats:
        """By power and load."""
        nearer = np.clip((power_dbm - self.far_dbm) / (self.near_dbm - self.far_dbm), 0.0, 1.0)
        near = self.near * np.clip(1 - self.fade * load, 0.0, 1.0)
        share: Floats = self.far + nearer * (near - self.far)
        return share


class FittedTable(BaseModel):
    """What was fitted.  ``delivery[size][load][power]`` is a share, ``busy[load]`` the channel busy
    ratio, ``delay_ms[load]`` equally likely delays of a frame of the first size."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    source: str
    size_bytes: tuple[int, int]
    crowded: tuple[float, float]
    """From the first to the second of these loads, stations that the sender hears come to disturb
    as much as hidden ones."""
    load: tuple[float, ...]
    frame_us: float
    """The mean airtime of the frames on the channel when it was measured."""
    power_dbm: tuple[float, ...]
    """In equal steps."""
    hidden_m: tuple[float, ...]
    hidden: tuple[float, ...]
    """By these distances: the airtime of hidden stations on an evenly used road, by its load."""
    delivery: tuple[tuple[tuple[float, ...], ...], ...]
    busy: tuple[float, ...]
    delay_ms: tuple[tuple[int, ...], ...]
    bursts: Bursts


@cache
def committed() -> FittedTable:
    """The table in radio_table.json (docs/radio.md)."""
    return FittedTable.model_validate_json(
        Path(__file__).with_name("radio_table.json").read_bytes()
    )


class TableRadio:
    """The stations of one channel.  Equal seeds and calls give equal arrivals.

    ``background`` is an offered load at every station, by others that are not simulated: a share of
    airtime, at least 0.  Raises ValueError for another one.
    """

    def __init__(
        self, seed: int, table: FittedTable | None = None, *, background: float = 0.0
    ) -> None:
        if not 0 <= background < math.inf:
            raise ValueError(f"background must be a finite share of at least 0, not {background}")
        self._background = background
        self.propagation = Propagation(seed)
        self.load = OfferedLoad()
        self._table = committed() if table is None else table
        self._delivery = np.array(self._table.delivery)
        self._delays = np.array(self._table.delay_ms)
        self._airtimes = [airtime_us(size) for size in self._table.size_bytes]
        self._sequence = Sequence()
        self._random = np.random.default_rng((seed, 3))
        self._draws: Floats = np.zeros((0, 0))
        """Of each direction, uniform from 0 to 1: low ones are in a bad state."""
        self._drawn_ms = 0
        self._log: Floats = np.zeros((2, 0, 0))
        """The logarithm of the probability of arrival by size, sender's and receiver's slot."""
        self._mean_us = self._table.frame_us
        """The mean airtime of the frames of the last second."""
        self._stale = False
        self._pending: dict[int, list[Arrival]] = {}

    def move(self, positions: Mapping[int, tuple[float, float]]) -> None:
        """As ``Radio.move``."""
        entered = self.propagation.move(positions)
        size = len(self.propagation)
        self.load.enter(entered, size)
        more = size - len(self._draws)
        self._draws = np.pad(self._draws, ((0, more), (0, more)))
        for slot in entered:
            self._draws[slot, :] = self._random.random(size)
            self._draws[:, slot] = self._random.random(size)
        self._stale = True

    def transmit(self, sender: int, size_bytes: int, now_ms: int, frame: int) -> None:
        """As ``Radio.transmit``."""
        slot = self._sequence.sent(self.propagation.slots, sender, size_bytes, now_ms)
        if self._stale:
            self._refresh()
        airtime = airtime_us(size_bytes)
        self.load.add(slot, self.propagation.mean_dbm[slot], airtime)
        arrives = self._row(slot, airtime)
        (slots,) = np.nonzero(self._random.random(len(arrives)) < arrives)
        at_ms = now_ms + self._delay(self._load(slot), airtime - self._airtimes[0])
        ids = self.propagation.ids
        reached = [s for each in slots.tolist() if (s := ids[each]) is not None]
        self._pending.setdefault(at_ms, []).append(Arrival(at_ms, frame, sorted(reached)))

    def advance(self, until_ms: int) -> list[Arrival]:
        """As ``Radio.advance``."""
        self._sequence.advanced(until_ms)
        if self.load.advance(until_ms):
            self._redraw(until_ms)
            self._stale = True
        if not self._pending:
            return []
        present, found = self.propagation.slots, list[Arrival]()
        for at_ms in sorted(ms for ms in self._pending if ms <= until_ms):
            for _, frame, reached in sorted(self._pending.pop(at_ms)):
                if there := [station for station in reached if station in present]:
                    found.append(Arrival(at_ms, frame, there))
        return found

    def channel_busy_ratio(self, station: int) -> float:
        """As ``Radio.channel_busy_ratio``, from the offered load."""
        slot = self._sequence.known(self.propagation.slots, station)
        return float(np.interp(self._load(slot), self._table.load, self._table.busy))

    def arrives(self, sender: int, receiver: int, size_bytes: int) -> float:
        """The probability that a frame would arrive now.  Raises ValueError without a position."""
        slots = self.propagation.slots
        slot = self._sequence.sent(slots, sender, size_bytes, self._sequence.now_ms)
        if self._stale:
            self._refresh()
        at = self._sequence.known(slots, receiver)
        return float(self._row(slot, airtime_us(size_bytes))[at])

    def _row(self, slot: int, airtime: float) -> Floats:
        """By receiver's slot; between the two sizes of the table by the airtime."""
        small, large = self._airtimes
        # What matters is how many frames begin during this one.
        as_measured = airtime * self._table.frame_us / self._mean_us
        part = min(max((as_measured - small) / (large - small), 0.0), 1.0)
        row: Floats = np.exp((1 - part) * self._log[0, slot] + part * self._log[1, slot])
        return row

    def _load(self, slot: int) -> float:
        return float(self.load.share[slot]) + self._background

    def _delay(self, load: float, longer_us: float) -> int:
        rows = self._table.load
        at = float(np.interp(load, rows, np.arange(len(rows))))
        row = min(int(at + self._random.random()), len(rows) - 1)
        delay = int(self._delays[row, int(self._random.random() * self._delays.shape[1])])
        return max(1, delay + round(longer_us / 1000))

    def _redraw(self, now_ms: int) -> None:
        """Leave or enter bad states, for the time since the last redraw."""
        kept = math.exp(-(now_ms - self._drawn_ms) / self._table.bursts.mean_ms)
        new = self._random.random(self._draws.shape) >= kept
        self._draws[new] = self._random.random(int(new.sum()))
        self._drawn_ms = now_ms

    def loads(self) -> Floats:
        """The load that disturbs a frame, by sender and receiver."""
        mean_dbm, table = self.propagation.mean_dbm, self._table
        near = np.interp(self.propagation.distances(), table.hidden_m, table.hidden)
        hidden = hidden_airtime(mean_dbm, self.load.airtime) / near
        light, full = table.crowded
        crowded = np.clip((self.load.share - light) / (full - light), 0.0, 1.0)
        return hidden + crowded * (self.load.share - hidden) + self._background

    def _refresh(self) -> None:
        """The probability of arrival for each pair, with its present state."""
        table, bursts, mean_dbm = self._table, self._table.bursts, self.propagation.mean_dbm
        frames = float(self.load.frames.sum())
        self._mean_us = 1e6 * float(self.load.airtime.sum()) / frames if frames else table.frame_us
        column, right = _between(mean_dbm, table.power_dbm)
        loads = self.loads()
        row, lower = _between(loads, table.load)

        def at(row: Places) -> Floats:
            left, beyond = self._delivery[:, row, column], self._delivery[:, row, column + 1]
            found: Floats = left + right * (beyond - left)
            return found

        idle = at(np.zeros_like(row))
        survive = (1 - lower) * at(row) + lower * at(row + 1)
        lost = np.clip(1 - survive / np.maximum(idle, 1e-9), 0.0, 1 - 1e-9)
        share = bursts.share(mean_dbm, loads)
        if bursts.loss < 1:  # the rest of the losses must fit outside the bad states
            share = np.minimum(share, (1 - lost) / np.maximum(lost * (1 / bursts.loss - 1), 1e-9))
        bad = share * lost / bursts.loss
        rest = (lost - bad * bursts.loss) / np.maximum(1 - bad, 1e-9)
        arrives = idle * (1 - np.where(self._draws < bad, bursts.loss, rest))
        arrives[:, mean_dbm < table.power_dbm[0]] = 0.0
        self._log = np.log(np.maximum(arrives, 1e-12))
        self._stale = False


def hidden_airtime(mean_dbm: Floats, airtime: Floats) -> Floats:
    """The airtime, as a share, that a receiver detects and a sender does not, by both slots.

    ``airtime``: that of each slot's own frames.
    """
    hears = sensed(mean_dbm)
    hidden = 1 - hears
    np.fill_diagonal(hidden, 0.0)
    np.fill_diagonal(hears, 1.0)  # a station that sends receives nothing
    # Not by @: BLAS's threads take 50 times as long while the other cores are busy.
    found: Floats = np.einsum("sk,kr->sr", hidden * airtime, hears)
    return found


Places = np.ndarray[tuple[int, ...], np.dtype[np.intp]]


def _between(values: Floats, nodes: tuple[float, ...]) -> tuple[Places, Floats]:
    """The node below each value, and the share of the way to the next one."""
    at = np.interp(values, nodes, np.arange(len(nodes)))
    below = np.minimum(at.astype(np.intp), len(nodes) - 2)
    return below, at - below
