"""Decides the fate of each message: delivered, duplicated, lost, overheard, unobserved, in flight,
forged, or rejected.

A copy that no log shows as received counts as lost only if the addressee's log promises all
received messages and continues for longer than ``t_life`` after the transmission. After that time
no copy is left (docs/protocol.md, section 3).
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator, Sequence
from typing import Literal, NamedTuple, get_args

from automcm_spec.log_format.log import Event, Receive, Send, source_of, transmission
from automcm_spec.log_format.number_sets import Numbers
from automcm_spec.vocabulary.messages import Fields
from automcm_traces.system.event_order import Head, Item, Node
from automcm_traces.system.matching import Ledger, Matches

Fate = Literal[
    "delivered",
    "lost",
    "duplicated",
    "unobserved",
    "in_flight",
    "sender_unobserved",
    "forged",
    "overheard",
    "rejected",
]
"""``unobserved``: the log of the addressee is missing or incomplete; ``sender_unobserved``: that of
the sender. ``duplicated``: received before. ``rejected``: a secured link discarded it."""
FATES: tuple[Fate, ...] = get_args(Fate)
ANYONE = 0
"""The addressee of a broadcast that no other log can show, and the sender of bytes that are not a
message."""


class Arrow(NamedTuple):
    """A message, or one copy of it, on its way to one station.

    ``leaves`` and ``arrives`` are known as far as the logs show them.
    """

    source: int
    to: int
    fate: Fate
    leaves: Node | None = None
    arrives: Node | None = None
    reason: str = ""
    """Why it was rejected, as logged."""

    @property
    def plain(self) -> Arrow:
        """The same without its places: equal for copies with the same fate."""
        return self._replace(leaves=None, arrives=None)

    @property
    def word(self) -> str:
        """The fate as text, with the reason."""
        word = "duplicate" if self.fate == "duplicated" else self.fate.replace("_", " ")
        return f"{word}: {self.reason}" if self.reason else word

    def as_dict(self) -> dict[str, int | str]:
        """The ``--json`` form."""
        found: dict[str, int | str] = {"from": self.source, "to": self.to, "fate": self.fate}
        return found | {"reason": self.reason} if self.reason else found


def head(item: Item, node: Node, event: Event, arrows: Sequence[Arrow]) -> Head[Item]:
    """An event in the order of all: a reception comes after its transmission."""
    if not isinstance(event, Receive) or not arrows:
        return Head(item, node, event.t_ms)
    sure = event.rejected is None and event.tx is not None
    return Head(item, node, event.t_ms, arrows[0].leaves, sure)


class Fates:
    """The fates of the messages of one run. Takes the events of each log in order."""

    def __init__(self, matches: Matches) -> None:
        self._matches = matches
        self.forged: dict[Node, str] = {}
        """Why certain received messages cannot have been sent."""
        self.rejecters: list[int] = []
        """The addressees that rejected the last sent message and received no copy of it."""
        self._sent, self._received = [0] * len(matches.ledgers), [0] * len(matches.ledgers)
        """The number of messages so far, by log."""
        self._copies: dict[tuple[int, int], Numbers] = defaultdict(Numbers)
        """By receiver and sender, the numbers received so far without a matching transmission."""

    def arrows(self, node: Node, event: Event) -> tuple[Arrow, ...]:
        """The arrows of the next event of a log. An arrow belongs to the event where it arrives,
        or, if it never does, to the one where it leaves.

        A station's own messages that it receives (echoes) have none.
        """
        if isinstance(event, Send):
            return tuple(self._arrows_of(node, event))
        arrow = self._arrow_of(node, event) if isinstance(event, Receive) else None
        return () if arrow is None else (arrow,)

    def outcome(self, i: int, n: int, t_ms: int, to: int) -> Fate:
        """What became of the ``n``-th transmission of a log, at ``t_ms``, for an addressee."""
        log = self._log(to) if to in self._matches.places else None
        if log is not None and n in log.arrived[i]:
            return "duplicated" if n in log.again[i] else "delivered"
        if log is not None and n in log.refused[i]:
            return "rejected"
        return self._not_received(i, t_ms, to)

    def _log(self, station: int) -> Ledger:
        return self._matches.ledgers[self._matches.places[station]]

    def _arrows_of(self, node: Node, event: Send) -> Iterator[Arrow]:
        """The arrows of a sent message to the addressees that never received it."""
        i, n = node[0], self._sent[node[0]]
        self._sent[i] += 1
        self.rejecters = []
        me = self._matches.stations[i]
        for to in addressees(me, event.message, self._matches.stations):
            fate = self.outcome(i, n, event.t_ms, to)
            if fate == "rejected":
                self.rejecters.append(to)
            elif fate not in ("delivered", "duplicated"):
                yield Arrow(me, to, fate, node)

    def _not_received(self, i: int, t_ms: int, to: int) -> Fate:
        """The fate of a message that its addressee's log does not contain."""
        j, clocks = self._matches.places.get(to), self._matches.clocks
        log = None if j is None else self._matches.ledgers[j]
        if j is None or log is None or not log.receives:
            return "unobserved"
        began = clocks.between(i, t_ms, j, log.first_ms)
        if began is not None and began.low > 0:
            return "unobserved"  # the log begins later
        gone = clocks.between(i, t_ms, j, log.last_ms)
        return "lost" if gone is not None and gone.low > log.t_life else "in_flight"

    def _arrow_of(self, node: Node, event: Receive) -> Arrow | None:
        """The arrow of a received message; None for an echo."""
        me, m, tx = self._matches.stations[node[0]], event.message, event.tx
        if event.rejected is not None:
            sent = None if tx is None else self._matches.find(tx)
            leaves = sent if sent is not None and sent[0] != node[0] else None
            source = self._rejected_from(me, tx, sent is not None)
            return Arrow(source, me, "rejected", leaves, node, event.rejected)
        if m is None:
            return Arrow(ANYONE, me, "sender_unobserved", None, node)
        match = self._matches.match(node[0], self._received[node[0]])
        self._received[node[0]] += 1
        if match is None:
            unmatched = self._unmatched(node, m, tx)
            return None if unmatched is None else Arrow(source_of(m), me, unmatched, None, node)
        sent, _, again = match
        source = self._matches.stations[sent[0]]
        fate: Fate = "duplicated" if again else "delivered" if is_for(me, m) else "overheard"
        return None if source == me else Arrow(source, me, fate, sent, node)

    def _unmatched(self, node: Node, m: Fields, tx: str | None) -> Fate | None:
        """The fate of a message whose transmission is not logged; None for an echo."""
        me, sender = self._matches.stations[node[0]], source_of(m, tx)
        again = logged = False
        if tx is not None:
            again = not self._copies[me, sender].add(transmission(tx)[1])
            logged = self._matches.find(tx) is not None
        if sender in self._matches.places:
            if sender == me and tx is None:
                return None
            why = self._log(sender).not_sent(tx, logged)
            if why is not None:
                self.forged[node] = why
                return "forged"
        return "duplicated" if again else "sender_unobserved"

    def _rejected_from(self, receiver: int, tx: str | None, logged: bool) -> int:
        """The sender of a rejected datagram according to its ``tx``, which is not signed. ANYONE
        if it names none, or one that certainly did not send it. ``logged`` is whether a log
        contains that transmission."""
        sender = source_of(None, tx)
        if sender in self._matches.places and (
            sender == receiver or (not logged and self._log(sender).not_sent(tx, False))
        ):
            return ANYONE
        return sender


def is_for(station: int, message: Fields) -> bool:
    """Whether a message names the station as addressee, or no other station."""
    dst = message.get("dst", 0)
    return dst == station or type(dst) is not int or dst <= 0


def addressees(sender: int, message: Fields, stations: Sequence[int]) -> list[int]:
    """The stations that a message is for: the one it names, or all others of ``stations``. A
    broadcast that no other log can show is for ANYONE."""
    dst = message.get("dst", 0)
    if type(dst) is int and dst > 0:
        return [dst] if dst != sender else []
    return [s for s in stations if s != sender] or [ANYONE]
