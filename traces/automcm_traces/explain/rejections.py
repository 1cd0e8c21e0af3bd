"""The datagrams that a station's secured link discarded: how many, why, and what this hints at.

``CAUSES`` says what each reason means (docs/secured.md). Other reasons are counted under their own
name and mean ``other``.
"""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Iterator, Mapping
from typing import Final, Literal

from automcm_spec.log_format.log import Event, Receive, transmission
from automcm_traces.checker.follow import Follower, Watcher
from automcm_traces.system.fates import ANYONE, source_of

Cause = Literal["forged", "replayed", "stale", "untrusted", "malformed", "other"]
"""``untrusted``: the signer's certificate is missing or not valid."""
CAUSES: Final[Mapping[str, Cause]] = {
    "bad_signature": "forged",
    "wrong_source": "forged",
    "not_permitted": "forged",
    "replayed": "replayed",
    "stale": "stale",
    "early": "stale",
    "unknown_authority": "untrusted",
    "certificate_expired": "untrusted",
    "certificate_not_yet": "untrusted",
    "revoked": "untrusted",
    "unknown_signer": "untrusted",
    "too_long": "malformed",
    "malformed": "malformed",
    "over_budget": "other",
}
"""By reason. Of the reasons of one cause, the first one explains the others: a signer is unknown
because its certificate was not accepted."""
QUESTIONS: Final[Mapping[str, str]] = {
    "bad_signature": "do they sign with the key of their certificate?",
    "wrong_source": "do they send under an id of their certificate?",
    "not_permitted": "does their certificate permit their role?",
    "stale": "do the clocks agree?",
    "early": "do the clocks agree?",
    "unknown_authority": "does this station know their authority?",
    "certificate_expired": "was their certificate renewed, and is the clock right?",
    "certificate_not_yet": "is the clock right?",
    "revoked": "should their certificate be revoked?",
    "unknown_signer": "do they send their certificate?",
    "too_long": "do they sign their messages, with the same codec?",
    "malformed": "do they sign their messages, with the same codec?",
}
LEAST: Final = 3
"""The minimum number of rejected messages of a station for a hint."""
MOST: Final = 100
"""The maximum number of senders and of reasons kept; further ones count as ANYONE and ``other``."""


def cause_of(reason: str) -> Cause:
    """What a logged reason means."""
    return CAUSES.get(reason, "other")


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
        sender = ANYONE if event.tx is None else transmission(event.tx)[0]
        if sender not in self._from and len(self._from) >= MOST:
            sender = ANYONE
        self.reasons[reason] += 1
        self._from[sender][reason] += 1

    def hint(self) -> str:
        """Why nobody answered, if one cause explains it: all messages of a station were rejected
        for it; empty if there is none."""
        return "; ".join(self._hints())

    def _hints(self) -> Iterator[str]:
        for sender, reasons in sorted(self._from.items()):
            heard = sender in self._accepted or (sender == ANYONE and self._accepted)
            if heard or reasons.total() < LEAST or len(set(map(cause_of, reasons))) > 1:
                continue
            reason = next((r for r in CAUSES if r in reasons), "")
            if question := QUESTIONS.get(reason):
                whose = f" that name station {sender} as sender" if sender else ""
                all_ = f"all {reasons.total()} messages{whose} were rejected"
                yield f"{all_} ({counted(reasons)}): {question}"


def ordered(reasons: Mapping[str, int]) -> dict[str, int]:
    """The most frequent reason first."""
    return dict(sorted(reasons.items(), key=lambda item: (-item[1], item[0])))


def counted(reasons: Mapping[str, int]) -> str:
    """Such as ``7 replayed, 5 bad_signature``."""
    return ", ".join(f"{n} {reason}" for reason, n in ordered(reasons).items())
