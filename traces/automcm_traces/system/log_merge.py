"""Several logs of one run as one partial order.

``seq`` orders the events of a station. Across stations, a transmission comes before its reception.
Times of different stations are not compared: two events that no chain of messages connects have no
order here.

A received message is matched with the transmission that it names (``tx``). If the link provides no
``tx``, it is matched by sender and content, first copy with first copy. Copies are equal byte by
byte, so it is unknown which of them was received, but their number is known.
"""

from __future__ import annotations

import json
from bisect import bisect_right
from collections import Counter, defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from itertools import pairwise

from automcm_spec.log_format.log import Event, Receive, Send
from automcm_spec.log_format.reader import Log
from automcm_spec.vocabulary.messages import Fields, same

Node = tuple[int, int]
"""An event: the index of its log among the merged logs, and its index in ``Log.events``."""


class MergeError(Exception):
    """The logs are not of one run; the text is one line and names the files."""


@dataclass(frozen=True, slots=True)
class Match:
    """The transmission of a received message."""

    sent: Node
    """The transmission; of equal copies without ``tx``, in order."""
    first: Node
    """The first possible transmission, which certainly came before the reception."""
    sure: bool
    """Whether the match is certain: named by ``tx``, or the only one with its content."""


@dataclass(slots=True)
class Merged:
    """The logs of one run, sorted by station, and the matches between them."""

    logs: tuple[Log, ...]
    matches: dict[Node, Match] = field(default_factory=dict)
    """The transmission of each reception."""
    again: dict[Node, Node] = field(default_factory=dict)
    """The transmission of each repeated reception at the same station."""
    rejected: dict[Node, Node] = field(default_factory=dict)
    """The transmission that a rejected datagram names. Its ``tx`` is not signed, so it is no match:
    it orders nothing and says nothing about clocks."""
    order: list[Node] = field(default_factory=list)
    """All events in an order that respects all dependencies; the lowest station goes first."""
    cycles: list[str] = field(default_factory=list)
    """Cycles of messages that were received before they were sent, one line each."""
    notices: list[str] = field(default_factory=list)
    _past: list[list[tuple[int, tuple[int, ...]]]] = field(default_factory=list)

    @property
    def run(self) -> str:
        """The name of the run, equal in all logs."""
        return self.logs[0].header.run

    @property
    def stations(self) -> list[int]:
        """The stations of the logs, in order."""
        return [log.header.station for log in self.logs]

    def place(self, station: int) -> int | None:
        """The index of a station's log; None if there is none."""
        stations = self.stations
        return stations.index(station) if station in stations else None

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
        if a[0] == b[0]:
            return a[1] < b[1]
        known = self._past[b[0]]
        at = bisect_right(known, b[1], key=lambda entry: entry[0]) - 1
        return at >= 0 and known[at][1][a[0]] > a[1]


def merge(logs: Sequence[Log]) -> Merged:
    """Merge the logs of one run.

    Raises MergeError if there are no logs, if they are of different runs, or if two are of one
    station.
    """
    if not logs:
        raise MergeError("no log to merge")
    ordered = sorted(logs, key=lambda log: (log.header.station, log.file))
    for log in ordered[1:]:
        if log.header.run != ordered[0].header.run:
            raise MergeError(
                f"{log.file}: must be of run {ordered[0].header.run!r}, as is "
                f"{ordered[0].file}, not of run {log.header.run!r}"
            )
    for one, other in pairwise(ordered):
        if one.header.station == other.header.station:
            raise MergeError(
                f"{other.file}: is of station {one.header.station}, as is {one.file}; "
                "give one log per station"
            )
    merged = Merged(tuple(ordered))
    _match(merged)
    _linearise(merged)
    return merged


_ENCODER = json.JSONEncoder(sort_keys=True, separators=(",", ":"))


def content(message: Fields) -> str:
    """A message as text; equal messages give equal texts."""
    return _ENCODER.encode(message)


def _match(merged: Merged) -> None:
    """Match each received message with its transmission."""
    by_tx: dict[str, Node] = {}
    by_content: dict[tuple[int, str], list[Node]] = defaultdict(list)
    named = all(e.tx is not None for _, e in receptions(merged))
    for i, log in enumerate(merged.logs):
        for k, (_, e) in enumerate(log.events):
            if isinstance(e, Send):
                if e.tx in by_tx:
                    first = merged.where(by_tx[e.tx])
                    merged.notices.append(f"{merged.where((i, k))}: tx {e.tx} repeats {first}")
                by_tx.setdefault(e.tx, (i, k))
                if not named:
                    by_content[log.header.station, content(e.message)].append((i, k))
    unnamed = 0
    for i, log in enumerate(merged.logs):
        used: Counter[tuple[int, str]] = Counter()
        seen: set[Node] = set()
        for k, (_, e) in enumerate(log.events):
            if not isinstance(e, Receive):
                continue
            sent = None if e.tx is None else by_tx.get(e.tx)
            if e.rejected is not None and sent is not None and sent[0] != i:
                merged.rejected[i, k] = sent
            if e.message is None:
                continue
            found = None
            if e.tx is not None:
                if sent is not None and same(_message(merged, sent), e.message):
                    found = Match(sent, sent, True)
            elif isinstance(src := e.message.get("src"), int):
                key = (src, content(e.message))
                copies = by_content.get(key)
                if copies and copies[0][0] != i:
                    unnamed += 1
                    n = used[key]
                    used[key] += 1
                    found = Match(copies[min(n, len(copies) - 1)], copies[0], len(copies) == 1)
            if found is None:
                continue
            if found.sent in seen:
                merged.again[i, k] = found.sent
            seen.add(found.sent)
            merged.matches[i, k] = found
    if unnamed:
        merged.notices.append(
            f"{unnamed} received messages name no transmission: matched by sender, content and "
            "order, so of equal copies the first counts as received"
        )


def _message(merged: Merged, node: Node) -> object:
    event = merged.event(node)
    return event.message if isinstance(event, Send) else None


def _linearise(merged: Merged) -> None:
    """Order the events, and record the events of other stations that each depends on."""
    logs = merged.logs
    ends = [len(log.events) for log in logs]
    at = [0] * len(logs)
    merged._past = [[] for _ in logs]
    past = [[0] * len(logs) for _ in logs]
    needs = _needs(merged)
    waiting: list[list[int]] = [[] for _ in logs]
    ready = list(range(len(logs)))
    while any(a < end for a, end in zip(at, ends, strict=True)):
        if not ready:
            ready = [_break(merged, at, needs)]
        i = ready.pop(0)
        while at[i] < ends[i]:
            sent = needs.get((i, at[i]))
            if sent is not None:
                if at[sent[0]] <= sent[1]:
                    waiting[sent[0]].append(i)
                    break
                before = past[sent[0]] if at[sent[0]] == sent[1] + 1 else _past(merged, sent)
                known = [max(a, b) for a, b in zip(past[i], before, strict=True)]
                known[sent[0]] = max(known[sent[0]], sent[1] + 1)
                past[i] = known
                merged._past[i].append((at[i], tuple(known)))
            merged.order.append((i, at[i]))
            at[i] += 1
            woken = [w for w in waiting[i] if _free(needs, at, w)]
            if woken:
                waiting[i] = [w for w in waiting[i] if w not in woken]
                ready = sorted({*ready, *woken})
                if ready[0] < i:
                    ready = sorted({*ready, i})
                    break


def _needs(merged: Merged) -> dict[Node, Node]:
    return {node: match.first for node, match in merged.matches.items()}


def _free(needs: dict[Node, Node], at: list[int], i: int) -> bool:
    sent = needs.get((i, at[i]))
    return sent is None or at[sent[0]] > sent[1]


def _past(merged: Merged, node: Node) -> tuple[int, ...]:
    """For each log, the number of its events that this event depends on."""
    known = merged._past[node[0]]
    at = bisect_right(known, node[1], key=lambda entry: entry[0]) - 1
    return known[at][1] if at >= 0 else (0,) * len(merged.logs)


def _break(merged: Merged, at: list[int], needs: dict[Node, Node]) -> int:
    """Break a cycle of messages, in which no log can continue: report it and release the lowest
    station."""
    i = next(i for i, log in enumerate(merged.logs) if at[i] < len(log.events))
    chain: list[int] = []
    while i not in chain:
        chain.append(i)
        i = needs[i, at[i]][0]
    circle = chain[chain.index(i) :]
    i = min(circle)
    parts = [
        f"{merged.where((j, at[j]))} receives the message of {merged.where(needs[j, at[j]])}"
        for j in (*circle[circle.index(i) :], *circle[: circle.index(i)])
    ]
    merged.cycles.append("received before it was sent: " + ", ".join(parts))
    del needs[i, at[i]]
    return i


def sends(merged: Merged) -> Iterator[tuple[Node, Send]]:
    """Every transmission, station by station."""
    for i, log in enumerate(merged.logs):
        for k, (_, e) in enumerate(log.events):
            if isinstance(e, Send):
                yield (i, k), e


def receptions(merged: Merged) -> Iterator[tuple[Node, Receive]]:
    """Every received message, station by station."""
    for i, log in enumerate(merged.logs):
        for k, (_, e) in enumerate(log.events):
            if isinstance(e, Receive) and e.message is not None:
                yield (i, k), e
