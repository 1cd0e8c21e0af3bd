"""Matches the received messages of one run with their transmissions, in memory bounded by a few
numbers for each message: also for logs of any length.

A received message is matched with the transmission that it names (``tx``), if that has the same
content. If the link provides no ``tx``, it is matched by sender and content. Copies are equal byte
by byte; the latest counts that can have been sent by then. An earlier one would have taken longer
than the longest delay of a copy (docs/protocol.md, section 3).
"""

from __future__ import annotations

from array import array
from bisect import bisect_left, bisect_right
from collections import defaultdict
from collections.abc import Sequence
from hashlib import blake2b
from itertools import pairwise
from json.encoder import c_make_encoder, encode_basestring_ascii  # type: ignore[attr-defined]

from automcm_spec.log_format.log import Event, Header, Receive, Send, source_of, transmission
from automcm_spec.log_format.number_sets import Numbers
from automcm_spec.log_format.reader import Log, LogStream
from automcm_spec.support.bad_input import BadInput
from automcm_spec.vocabulary.messages import Fields
from automcm_spec.vocabulary.parameters import Parameters
from automcm_traces.system.event_order import Node
from automcm_traces.system.log_clocks import Clocks, Travels

NO_TX = 2**64 - 1
_ENCODED = c_make_encoder(None, None, encode_basestring_ascii, None, ":", ",", True, False, True)
"""As by a JSONEncoder with sorted keys, which makes such an encoder anew for each value."""


def content(message: Fields) -> str:
    """A message as text; equal messages give equal texts."""
    return "".join(_ENCODED(message, 0))


class Messages:
    """Messages as columns: of each, the index of its event, its number, time and digest."""

    def __init__(self) -> None:
        self.at, self.numbers = array("Q"), array("Q")
        self.times, self.digests = array("Q"), array("Q")
        self._in_order: bool | None = None
        self._places: dict[int, int] = {}
        self._copies: dict[int, list[int]] = {}

    def add(self, at: int, number: int, t_ms: int, digest: int) -> None:
        """Add the message of an event."""
        self.at.append(at)
        self.numbers.append(number)
        self.times.append(t_ms)
        self.digests.append(digest)

    def find(self, number: int) -> int | None:
        """The index of the first message with this number."""
        if self._in_order is None:
            self._in_order = all(a <= b for a, b in pairwise(self.numbers))
            if not self._in_order:
                backwards = range(len(self.numbers) - 1, -1, -1)
                self._places = {self.numbers[k]: k for k in backwards}
        if not self._in_order:
            return self._places.get(number)
        k = bisect_left(self.numbers, number)
        return k if k < len(self.numbers) and self.numbers[k] == number else None

    def copies(self, digest: int) -> list[int]:
        """The indices of the messages with this content."""
        if not self._copies:
            for k, one in enumerate(self.digests):
                self._copies.setdefault(one, []).append(k)
        return self._copies.get(digest, [])


class Ledger:
    """What matching needs of one log, and what the log promises to contain."""

    def __init__(self, file: str, header: Header, digests: dict[int, int] | None) -> None:
        self.file, self.header = file, header
        self._digests = digests
        self.sends = self.receives = False
        """Whether it contains all messages sent, or received, from its first to its last event."""
        self.ended = True
        """Whether it has an end record; without one, events may be missing at the end."""
        self.first_ms = self.last_ms = 0
        self.t_life = header.known.get("t_life", Parameters().t_life)
        self.last_sent = 0
        """The highest transmission number."""
        self.sent, self.received = Messages(), Messages()
        self.senders = array("Q")
        """Of each received message."""
        self.rejected = array("Q")
        """Of each rejected datagram, the sender and the number in its tx."""
        self.arrived: dict[int, Numbers] = defaultdict(Numbers)
        """By log, which of its sent messages this log shows as received."""
        self.again: dict[int, Numbers] = defaultdict(Numbers)
        """By log, which of its sent messages this log shows as received more than once."""
        self.refused: dict[int, Numbers] = defaultdict(Numbers)
        """By log, which of its sent messages this log shows as rejected."""
        self._events = 0

    @staticmethod
    def of(log: Log | LogStream, digests: dict[int, int] | None = None) -> Ledger:
        """The ledger of a log, up to where it is readable; it promises nothing after a gap.
        ``digests`` are those of messages in memory, by identity: logs of a run share them."""
        made = Ledger(log.file, log.header, digests)
        lost: int | None = None  # the number of lost records in the end record
        try:
            for _, event in log:
                made.add(event)
                if not _has_gap(log):
                    made.first_ms = event.t_ms if made._events == 1 else made.first_ms
                    made.last_ms = event.t_ms
                    if isinstance(event, Send):
                        made.last_sent = max(made.last_sent, made.sent.numbers[-1])
            if log.end is not None and not _has_gap(log):
                lost = log.end.lost_records
        except BadInput:
            pass  # reported where its rows end
        made.ended = lost is not None
        # Before a log that begins in mid-session its station may have sent and received more.
        if not (lost or log.mid_session):
            made.sends, made.receives = (k in log.header.complete for k in ("send", "receive"))
        return made

    def not_sent(self, tx: str | None, logged: bool) -> str | None:
        """Why a received message without a matching transmission was certainly not sent.

        ``logged`` is whether the log has another message under this tx. None if the message may
        have been sent: the log is not complete, or ends earlier.
        """
        if not self.sends:
            return None
        if logged:
            return f"{self.file} has another message under this tx"
        if not self.ended and (tx is None or transmission(tx)[1] > self.last_sent):
            return None
        return f"{self.file} contains no such sent message"

    def add(self, event: Event) -> None:
        """Add the next event of the log."""
        at, self._events = self._events, self._events + 1
        if isinstance(event, Send):
            number = transmission(event.tx)[1]
            self.sent.add(at, number, event.t_ms, self._digest(event.message))
        elif not isinstance(event, Receive):
            return
        elif event.message is not None:
            tx = event.tx
            source, number = (source_of(event.message), NO_TX) if tx is None else transmission(tx)
            self.senders.append(source)
            self.received.add(at, number, event.t_ms, self._digest(event.message))
        elif event.rejected is not None and event.tx is not None:
            self.rejected.extend(n if n < NO_TX else NO_TX for n in transmission(event.tx))

    def _digest(self, message: Fields) -> int:
        known = None if self._digests is None else self._digests.get(id(message))
        if known is not None:
            return known
        text = content(message).encode("utf-8", "surrogatepass")
        digest = int.from_bytes(blake2b(text, digest_size=8).digest(), "big")
        if self._digests is not None:
            self._digests[id(message)] = digest
        return digest


def _has_gap(log: Log | LogStream) -> bool:
    return isinstance(log, LogStream) and log.gap is not None


UNMATCHED, MATCHED, AGAIN, SURE = 0, 1, 2, 4
"""``SURE``: the match is named by ``tx``, or the only one with its content."""


class Matches:
    """The matches between the logs of one run, and their clocks."""

    def __init__(self, ledgers: Sequence[Ledger]) -> None:
        self.ledgers = ledgers
        self.stations = [ledger.header.station for ledger in ledgers]
        self.places = {station: i for i, station in enumerate(self.stations)}
        self.guessed = 0
        """The number of matches by content alone."""
        self._flags = [bytearray(len(ledger.senders)) for ledger in ledgers]
        self._sent = [array("q", [-1]) * len(flags) for flags in self._flags]
        self._first = [array("q", [-1]) * len(flags) for flags in self._flags]
        travels = Travels([ledger.header.longest_delay for ledger in ledgers])
        for j in range(len(ledgers)):
            self._find(j, travels)
        self.clocks = Clocks(travels)
        for j in range(len(ledgers)):
            self._choose(j)
        for j, ledger in enumerate(ledgers):
            self._refuse(j, ledger)
            ledger.received, ledger.rejected = Messages(), array("Q")  # no longer needed

    def match(self, j: int, n: int) -> tuple[Node, Node, bool] | None:
        """The transmission of the ``n``-th received message of a log: of equal copies without
        ``tx``, the latest and the first possible one, which certainly came before; and whether
        another copy of it was received before."""
        flags = self._flags[j][n]
        if flags == UNMATCHED:
            return None
        i = self.places[self.ledgers[j].senders[n]]
        at = self.ledgers[i].sent.at
        return (i, at[self._sent[j][n]]), (i, at[self._first[j][n]]), bool(flags & AGAIN)

    def find(self, tx: str) -> Node | None:
        """The first transmission with this ``tx``; None if no log has one."""
        sender, number = transmission(tx)
        i = self.places.get(sender)
        k = None if i is None else self.ledgers[i].sent.find(number)
        return None if i is None or k is None else (i, self.ledgers[i].sent.at[k])

    def _find(self, j: int, travels: Travels) -> None:
        """Find the first possible transmission of each message received by a log."""
        ledger, flags = self.ledgers[j], self._flags[j]
        got = ledger.received
        for n, (sender, number) in enumerate(zip(ledger.senders, got.numbers, strict=True)):
            i = self.places.get(sender)
            if i is None:
                continue
            sent = self.ledgers[i].sent
            if number != NO_TX:
                k = sent.find(number)
                if k is None or sent.digests[k] != got.digests[n]:
                    continue
                flags[n], self._first[j][n] = MATCHED | SURE, k
            elif i != j and (copies := sent.copies(got.digests[n])):
                flags[n] = MATCHED | SURE if len(copies) == 1 else MATCHED
                self._first[j][n] = copies[0]
                self.guessed += 1
            if flags[n]:
                ms = got.times[n] - sent.times[self._first[j][n]]
                travels.add(i, j, ms, bool(flags[n] & SURE))

    def _choose(self, j: int) -> None:
        """Of equal copies, choose the latest that can have been sent before it was received."""
        ledger, flags = self.ledgers[j], self._flags[j]
        for n, sender in enumerate(ledger.senders):
            if flags[n] == UNMATCHED:
                continue
            i, k = self.places[sender], self._first[j][n]
            ahead = None if flags[n] & SURE else self.clocks.ahead(i, j)
            if ahead is not None:
                sent = self.ledgers[i].sent
                copies, last_ms = sent.copies(sent.digests[k]), ledger.received.times[n] - ahead.low
                k = copies[max(0, bisect_right(copies, last_ms, key=sent.times.__getitem__) - 1)]
            self._sent[j][n] = k
            if not ledger.arrived[i].add(k):
                flags[n] |= AGAIN
                ledger.again[i].add(k)

    def _refuse(self, j: int, ledger: Ledger) -> None:
        for sender, number in zip(ledger.rejected[::2], ledger.rejected[1::2], strict=True):
            i = self.places.get(sender, j)
            k = None if i == j else self.ledgers[i].sent.find(number)
            if k is not None:
                ledger.refused[i].add(k)
