"""The fates of the messages in logs in memory (``fates`` decides them)."""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from automcm_spec.log_format.log import Receive, Send
from automcm_spec.log_format.reader import Log
from automcm_spec.vocabulary.messages import Fields, same
from automcm_traces.system.fates import (
    ANYONE,
    Arrow,
    Fate,
    Fates,
    Promised,
    addressees,
    sender_of,
    source_of,
)
from automcm_traces.system.log_clocks import Clocks
from automcm_traces.system.log_merge import Merged, Node, receptions, sends

OUTCOMES: tuple[Fate, ...] = (
    "delivered",
    "duplicated",
    "rejected",
    "lost",
    "in_flight",
    "unobserved",
)


@dataclass(frozen=True, slots=True)
class Delivery:
    """The fate of one transmission at one of its addressees."""

    sent: Node
    to: int
    outcome: Fate
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
        self._merged = merged
        logs = {log.header.station: Promised.of(log) for log in merged.logs}
        self._fates = Fates(logs, clocks)
        self._sent = {e.tx for _, e in sends(merged)}
        self._unmatched: dict[Node, Fate | None] = {}
        self.all: list[Delivery] = []
        """Sorted by sender and line; a broadcast once for each other station with a log."""
        self.forged: list[Forged] = []
        self.unsent: dict[Node, str] = {}
        """Received messages without a logged transmission, and the possible reason."""
        arrived: dict[tuple[Node, int], list[Node]] = defaultdict(list)
        rejected = {(sent, node[0]) for node, sent in merged.rejected.items()}
        seen: set[tuple[int, str]] = set()
        for node, e in receptions(merged):
            match = merged.matches.get(node)
            if match is not None:
                arrived[match.sent, node[0]].append(node)
            else:
                self._classify(node, e, (node[0], e.tx or "") in seen)
                seen |= {(node[0], e.tx)} if e.tx is not None else set()
        for node, sent in sends(merged):
            me = merged.stations[node[0]]
            for to in addressees(me, sent.message, merged.stations):
                place = merged.place(to)
                got = () if place is None else tuple(arrived.get((node, place), ()))
                outcome: Fate = "duplicated" if len(got) > 1 else "delivered"
                if not got and (node, place) in rejected:
                    outcome = "rejected"
                elif not got:
                    outcome = self._fates.not_received(me, sent.t_ms, to)
                self.all.append(Delivery(node, to, outcome, got))

    def arrows(self) -> Iterator[Arrow]:
        """An arrow for each message, or copy of it, and addressee or receiver; in no order.

        A station's own messages that it receives (echoes) have none.
        """
        merged = self._merged
        for d in self.all:
            if not d.received and d.outcome != "rejected":
                yield Arrow(merged.stations[d.sent[0]], d.to, d.outcome, d.sent)
        for i, log in enumerate(merged.logs):
            me = log.header.station
            for k, (_, e) in enumerate(log.events):
                node = (i, k)
                if not isinstance(e, Receive):
                    continue
                if e.rejected is not None:
                    source = self._fates.rejected_from(me, e.tx, e.tx in self._sent)
                    sent_at = merged.rejected.get(node)
                    yield Arrow(source, me, "rejected", sent_at, node, e.rejected)
                    continue
                match = merged.matches.get(node)
                if match is None:
                    fate = "sender_unobserved" if e.message is None else self._unmatched[node]
                    if fate is not None:
                        yield Arrow(source_of(e.message), me, fate, None, node)
                elif match.sent[0] != i:
                    source = merged.stations[match.sent[0]]
                    sent = merged.event(match.sent)
                    assert isinstance(sent, Send), "a match is of a transmission"
                    addressed = me in addressees(source, sent.message, merged.stations)
                    fate = self._fates.received(node in merged.again, addressed)
                    yield Arrow(source, me, fate, match.sent, node)

    def counts(self) -> dict[str, dict[str, int]]:
        """By ``SRC-DST``, how often each outcome occurred, including CAMs."""
        found: dict[str, Counter[str]] = defaultdict(Counter)
        for d in self.all:
            if d.to != ANYONE:
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

    def _classify(self, node: Node, e: Receive, again: bool) -> None:
        """Decide the fate of a received message without a matching transmission."""
        m, me = e.message, self._merged.stations[node[0]]
        assert m is not None, "receptions() yields messages"
        logged = e.tx in self._sent
        fate, why = self._fates.unmatched(me, sender_of(m, e.tx), e.tx, logged, again)
        self._unmatched[node] = fate
        if fate != "forged":
            self.unsent[node] = why
            return
        own = self._merged.logs[node[0]]
        text = f"{m['type']} from {m.get('src')}" + (f", tx {e.tx}" if e.tx else "")
        self.forged.append(Forged(node, own.file, own.events[node[1]][0], text, why))


def forged_receptions(logs: Sequence[Log]) -> dict[str, tuple[int, Receive, Fields | None]]:
    """By file: the first received message that differs from the message its sender logged under the
    same ``tx``, as its line, the event, and the sender's message (None: there is none).

    The logs may be of several runs. Only messages with a ``tx`` are compared.
    """
    sent: dict[tuple[str, str], Fields] = {}
    for log in logs:
        for _, e in log.events:
            if isinstance(e, Send):
                sent.setdefault((log.header.run, e.tx), e.message)
    covered = {(log.header.run, log.header.station): Promised.of(log) for log in logs}
    found: dict[str, tuple[int, Receive, Fields | None]] = {}
    for log in logs:
        for at, e in log.events:
            if not isinstance(e, Receive) or e.tx is None or e.message is None:
                continue
            original = sent.get((log.header.run, e.tx))
            sender = covered.get((log.header.run, sender_of(e.message, e.tx) or 0))
            if same(original, e.message) or sender is None:
                continue
            if sender.not_sent(e.tx, original is not None) is not None:
                found[log.file] = (at, e, original)
                break
    return found
