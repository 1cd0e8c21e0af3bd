"""What the reference costs, each figure beside a baseline measured in the same run.

Times are the best of several repetitions, in microseconds a message; sessions are counted per
second of the machine; memory is what tracemalloc sees.
"""

from __future__ import annotations

import time
import tracemalloc
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from typing import Any

from automcm.application import Application
from automcm.clock import VirtualClock
from automcm.codec import NAMES, Codec, CodecError, codec
from automcm.interface import Accept, Command
from automcm.links.simulated import Channel, Radio
from automcm.messages import (
    Advertisement,
    Cam,
    Message,
    Prescription,
    Trajectory,
    decode,
    encode,
)
from automcm.outcome import Expiry, Heard, Restart
from automcm.parameters import Parameters
from automcm.phases import PrescriberPhases
from automcm.service import McService, Observer
from automcm.simulation import Simulation
from automcm.station import Station
from automcm.straight import Straight

LOSSES = (0.0, 0.2, 0.6)
STATIONS = 1000
POINTS = 52
"""260 m in points 5 m apart: the paper's trajectory."""


@dataclass(frozen=True, slots=True)
class Core:
    """Microseconds a message: the core, a dictionary look-up for each, decoding it from JSON,
    and a transition of python-statemachine, which the core's table stands in for."""

    messages: int
    core_us: float
    lookup_us: float
    decode_us: float
    statemachine_us: float
    by_type: dict[str, tuple[int, float, float]]
    """Of each type: how many, core, decoding."""


@dataclass(frozen=True, slots=True)
class Coding:
    """A codec on a Prescription of ``points`` points: bytes, and microseconds each way."""

    codec: str
    points: int
    size: int
    encode_us: float
    decode_us: float


@dataclass(frozen=True, slots=True)
class Sessions:
    """Whole sessions of a prescriber and a receiver, CAMs and all, through a simulated radio."""

    t_timeout: int
    loss: float
    sessions: int
    agreed: int
    per_second: float
    messages_per_second: float


@dataclass(frozen=True, slots=True)
class Memory:
    """Bytes a station (with its service), of ``stations`` in one process."""

    stations: int
    idle: int
    waiting: int
    acting: int
    trajectory: int
    """Of these, one trajectory of POINTS points; an acting receiver holds two."""


@dataclass(frozen=True, slots=True)
class Report:
    """All figures of one run."""

    core: Core
    codings: tuple[Coding, ...]
    sessions: tuple[Sessions, ...]
    memory: Memory

    def as_dict(self) -> dict[str, Any]:
        """As in ``--json``."""
        return asdict(self)


Input = Message | Cam | Command


def run(seconds: float, say: Callable[[str], None] = lambda text: None) -> Report:
    """All figures, in about ``seconds`` and some for the memory."""
    say("core")
    core_ = core(seconds / 5)
    say("codecs")
    codings_ = codings(seconds / 20)
    found = []
    for t_timeout in (0, 2000):
        for loss in LOSSES:
            say(f"sessions, t_timeout {t_timeout} ms, loss {loss:.0%}")
            found.append(sessions(t_timeout, loss, seconds / 8))
    say("memory")
    return Report(core_, codings_, tuple(found), memory())


# -- the core


def recorded() -> dict[int, list[tuple[int, Input]]]:
    """What each of four stations gets in a session with one target, with times in ms."""
    inputs: dict[int, list[tuple[int, Input]]] = {}

    def note(to: list[tuple[int, Input]]) -> Observer:
        def observe(before: object, effects: Any) -> None:
            match effects.input:
                case Expiry() | Restart() | None:
                    pass
                case Heard(message):
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
    """With trajectories of POINTS points."""

    def trajectory(self, per_cent: int = 100) -> Trajectory:
        step = 5_000_000 // self.speed_mm_s * 100 // per_cent
        return Trajectory(t0=0, points=tuple((n * step, n * 5000, 0) for n in range(POINTS)))


def replay(station_id: int, inputs: Sequence[tuple[int, Input]], spent: Counter[str]) -> None:
    """Give a fresh station its inputs; adds the seconds that the messages took, by type."""
    planned = _Long().trajectory()
    station = Station(station_id, plan=lambda advertisement: planned)
    clock = time.perf_counter
    for now, i in inputs:
        if isinstance(i, Command):
            station.command(i, now)
        else:
            began = clock()
            station.receive(i, now)
            spent[i.type] += clock() - began  # type: ignore[assignment]


def core(seconds: float) -> Core:
    """Replay recorded sessions through fresh stations."""
    inputs = recorded()
    messages = [i for each in inputs.values() for _, i in each if not isinstance(i, Command)]
    table = {(type(m), m.src): m for m in messages}
    keys = [(type(m), m.src) for m in messages]
    encoded = [(m.type, encode(m)) for m in messages]
    count = Counter(m.type for m in messages)
    clock = time.perf_counter

    def replay_all(spent: Counter[str]) -> None:
        for station_id, each in inputs.items():
            replay(station_id, each, spent)

    def decode_all(spent: Counter[str]) -> None:
        for type_, data in encoded:
            began = clock()
            decode(data)
            spent[type_] += clock() - began  # type: ignore[assignment]

    def look_up(spent: Counter[str]) -> None:
        began = clock()
        for key in keys:
            table[key]
        spent["all"] += clock() - began  # type: ignore[assignment]

    def statemachine(spent: Counter[str]) -> None:
        machine = PrescriberPhases()
        began = clock()
        for _ in range(20):
            machine.send("open", rule="ADV-1")
            machine.send("leave", rule="END-1")
        spent["all"] += clock() - began  # type: ignore[assignment]

    handled = _best(replay_all, seconds * 0.4)
    decoded = _best(decode_all, seconds * 0.4)
    n = len(messages)
    return Core(
        messages=n,
        core_us=sum(handled.values()) / n * 1e6,
        lookup_us=_best(look_up, seconds * 0.1)["all"] / n * 1e6,
        decode_us=sum(decoded.values()) / n * 1e6,
        statemachine_us=_best(statemachine, seconds * 0.1)["all"] / 40 * 1e6,
        by_type={
            t: (count[t], handled[t] / count[t] * 1e6, decoded[t] / count[t] * 1e6)
            for t in sorted(count)
        },
    )


def _best(what: Callable[[Counter[str]], None], seconds: float) -> dict[str, float]:
    """For each name the least time of several repetitions: the one least disturbed."""
    best: dict[str, float] = {}
    end = time.perf_counter() + seconds
    while not best or time.perf_counter() < end:
        spent: Counter[str] = Counter()
        what(spent)
        best = {name: min(best.get(name, t), t) for name, t in spent.items()}
    return best


def codings(seconds: float) -> tuple[Coding, ...]:
    """Both codecs; UPER only if it is installed."""
    found = []
    for name in NAMES:
        try:
            each = codec(name)
        except CodecError:
            continue
        data = each.encode(PRESCRIPTION)

        def both(spent: Counter[str], each: Codec = each, data: bytes = data) -> None:
            began = time.perf_counter()
            each.encode(PRESCRIPTION)
            between = time.perf_counter()
            each.decode(data)
            spent["encode"] += between - began  # type: ignore[assignment]
            spent["decode"] += time.perf_counter() - between  # type: ignore[assignment]

        best = _best(both, seconds)
        us = best["encode"] * 1e6, best["decode"] * 1e6
        found.append(Coding(name, POINTS, len(data), *us))
    return tuple(found)


# -- sessions


def session(seed: int, t_timeout: int, loss: float) -> tuple[bool, int]:
    """One session from the request until nobody has anything to send: agreed?, messages sent."""
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
    """As many sessions as fit; at least one."""
    began = time.perf_counter()
    n = agreed = messages = 0
    while n == 0 or time.perf_counter() < began + seconds:
        ok, sent = session(n, t_timeout, loss)
        n, agreed, messages = n + 1, agreed + ok, messages + sent
    spent = time.perf_counter() - began
    return Sessions(t_timeout, loss, n, agreed, n / spent, messages / spent)


# -- memory


def memory(stations: int = STATIONS) -> Memory:
    """Stations on one radio; then each waits as a receiver; then each acts."""
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
    """A copy that shares nothing."""
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
