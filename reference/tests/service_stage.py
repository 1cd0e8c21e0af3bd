"""A service with a link that keeps its messages, and an application that records its calls."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import automcm_stage

from automcm.links.clock import VirtualClock
from automcm.links.simulated_radio import Channel
from automcm.service.application import Advertised, AgreedManeuver, Application, Choice, Proposal
from automcm.service.service import McService
from automcm_simulation.road.simulation import Simulation
from automcm_simulation.road.straight_lane import Straight
from automcm_spec.vocabulary.messages import Session, Trajectory, decode, encode

PATH = Trajectory(t0=0, points=((0, 0, 0),))


class Wire:
    """A link that keeps all sent messages."""

    def __init__(self) -> None:
        self.sent: list[tuple[Any, int, str]] = []

    def open(self, receive: Any) -> None:
        self.receive = receive

    def send(self, data: bytes, to: int, tx: str) -> None:
        self.sent.append((decode(data), to, tx))

    def close(self) -> None:
        self.receive = None

    def of(self, kind: str) -> list[Any]:
        return [message for message, _, _ in self.sent if message.type == kind]


@dataclass
class Noted(Straight):
    """Straight on, noting every call."""

    calls: list[Any] = field(default_factory=list)

    def concerned(self, advertised: Advertised) -> Trajectory | None:
        self.calls.append(advertised)
        return super().concerned(advertised)

    def choose(self, choice: Choice) -> None:
        self.calls.append(choice)
        super().choose(choice)

    def verify(self, proposal: Proposal) -> None:
        self.calls.append(proposal)
        super().verify(proposal)

    def load(self, maneuver: AgreedManeuver) -> None:
        self.calls.append(maneuver)
        super().load(maneuver)

    def fallback(self, session: Session, reason: str) -> None:
        self.calls.append(("fallback", session, reason))

    def finished(self, session: Session) -> None:
        self.calls.append(("finished", session))

    def refused(self, command: str, rule: str) -> None:
        self.calls.append(("refused", command, rule))

    def of(self, kind: type) -> list[Any]:
        return [call for call in self.calls if isinstance(call, kind)]


def alone(
    application: Application | None = None, clock: Any = None, **more: Any
) -> tuple[McService, Wire, Any]:
    """A service of station 1 on a link that leads nowhere."""
    clock, wire = clock or VirtualClock(), Wire()
    service = McService(1, application or Noted(), wire, clock, **more)
    service.start()
    return service, wire, clock


def pair(**more: Any) -> tuple[Noted, Noted, Simulation]:
    """A prescriber (1) and a receiver (2) on a perfect radio without delay."""
    simulation = Simulation(channel=Channel(delay_ms=(0, 0)), **more)
    prescriber, receiver = Noted(concerned_by_all=False), Noted()
    simulation.add(1, prescriber)
    simulation.add(2, receiver)
    simulation.request(1, 100)
    return prescriber, receiver, simulation


def cam(src: int, generation_ms: int) -> bytes:
    return encode(automcm_stage.cam(src, generation_ms))


class Jumpy:
    """A clock that wakes too early, or stands still or goes back for a while."""

    def __init__(self) -> None:
        self.time, self.alarms = 0, list[tuple[int, Any]]()

    def now(self) -> int:
        return self.time

    def at(self, when_ms: int, do: Any) -> Any:
        alarm = when_ms, do
        self.alarms.append(alarm)
        return lambda: alarm in self.alarms and self.alarms.remove(alarm)

    def ring(self, time: int) -> None:
        """Wake for the next alarm although it is only ``time``."""
        self.time = time
        alarm = min(self.alarms, key=lambda alarm: alarm[0])
        self.alarms.remove(alarm)
        alarm[1]()
