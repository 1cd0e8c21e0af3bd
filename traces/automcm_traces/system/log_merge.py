"""Several logs of one run as one partial order.

Within a station ``seq`` orders; across stations only that a message is sent before it is
received.  Times of two stations are not compared: two events that no chain of messages connects
have no order here.

A message received is matched with the transmission that it names (``tx``).  Where the link does
not tell, it is matched by sender and content, the first copy with the first: copies are the same
byte by byte, so which of them arrived cannot be told, but how many did can.
"""

from __future__ import annotations

import json
from bisect import bisect_right
from collections import Counter, defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from itertools import pairwise

from automcm_spec.vocabulary.messages import Fields
from automcm_traces.format.log import Event, Receive, Send
from automcm_traces.format.reader import Log

Node = tuple[int, int]
"""An event: the place of its log among those merged, and its place in ``Log.events``."""


class MergeError(Exception):
    """Logs that are not those of one run; the text is one line and names the files."""


@dataclass(frozen=True, slots=True)
class Match:
    """The transmission that a message received is."""

    sent: Node
    """Where it was sent; of equal copies that the link does not name, in order."""
    first: Node
    """The first that it can have been: certainly sent before it was received."""
    sure: bool
    """It is this one: named by ``tx``, or the only one of its content."""


@dataclass(slots=True)
class Merged:
    """The logs of one run, in order of their stations, and what connects them."""

    logs: tuple[Log, ...]
    matches: dict[Node, Match] = field(default_factory=dict)
    """By the node of a message received: where it was sent."""
    again: dict[Node, Node] = field(default_factory=dict)
    """Receptions beyond the first of a transmission at a station: where it was sent."""
    order: list[Node] = field(default_factory=list)
    """Every event, each after what it depends on; the lowest station that can go on does."""
    cycles: list[str] = field(default_factory=list)
    """Messages that would have to be received before they were sent, one line each."""
    notices: list[str] = field(default_factory=list)
    _past: list[list[tuple[int, tuple[int, ...]]]] = field(default_factory=list)

    @property
    def run(self) -> str:
        """The id of the run, the same in all logs."""
        return self.logs[0].header.run

    @property
    def stations(self) -> list[int]:
        """Whose logs they are, in their order."""
        return [log.header.station for log in self.logs]

    def place(self, station: int) -> int | None:
        """The place of a station's log, if there is one."""
        stations = self.stations
        return stations.index(station) if station in stations else None

    def event(self, node: Node) -> Event:
        """The event at a place."""
        return self.logs[node[0]].events[node[1]][1]

    def where(self, node: Node) -> str:
        """``FILE:LINE`` of an event."""
        log = self.logs[node[0]]
        return f"{log.file}:{log.events[node[1]][0]}"

    def before(self, a: Node, b: Node) -> bool:
        """Whether ``a`` certainly came before ``b``: a chain of messages leads from it to it."""
        if a[0] == b[0]:
            return a[1] < b[1]
        known = self._past[b[0]]
        at = bisect_right(known, b[1], key=lambda entry: entry[0]) - 1
        return at >= 0 and known[at][1][a[0]] > a[1]


def merge(logs: Sequence[Log]) -> Merged:
    """The logs of one run, merged.

    Raises MergeError if there is none, if they are of different runs, or if two are of one
    station.
    """
    if not logs:
        raise MergeError("no log to merge")
    ordered = sorted(logs, key=lambda log: (log.header.station, log.file))
    for log in ordered[1:]:
        if log.header.run != ordered[0].header.run:
            raise MergeError(
                f"{log.file}: run {log.header.run!r}, but {ordered[0].file} is of run "
                f"{ordered[0].header.run!r}"
            )
    for one, other in pairwise(ordered):
        if one.header.station == other.header.station:
            raise MergeError(f"{other.file}: station {one.header.station}, as is {one.file}")
    merged = Merged(tuple(ordered))
    _match(merged)
    _linearise(merged)
    return merged


def content(message: Fields) -> str:
    """A message as a text that is equal for equal messages."""
    return json.dumps(message, sort_keys=True, separators=(",", ":"))


def _match(merged: Merged) -> None:
    """Find where each message received was sent."""
    by_tx: dict[str, Node] = {}
    by_content: dict[tuple[int, str], list[Node]] = defaultdict(list)
    named = all(e.tx is not None for _, e in receptions(merged))
    for i, log in enumerate(merged.logs):
        for k, (_, e) in enumerate(log.events):
            if isinstance(e, Send):
                if e.tx in by_tx:
                    first = merged.where(by_tx[e.tx])
                    merged.notices.append(f"{merged.where((i, k))}: tx {e.tx} again, as {first}")
                by_tx.setdefault(e.tx, (i, k))
                if not named:
                    by_content[log.header.station, content(e.message)].append((i, k))
    unnamed = 0
    for i, log in enumerate(merged.logs):
        used: Counter[tuple[int, str]] = Counter()
        seen: set[Node] = set()
        for k, (_, e) in enumerate(log.events):
            if not isinstance(e, Receive) or e.message is None:
                continue
            found = None
            if e.tx is not None:
                sent = by_tx.get(e.tx)
                if sent is not None and _message(merged, sent) == e.message:
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
            f"{unnamed} messages received name no transmission: matched by sender, content and "
            "order, so of equal copies the first counts as the one received"
        )


def _message(merged: Merged, node: Node) -> object:
    event = merged.event(node)
    return event.message if isinstance(event, Send) else None


def _linearise(merged: Merged) -> None:
    """Order the events, and note what each has seen of the other stations."""
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
    """What an event had seen of each log, as a number of events."""
    known = merged._past[node[0]]
    at = bisect_right(known, node[1], key=lambda entry: entry[0]) - 1
    return known[at][1] if at >= 0 else (0,) * len(merged.logs)


def _break(merged: Merged, at: list[int], needs: dict[Node, Node]) -> int:
    """No log can go on: name the messages in the circle, and let the lowest station go on."""
    i = next(i for i, log in enumerate(merged.logs) if at[i] < len(log.events))
    chain: list[int] = []
    while i not in chain:
        chain.append(i)
        i = needs[i, at[i]][0]
    circle = chain[chain.index(i) :]
    i = min(circle)
    parts = [
        f"{merged.where((j, at[j]))} receives what {merged.where(needs[j, at[j]])} sends"
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
    """Every message received, station by station."""
    for i, log in enumerate(merged.logs):
        for k, (_, e) in enumerate(log.events):
            if isinstance(e, Receive) and e.message is not None:
                yield (i, k), e
