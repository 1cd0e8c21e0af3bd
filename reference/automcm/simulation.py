"""Several stations on a simulated radio, in virtual time: seeded loss, duplication and delay.

The same seed gives the same bytes.  Each station may write a log.
"""

from __future__ import annotations

import heapq
import random
from collections.abc import Callable, Iterable
from contextlib import ExitStack
from dataclasses import dataclass, field
from pathlib import Path
from typing import Protocol

from automcm import logging
from automcm.interface import Accept, Command, Complete, Indication, Prescribe, Refuse, Request
from automcm.messages import (
    BROADCAST,
    Advertisement,
    Cam,
    Message,
    Trajectory,
    encode,
    to_dict,
)
from automcm.parameters import Parameters
from automcm.station import Effects, Station
from automcm_traces.writer import LogWriter


class Driver(Protocol):
    """The application of one station."""

    def plan(self, advertisement: Advertisement) -> Trajectory | None:
        """What it would drive, or None if the Advertisement does not concern it (ADV-3)."""

    def told(self, indication: Indication) -> Iterable[tuple[int, Command]]:
        """Commands that answer an indication, each with a delay in ms."""


@dataclass
class Straight:
    """A driver on a straight lane that agrees to everything; as a prescriber, it takes ``target``
    (or the first who answered) and completes after ``maneuver_ms``."""

    speed_mm_s: int = 8333
    target: int = 0
    think_ms: int = 50
    maneuver_ms: int = 3000
    refuse_first: int = 0
    """How many proposals it refuses before it accepts one."""
    concerned: bool = True
    heard: list[Indication] = field(default_factory=list)

    def plan(self, advertisement: Advertisement) -> Trajectory | None:
        return self.trajectory() if self.concerned else None

    def trajectory(self, factor: int = 100) -> Trajectory:
        """A second at ``factor`` per cent of the speed."""
        return Trajectory(t0=0, points=((0, 0, 0), (1000, self.speed_mm_s * factor // 100, 0)))

    def told(self, indication: Indication) -> Iterable[tuple[int, Command]]:
        self.heard.append(indication)
        session, proposal = indication.session, indication.proposal
        if session is None:
            return
        match indication.name:
            case "choose":
                answered = [intention.src for intention in indication.intentions]
                self.target = self.target if self.target in answered else answered[0]
                yield self.think_ms, self.proposal(session, 1)
            case "propose":
                yield self.think_ms, self.proposal(session, proposal)
            case "verify" if self.refuse_first >= proposal:
                yield self.think_ms, Refuse(session=session, proposal=proposal)
            case "verify":
                assert indication.prescription is not None
                selected = indication.prescription.prescribed
                yield (
                    self.think_ms,
                    Accept(session=session, proposal=proposal, selected=selected),
                )
            case "accepted":
                yield self.maneuver_ms, Complete(session=session)

    def proposal(self, session: tuple[int, int], proposal: int) -> Prescribe:
        """Proposal ``proposal`` to the target: slower each time."""
        return Prescribe(
            session=session,
            proposal=proposal,
            target=self.target,
            prescribed=self.trajectory(100 - 30 * min(proposal, 3)),
            hold_ms=2000,
            lease_ms=20_000,
        )


@dataclass(frozen=True, kw_only=True)
class Radio:
    """How the radio treats each copy; delay in ms stays below half of t_resend."""

    loss: float = 0.0
    duplicate: float = 0.0
    delay_ms: tuple[int, int] = (2, 40)


class Simulation:
    """Virtual time, in ms, over stations and their drivers."""

    def __init__(self, *, seed: int = 0, radio: Radio | None = None, logs: Path | None = None):
        self.now = 0
        self.stations: dict[int, Station] = {}
        self.drivers: dict[int, Driver] = {}
        self._radio = radio or Radio()
        self._seed = seed
        self._random = random.Random(seed)
        self._logs = logs
        self._writers: dict[int, LogWriter] = {}
        self._sent: dict[int, int] = {}
        self._agenda: list[tuple[int, int, Callable[[], None]]] = []
        self._n = 0
        self._stack = ExitStack()

    def add(self, station_id: int, driver: Driver, parameters: Parameters | None = None) -> Station:
        """A station that sends CAMs from now on."""
        if station_id in self.stations:
            raise ValueError(f"station_id: {station_id} is there already")
        station = Station(
            station_id, parameters, plan=driver.plan, seed=self._seed * 1000 + station_id
        )
        self.stations[station_id], self.drivers[station_id] = station, driver
        self._sent[station_id] = 0
        if self._logs is not None:
            self._writers[station_id] = self._stack.enter_context(
                LogWriter(
                    self._logs / f"{station_id}.ndjson",
                    run=f"seed-{self._seed}",
                    station=station_id,
                    implementation="automcm",
                    version="0.1.0",
                    parameters=logging.parameters(station.parameters),
                    complete=logging.COMPLETE,
                )
            )
        self._at(self._random.randrange(station.parameters.t_cam), lambda: self._cam(station))
        return station

    def command(self, station_id: int, command: Command, at: int) -> None:
        """Give a command at a time."""
        station = self.stations[station_id]
        self._at(at, lambda: self._done(station, station.command(command, self.now)))

    def request(self, station_id: int, at: int) -> None:
        """Ask for a lane change at a time."""
        self.command(station_id, Request(scenario="lane_change", details={"lane": 2}), at)

    def restart(self, station_id: int, at: int) -> None:
        """Restart a station at a time (END-8)."""
        station = self.stations[station_id]
        self._at(at, lambda: self._done(station, station.restart(self.now)))

    def run(self, until: int) -> None:
        """Run to a time and close the logs."""
        with self._stack:
            while (due := self._next()) <= until:
                self.now = due
                if self._agenda and self._agenda[0][0] <= due:
                    heapq.heappop(self._agenda)[2]()
                for station in self.stations.values():
                    self._done(station, station.advance(self.now))

    def _next(self) -> int:
        deadlines = [d for s in self.stations.values() if (d := s.next_deadline()) is not None]
        return min([*deadlines, self._agenda[0][0]])

    def _at(self, t: int, what: Callable[[], None]) -> None:
        self._n += 1
        heapq.heappush(self._agenda, (t, self._n, what))

    def _cam(self, station: Station) -> None:
        self._transmit(
            station,
            Cam(
                src=station.station_id,
                generation_ms=self.now,
                x_mm=0,
                y_mm=0,
                heading_mrad=0,
                speed_mm_s=8333,
                marks=station.state.marks,
            ),
            log=True,
        )
        self._at(self.now + station.parameters.t_cam, lambda: self._cam(station))

    def _transmit(self, station: Station, message: Message | Cam, *, log: bool = False) -> str:
        """Put a message on the air; returns its transmission id."""
        me = station.station_id
        self._sent[me] += 1
        tx, data = f"{me}:{self._sent[me]}", encode(message)
        if log and me in self._writers:
            event = {"tx": tx, "message": to_dict(message)}
            self._writers[me].event("send", self.now, **event)
        to = BROADCAST if isinstance(message, Cam) else message.dst
        for other in self.stations.values():
            if other is not station and to in (BROADCAST, other.station_id):
                copies = 2 if self._random.random() < self._radio.duplicate else 1
                for _ in range(copies):
                    self._deliver(other, data, tx)
        return tx

    def _deliver(self, to: Station, data: bytes, tx: str) -> None:
        delay = self._random.randint(*self._radio.delay_ms)
        if self._random.random() >= self._radio.loss:
            arrives = self.now + delay
            self._at(arrives, lambda: self._done(to, to.receive(data, self.now), tx=tx, raw=data))

    def _done(
        self, station: Station, effects: list[Effects], *, tx: str | None = None, raw: bytes = b""
    ) -> None:
        """Log and transmit what a station did, and let its driver answer.

        The input that ``tx`` belongs to comes last: due timers fire first.
        """
        me = station.station_id
        for n, effect in enumerate(effects, 1):
            own_tx = tx if n == len(effects) else None
            if me in self._writers:
                logging.write(
                    self._writers[me],
                    effect,
                    lambda message: self._transmit(station, message),
                    tx=own_tx,
                    raw=raw,
                )
            else:
                for message in effect.messages:
                    self._transmit(station, message)
            for indication in effect.indications:
                for delay, command in self.drivers[me].told(indication):
                    self.command(me, command, self.now + delay)
