"""Several logs of one run as one partial order, with the fate of each message.

``seq`` orders the events of a station. Across stations, a transmission comes before its reception.
Times of different stations are not compared: two events that no chain of messages connects have no
order here, but stand in one possible order (``event_order``).
"""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from itertools import pairwise

from automcm_spec.log_format.log import Event, Receive, Send
from automcm_spec.log_format.reader import Log
from automcm_traces.system.event_order import Head, Node, Ordered
from automcm_traces.system.fates import Arrow, Fates, head
from automcm_traces.system.log_clocks import Clocks
from automcm_traces.system.matching import Ledger, Matches


class MergeError(Exception):
    """The logs are not of one run; the text is one line and names the files."""


@dataclass(slots=True)
class Merged:
    """The logs of one run, sorted by station, and the messages between them."""

    logs: tuple[Log, ...]
    stations: list[int]
    """The stations of the logs, in order."""
    clocks: Clocks
    nodes: list[list[Node]]
    """For each log, the nodes of its events."""
    arrows: dict[Node, tuple[Arrow, ...]] = field(default_factory=dict)
    """The messages that arrive at an event, or leave there and arrive nowhere."""
    forged: dict[Node, str] = field(default_factory=dict)
    """Why certain received messages cannot have been sent."""
    notices: list[str] = field(default_factory=list)
    order: list[Node] = field(default_factory=list)
    """All events in the order of ``event_order``."""
    cycles: list[str] = field(default_factory=list)
    """Cycles of messages that were received before they were sent, one line each."""
    _past: list[tuple[list[int], list[tuple[int, ...]]]] = field(default_factory=list)
    """For each log, the events that depend on others, and what they depend on (``_known``)."""

    @property
    def run(self) -> str:
        """The name of the run, equal in all logs."""
        return self.logs[0].header.run

    def place(self, station: int) -> int:
        """The index of the log of a station that has one."""
        return self.stations.index(station)

    def event(self, node: Node) -> Event:
        """The event of a node."""
        return self.logs[node[0]].events[node[1]][1]

    def where(self, node: Node) -> str:
        """``FILE:LINE`` of an event."""
        log = self.logs[node[0]]
        return f"{log.file}:{log.events[node[1]][0]}"

    def before(self, a: Node, b: Node) -> bool:
        """Whether ``a`` certainly came before ``b``: a chain of messages leads from ``a`` to
        ``b``."""
        return a[1] < (b[1] if a[0] == b[0] else self._known(b)[a[0]])

    def feed(self, i: int) -> Iterator[Head[Node]]:
        """The events of a log, as ``Ordered`` takes them."""
        for node, (_, event) in zip(self.nodes[i], self.logs[i].events, strict=True):
            yield head(node, node, event, self.arrows.get(node, ()))

    def _known(self, node: Node) -> tuple[int, ...]:
        """For each log, the number of its events that this event depends on."""
        places, known = self._past[node[0]]
        at = bisect_right(places, node[1]) - 1
        return known[at] if at >= 0 else (0,) * len(self.logs)

    def _line_up(self, matches: Matches) -> None:
        """Order the events, and record the events of other stations that each depends on."""
        feeds = [self.feed(i) for i in range(len(self.logs))]
        self._past = [([], []) for _ in self.logs]
        at, received = [0] * len(self.logs), [0] * len(self.logs)
        for (node,) in Ordered(feeds, self.clocks.offsets(), cycle=self._cycle):
            self.order.append(node)
            at[node[0]] += 1
            event = self.event(node)
            if not isinstance(event, Receive) or event.message is None:
                continue
            match = matches.match(node[0], received[node[0]])
            received[node[0]] += 1
            if match is None or at[match.first[0]] <= match.first[1]:
                continue  # it depends on no other, or is part of a cycle
            pairs = zip(self._known(node), self._known(match.first), strict=True)
            known = [max(a, b) for a, b in pairs]
            known[match.first[0]] = max(known[match.first[0]], match.first[1] + 1)
            self._past[node[0]][0].append(node[1])
            self._past[node[0]][1].append(tuple(known))

    def _cycle(self, circle: list[tuple[Node, Node]]) -> None:
        parts = [f"{self.where(a)} receives the message of {self.where(b)}" for a, b in circle]
        self.cycles.append("received before it was sent: " + ", ".join(parts))


def merge(logs: Sequence[Log]) -> Merged:
    """Merge the logs of one run.

    Raises MergeError if there are no logs, if they are of different runs, or if two are of one
    station.
    """
    if not logs:
        raise MergeError("no log to merge")
    inputs = tuple(sorted(logs, key=lambda log: (log.header.station, log.file)))
    for log in inputs[1:]:
        if log.header.run != inputs[0].header.run:
            raise MergeError(
                f"{log.file}: must be of run {inputs[0].header.run!r}, as is "
                f"{inputs[0].file}, not of run {log.header.run!r}"
            )
    for one, other in pairwise(inputs):
        if one.header.station == other.header.station:
            raise MergeError(
                f"{other.file}: is of station {one.header.station}, as is {one.file}; "
                "give one log per station"
            )
    matches = Matches([Ledger.of(log) for log in inputs])
    nodes = [[(i, k) for k in range(len(log.events))] for i, log in enumerate(inputs)]
    merged = Merged(inputs, matches.stations, matches.clocks, nodes)
    merged.notices += _repeated(merged)
    if matches.guessed:
        merged.notices.append(
            f"{matches.guessed} received messages name no transmission: matched by sender and "
            "content, so of equal copies the latest that was sent before counts as received"
        )
    fates = Fates(matches)
    for own, log in zip(nodes, inputs, strict=True):
        for node, (_, event) in zip(own, log.events, strict=True):
            if arrows := fates.arrows(node, event):
                merged.arrows[node] = arrows
    merged.forged = fates.forged
    merged._line_up(matches)
    return merged


def _repeated(merged: Merged) -> Iterator[str]:
    """A notice for each transmission that takes the ``tx`` of another."""
    first: dict[tuple[int, str], Node] = {}
    for node, event in sends(merged):
        if (was := first.setdefault((node[0], event.tx), node)) != node:
            yield f"{merged.where(node)}: tx {event.tx} repeats {merged.where(was)}"


def sends(merged: Merged) -> Iterator[tuple[Node, Send]]:
    """Every transmission, station by station."""
    for i, log in enumerate(merged.logs):
        for k, (_, e) in enumerate(log.events):
            if isinstance(e, Send):
                yield (i, k), e
