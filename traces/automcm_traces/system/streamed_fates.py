"""The fates of the messages in logs of any length (``fates`` decides them).

Of several logs, a first pass keeps 24 bytes of each sent message and 32 of each received one, then
only a few; one log alone needs no first pass.
"""

from __future__ import annotations

from array import array
from bisect import bisect_left
from collections import Counter, defaultdict
from collections.abc import Iterator, Mapping
from hashlib import blake2b
from itertools import pairwise
from pathlib import Path

from automcm_spec.log_format.log import End, Event, Header, Receive, Send, transmission
from automcm_spec.log_format.number_sets import Numbers
from automcm_spec.log_format.reader import Notice, records
from automcm_spec.support.bad_input import BadInput, name_of
from automcm_spec.vocabulary.messages import Fields
from automcm_traces.system.fates import (
    ANYONE,
    Arrow,
    Fates,
    Promised,
    addressees,
    sender_of,
    source_of,
)
from automcm_traces.system.log_clocks import Clocks, Travels
from automcm_traces.system.log_merge import content

NO_TX = 2**64 - 1
UNMATCHED, MATCHED, AGAIN = range(3)


class Ledger:
    """The messages of one log as columns: of each, the number, the time and a digest."""

    def __init__(self, path: Path) -> None:
        self.sent = _Columns()
        self.received = _Columns()
        self.senders = array("Q")
        """Of each received message."""
        self.rejected = array("Q")
        """Of each rejected datagram, the sender and the number in its tx."""
        self.header: Header
        first = last = None
        ended: int | None = None
        top = 0
        whole, mid_session = True, False
        try:
            for entry in records(path, gaps=True):
                match entry.record:
                    case Header() as header:
                        self.header, mid_session = header, header.begins is not None
                    case Notice(kind=kind):
                        whole = whole and kind != "gap"
                        mid_session = mid_session or kind == "begins_late"
                    case End(lost_records=lost):
                        ended = lost if whole else None
                    case event:
                        self._add(event)
                        if whole:
                            first, last = event.t_ms if first is None else first, event.t_ms
                            top = max(top, self.sent.numbers[-1] if isinstance(event, Send) else 0)
        except BadInput:
            ended = None
        span = first or 0, last or 0
        self.coverage = Promised.by(name_of(path), self.header, span, top, ended, mid_session)
        self.results = bytearray(len(self.senders))
        """Of each received message: UNMATCHED, MATCHED, or AGAIN for another copy."""
        self.arrived: dict[int, Numbers] = defaultdict(Numbers)
        """By sender, the indices of its sent messages that this log shows as received."""
        self.refused: dict[int, Numbers] = defaultdict(Numbers)
        """By sender, the indices of those that this log shows as rejected."""

    def _add(self, event: Event) -> None:
        if isinstance(event, Send):
            self.sent.add(transmission(event.tx)[1], event.t_ms, event.message)
        elif not isinstance(event, Receive):
            return
        elif event.rejected is not None and event.tx is not None:
            self.rejected.extend(n if n < NO_TX else NO_TX for n in transmission(event.tx))
        elif event.message is not None:
            sender = sender_of(event.message, event.tx)
            self.senders.append(sender if sender is not None and 0 < sender < NO_TX else ANYONE)
            self.received.add(
                NO_TX if event.tx is None else transmission(event.tx)[1], event.t_ms, event.message
            )


class _Columns:
    def __init__(self) -> None:
        self.numbers, self.times, self.digests = array("Q"), array("Q"), array("Q")
        self._in_order: bool | None = None
        self._places: dict[int, int] = {}
        self._copies: dict[int, list[int]] = {}

    def add(self, number_: int, t_ms: int, message: Fields) -> None:
        self.numbers.append(number_)
        self.times.append(t_ms)
        digest = blake2b(content(message).encode("utf-8", "surrogatepass"), digest_size=8).digest()
        self.digests.append(int.from_bytes(digest, "big"))

    def find(self, number_: int) -> int | None:
        """The index of the first message with this number."""
        if self._in_order is None:
            self._in_order = all(a <= b for a, b in pairwise(self.numbers))
            if not self._in_order:
                backwards = range(len(self.numbers) - 1, -1, -1)
                self._places = {self.numbers[k]: k for k in backwards}
        if not self._in_order:
            return self._places.get(number_)
        k = bisect_left(self.numbers, number_)
        return k if k < len(self.numbers) and self.numbers[k] == number_ else None

    def copies(self, digest: int) -> list[int]:
        """The indices of the messages with this content."""
        if not self._copies:
            for k, one in enumerate(self.digests):
                self._copies.setdefault(one, []).append(k)
        return self._copies.get(digest, [])


class StreamedFates:
    """The arrows of the events of several logs, in the order of each log.

    An arrow belongs to the event where it arrives, or, if it never does, to the one where it
    leaves. ``stations`` are those of the logs.
    """

    def __init__(self, paths: Mapping[int, Path]) -> None:
        self._stations = sorted(paths)
        alone = len(paths) == 1
        self._ledgers = {} if alone else {s: Ledger(paths[s]) for s in self._stations}
        travels = Travels([ledger.header.longest_delay for ledger in self._ledgers.values()])
        for station in self._ledgers:
            self._match(station, travels)
        coverage = {s: ledger.coverage for s, ledger in self._ledgers.items()}
        if alone:
            (station,) = self._stations
            entries = records(paths[station], gaps=True)
            header = next(entries).record
            second = None if (entry := next(entries, None)) is None else entry.record
            assert isinstance(header, Header), "records() yields the header first"
            late = isinstance(second, Notice) and second.kind == "begins_late"
            coverage[station] = Promised.by(
                name_of(paths[station]), header, (0, 0), 0, 0, late or header.begins is not None
            )
            travels = Travels([header.longest_delay])
        self._fates = Fates(coverage, Clocks(travels))
        self._sent = {s: Numbers() for s in self._stations}
        """The numbers sent so far."""
        self._copies: dict[tuple[int, int], Numbers] = defaultdict(Numbers)
        """By receiver and sender, the numbers received so far without a matching transmission."""
        self._next: Counter[tuple[int, str]] = Counter()

    def is_ahead(self, station: int, number: int) -> bool:
        """Whether the log of a station contains a transmission with this number further on."""
        return number not in self._sent.get(station, ()) and self._is_logged(station, number)

    def arrows(self, station: int, event: Event) -> tuple[Arrow, ...]:
        """The arrows of the next event of a station's log."""
        if isinstance(event, Send):
            return tuple(self._sent_arrows(station, event))
        if isinstance(event, Receive):
            arrow = self._received_arrow(station, event)
            return () if arrow is None else (arrow,)
        return ()

    def _sent_arrows(self, me: int, event: Send) -> Iterator[Arrow]:
        k = self._next[me, "send"]
        self._next[me, "send"] += 1
        self._sent[me].add(transmission(event.tx)[1])
        for to in addressees(me, event.message, self._stations):
            ledger = self._ledgers.get(to)
            if ledger is None or (k not in ledger.arrived[me] and k not in ledger.refused[me]):
                yield Arrow(me, to, self._fates.not_received(me, event.t_ms, to))

    def rejected_by(self, me: int, event: Send) -> list[int]:
        """The addressees that rejected a message and received no copy of it."""
        own = self._ledgers.get(me)
        k = None if own is None else own.sent.find(transmission(event.tx)[1])
        if k is None:
            return []
        others = [to for to in addressees(me, event.message, self._stations) if to in self._ledgers]
        logs = [(to, self._ledgers[to]) for to in others]
        return [to for to, log in logs if k in log.refused[me] and k not in log.arrived[me]]

    def _received_arrow(self, me: int, event: Receive) -> Arrow | None:
        m, tx = event.message, event.tx
        if event.rejected is not None:
            logged = tx is not None and self._is_logged(*transmission(tx))
            source = self._fates.rejected_from(me, tx, logged)
            return Arrow(source, me, "rejected", reason=event.rejected)
        if m is None:
            return Arrow(ANYONE, me, "sender_unobserved")
        sender = sender_of(m, tx)
        result = self._result(me, sender, tx)
        if sender is not None and result != UNMATCHED:
            addressed = me in addressees(sender, m, self._stations)
            fate = self._fates.received(result == AGAIN, addressed)
            return None if sender == me else Arrow(sender, me, fate)
        again = logged = False
        if sender is not None and tx is not None:
            again = not self._copies[me, sender].add(transmission(tx)[1])
            logged = self._is_logged(sender, transmission(tx)[1])
        unmatched, _ = self._fates.unmatched(me, sender, tx, logged, again)
        return None if unmatched is None else Arrow(source_of(m), me, unmatched)

    def _is_logged(self, station: int, number: int) -> bool:
        ledger = self._ledgers.get(station)
        return ledger is not None and ledger.sent.find(number) is not None

    def _result(self, me: int, sender: int | None, tx: str | None) -> int:
        if not self._ledgers:  # of one log, only its own messages can match
            own = sender == me and tx is not None and transmission(tx)[1] in self._sent[me]
            return MATCHED if own else UNMATCHED
        k = self._next[me, "receive"]
        self._next[me, "receive"] += 1
        return self._ledgers[me].results[k]

    def _match(self, station: int, travels: Travels) -> None:
        """Match the received messages of a log, as ``log_merge.merge`` does, and forget them."""
        ledger, j = self._ledgers[station], self._stations.index(station)
        got = ledger.received
        used: Counter[tuple[int, int]] = Counter()
        for n, (sender, digest) in enumerate(zip(ledger.senders, got.digests, strict=True)):
            if sender not in self._ledgers:
                continue
            sent = self._ledgers[sender].sent
            if got.numbers[n] != NO_TX:
                k = sent.find(got.numbers[n])
                if k is None or sent.digests[k] != digest:
                    continue
                first, sure = k, True
            else:
                copies = sent.copies(digest)
                if not copies or sender == station:
                    continue
                k = copies[min(used[sender, digest], len(copies) - 1)]
                used[sender, digest] += 1
                first, sure = copies[0], len(copies) == 1
            new = ledger.arrived[sender].add(k)
            ledger.results[n] = MATCHED if new else AGAIN
            i = self._stations.index(sender)
            travels.add(i, j, got.times[n] - sent.times[first], sure)
        named = ledger.rejected
        for sender, number in zip(named[::2], named[1::2], strict=True):
            if sender != station and sender in self._ledgers:
                k = self._ledgers[sender].sent.find(number)
                if k is not None:
                    ledger.refused[sender].add(k)
        ledger.received, ledger.senders, ledger.rejected = _Columns(), array("Q"), array("Q")
