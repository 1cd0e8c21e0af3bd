"""Several logs of one run as one partial order, with the fate of each message.

``seq`` orders the events of a station. Across stations, a transmission comes before its reception.
Times of different stations are not compared: two events that no chain of messages connects have no
order here, but stand in one possible order (``event_order``).
"""

from __future__ import annotations

from array import array
from bisect import bisect_right
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from itertools import count, pairwise, repeat

from automcm_spec.log_format.log import Event, Receive, Send, transmission
from automcm_spec.log_format.reader import Log
from automcm_spec.vocabulary.messages import Fields
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
    matches: Matches
    forged: dict[Node, str] = field(default_factory=dict)
    """Why certain received messages cannot have been sent."""
    notices: list[str] = field(default_factory=list)
    cycles: list[str] = field(default_factory=list)
    """Cycles of messages that were received before they were sent, one line each."""
    _turns: array[int] = field(default_factory=lambda: array("L"))
    """The log of each event, in the order of ``event_order``."""
    _past: list[tuple[array[int], array[int]]] = field(default_factory=list)
    """For each log, the events that depend on others, and what each depends on (``_known``)."""

    @property
    def run(self) -> str:
        """The name of the run, equal in all logs."""
        return self.logs[0].header.run

    @property
    def order(self) -> list[Node]:
        """All events in the order of ``event_order``."""
        at = [count() for _ in self.logs]
        return [(i, next(at[i])) for i in self._turns]

    def arrows(self) -> Iterator[Arrow]:
        """The messages, log by log: each where it arrives, or else where it leaves."""
        fates = Fates(self.matches)
        for i, log in enumerate(self.logs):
            for k, (_, event) in enumerate(log.events):
                yield from fates.arrows((i, k), event)

    def place(self, station: int) -> int:
        """The index of the log of a station that has one."""
        return self.stations.index(station)

    def event(self, node: Node) -> Event:
        """The event of a node."""
        return self.logs[node[0]].events[node[1]][1]

    def message(self, node: Node) -> Fields:
        """The message of an event."""
        event = self.event(node)
        assert isinstance(event, Send | Receive) and event.message is not None
        return event.message

    def where(self, node: Node) -> str:
        """``FILE:LINE`` of an event."""
        log = self.logs[node[0]]
        return f"{log.file}:{log.events[node[1]][0]}"

    def before(self, a: Node, b: Node) -> bool:
        """Whether ``a`` certainly came before ``b``: a chain of messages leads from ``a`` to
        ``b``."""
        return a[1] < (b[1] if a[0] == b[0] else self._known(b)[a[0]])

    def feed(self, i: int, fates: Fates) -> Iterator[Head[Node]]:
        """The events of a log, as ``Ordered`` takes them; ``fates`` gets only receptions."""
        for k, (_, event) in enumerate(self.logs[i].events):
            arrows = fates.arrows((i, k), event) if isinstance(event, Receive) else ()
            yield head((i, k), (i, k), event, arrows)

    def _known(self, node: Node) -> Sequence[int]:
        """For each log, the number of its events that this event depends on."""
        (places, known), logs = self._past[node[0]], len(self.logs)
        end = bisect_right(places, node[1]) * logs
        return known[end - logs : end] if end else [0] * logs

    def _line_up(self) -> None:
        """Order the events, and record the events of other stations that each depends on."""
        fates = Fates(self.matches)
        feeds = [self.feed(i, fates) for i in range(len(self.logs))]
        self._past = [(array("I"), array("I")) for _ in self.logs]
        at, received = [0] * len(self.logs), [0] * len(self.logs)
        for ((i, k),) in Ordered(feeds, self.clocks.offsets(), cycle=self._cycle):
            self._turns.append(i)
            at[i] += 1
            event = self.logs[i].events[k][1]
            if not isinstance(event, Receive) or event.message is None:
                continue
            match = self.matches.match(i, received[i])
            received[i] += 1
            if match is None or at[match[1][0]] <= match[1][1]:
                continue  # it depends on no other, or is part of a cycle
            first = match[1]
            known = array("I", map(max, self._known((i, k)), self._known(first)))
            known[first[0]] = max(known[first[0]], first[1] + 1)
            self._past[i][0].append(k)
            self._past[i][1].extend(known)
        self.forged = dict(sorted(fates.forged.items()))

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
    matches = Matches([*map(Ledger.of, inputs, repeat({}))])
    merged = Merged(inputs, matches.stations, matches.clocks, matches)
    merged.notices += _repeated(merged)
    if matches.guessed:
        merged.notices.append(
            f"{matches.guessed} received messages name no transmission: matched by sender and "
            "content, so of equal copies the latest that was sent before counts as received"
        )
    merged._line_up()
    return merged


def _repeated(merged: Merged) -> Iterator[str]:
    """A notice for each transmission that takes the ``tx`` of another."""
    for i, ledger in enumerate(merged.matches.ledgers):
        first: dict[int, int] = {}
        for k in ledger.sent.at:
            event = merged.event((i, k))
            assert isinstance(event, Send), "a ledger's sent messages"
            station, number = transmission(event.tx)
            if (was := first.setdefault(station << 64 | number, k)) != k:
                repeats = f"tx {event.tx} repeats {merged.where((i, was))}"
                yield f"{merged.where((i, k))}: {repeats}"
