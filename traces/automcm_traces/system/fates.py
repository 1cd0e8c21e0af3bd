"""Decides the fate of each message: delivered, duplicated, lost, overheard, unobserved, in flight,
forged, or rejected.

The decision needs facts, not logs: ``delivery`` takes them from logs in memory, ``streamed_fates``
from logs of any length. A copy that no log shows as received counts as lost only if the addressee's
log promises all received messages and continues for longer than ``t_life`` after the transmission.
After that time no copy is left (docs/protocol.md, section 3).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal, NamedTuple, get_args

from automcm_spec.log_format.log import Header, Send, transmission
from automcm_spec.log_format.reader import Log
from automcm_spec.vocabulary.messages import Fields
from automcm_spec.vocabulary.parameters import Parameters
from automcm_traces.system.log_clocks import Clocks
from automcm_traces.system.log_merge import Node

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
WORDS = {"duplicated": "duplicate", "in_flight": "in flight"} | {
    "sender_unobserved": "sender unobserved"
}
"""The fates whose text differs from their name."""
ANYONE = 0
"""The addressee of a broadcast that no other log can show, and the sender of bytes that are not a
message."""


class Arrow(NamedTuple):
    """A message, or one copy of it, on its way to one station.

    ``leaves`` and ``arrives`` are known for logs in memory, as far as the logs show them.
    """

    source: int
    to: int
    fate: Fate
    leaves: Node | None = None
    arrives: Node | None = None
    reason: str = ""
    """Why it was rejected, as logged."""

    @property
    def word(self) -> str:
        """The fate as text, with the reason."""
        return f"{self.fate}: {self.reason}" if self.reason else WORDS.get(self.fate, self.fate)

    def as_dict(self) -> dict[str, int | str]:
        """The ``--json`` form."""
        found: dict[str, int | str] = {"from": self.source, "to": self.to, "fate": self.fate}
        return found | {"reason": self.reason} if self.reason else found


@dataclass(frozen=True, slots=True)
class Promised:
    """The messages that a log promises to contain."""

    file: str
    sends: bool
    receives: bool
    """Whether it contains all messages between its first and its last event."""
    ended: bool
    """Whether it has an end record; without one, events may be missing at the end."""
    first_ms: int
    last_ms: int
    t_life: int
    last_sent: int
    """The highest transmission number."""

    @staticmethod
    def by(
        file: str,
        header: Header,
        span: tuple[int, int],
        last_sent: int,
        lost: int | None,
        mid_session: bool = False,
    ) -> Promised:
        """The coverage of a log from the first to the last time in ``span``. ``lost`` is the number
        of lost records in the end record; None without one. A log that begins in mid-session
        promises nothing: its station may have sent and received more before."""
        life = header.known.get("t_life", Parameters().t_life)
        whole = not (lost or mid_session)
        sends, receives = (whole and kind in header.complete for kind in ("send", "receive"))
        return Promised(file, sends, receives, lost is not None, *span, life, last_sent)

    @staticmethod
    def of(log: Log) -> Promised:
        """The coverage of a log in memory."""
        numbers = [transmission(e.tx)[1] for _, e in log.events if isinstance(e, Send)]
        span = (log.events[0][1].t_ms, log.events[-1][1].t_ms) if log.events else (0, 0)
        lost = None if log.end is None else log.end.lost_records
        last = max(numbers, default=0)
        return Promised.by(log.file, log.header, span, last, lost, log.mid_session)

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


class Fates:
    """The fates of the messages between logs, given in the order of ``clocks``."""

    def __init__(self, logs: Mapping[int, Promised], clocks: Clocks) -> None:
        self._logs, self._clocks = logs, clocks
        self._places = {station: i for i, station in enumerate(logs)}

    def not_received(self, sender: int, t_ms: int, to: int) -> Fate:
        """The fate of a message that its addressee's log does not contain."""
        log, i = self._logs.get(to), self._places[sender]
        if log is None or not log.receives:
            return "unobserved"
        j = self._places[to]
        began = self._clocks.between(i, t_ms, j, log.first_ms)
        if began is not None and began.low > 0:
            return "unobserved"  # the log begins later
        gone = self._clocks.between(i, t_ms, j, log.last_ms)
        return "lost" if gone is not None and gone.low > log.t_life else "in_flight"

    def received(self, again: bool, addressed: bool) -> Fate:
        """The fate of a message whose transmission is logged; ``again`` if another copy of it was
        received before."""
        return "duplicated" if again else "delivered" if addressed else "overheard"

    def unmatched(
        self, receiver: int, sender: int | None, tx: str | None, logged: bool, again: bool
    ) -> tuple[Fate | None, str]:
        """The fate of a message whose transmission is not logged, and the reason; None for an echo.

        ``again`` is whether a copy with this tx was received before.
        """
        log = None if sender is None else self._logs.get(sender)
        if log is None:
            why = f"no log of station {sender}"
        elif sender == receiver and tx is None:
            return None, "an echo"
        else:
            forged = log.not_sent(tx, logged)
            if forged is not None:
                return "forged", forged
            why = f"{log.file} may lack sent messages"
        return "duplicated" if again else "sender_unobserved", why

    def rejected_from(self, receiver: int, tx: str | None, logged: bool) -> int:
        """The sender of a rejected datagram according to its ``tx``, which is not signed. ANYONE
        if it names none, or one that certainly did not send it. ``logged`` is whether a log
        contains that transmission."""
        sender = ANYONE if tx is None else transmission(tx)[0]
        log = self._logs.get(sender)
        if log is not None and (sender == receiver or (not logged and log.not_sent(tx, False))):
            return ANYONE
        return sender


def addressees(sender: int, message: Fields, stations: Sequence[int]) -> list[int]:
    """The stations that a message is for: the one it names, or all others of ``stations``. A
    broadcast that no other log can show is for ANYONE."""
    dst = message.get("dst", 0)
    if type(dst) is int and dst > 0:
        return [dst] if dst != sender else []
    return [s for s in stations if s != sender] or [ANYONE]


def sender_of(message: Fields, tx: str | None) -> int | None:
    """The station that sent a received message, by its tx, or as the message says."""
    if tx is not None:
        return transmission(tx)[0]
    src = message.get("src")
    return src if type(src) is int else None


def source_of(message: Fields | None) -> int:
    """The station that a received message names as its sender; ANYONE if it names none."""
    src = None if message is None else message.get("src")
    return src if type(src) is int and src > 0 else ANYONE
