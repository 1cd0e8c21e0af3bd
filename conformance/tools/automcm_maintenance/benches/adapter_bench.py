"""The cost of checking an adapter.

The same lines go to an adapter with every answer checked, to the same adapter with no answer
checked, and to an echo adapter in the same language.
"""

from __future__ import annotations

import resource
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from time import perf_counter
from typing import Any

from automcm_conformance.adapter.adapter import Adapter
from automcm_conformance.adapter.process import Process
from automcm_conformance.suite.graph_cases import Notify, Runner
from automcm_conformance.suite.purposes import Owners, Purpose
from automcm_conformance.suite.suite_run import uncollected
from automcm_conformance.suite.tally import PairPart
from automcm_spec.graph.oracle import Oracle

LIMIT_S = 60.0
SINGLES = 20_000
"""Number of lines that are sent one by one; the time for all lines is extrapolated from them."""


@dataclass(frozen=True, slots=True)
class AdapterRow:
    """The figures of one language.  Times in seconds for ``lines`` lines."""

    language: str
    lines: int
    checked_s: float
    unchecked_s: float
    echo_s: float
    """The echo adapter, with the same batches."""
    single_s: float
    """The echo adapter, with one line at a time: the cost of a kit without batches."""
    faults: int
    """Wrong answers; the figures are only valid without any."""

    @property
    def steps_per_s(self) -> float:
        """The adapter with every answer checked."""
        return self.lines / self.checked_s

    def as_dict(self) -> dict[str, Any]:
        """The row for ``--json``."""
        return asdict(self) | {
            "steps_per_s": round(self.steps_per_s),
            "checked_over_echo": round(self.checked_s / self.echo_s, 2),
            "checked_over_single": round(self.checked_s / self.single_s, 2),
            "checked_over_unchecked": round(self.checked_s / self.unchecked_s, 2),
        }


class _Recorder(Adapter):
    """Records the lines that it writes."""

    def __init__(self, command: Sequence[str]) -> None:
        super().__init__(command, LIMIT_S)
        self.bulks: list[list[bytes]] = []

    def send(self, lines: Sequence[bytes], *, continued: bool = False) -> None:
        self.bulks.append(list(lines))
        super().send(lines, continued=continued)


def measure(
    language: str,
    command: Sequence[str],
    echo: Sequence[str],
    oracle: Oracle,
    purposes: Sequence[Purpose],
    notify: Notify,
) -> AdapterRow:
    """Run these purposes on ``oracle``.  Raises AdapterError and ProtocolError."""
    adapter = _Recorder(command)
    runner = Runner(adapter, purposes, 1, notify)
    everything = (a for state in range(len(oracle.states)) for a in oracle.answers(state))
    drive = runner.plan(PairPart(f"{language}, checked", oracle), everything, Owners(purposes))
    with uncollected():
        start = perf_counter()
        runner.tour(drive)
        checked = perf_counter() - start
    adapter.stop()
    notify(f"{language}, unchecked")
    unchecked = _unread(command, adapter.bulks)
    notify(f"{language}, echo")
    floor = _unread(echo, adapter.bulks)
    faults = sum(len(tally.faults) for tally in runner.tallies.values())
    notify(f"{language}, echo line by line")
    lines = [line for bulk in adapter.bulks for line in bulk]
    some = lines[:SINGLES]
    single = _unread(echo, [[line] for line in some]) * len(lines) / len(some)
    return AdapterRow(language, len(lines), checked, unchecked, floor, single, faults)


def _unread(command: Sequence[str], bulks: list[list[bytes]]) -> float:
    """The time in seconds to send the same lines without checking the answers."""
    with Process(command, limit_s=LIMIT_S) as process:
        process.exchange([b'{"cmd":"hello","protocol":1}\n'])
        start = perf_counter()
        for lines in bulks:
            process.exchange(lines)
        return perf_counter() - start


def memory_mb() -> int:
    """The peak memory of this process, in MB."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss // 1024
