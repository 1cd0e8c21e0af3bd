"""Packet loss over real UDP sockets (section VI-C), to check the simulated sessions.

Each trial has its own prescriber, receiver, sockets and lossy relay.  All trials share one event
loop and run in real time.
"""

from __future__ import annotations

import asyncio
import random
from collections import Counter
from contextlib import ExitStack, closing
from typing import Any

from automcm.core.state import State
from automcm.core.station import Effects
from automcm.links.clock import AsyncioClock
from automcm.links.link import LinkError
from automcm.links.simulated_radio import Channel
from automcm.links.udp_link import UdpLink
from automcm.service.service import McService
from automcm_evaluation.framework.experiment import ExperimentError, Values
from automcm_simulation.radio.relay import Relay
from automcm_simulation.road.straight_lane import LANE_CHANGE, Straight
from automcm_spec.vocabulary.parameters import Parameters

THINK_MS = 5
MANEUVER_MS = 100
"""Maneuver time of a prescriber whose receiver does not act; agreement ends a trial earlier."""
APART_MS = 7
"""Time between the starts of two trials, so that they do not delay each other."""
LATE_MS = 10_000
"""The tolerated delay of a busy host before a trial counts as undecided."""


def over_udp(t_timeout: int, loss: float, trials: int, seed: int) -> Values:
    """Run ``trials`` in parallel; ``t_timeout`` in ms, ``loss`` the share of lost datagrams.

    A trial ends when both stations are ACTUATING in the same session (``agreed``), when the
    prescriber is back in STANDALONE (failed), or at a time limit (``undecided``).
    ``sent`` counts what both stations of all trials sent until then, by type.
    ``signal_to_agreement_ms`` has the time from request to agreement of each that agreed, sorted.
    ``latest_ms`` is by how much an alarm rang late at most: near ``t_resend`` or above, a message
    that is sent once was given up before what had come in was looked at, and the host's loss is
    added to the relay's.

    The relay delays as the simulated radio does (``Channel``).  ``seed`` feeds its draws, but they
    fall to datagrams in the order in which these arrive, and that is a matter of real time: equal
    seeds do not give equal results.

    Raises ExperimentError if the sockets cannot be had.
    """
    parameters, channel = Parameters(t_timeout=t_timeout), Channel(loss=loss)
    try:
        return asyncio.run(_run(parameters, channel, trials, random.Random(seed)))
    except (LinkError, OSError) as error:
        raise ExperimentError(f"{trials} trials over UDP cannot be run: {error}") from None


async def _run(
    parameters: Parameters, channel: Channel, trials: int, draw: random.Random
) -> Values:
    errors: list[BaseException] = []

    def failed(loop: asyncio.AbstractEventLoop, context: dict[str, Any]) -> None:
        errors.append(context.get("exception") or RuntimeError(context["message"]))

    asyncio.get_running_loop().set_exception_handler(failed)
    clock = AsyncioClock()
    with ExitStack() as stack:
        pairs = [
            _Pair(parameters, channel, clock, draw, stack.enter_context(ExitStack()))
            for _ in range(trials)
        ]
        began = clock.now()
        for n, pair in enumerate(pairs):
            clock.at(began + n * APART_MS, pair.start)
        limit_ms = trials * APART_MS + parameters.t_hold + LATE_MS
        await asyncio.wait([pair.decided for pair in pairs], timeout=limit_ms / 1000)
    if errors:
        raise errors[0]
    ended = [pair.decided.result() for pair in pairs if pair.decided.done()]
    times = sorted(ms for ms in ended if ms is not None)
    statistics = [service.statistics for pair in pairs for service in pair.services]
    sent = sum((s.sent for s in statistics), Counter[str]())
    return {
        "trials": trials,
        "agreed": len(times),
        "undecided": trials - len(ended),
        "sent": dict(sorted(sent.items())),
        "signal_to_agreement_ms": times,
        "latest_ms": max((s.latest_ms for s in statistics), default=0),
    }


class _Pair:
    """One trial.  It closes its sockets when it is decided, else ``sockets`` does."""

    def __init__(
        self,
        parameters: Parameters,
        channel: Channel,
        clock: AsyncioClock,
        draw: random.Random,
        sockets: ExitStack,
    ) -> None:
        self.decided: asyncio.Future[int | None] = asyncio.get_running_loop().create_future()
        """The time from request to agreement in ms; None: it failed."""
        self.decided.add_done_callback(lambda decided: sockets.close())
        self.services: list[McService] = []
        self._parameters, self._clock, self._sockets = parameters, clock, sockets
        relay = Relay(channel=channel, seed=draw.randrange(2**32))
        sockets.callback(relay.close)
        links = (closing(UdpLink(via=relay.address)) for _ in range(2))
        self._links = [sockets.enter_context(link) for link in links]
        self._seeds = [draw.randrange(2**32) for _ in self._links]

    def start(self) -> None:
        """Make the services at the start, because a CAM is due within ``t_cam``."""
        for station_id, (link, seed) in enumerate(zip(self._links, self._seeds, strict=True), 1):
            service = McService(
                station_id,
                Straight(think_ms=THINK_MS, maneuver_ms=MANEUVER_MS),
                link,
                self._clock,
                parameters=self._parameters,
                seed=seed,
                observers=(self._look,),
            )
            self._sockets.callback(service.close)
            self.services.append(service)
        prescriber, receiver = self.services
        receiver.start()  # first: the relay is to know it before there is anything to pass on
        prescriber.start()
        self._asked = self._clock.now()
        prescriber.command(LANE_CHANGE)

    def _look(self, before: State, effects: Effects) -> None:
        if self.decided.done():
            return
        prescriber, receiver = (service.state for service in self.services)
        if prescriber.phase == receiver.phase == "ACTUATING":  # there is but the one session
            self.decided.set_result(self._clock.now() - self._asked)
        elif not prescriber.bound:
            self.decided.set_result(None)
