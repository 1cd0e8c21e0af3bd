"""The order of the rows of a page, for one run or two side by side."""

from __future__ import annotations

import heapq
from collections.abc import Mapping, Sequence

from automcm_spec.log_format.reader import Log
from automcm_traces.system.log_merge import Node


def order(
    logs: Sequence[Log],
    needs: Mapping[Node, Node],
    ahead: Sequence[int],
    beside: Mapping[Node, Node],
) -> list[tuple[Node, ...]]:
    """All events, each alone or with the event beside it, each after the events it depends on.
    Among the possible next events the earliest comes first, then the lowest log.

    ``needs`` maps an event to the event that must come before it. ``ahead`` is the offset of each
    log's clock in ms. ``beside`` maps events to events in the same row; after such a pair, the
    offset of the second log is the time between the two. From the first pair that conflicts with
    the order of the other events, the events of its two logs are placed alone; before two runs
    differ, that is rare.
    """
    needs, ahead = dict(needs), list(ahead)
    mates = {**beside, **{b: a for a, b in beside.items()}}
    at = [0] * len(logs)
    waiting: list[set[int]] = [set() for _ in logs]
    heap: list[tuple[int, Node]] = []
    found: list[tuple[Node, ...]] = []

    def clock(node: Node) -> int:
        return logs[node[0]].events[node[1]][1].t_ms - ahead[node[0]]

    def together(node: Node) -> tuple[Node, ...]:
        mate = mates.get(node)
        return (node,) if mate is None else (min(node, mate), max(node, mate))

    def offer(i: int) -> None:
        """Queue the next event of a log, if it can come now."""
        if at[i] == len(logs[i].events):
            return
        nodes = together((i, at[i]))
        for node in nodes:
            sent = needs.get(node)
            if at[node[0]] < node[1]:
                waiting[node[0]].add(i)
                return
            if sent is not None and at[sent[0]] <= sent[1]:
                waiting[sent[0]].add(i)
                return
        heapq.heappush(heap, (clock(nodes[0]), nodes[0]))

    for i in range(len(at)):
        offer(i)
    while heap or any(waiting):
        if not heap:
            stuck = sorted(set().union(*waiting))
            cams = [i for i in stuck if (i, at[i]) in needs and logs[i].events[at[i]][1].is_cam]
            torn = [together((i, at[i])) for i in stuck if (i, at[i]) in mates]
            if torn and cams:  # CAMs are not compared
                del needs[cams[0], at[cams[0]]]
            elif torn:
                a, b = min(torn, key=lambda nodes: clock(nodes[0]))
                mates = {n: m for n, m in mates.items() if n[0] not in (a[0], b[0])}
            else:  # received before it was sent, which the report states
                del needs[stuck[0], at[stuck[0]]]
            for others in waiting:
                others.clear()
            for i in stuck:
                offer(i)
            continue
        _, first = heapq.heappop(heap)
        if at[first[0]] > first[1]:
            continue  # offered by both logs of a pair
        nodes = together(first)
        if len(nodes) == 2:
            ahead[nodes[1][0]] += clock(nodes[1]) - clock(first)
        found.append(nodes)
        woken = {i for i, _ in nodes}
        for i, _ in nodes:
            at[i] += 1
            woken |= waiting[i]
            waiting[i] = set()
        for i in sorted(woken):
            offer(i)
    return found
