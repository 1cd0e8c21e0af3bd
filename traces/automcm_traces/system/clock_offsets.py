"""How the clocks of several stations stand to each other, as far as their messages tell.

Every station has a monotonic clock of its own.  They are taken to run alike, as everywhere
(docs/verification.md, section 4).  A message received at ``r`` on one clock and sent at ``s`` on
another shows that the first is ahead by at most ``r - s``: it was not received before it was
sent.  Messages both ways enclose the difference.  Where there are none one way, a copy is taken
to be under way for at most half of ``t_resend`` (docs/protocol.md, section 3), and that is said.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import inf

from automcm_traces.system.log_merge import Merged

Bounds = list[list[float]]


@dataclass(frozen=True, slots=True)
class Span:
    """A time in ms between two events: between ``low`` and ``high``, and most likely ``best``."""

    low: int
    high: int
    best: int
    assumed: bool = False
    """That no copy takes longer than half of t_resend was used."""

    def __str__(self) -> str:
        if self.low == self.high:
            return f"{self.best} ms"
        return f"{self.best} ms ({self.low} to {self.high} ms)"

    def as_dict(self) -> dict[str, int | bool]:
        """As in ``--json``."""
        return {
            "ms": self.best,
            "at_least_ms": self.low,
            "at_most_ms": self.high,
            "assumed": self.assumed,
        }


class Clocks:
    """What can be said of a time from an event of one log to an event of another."""

    def __init__(self, merged: Merged) -> None:
        n = len(merged.logs)
        seen: Bounds = [[inf] * n for _ in range(n)]
        longest: Bounds = [[-inf] * n for _ in range(n)]
        for node, match in merged.matches.items():
            i, j = match.sent[0], node[0]
            if i == j:
                continue
            first = merged.event(node).t_ms - merged.event(match.first).t_ms
            seen[i][j] = min(seen[i][j], first)
            if match.sure:
                longest[i][j] = max(longest[i][j], first)
        self.delay_ms = [log.header.longest_delay for log in merged.logs]
        """By place: how long a copy of a station is assumed to be under way at most."""
        self.notices: list[str] = []
        self._longest = longest
        self._sure = _closed(seen)
        self._alike = all(self._sure[i][i] >= 0 for i in range(n))
        if not self._alike:
            self.notices.append("the clocks do not run alike: no time across stations can be told")
        wide = [
            [min(seen[i][j], self.delay_ms[j] - longest[j][i]) if i != j else 0.0 for j in range(n)]
            for i in range(n)
        ]
        closed = _closed(wide)
        fits = all(closed[i][i] >= 0 for i in range(n))
        self._assumed = closed if fits else self._sure

    def ahead(self, i: int, j: int) -> Span | None:
        """By how much the clock of log ``j`` is ahead of that of log ``i``; None: not known.

        The clocks are taken to be the same where the messages allow it."""
        if i == j:
            return Span(0, 0, 0)
        if not self._alike:
            return None
        high, low, assumed = self._sure[i][j], -self._sure[j][i], False
        if high == inf or low == -inf:
            high, low, assumed = self._assumed[i][j], -self._assumed[j][i], True
        if high == inf or low == -inf:
            return None
        best = 0 if low <= 0 <= high else (int(low) + int(high)) // 2
        return Span(int(low), int(high), best, assumed)

    def between(self, i: int, t_i: int, j: int, t_j: int) -> Span | None:
        """How long after ``t_i`` on the clock of log ``i`` it is ``t_j`` on that of log ``j``."""
        ahead = self.ahead(i, j)
        if ahead is None:
            return None
        gap = t_j - t_i
        return Span(gap - ahead.high, gap - ahead.low, gap - ahead.best, ahead.assumed)

    def slowest(self, i: int, j: int) -> int:
        """How many ms some copy from log ``i`` to log ``j`` was certainly under way at least."""
        ahead = self.ahead(i, j)
        if ahead is None or ahead.assumed or self._longest[i][j] == -inf:
            return 0
        return max(0, int(self._longest[i][j]) - ahead.high)


def _closed(bounds: Bounds) -> Bounds:
    """The tightest bounds that follow, through third stations too."""
    n = len(bounds)
    d = [[min(bounds[i][j], 0.0) if i == j else bounds[i][j] for j in range(n)] for i in range(n)]
    for k in range(n):
        for i in range(n):
            if d[i][k] == inf:
                continue
            for j in range(n):
                d[i][j] = min(d[i][j], d[i][k] + d[k][j])
    return d
