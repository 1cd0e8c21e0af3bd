"""The cost of the reference, each figure with a baseline measured in the same run.

Times are the best of several repetitions, in microseconds for a message.  Sessions are counted for
a second of real time.  Memory is measured by tracemalloc.
"""

from __future__ import annotations

import math
import time
import tracemalloc
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass
from functools import partial
from typing import Any, TypeVar

import numpy as np

from automcm.core.outcome import Expiry, Received, ReceivedCam, Restart
from automcm.core.phases import PrescriberPhases
from automcm.core.rules import decide
from automcm.core.station import Effects, Station
from automcm.encoding.codec import NAMES, CodecError, codec
from automcm.links.clock import VirtualClock
from automcm.links.simulated_radio import Channel, Radio
from automcm.service.application import Application
from automcm.service.service import McService, Observer
from automcm_simulation.road.simulation import Simulation
from automcm_simulation.road.straight_lane import Straight
from automcm_spec.vocabulary.application import Accept, Command
from automcm_spec.vocabulary.messages import (
    Advertisement,
    Cam,
    Message,
    Prescription,
    Trajectory,
    decode,
    encode,
)
from automcm_spec.vocabulary.parameters import Parameters

LOSSES = (0.0, 0.2, 0.6)
STATIONS = 1000
POINTS = 52
"""260 m in points 5 m apart: the paper's trajectory."""


@dataclass(frozen=True, slots=True)
class Parts:
    """Microseconds for each of ``messages``: its decoding, the core, and the parts of the core: the
    rules (``decide``) and the arming and stopping of timers."""

    messages: int
    decode_us: float
    core_us: float
    decide_us: float
    timers_us: float


@dataclass(frozen=True, slots=True)
class Core:
    """Microseconds for a message: the core, a dictionary look-up, decoding from JSON, and a
    transition of python-statemachine, which the core's table replaces."""

    messages: int
    core_us: float
    lookup_us: float
    decode_us: float
    statemachine_us: float
    by_type: dict[str, Parts]


@dataclass(frozen=True, slots=True)
class Coding:
    """A codec on a Prescription of ``points`` points: bytes, microseconds to encode and decode."""

    codec: str
    points: int
    size: int
    encode_us: float
    decode_us: float


@dataclass(frozen=True, slots=True)
class Sessions:
    """Complete sessions of a prescriber and a receiver with CAMs, over a simulated radio."""

    t_timeout: int
    loss: float
    sessions: int
    agreed: int
    per_second: float
    messages_per_second: float


@dataclass(frozen=True, slots=True)
class Memory:
    """Bytes for a station with its service, with ``stations`` in one process."""

    stations: int
    idle: int
    waiting: int
    acting: int
    trajectory: int
    """The part of one trajectory of POINTS points; an acting receiver holds two."""


@dataclass(frozen=True, slots=True)
class StationFigures:
    """All figures of one run."""

    core: Core
    codings: tuple[Coding, ...]
    sessions: tuple[Sessions, ...]
    memory: Memory

    def as_dict(self) -> dict[str, Any]:
        """The report for ``--json``."""
        return asdict(self)


Input = Message | Cam | Command


def run(seconds: float, notify: Callable[[str], None] = lambda text: None) -> StationFigures:
    """Measure all figures in about ``seconds``, plus the time for the memory."""
    notify("core")
    core_ = core(seconds / 5)
    notify("codecs")
    codings_ = codings(seconds / 20)
    found = []
    for t_timeout in (0, 2000):
        for loss in LOSSES:
            notify(f"sessions, t_timeout {t_timeout} ms, loss {loss:.0%}")
            found.append(sessions(t_timeout, loss, seconds / 8))
    notify("memory")
    return StationFigures(core_, codings_, tuple(found), memory())


# -- the core


def recorded() -> dict[int, list[tuple[int, Input]]]:
    """The inputs of each of four stations in a session with one target, with times in ms."""
    inputs: dict[int, list[tuple[int, Input]]] = {}

    def note(to: list[tuple[int, Input]]) -> Observer:
        def observe(before: object, effects: Any) -> None:
            match effects.input:
                case Expiry() | Restart() | None:
                    pass
                case Received(message) | ReceivedCam(message):
                    to.append((effects.now_ms, message))
                case other:
                    to.append((effects.now_ms, other))

        return observe

    simulation = Simulation(channel=Channel())
    for n in (1, 2, 3, 4):
        application = _Long(target=3, concerned_by_all=n > 1)
        simulation.add(n, application, observers=(note(inputs.setdefault(n, [])),))
    simulation.request(1, 100)
    simulation.run(8000)
    return inputs


class _Long(Straight):
    """An application with trajectories of POINTS points."""

    def trajectory(self, per_cent: int = 100) -> Trajectory:
        step = 5_000_000 // self.speed_mm_s * 100 // per_cent
        return Trajectory(t0=0, points=tuple((n * step, n * 5000, 0) for n in range(POINTS)))


S = TypeVar("S", bound=Station)


class _Measured(Station):
    """A station that records the time in s that the rules and timers of the last input took."""

    decided = rearmed = 0.0

    def _step(self, i: Any, now: int) -> Effects:
        began = time.perf_counter()
        decide(self.me, self.state, i)  # a second evaluation, which has no effect
        self.decided, self.rearmed = time.perf_counter() - began, 0.0
        return super()._step(i, now)

    def _rearm(self, *given: Any) -> Any:
        began = time.perf_counter()
        done = super()._rearm(*given)
        self.rearmed = time.perf_counter() - began
        return done


def replay(station: Station, inputs: Sequence[tuple[int, Input]]) -> Iterator[float]:
    """Give a new station its inputs; the time in s of each message, without earlier due timers."""
    for now, i in inputs:
        if isinstance(i, Command):
            station.command(i, now)
            continue
        station.advance(now)
        began = time.perf_counter()
        station.receive(i, now)
        yield time.perf_counter() - began


def decoding(encoded: Sequence[bytes]) -> Iterator[float]:
    """The time in s to decode each message."""
    for data in encoded:
        began = time.perf_counter()
        decode(data)
        yield time.perf_counter() - began


def core(seconds: float) -> Core:
    """Replay recorded sessions through new stations."""
    inputs = recorded()
    messages = [i for each in inputs.values() for _, i in each if not isinstance(i, Command)]
    encoded = [encode(m) for m in messages]
    n, types = len(messages), np.array([m.type for m in messages])
    planned = _Long().trajectory()

    def stations(made: type[S]) -> Iterator[tuple[S, Sequence[tuple[int, Input]]]]:
        return ((made(s, plan=lambda _: planned), each) for s, each in inputs.items())

    best = np.full((4, n), np.inf)
    end = time.perf_counter() + seconds * 0.8
    while best[0, 0] == np.inf or time.perf_counter() < end:
        whole = [spent for s, each in stations(Station) for spent in replay(s, each)]
        parts = [(s.decided, s.rearmed) for s, each in stations(_Measured) for _ in replay(s, each)]
        spent = [list(decoding(encoded)), whole, *zip(*parts, strict=True)]
        best = np.minimum(best, np.array(spent) * 1e6)
    table = {(type(m), m.src): m for m in messages}
    keys = list(table)
    machine = PrescriberPhases()

    def transitions() -> None:
        machine.send("open", rule="ADV-1")
        machine.send("leave", rule="END-1")

    decode_us, core_us = best[:2].mean(axis=1).tolist()
    return Core(
        messages=n,
        core_us=core_us,
        lookup_us=best_us(lambda: [table[key] for key in keys], seconds * 0.1, len(keys)),
        decode_us=decode_us,
        statemachine_us=best_us(transitions, seconds * 0.1, 2),
        by_type={
            str(type_): Parts(int(count), *best[:, types == type_].mean(axis=1).tolist())
            for type_, count in zip(*np.unique(types, return_counts=True), strict=True)
        },
    )


def best_us(call: Callable[[], object], seconds: float, count: int = 1) -> float:
    """The best CPU time of at least three calls, over ``count``; the machine may be busy."""
    call()
    began = time.thread_time()
    call()
    once = time.thread_time() - began
    loops = max(1, int(min(0.01, seconds / 5) / max(once, 1e-7)))
    best, end, done = math.inf, time.perf_counter() + seconds, 0
    while done < 3 or time.perf_counter() < end:
        began = time.thread_time()
        for _ in range(loops):
            call()
        best, done = min(best, (time.thread_time() - began) / loops), done + 1
    return best / count * 1e6


def codings(seconds: float) -> tuple[Coding, ...]:
    """Measure both codecs; UPER only if it is installed."""
    found = []
    for name in NAMES:
        try:
            each = codec(name)
        except CodecError:
            continue
        data = each.encode(PRESCRIPTION)
        encode_us = best_us(partial(each.encode, PRESCRIPTION), seconds / 2)
        decode_us = best_us(partial(each.decode, data), seconds / 2)
        found.append(Coding(name, POINTS, len(data), encode_us, decode_us))
    return tuple(found)


# -- sessions


def session(seed: int, t_timeout: int, loss: float) -> tuple[bool, int]:
    """One session, from the request until no message is left: whether agreed, messages sent."""
    simulation = Simulation(seed=seed, channel=Channel(loss=loss))
    parameters = Parameters(t_timeout=t_timeout)
    services = [
        simulation.add(n, Straight(concerned_by_all=n > 1, think_ms=1, maneuver_ms=1), parameters)
        for n in (1, 2)
    ]
    simulation.request(1, 0)
    until = 0
    while until == 0 or any(s.state.bound or s.state.outbox for s in services):
        until += 50
        simulation.run(until)
    sent = sum(sum(s.statistics.sent.values()) for s in services)
    return services[0].statistics.rules["ACT-3"] > 0, sent


def sessions(t_timeout: int, loss: float, seconds: float) -> Sessions:
    """Run as many sessions as the time allows, at least one."""
    began = time.perf_counter()
    n = agreed = messages = 0
    while n == 0 or time.perf_counter() < began + seconds:
        ok, sent = session(n, t_timeout, loss)
        n, agreed, messages = n + 1, agreed + ok, messages + sent
    spent = time.perf_counter() - began
    return Sessions(t_timeout, loss, n, agreed, n / spent, messages / spent)


# -- memory


def memory(stations: int = STATIONS) -> Memory:
    """Measure stations on one radio: idle, then as waiting receivers, then acting."""
    path = _Long().trajectory()
    tracemalloc.start()
    began = tracemalloc.get_traced_memory()[0]
    copies = [decode_trajectory(path) for _ in range(100)]
    trajectory = (tracemalloc.get_traced_memory()[0] - began) // len(copies)
    del copies

    def each_since(before: int) -> int:
        return (tracemalloc.get_traced_memory()[0] - before) // stations

    clock = VirtualClock()
    radio = Radio(clock)
    before = tracemalloc.get_traced_memory()[0]
    made = [_service(n, _Long(), radio, clock) for n in range(2, stations + 2)]
    idle = each_since(before)
    for service in made:
        service.receive(encode(ADVERTISEMENT))
    waiting = each_since(before)
    for service in made:
        prescribed = encode(PRESCRIPTION.model_copy(update={"dst": service.station_id}))
        service.receive(prescribed)
        selected = decode_trajectory(PRESCRIPTION.prescribed)
        service.command(Accept(session=(1, 1), proposal=1, selected=selected))
        assert service.state.phase == "ACTUATING"
    acting = each_since(before)
    tracemalloc.stop()
    return Memory(stations, idle, waiting, acting, trajectory)


def _service(n: int, application: Application, radio: Radio, clock: VirtualClock) -> McService:
    service = McService(n, application, radio.link(n), clock)
    service.start()
    return service


def decode_trajectory(path: Trajectory) -> Trajectory:
    """A deep copy."""
    return Trajectory.model_validate_json(path.model_dump_json())


ADVERTISEMENT = Advertisement(src=1, session=(1, 1), seq=1, scenario="lane_change", details={})
PRESCRIPTION = Prescription(
    src=1,
    session=(1, 1),
    seq=1,
    proposal=1,
    prescribed=_Long().trajectory(),
    hold_ms=2000,
    lease_ms=20_000,
)
