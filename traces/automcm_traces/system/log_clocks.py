"""The offsets between the clocks of several stations, as far as their messages determine them.

Every station has its own monotonic clock. All clocks are assumed to run at the same rate
(docs/verification.md, section 4). A message received at ``r`` on one clock and sent at ``s`` on
another shows that the first clock is ahead by at most ``r - s``, because it was not received before
it was sent. Messages in both directions bound the offset from both sides. Where a direction has no
messages, a copy is assumed to take at most half of ``t_resend`` (docs/protocol.md, section 3), and
the result is marked as assumed.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import inf

from automcm_spec.log_format.reader import Log

Bounds = list[list[float]]


@dataclass(frozen=True, slots=True)
class Span:
    """A time in ms between two events: from ``low`` to ``high``, most likely ``best``."""

    low: int
    high: int
    best: int
    assumed: bool = False
    """Whether it relies on the assumption that a copy takes at most half of t_resend."""

    def __str__(self) -> str:
        if self.low == self.high:
            return f"{self.best} ms"
        return f"{self.best} ms ({self.low} to {self.high} ms)"

    def as_dict(self) -> dict[str, int | bool]:
        """The ``--json`` form."""
        return {
            "ms": self.best,
            "at_least_ms": self.low,
            "at_most_ms": self.high,
            "assumed": self.assumed,
        }


class Travels:
    """The shortest and longest times in ms from a transmission, on the clock of its sender, to the
    reception, on that of its receiver: by the indices of their logs."""

    def __init__(self, delay_ms: Sequence[int]) -> None:
        n = len(delay_ms)
        self.delay_ms = delay_ms
        """For each log, the maximum assumed delay of a copy from its station."""
        self.shortest: Bounds = [[inf] * n for _ in range(n)]
        self.longest: Bounds = [[-inf] * n for _ in range(n)]

    def add(self, i: int, j: int, ms: int, sure: bool) -> None:
        """Add a message from log ``i`` to log ``j``. ``ms`` counts from the first transmission that
        may have been received; ``sure`` if it is the only one."""
        if i != j:
            self.shortest[i][j] = min(self.shortest[i][j], ms)
            if sure:
                self.longest[i][j] = max(self.longest[i][j], ms)


class Clocks:
    """Bounds on the time between events of different logs."""

    def __init__(self, travels: Travels) -> None:
        self.delay_ms = travels.delay_ms
        n, seen, longest = len(self.delay_ms), travels.shortest, travels.longest
        self.notices: list[str] = []
        self._longest = longest
        self._sure = _closed(seen)
        self._alike = all(self._sure[i][i] >= 0 for i in range(n))
        if not self._alike:
            self.notices.append(
                "the clocks run at different rates: times of different stations are not compared"
            )
        wide = [
            [min(seen[i][j], self.delay_ms[j] - longest[j][i]) if i != j else 0.0 for j in range(n)]
            for i in range(n)
        ]
        closed = _closed(wide)
        fits = all(closed[i][i] >= 0 for i in range(n))
        self._assumed = closed if fits else self._sure

    def ahead(self, i: int, j: int) -> Span | None:
        """How far the clock of log ``j`` is ahead of that of log ``i``; None if unknown.

        The clocks are taken to be equal if the messages allow it.
        """
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

    def offsets(self) -> list[int]:
        """For each log, how many ms its clock is most likely ahead of the first one."""
        spans = [self.ahead(0, i) for i in range(len(self.delay_ms))]
        return [0 if span is None else span.best for span in spans]

    def starts(self, logs: Sequence[Log]) -> list[int]:
        """For each log, the time of the first event of all logs, on its own clock."""
        offsets = self.offsets()
        pairs = zip(logs, offsets, strict=True)
        first = min((log.events[0][1].t_ms - o for log, o in pairs if log.events), default=0)
        return [first + offset for offset in offsets]

    def between(self, i: int, t_i: int, j: int, t_j: int) -> Span | None:
        """The time from ``t_i`` on the clock of log ``i`` to ``t_j`` on the clock of log ``j``."""
        ahead = self.ahead(i, j)
        if ahead is None:
            return None
        gap = t_j - t_i
        return Span(gap - ahead.high, gap - ahead.low, gap - ahead.best, ahead.assumed)

    def slowest(self, i: int, j: int) -> int:
        """A lower bound in ms on the longest delay of a copy from log ``i`` to log ``j``."""
        ahead = self.ahead(i, j)
        if ahead is None or ahead.assumed or self._longest[i][j] == -inf:
            return 0
        return max(0, int(self._longest[i][j]) - ahead.high)


def _closed(bounds: Bounds) -> Bounds:
    """The tightest bounds that follow, also through third stations."""
    n = len(bounds)
    d = [[min(bounds[i][j], 0.0) if i == j else bounds[i][j] for j in range(n)] for i in range(n)]
    for k in range(n):
        for i in range(n):
            if d[i][k] == inf:
                continue
            for j in range(n):
                d[i][j] = min(d[i][j], d[i][k] + d[k][j])
    return d
