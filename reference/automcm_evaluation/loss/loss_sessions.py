"""Many sessions on a lossy radio without a road, up to the agreement (VI-C)."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from random import Random
from typing import NamedTuple

from automcm.core.state import State
from automcm.core.station import Effects
from automcm.links.simulated_radio import Channel
from automcm.service.service import McService
from automcm_evaluation.framework.experiment import Values
from automcm_simulation.road.simulation import Simulation
from automcm_simulation.road.straight_lane import Straight
from automcm_spec.vocabulary.parameters import Parameters

STEP_MS = 100
BIN_MS = 100
"""Bin width of the histogram of times."""


class SessionOutcome(NamedTuple):
    """The outcome of one session: whether both stations act, the time of that or of the end, and
    the messages sent up to the end of that STEP_MS."""

    agreed: bool
    after_ms: int
    sent: int
    """The number of messages without CAMs."""


def session(simulation: Simulation, t_timeout: int) -> SessionOutcome:
    """Adds a prescriber, 1, and an accepting receiver, 2, and runs one session of theirs, from the
    request on, until the prescriber is in ACTUATING or back in STANDALONE."""
    ends: list[tuple[str, int]] = []

    def observe(before: State, effects: Effects) -> None:
        if before.bound and effects.state.phase in ("ACTUATING", "STANDALONE"):
            ends.append((effects.state.phase, effects.now_ms))

    for station_id in (1, 2):
        simulation.add(
            station_id,
            Straight(concerned_by_all=station_id == 2, think_ms=1),
            Parameters(t_timeout=t_timeout),  # CAMs too: a receiver acts first (NEG-2, ACT-2)
            observers=(observe,) if station_id == 1 else (),
        )
    simulation.request(1, 0)
    until = 0
    while not ends:
        until += STEP_MS
        simulation.run(until)
    phase, at = ends[0]
    # S-3: a prescriber acts only on an Acceptance that its target, then committed, has sent.
    return SessionOutcome(phase == "ACTUATING", at, messages(simulation.services.values()))


def messages(services: Iterable[McService]) -> int:
    """The number of messages that these have sent, without CAMs."""
    sent = [service.statistics.sent for service in services]
    return sum(each.total() - each["CAM"] for each in sent)


def block(values: Values, seed: int) -> Values:
    """Sessions in one cell: how many ``agreed``, all messages ``sent``, the sum of the times to
    agreement ``agreed_ms``, and their histogram ``bins`` (from n x BIN_MS on)."""
    random = Random(seed)
    channel = Channel(loss=values["loss"] / 100, burst_ms=values["burst_ms"])
    bins: Counter[int] = Counter()
    agreed_ms = sent = 0
    for _ in range(values["trials"]):
        simulation = Simulation(seed=random.getrandbits(31), channel=channel)
        one = session(simulation, values["t_timeout"])
        sent += one.sent
        if one.agreed:
            agreed_ms += one.after_ms
            bins[one.after_ms // BIN_MS] += 1
    return {
        "agreed": bins.total(),
        "sent": sent,
        "agreed_ms": agreed_ms,
        "bins": [[n, bins[n]] for n in sorted(bins)],
    }
