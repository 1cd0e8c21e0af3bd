"""The fate of each message: delivered, lost, duplicated, unobserved, in flight, or forged.

A copy that no log shows as received counts as lost only if the addressee's log promises all
received messages and continues for longer than ``t_life`` after the transmission. After that time
no copy is left (docs/protocol.md, section 3).
"""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

from automcm_spec.vocabulary.messages import Fields, same
from automcm_spec.vocabulary.parameters import Parameters
from automcm_traces.format.log import Receive, Send
from automcm_traces.format.reader import Log
from automcm_traces.system.clock_offsets import Clocks
from automcm_traces.system.log_merge import Merged, Node, receptions, sends

Outcome = Literal["delivered", "duplicated", "lost", "in_flight", "unobserved"]
OUTCOMES: tuple[Outcome, ...] = ("delivered", "duplicated", "lost", "in_flight", "unobserved")


@dataclass(frozen=True, slots=True)
class Delivery:
    """The fate of one transmission at one of its addressees."""

    sent: Node
    to: int
    outcome: Outcome
    received: tuple[Node, ...] = ()


@dataclass(frozen=True, slots=True)
class Forged:
    """A received message that nobody can have sent, and the reason."""

    at: Node
    file: str
    line: int
    message: str
    why: str

    def __str__(self) -> str:
        return f"{self.file}:{self.line}: FORGED {self.message}: {self.why}"


class Deliveries:
    """The fates of all transmissions in merged logs."""

    def __init__(self, merged: Merged, clocks: Clocks) -> None:
        self._merged, self._clocks = merged, clocks
        self._sent: dict[int, Sent] = {}
        self.all: list[Delivery] = []
        """Sorted by sender and line; a broadcast once for each other station with a log."""
        self.forged: list[Forged] = []
        self.unsent: dict[Node, str] = {}
        """Received messages without a logged transmission, and the possible reason."""
        arrived: dict[tuple[Node, int], list[Node]] = defaultdict(list)
        for node, _ in receptions(merged):
            match = merged.matches.get(node)
            if match is None:
                self._unmatched(node)
            else:
                arrived[match.sent, node[0]].append(node)
        for node, e in sends(merged):
            for to in self._addressees(node, e):
                self.all.append(self._delivery(node, to, arrived))

    def counts(self) -> dict[str, dict[str, int]]:
        """By ``SRC-DST``, how often each outcome occurred, including CAMs."""
        found: dict[str, Counter[str]] = defaultdict(Counter)
        for d in self.all:
            found[f"{self._merged.stations[d.sent[0]]}-{d.to}"][d.outcome] += 1
        return {way: {o: n[o] for o in OUTCOMES if n[o]} for way, n in sorted(found.items())}

    def between(
        self, src: int, dst: int, first: int = 0, last: int | None = None, type_: str = ""
    ) -> Counter[str]:
        """The outcomes of the messages that ``src`` sent to ``dst`` in its events ``first`` to
        ``last``."""
        place, found = self._merged.place(src), Counter[str]()
        for d in self.all:
            inside = d.sent[1] >= first and (last is None or d.sent[1] <= last)
            if d.sent[0] == place and d.to == dst and inside:
                event = self._merged.event(d.sent)
                if isinstance(event, Send) and type_ in ("", event.message["type"]):
                    found[d.outcome] += 1
        return found

    def _addressees(self, node: Node, e: Send) -> list[int]:
        me = self._merged.stations[node[0]]
        dst = e.message.get("dst", 0)
        if isinstance(dst, int) and dst > 0:
            return [dst] if dst != me else []
        return [s for s in self._merged.stations if s != me]

    def _delivery(
        self, node: Node, to: int, arrived: dict[tuple[Node, int], list[Node]]
    ) -> Delivery:
        place = self._merged.place(to)
        if place is None:
            return Delivery(node, to, "unobserved")
        got = tuple(arrived.get((node, place), ()))
        if got:
            return Delivery(node, to, "duplicated" if len(got) > 1 else "delivered", got)
        log = self._merged.logs[place]
        if "receive" not in log.header.complete or (log.end is not None and log.end.lost_records):
            return Delivery(node, to, "unobserved")
        life = log.header.known.get("t_life", Parameters().t_life)
        first, last = (log.events[k][1].t_ms if log.events else 0 for k in (0, -1))
        t_ms = self._merged.event(node).t_ms
        began = self._clocks.between(node[0], t_ms, place, first)
        if began is not None and began.low > 0:
            return Delivery(node, to, "unobserved")  # the log begins later
        gone = self._clocks.between(node[0], t_ms, place, last)
        over = gone is not None and gone.low > life
        return Delivery(node, to, "lost" if over else "in_flight")

    def _unmatched(self, node: Node) -> None:
        """Classify a received message without a matching transmission: forged, or unobserved."""
        event = self._merged.event(node)
        assert isinstance(event, Receive) and event.message is not None
        m, tx = event.message, event.tx
        src = int(tx.split(":")[0]) if tx is not None else m.get("src")
        place = self._merged.place(src) if isinstance(src, int) else None
        if place is None:
            self.unsent[node] = f"no log of station {src}"
            return
        log = self._merged.logs[place]
        if place == node[0] and tx is None:
            self.unsent[node] = "an echo"
            return
        if place not in self._sent:
            self._sent[place] = Sent.of(log)
        why = self._sent[place].not_sent(tx)
        if why is None:
            self.unsent[node] = f"{log.file} may lack sent messages"
            return
        own, line = self._merged.logs[node[0]], self._merged.logs[node[0]].events[node[1]][0]
        text = f"{m['type']} from {m.get('src')}" + (f", tx {tx}" if tx else "")
        self.forged.append(Forged(node, own.file, line, text, why))


@dataclass(frozen=True, slots=True)
class Sent:
    """The transmissions in one log."""

    log: Log
    txs: frozenset[str]
    last: int
    """The highest transmission number."""

    @staticmethod
    def of(log: Log) -> Sent:
        """The transmissions in a log."""
        txs = frozenset(e.tx for _, e in log.events if isinstance(e, Send))
        return Sent(log, txs, max((number(tx) for tx in txs), default=0))

    def not_sent(self, tx: str | None) -> str | None:
        """Why a message without a logged transmission was certainly not sent.

        None if it may have been sent: the log is not complete, or ends earlier.
        """
        log = self.log
        if "send" not in log.header.complete or (log.end is not None and log.end.lost_records):
            return None
        if tx is not None and tx in self.txs:
            return f"{log.file} has another message under this tx"
        if log.end is None and (tx is None or number(tx) > self.last):
            return None
        return f"{log.file} contains no such sent message"


def number(tx: str) -> int:
    """The counter of a transmission id."""
    return int(tx.split(":")[1])


def forged_receptions(logs: Sequence[Log]) -> dict[str, tuple[int, Receive, Fields | None]]:
    """By file: the first received message that differs from the message its sender logged under the
    same ``tx``, as its line, the event, and the sender's message (None: there is none).

    Only transmissions of stations whose logs promise all sent messages are compared; in a log
    without an end record, only those up to its last transmission.
    """
    sent: dict[tuple[str, str], Fields] = {}
    last: dict[tuple[str, int], int | None] = {}
    for log in logs:
        run = log.header.run
        own = [e for _, e in log.events if isinstance(e, Send)]
        sent |= {(run, e.tx): e.message for e in own}
        if "send" in log.header.complete:
            count = max((number(e.tx) for e in own), default=0)
            last[run, log.header.station] = None if log.ended else count
    found: dict[str, tuple[int, Receive, Fields | None]] = {}
    for log in logs:
        for at, e in log.events:
            if not isinstance(e, Receive) or e.tx is None or e.message is None:
                continue
            original = sent.get((log.header.run, e.tx))
            station, count = (int(part) for part in e.tx.split(":"))
            sender = log.header.run, station
            if same(original, e.message) or sender not in last:
                continue
            limit = last[sender]
            if original is None and limit is not None and count > limit:
                continue
            found[log.file] = (at, e, original)
            break
    return found
