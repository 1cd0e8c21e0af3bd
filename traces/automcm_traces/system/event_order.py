"""The order in which all views show the events of several logs.

Each log keeps its order, and a received message comes after its transmission. Of the events that
can come next, the earliest by aligned clocks comes first, then that of the lowest log.
"""

from __future__ import annotations

import heapq
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Generic, NamedTuple, TypeVar

Item = TypeVar("Item")
Node = tuple[int, int]
"""An event: the index of its log, and its index among the events of that log."""


class Head(NamedTuple, Generic[Item]):
    """The next event of a log, or a note before it."""

    item: Item
    node: Node
    t_ms: int
    needs: Node | None = None
    """The event that must come before it."""
    sure: bool = True
    """Whether it certainly came before; if not, it need not if that is a contradiction."""
    note: bool = False


class Ordered(Generic[Item]):
    """All items, each alone or with the one beside it. At most one item of each feed is held.

    ``ahead`` is the offset of each log's clock in ms. ``beside`` maps events to events in the same
    row; after such a pair, the offset of the second log is the time between the two. From the first
    pair that contradicts the order of the other events, the events of its two logs are placed
    alone; before two runs differ, that is rare.

    ``cycle`` is called for each cycle of events of which each certainly needs the next one: pairs
    of an event and the one that it needs.
    """

    def __init__(
        self,
        feeds: Sequence[Iterator[Head[Item]]],
        ahead: Sequence[int],
        beside: Mapping[Node, Node] | None = None,
        cycle: Callable[[list[tuple[Node, Node]]], None] = lambda circle: None,
    ) -> None:
        beside = beside or {}
        self._feeds, self._ahead, self._cycle = feeds, list(ahead), cycle
        self._mates = {**beside, **{b: a for a, b in beside.items()}}
        self._heads = [next(feed, None) for feed in feeds]
        self._at = [0] * len(feeds)
        """The number of events of each log so far."""
        self._taken = [0] * len(feeds)
        """The number of its items so far."""
        self._waiting: list[set[int]] = [set() for _ in feeds]
        """The logs that cannot go on before this one does."""
        self._heap: list[tuple[int, int, int, tuple[Node, ...]]] = []
        """Time, log, number of the items before it, and row: those that can come next."""
        for i in range(len(feeds)):
            self._offer(i)

    def _offer(self, i: int) -> None:
        """Queue the next item of a log, if it can come now."""
        if self._heads[i] is None:
            return
        row = self._row(i)
        blocker = self._blocker(row)
        if blocker is not None:
            self._waiting[blocker].add(i)
            return
        first = row[0][0]
        heapq.heappush(self._heap, (self._clock(first), first, self._taken[first], row))

    def __iter__(self) -> Iterator[tuple[Item, ...]]:
        while True:
            while not self._heap:
                stuck = set().union(*self._waiting)
                if not stuck:
                    return
                self._release(min(stuck))
                for others in self._waiting:
                    others.clear()
                for i in sorted(stuck):
                    self._offer(i)
            _, first, taken, row = heapq.heappop(self._heap)
            if taken == self._taken[first]:  # else it was offered by both logs of a pair
                yield self._take(row)

    def _take(self, row: tuple[Node, ...]) -> tuple[Item, ...]:
        logs = [i for i, _ in row]
        if len(logs) == 2:
            self._ahead[logs[1]] += self._clock(logs[1]) - self._clock(logs[0])
        items, woken = [], set(logs)
        for i in logs:
            head = self._head(i)
            items.append(head.item)
            self._at[i] += not head.note
            self._taken[i] += 1
            self._heads[i] = next(self._feeds[i], None)
            woken |= self._waiting[i]
            self._waiting[i].clear()
        for i in sorted(woken):
            self._offer(i)
        return tuple(items)

    def _head(self, i: int) -> Head[Item]:
        head = self._heads[i]
        assert head is not None, "the log has a next item"
        return head

    def _clock(self, i: int) -> int:
        return self._head(i).t_ms - self._ahead[i]

    def _row(self, i: int) -> tuple[Node, ...]:
        """The events of the row of a log's next item."""
        node = self._head(i).node
        mate = self._mates.get(node)
        return (node,) if mate is None else (min(node, mate), max(node, mate))

    def _missing(self, i: int) -> Node | None:
        """What the next item of a log needs, if it is still to come."""
        needs = self._head(i).needs
        return None if needs is None or self._at[needs[0]] > needs[1] else needs

    def _blocker(self, row: tuple[Node, ...]) -> int | None:
        """The log that must go on before a row can come."""
        for j, k in row:
            if self._at[j] < k:
                return j
            if (missing := self._missing(j)) is not None:
                return missing[0]
        return None

    def _release(self, i: int) -> None:
        """Break a cycle in which no log can go on."""
        chain: list[int] = []
        while i not in chain and self._heads[i] is not None:
            chain.append(i)
            blocker = self._blocker(self._row(i))
            assert blocker is not None, "the log waits"
            i = blocker
        circle = chain[chain.index(i) :] if i in chain else chain[-1:]
        waiting = {j for i in circle for j, k in self._row(i) if self._at[j] == k}
        missing = sorted(j for j in waiting if self._missing(j) is not None)
        guessed = [j for j in missing if not self._head(j).sure]
        torn = [row for row in map(self._row, circle) if len(row) == 2]
        if torn and not guessed:
            logs = {i for i, _ in min(torn, key=lambda row: self._clock(row[0][0]))}
            self._mates = {a: b for a, b in self._mates.items() if a[0] not in logs}
            return
        if not guessed:
            least = circle.index(min(circle))
            heads = [self._head(j) for j in (*circle[least:], *circle[:least])]
            self._cycle([(head.node, head.needs) for head in heads if head.needs is not None])
        drop = (guessed or missing)[0]
        self._heads[drop] = self._head(drop)._replace(needs=None)
