"""How busy the channel gets when many vehicles send CAMs, with and without congestion control."""

from __future__ import annotations

from collections import defaultdict
from functools import partial
from itertools import pairwise
from statistics import fmean as mean

import numpy as np

from automcm.links.clock import VirtualClock
from automcm_evaluation.framework.experiment import Values
from automcm_evaluation.framework.intervals import quantile
from automcm_evaluation.radio.radio_traffic import FourLanes, positions
from automcm_simulation.radio.radio_link import RadioLinks
from automcm_simulation.radio.table_radio import TableRadio
from automcm_spec.vocabulary.messages import BROADCAST
from automcm_spec.vocabulary.parameters import Parameters

COUNTED_MS = 2000
"""At the end of a run."""
NEAR_M = 100.0
"""A receiver needs the CAMs of vehicles so near."""
STEP_MS = 100


def crowd(values: Values, seed: int) -> Values:
    """Vehicles on a road that send CAMs of ``size_bytes`` by t_cam.

    ``busy`` is the mean channel busy ratio; ``per_s`` the CAMs sent a second and vehicle; of pairs
    within NEAR_M ``arrived`` is the share of those sent, and ``gap_ms`` the time between two
    receptions that 95 % do not exceed.
    """
    traffic = FourLanes(name="", per_km=values["per_km"], seconds=0, seed=seed % 2**31)
    n, clock, random = traffic.vehicles, VirtualClock(), np.random.default_rng(seed)
    courses = positions(traffic)
    place = np.zeros((n, 2))

    def places() -> dict[int, tuple[float, float]]:
        now = next(courses)
        place[:] = [now[i + 1] for i in range(n)]
        return now

    radio = TableRadio(traffic.seed)
    links = RadioLinks(clock, radio, places, congestion_control=values["control"])
    begin = values["run_ms"] - COUNTED_MS
    received: dict[tuple[int, int], list[int]] = defaultdict(list)

    def receive(receiver: int, _data: bytes, tx: str | None) -> None:
        if clock.now() >= begin:
            received[int(tx or 0), receiver].append(clock.now())

    def send(station: int) -> None:
        ends[station].send(bytes(values["size_bytes"]), BROADCAST, str(station))
        clock.at(clock.now() + Parameters().t_cam, partial(send, station))

    ends = {station: links.link(station) for station in range(1, n + 1)}
    for station, link in ends.items():
        link.open(partial(receive, station))
        clock.at(int(random.integers(Parameters().t_cam)), partial(send, station))
    clock.run(begin)
    sent = dict(links.sent)
    clock.run(values["run_ms"])
    apart = np.hypot(*(place[:, None] - place[None, :]).transpose(2, 0, 1))
    pairs = [(int(a) + 1, int(b) + 1) for a, b in np.argwhere(apart < NEAR_M) if a != b]
    now = {station: links.sent[station] - sent.get(station, 0) for station in ends}
    gaps = [b - a for pair in pairs for a, b in pairwise(received[pair])]
    return {
        "busy": round(mean([radio.channel_busy_ratio(station) for station in ends]), 4),
        "per_s": round(1000 * mean(list(now.values())) / COUNTED_MS, 2),
        "arrived": round(
            sum(len(received[p]) for p in pairs) / max(1, sum(now[p[0]] for p in pairs)), 4
        ),
        "gap_ms": round(quantile(gaps, 0.95)) if gaps else None,
    }
