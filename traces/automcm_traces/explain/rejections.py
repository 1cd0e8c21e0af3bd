"""The datagrams that a station's secured link discarded: how many, why, and what this hints at.

``CAUSES`` says what each reason means (docs/secured.md). Other reasons are counted under their own
name and mean ``other``.
"""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Iterator, Mapping
from typing import Final, Literal

from automcm_spec.log_format.log import Event, Receive
from automcm_traces.checker.follow import Follower, Watcher
from automcm_traces.system.fates import ANYONE
from automcm_traces.system.matching import source_of

Cause = Literal["forged", "replayed", "stale", "untrusted", "malformed", "other"]
"""``untrusted``: the signer's certificate is missing or not valid."""
CAUSES: Final[Mapping[str, tuple[Cause, str]]] = {
    "bad_signature": ("forged", "do they sign with the key of their certificate?"),
    "wrong_source": ("forged", "do they send under an id of their certificate?"),
    "not_permitted": ("forged", "does their certificate permit their role?"),
    "replayed": ("replayed", ""),
    "stale": ("stale", "do the clocks agree?"),
    "early": ("stale", "do the clocks agree?"),
    "unknown_authority": ("untrusted", "does this station know their authority?"),
    "certificate_expired": ("untrusted", "was their certificate renewed, and is the clock right?"),
    "certificate_not_yet": ("untrusted", "is the clock right?"),
    "revoked": ("untrusted", "should their certificate be revoked?"),
    "unknown_signer": ("untrusted", "do they send their certificate?"),
    "too_long": ("malformed", "do they sign their messages, with the same codec?"),
    "malformed": ("malformed", "do they sign their messages, with the same codec?"),
    "over_budget": ("other", ""),
}
"""By reason, with a question that hints at why it comes about. Of the reasons of one cause, the
first one explains the others: a signer is unknown because its certificate was not accepted."""
LEAST: Final = 3
"""The minimum number of rejected messages of a station for a hint."""
MOST: Final = 100
"""The maximum number of senders and of reasons kept; further ones count as ANYONE and ``other``."""


def cause_of(reason: str) -> Cause:
    """What a logged reason means."""
    return CAUSES[reason][0] if reason in CAUSES else "other"


class Rejections(Watcher):
    """Counts what a station rejected."""

    def __init__(self) -> None:
        self.reasons: Counter[str] = Counter()
        """All rejected datagrams."""
        self._from: dict[int, Counter[str]] = defaultdict(Counter)
        """The same, by the sender that ``tx`` names."""
        self._accepted: set[int] = set()
        """The stations of which a message was accepted."""

    def event(self, line: int, event: Event, engine: Follower) -> None:
        """Count a rejected datagram."""
        if not isinstance(event, Receive):
            return
        if event.rejected is None:
            if (source := source_of(event.message)) != ANYONE:
                self._accepted.add(source)
            return
        reason = event.rejected
        if reason not in self.reasons and len(self.reasons) >= MOST:
            reason = "other"
        sender = source_of(None, event.tx)
        if sender not in self._from and len(self._from) >= MOST:
            sender = ANYONE
        self.reasons[reason] += 1
        self._from[sender][reason] += 1

    def hints(self) -> Iterator[str]:
        """Why nobody answered, where one cause explains it: all messages of a station were rejected
        for it."""
        for sender, reasons in sorted(self._from.items()):
            heard = sender in self._accepted or (sender == ANYONE and self._accepted)
            if heard or reasons.total() < LEAST or len(set(map(cause_of, reasons))) > 1:
                continue
            if question := next((CAUSES[r][1] for r in CAUSES if r in reasons), ""):
                whose = f" that name station {sender} as sender" if sender else ""
                all_ = f"all {reasons.total()} messages{whose} were rejected"
                yield f"{all_} ({counted(reasons)}): {question}"


def ordered(reasons: Mapping[str, int]) -> dict[str, int]:
    """The most frequent reason first."""
    return dict(sorted(reasons.items(), key=lambda item: (-item[1], item[0])))


def counted(reasons: Mapping[str, int]) -> str:
    """Such as ``7 replayed, 5 bad_signature``."""
    return ", ".join(f"{n} {reason}" for reason, n in ordered(reasons).items())
