"""A radio within one process, in virtual time.

It has seeded loss, duplication, delay, reordering, one-way cuts and partitions.  The same seed
gives the same deliveries.
"""

from __future__ import annotations

import math
import random
from collections.abc import Iterable
from dataclasses import dataclass

from automcm.links.clock import Clock
from automcm.links.link import Receiver
from automcm_spec.vocabulary.messages import BROADCAST


@dataclass(frozen=True, kw_only=True)
class Channel:
    """The faults of a radio for each copy.  Probabilities from 0 to 1, delays in ms.

    A copy is lost with ``loss``, duplicated with ``duplicate``, and delayed by a uniform random
    time from ``delay_ms``; with ``reorder`` it is held back for another such delay, so that later
    copies overtake it.  The rules assume a one-way delay below t_resend / 2 (section 3); with
    ``reorder`` the longest delay is twice that of ``delay_ms``.

    With ``burst_ms``, loss comes in bursts (Gilbert, Capacity of a burst-noise channel, 1960;
    Elliott, 1963): each direction between two stations has a good state without loss and a bad
    state, which lasts ``burst_ms`` on average and loses with ``burst_loss``.  The share of bad time
    follows from ``loss``, which remains the mean.
    """

    loss: float = 0.0
    duplicate: float = 0.0
    reorder: float = 0.0
    delay_ms: tuple[int, int] = (2, 40)
    burst_ms: float = 0.0
    burst_loss: float = 1.0

    def __post_init__(self) -> None:
        for name in ("loss", "duplicate", "reorder"):
            if not 0 <= getattr(self, name) <= 1:
                raise ValueError(f"{name} must be between 0 and 1, not {getattr(self, name)}")
        low, high = self.delay_ms
        if not 0 <= low <= high:
            raise ValueError(f"delay_ms must be a range from 0 ms upwards, not {low} to {high} ms")
        if not 0 <= self.burst_ms < math.inf:
            raise ValueError(f"burst_ms must be a finite number of at least 0, not {self.burst_ms}")
        if not 0 < self.burst_loss <= 1 or (self.burst_ms and self.loss > self.burst_loss):
            raise ValueError(
                f"burst_loss must be above 0 and from loss to 1, not {self.burst_loss}"
            )

    @property
    def bad(self) -> float:
        """The share of time in the bad state, from 0 to 1."""
        return self.loss / self.burst_loss


class Radio:
    """The medium that simulated links share.

    With ``capacity``, a copy is lost while that many others are in flight.
    """

    def __init__(
        self,
        clock: Clock,
        channel: Channel | None = None,
        seed: int = 0,
        *,
        capacity: int | None = None,
    ) -> None:
        self.channel = channel or Channel()
        self.delivered = self.lost = self.in_flight = 0
        self._capacity = capacity
        self._clock = clock
        self._random = random.Random(seed)
        self._receivers: dict[int, Receiver | None] = {}
        self._cut: set[tuple[int, int]] = set()
        self._burst: dict[tuple[int, int], tuple[bool, int]] = {}
        """For each direction, whether it was bad, and the time in ms."""

    def link(self, station_id: int) -> SimulatedLink:
        """The link of a station.  Raises ValueError if it has one already."""
        if station_id in self._receivers:
            raise ValueError(f"station_id {station_id} has a link already")
        self._receivers[station_id] = None
        return SimulatedLink(self, station_id)

    def cut(self, src: int, dst: int) -> None:
        """Lose all that ``src`` sends to ``dst`` from now on; the other direction is unaffected."""
        self._cut.add((src, dst))

    def partition(self, *groups: Iterable[int]) -> None:
        """Lose all that is sent between groups from now on.

        A station in no group is unaffected.
        """
        sets = [set(group) for group in groups]
        self._cut |= {
            (src, dst) for a in sets for b in sets if a is not b for src in a for dst in b
        }

    def mend(self) -> None:
        """Undo every cut."""
        self._cut.clear()

    def _send(self, src: int, data: bytes, to: int, tx: str) -> None:
        for dst in self._receivers:
            if dst != src and to in (BROADCAST, dst) and (src, dst) not in self._cut:
                copies = 2 if self._chance(self.channel.duplicate) else 1
                for _ in range(copies):
                    self._deliver(src, dst, data, tx)

    def _lost(self, src: int, dst: int) -> bool:
        channel = self.channel
        if not channel.burst_ms:
            return self._chance(channel.loss)
        return self._is_bad((src, dst)) and self._chance(channel.burst_loss)

    def _is_bad(self, way: tuple[int, int]) -> bool:
        """The state of this direction now: a Markov chain in continuous time, evaluated when a copy
        is sent.  It is stationary at its first evaluation."""
        now, bad = self._clock.now(), self.channel.bad
        if (before := self._burst.get(way)) is not None and bad < 1:
            fades = math.exp(-(now - before[1]) / (self.channel.burst_ms * (1 - bad)))
            bad += (before[0] - bad) * fades
        is_bad = self._chance(bad)
        self._burst[way] = is_bad, now
        return is_bad

    def _chance(self, probability: float) -> bool:
        return probability > 0 and self._random.random() < probability

    def _deliver(self, src: int, dst: int, data: bytes, tx: str) -> None:
        if self._lost(src, dst) or self.in_flight == self._capacity:
            self.lost += 1
            return
        delay = self._random.randint(*self.channel.delay_ms)
        if self._chance(self.channel.reorder):
            delay += self._random.randint(*self.channel.delay_ms)
        self.in_flight += 1
        self._clock.at(self._clock.now() + delay, lambda: self._arrive(dst, data, tx))

    def _arrive(self, dst: int, data: bytes, tx: str) -> None:
        self.in_flight -= 1
        if (receive := self._receivers.get(dst)) is not None:
            self.delivered += 1
            receive(data, tx)


class SimulatedLink:
    """One station's end of a ``Radio``."""

    def __init__(self, radio: Radio, station_id: int) -> None:
        self._radio, self._station_id = radio, station_id

    def open(self, receive: Receiver) -> None:
        """As ``Link.open``."""
        self._radio._receivers[self._station_id] = receive

    def send(self, data: bytes, to: int, tx: str) -> None:
        """As ``Link.send``."""
        if self._station_id in self._radio._receivers:
            self._radio._send(self._station_id, data, to, tx)

    def close(self) -> None:
        """As ``Link.close``."""
        self._radio._receivers.pop(self._station_id, None)
