"""Links of services over a ``RadioModel``, in virtual time, with congestion control.

Congestion control is the adaptive approach of ETSI TS 102 687 V1.2.1. The text of the standard was
not read; the formulas and values are those that public implementations cite from its sections 5.4
and annex B.
"""

from __future__ import annotations

import math
from collections import Counter, deque
from collections.abc import Callable, Mapping
from functools import partial
from typing import Literal, NamedTuple

from automcm.links.clock import Clock
from automcm.links.link import Receiver
from automcm_simulation.radio.propagation import airtime_us
from automcm_simulation.radio.radio import LARGEST_BYTES, RadioModel
from automcm_spec.vocabulary.messages import BROADCAST

ALPHA, BETA, TARGET = 0.016, 0.0012, 0.68
UP, DOWN = 0.0005, -0.00025
"""The limits of a change of the permitted share."""
LEAST, MOST = 0.0006, 0.03
"""The limits of the permitted share of time."""
SHORTEST_MS, LONGEST_MS = 25, 1000
"""The limits of the time for which the gate is closed."""
UPDATE_MS = 200
MOVE_MS = 100
LIFETIME_MS = 100
"""A frame that waited longer at a gate is dropped: t_cam and t_resend have made another."""
OLDEST_MS = 2000
"""No frame arrives later."""
Lost = Literal["too_long", "no_place", "gate"]
"""No frame holds the message, its sender has no place, or it was dropped at its gate."""


class GateKeeper:
    """The gate of one station: after each frame it is closed for as long as the channel requires.

    ``update`` is due every UPDATE_MS.
    """

    def __init__(self) -> None:
        self.share = (LEAST + MOST) / 2
        """The share of time in which this station may send."""
        self._busy: float | None = None
        self._sent_ms = self._opens_ms = 0.0
        self._airtime_ms = 0.0

    def opens_ms(self) -> float:
        """From when on the next frame may be sent."""
        return self._opens_ms

    def sent(self, airtime_us: float, now_ms: int) -> None:
        """A frame was sent (B.1)."""
        self._sent_ms, self._airtime_ms = now_ms, airtime_us / 1000
        self._close(self._airtime_ms / self.share)

    def update(self, busy: float, now_ms: int) -> None:
        """A channel busy ratio, from 0 to 1, was measured (5.4, B.2).

        Raises ValueError for another one.
        """
        if not 0 <= busy <= 1:
            raise ValueError(f"the channel busy ratio must be from 0 to 1, not {busy}")
        self._busy = busy if self._busy is None else (self._busy + busy) / 2
        apart = BETA * (TARGET - self._busy)
        share = (1 - ALPHA) * self.share + max(DOWN, min(apart, UP))
        self.share = max(LEAST, min(share, MOST))
        left = self._opens_ms - now_ms
        if left > 0:
            waits = self._opens_ms - self._sent_ms
            self._close(now_ms - self._sent_ms + self._airtime_ms / self.share * left / waits)

    def _close(self, for_ms: float) -> None:
        self._opens_ms = self._sent_ms + max(SHORTEST_MS, min(for_ms, LONGEST_MS))


class _Frame(NamedTuple):
    src: int
    to: int
    tx: str
    data: bytes


class RadioLinks:
    """The links of all stations over one radio.

    ``places`` returns the position of each station in m, and is called every MOVE_MS; without it,
    the caller calls ``move``.  With ``congestion_control`` every station sends through a
    ``GateKeeper``.
    """

    def __init__(
        self,
        clock: Clock,
        radio: RadioModel,
        places: Callable[[], Mapping[int, tuple[float, float]]] | None = None,
        *,
        congestion_control: bool = False,
    ) -> None:
        self.radio = radio
        self.lost: Counter[Lost] = Counter()
        """Messages that were not sent, by reason."""
        self.sent: Counter[int] = Counter()
        """The frames of each station."""
        self.received = 0
        """Copies that reached their addressee."""
        self.longest_ms = 0
        """The longest delay of one."""
        self._clock = clock
        self._controlled = congestion_control
        self._receivers: dict[int, Receiver | None] = {}
        self._gates: dict[int, GateKeeper] = {}
        self._queues: dict[int, deque[tuple[int, _Frame]]] = {}
        """What waits at each gate, with the time since when."""
        self._placed: Mapping[int, tuple[float, float]] = {}
        self._frames: dict[int, tuple[int, _Frame]] = {}
        """The frames on the air, by number, with the time in ms."""
        self._number = 0
        if places is not None:
            clock.at(clock.now(), partial(self._follow, places))
        clock.at(clock.now() + 1, self._pass)
        if congestion_control:
            clock.at(clock.now() + UPDATE_MS, self._update)

    def link(self, station_id: int) -> RadioLink:
        """The link of a station.  Raises ValueError if it has one already."""
        if station_id in self._receivers:
            raise ValueError(f"station_id {station_id} has a link already")
        self._receivers[station_id] = None
        self._gates[station_id], self._queues[station_id] = GateKeeper(), deque()
        return RadioLink(self, station_id)

    def move(self, places: Mapping[int, tuple[float, float]]) -> None:
        """Where the stations are now, m.  A station that is left out is off the air."""
        self._placed = places
        self.radio.move(places)

    def _follow(self, places: Callable[[], Mapping[int, tuple[float, float]]]) -> None:
        self.move(places())
        self._clock.at(self._clock.now() + MOVE_MS, partial(self._follow, places))

    def _pass(self) -> None:
        """Pass on what has arrived, every millisecond."""
        now = self._clock.now()
        for _, number, reached in self.radio.advance(now):
            sent_ms, (_, to, tx, data) = self._frames[number]
            for receiver in reached:
                receive = self._receivers.get(receiver)
                if receive is not None and to in (BROADCAST, receiver):
                    self.received += 1
                    self.longest_ms = max(self.longest_ms, now - sent_ms)
                    receive(data, tx)
        while self._frames and now - next(iter(self._frames.values()))[0] > OLDEST_MS:
            del self._frames[next(iter(self._frames))]
        self._clock.at(now + 1, self._pass)

    def _update(self) -> None:
        now = self._clock.now()
        for station_id, gate in self._gates.items():
            if station_id in self._placed:
                gate.update(self.radio.channel_busy_ratio(station_id), now)
        self._clock.at(now + UPDATE_MS, self._update)

    def _send(self, frame: _Frame) -> None:
        if len(frame.data) > LARGEST_BYTES or frame.src not in self._placed:
            self.lost["too_long" if len(frame.data) > LARGEST_BYTES else "no_place"] += 1
            return
        if not self._controlled:
            self._transmit(frame)
            return
        queue = self._queues[frame.src]
        queue.append((self._clock.now(), frame))
        if len(queue) == 1:
            self._flush(frame.src)

    def _flush(self, src: int) -> None:
        """Send what the gate lets through, and look again when it opens."""
        gate, queue, now = self._gates[src], self._queues[src], self._clock.now()
        while queue and now - queue[0][0] > LIFETIME_MS:
            queue.popleft()
            self.lost["gate"] += 1
        if queue and gate.opens_ms() <= now:
            _, frame = queue.popleft()
            if src in self._placed:
                gate.sent(airtime_us(len(frame.data)), now)
                self._transmit(frame)
        if queue:
            self._clock.at(max(now + 1, math.ceil(gate.opens_ms())), lambda: self._flush(src))

    def _transmit(self, frame: _Frame) -> None:
        self._number += 1
        self.sent[frame.src] += 1
        now = self._clock.now()
        self._frames[self._number] = now, frame
        self.radio.transmit(frame.src, len(frame.data), now, self._number)


class RadioLink:
    """One station's end of ``RadioLinks``."""

    def __init__(self, links: RadioLinks, station_id: int) -> None:
        self._links, self._station_id = links, station_id

    def open(self, receive: Receiver) -> None:
        """As ``Link.open``."""
        self._links._receivers[self._station_id] = receive

    def send(self, data: bytes, to: int, tx: str) -> None:
        """As ``Link.send``."""
        if self._station_id in self._links._receivers:
            self._links._send(_Frame(self._station_id, to, tx, data))

    def close(self) -> None:
        """As ``Link.close``."""
        self._links._receivers.pop(self._station_id, None)
