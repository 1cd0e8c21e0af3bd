"""The cost of the reference: the core, codecs and sessions."""

from __future__ import annotations

from functools import partial
from typing import Any

import pytest

from automcm.core.outcome import Expiry, Received, ReceivedCam, Restart
from automcm.core.phases import PrescriberPhases
from automcm.core.station import Station
from automcm.encoding.codec import NAMES, CodecError, codec
from automcm.links.simulated_radio import Channel
from automcm_evaluation.bandwidth import message_sizes as sizes
from automcm_maintenance.benches.plugin import Timed
from automcm_simulation.road.simulation import Simulation
from automcm_simulation.road.straight_lane import Straight
from automcm_spec.vocabulary.application import Command
from automcm_spec.vocabulary.messages import Cam, Message, decode, encode

PRESCRIPTION = sizes.carrying(sizes.trajectory(52))[2]
"""With the paper's trajectory: 260 m in points 5 m apart."""
Inputs = dict[int, list[tuple[int, Message | Cam | Command]]]


@pytest.fixture(scope="module")
def inputs() -> Inputs:
    """The inputs of each of four stations in a session with one target, with times in ms."""
    found: Inputs = {n: [] for n in (1, 2, 3, 4)}

    def observe(n: int, before: object, effects: Any) -> None:
        match effects.input:
            case Expiry() | Restart() | None:
                pass
            case Received(message) | ReceivedCam(message):
                found[n].append((effects.now_ms, message))
            case other:
                found[n].append((effects.now_ms, other))

    simulation = Simulation(channel=Channel())
    for n in found:
        application = Straight(target=3, concerned_by_all=n > 1)
        simulation.add(n, application, observers=(partial(observe, n),))
    simulation.request(1, 100)
    simulation.run(8000)
    return found


def messages(inputs: Inputs) -> list[Message | Cam]:
    """The received ones."""
    return [i for own in inputs.values() for _, i in own if not isinstance(i, Command)]


def bench_decode_inputs(inputs: Inputs, timed: Timed) -> None:
    """From JSON; µs a message, as below."""
    encoded = [encode(message) for message in messages(inputs)]
    timed(lambda: [decode(data) for data in encoded], per=len(encoded))


def bench_statemachine(timed: Timed) -> None:
    """A transition of python-statemachine, which the core's table replaces."""
    machine = PrescriberPhases()

    def transitions() -> None:
        machine.send("open", rule="ADV-1")
        machine.send("leave", rule="END-1")

    timed(transitions, per=2)


def bench_core(inputs: Inputs, timed: Timed) -> None:
    """All inputs of a session, commands and due timers among them."""

    def replay() -> None:
        for n, own in inputs.items():
            station = Station(n)
            for now, i in own:
                station.advance(now)
                if isinstance(i, Command):
                    station.command(i, now)
                else:
                    station.receive(i, now)

    timed(replay, per=len(messages(inputs)), beside=("decode_inputs", 2))


@pytest.mark.parametrize("name", NAMES)
def bench_encode(name: str, timed: Timed) -> None:
    """PRESCRIPTION."""
    timed(partial(_codec(name).encode, PRESCRIPTION), beside=("encode[json]", 40))


@pytest.mark.parametrize("name", NAMES)
def bench_decode(name: str, timed: Timed) -> None:
    """The same."""
    data = _codec(name).encode(PRESCRIPTION)
    timed(lambda: _codec(name).decode(data), beside=("decode[json]", 40))


def _codec(name: str) -> Any:
    try:
        return codec(name)
    except CodecError as error:
        pytest.skip(str(error))


@pytest.mark.parametrize("loss", [0.0, 0.2, 0.6])
def bench_session(loss: float, timed: Timed) -> None:
    """From the request until no message is left, over a simulated radio."""

    def session(seed: int) -> int:
        simulation = Simulation(seed=seed, channel=Channel(loss=loss))
        services = [
            simulation.add(n, Straight(concerned_by_all=n > 1, think_ms=1, maneuver_ms=1))
            for n in (1, 2)
        ]
        simulation.request(1, 0)
        until = 0
        while until == 0 or any(s.state.bound or s.state.outbox for s in services):
            until += 50
            simulation.run(until)
        return until

    timed(lambda: [session(seed) for seed in range(10)], per=10, beside=("session[0.0]", 2))
