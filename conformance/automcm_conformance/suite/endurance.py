"""What no answer shows: memory that grows with every message, and a message nested so deep that it
ends the process. Notes of the report, not verdicts."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

from automcm_conformance.adapter.adapter import Adapter
from automcm_conformance.adapter.process import AdapterError, Process
from automcm_conformance.adapter.protocol import SAY_HELLO

WARM = 100_000
"""Not judged after fewer answers: a garbage collector may not have run yet."""
LEAST = 1 << 18
"""The bytes by which each of the last three quarters must grow: some 100 for each message."""
DEPTH = 30_000
"""Lists within lists; with them a message still fits a datagram."""
_NESTS = (
    b'{"cmd":"receive","now":2000,"message":{"v":1,"type":"Advertisement","src":1702,'
    b'"session":[1702,5],"seq":1,"scenario":"lane_change","details":{"in":'
)


class MemoryWatch:
    """Exchanges lines with the adapter, and samples its main memory after each exchange."""

    def __init__(self, adapter: Adapter) -> None:
        self._adapter = adapter
        self._samples: list[int] = []

    def exchange(self, lines: Sequence[bytes]) -> list[bytes]:
        """As ``Adapter.exchange``."""
        answers = self._adapter.exchange(lines)
        self._samples.append(self._adapter.resident)
        return answers

    @property
    def note(self) -> str:
        """Empty unless the memory grew steadily after the first quarter."""
        ends = self._samples[:: max(1, len(self._samples) // 4)][1:]
        growth = [after - before for before, after in pairwise(ends)]
        if self._adapter.answered < WARM or len(growth) < 3 or min(growth) < LEAST:
            return ""
        return (
            f"the memory of the adapter grows steadily, by {sum(growth) / 1e6:.1f} MB in three "
            "quarters of 10,000 receptions: is every message kept?"
        )


def nesting(adapter: Adapter, reset: bytes) -> str:
    """A note if a message that is nested too deep (END-5) ends a process of its own; else empty.
    ``reset``: a line."""
    line = b"%b%b%b}}}\n" % (_NESTS, b"[" * DEPTH, b"]" * DEPTH)
    try:
        with Process(adapter.command, limit_s=adapter.limit_s) as process:
            process.exchange([SAY_HELLO, reset, line, reset])
    except AdapterError as error:
        return f"at a message nested {DEPTH:,} deep, {error}"
    return ""
