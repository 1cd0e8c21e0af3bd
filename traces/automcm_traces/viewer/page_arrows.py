"""The messages of a run as arrows of a page: source, destination and fate."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

from automcm_traces.format.log import Receive, Send
from automcm_traces.system.clock_offsets import Clocks
from automcm_traces.system.delivery import Deliveries
from automcm_traces.system.log_merge import Node
from automcm_traces.viewer.page_run import Run

DELIVERED, LOST, DUPLICATE, UNOBSERVED, IN_FLIGHT, UNSENT, FORGED, OVERHEARD = range(8)
KINDS = {"duplicated": DUPLICATE, "lost": LOST, "unobserved": UNOBSERVED, "in_flight": IN_FLIGHT}


class Arrow(NamedTuple):
    """A message, or a copy of it, on its way to one station."""

    leaves: Node
    """The transmission; for a message without a logged transmission, the reception."""
    kind: int
    arrives: Node | None
    source: int
    to: int
    """The stations; 0 if unknown, or if all are meant."""


def arrows(run: Run) -> Iterator[Arrow]:
    """An arrow for every message, in no particular order."""
    merged, alone = run.merged, len(run.logs) == 1
    deliveries = Deliveries(merged, Clocks(merged))
    delivered: set[Node] = set()
    for d in deliveries.all:
        source = merged.stations[d.sent[0]]
        if not d.received:
            yield Arrow(d.sent, KINDS[d.outcome], None, source, d.to)
        for n, node in enumerate(d.received):
            delivered.add(node)
            yield Arrow(d.sent, DUPLICATE if n else DELIVERED, node, source, d.to)
    forged = {f.at for f in deliveries.forged}
    for i, log in enumerate(run.logs):
        me = log.header.station
        for k, (_, event) in enumerate(log.events):
            node, match = (i, k), merged.matches.get((i, k))
            if alone and isinstance(event, Send) and not event.message.get("dst"):
                yield Arrow(node, UNOBSERVED, None, me, 0)
            elif isinstance(event, Receive) and match is None:
                src = (event.message or {}).get("src")
                source = src if type(src) is int else 0
                yield Arrow(node, FORGED if node in forged else UNSENT, None, source, me)
            elif match is not None and node not in delivered and match.sent[0] != i:
                yield Arrow(match.sent, OVERHEARD, node, merged.stations[match.sent[0]], me)
