"""Two runs side by side on one page: which events share a row, and where the runs differ."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from automcm_spec.log_format.reader import Log
from automcm_traces.edit.log_diff import Diff, diff_logs
from automcm_traces.system.event_order import Node
from automcm_traces.viewer.page_part import PageError
from automcm_traces.viewer.page_run import PageRun


@dataclass(slots=True)
class Comparison:
    """The ``diff`` of two runs by log index: the logs of A first, then those of B."""

    diff: Diff
    ahead: list[int]
    """For each log, how many ms its clock is ahead of the first clock of A. For B, determined at
    the first events that share a row."""
    logs: list[tuple[int, int]] = field(default_factory=list)
    """For each station compared, the logs of A and of B."""
    beside: dict[Node, Node] = field(default_factory=dict)
    """Events of A and the equal events of B: they share a row."""
    ends: list[list[Node | None]] = field(default_factory=list)
    """For each station compared, the first events of A and B that differ; None if there is none."""


def compare(a: PageRun, b: PageRun, stations: Mapping[int, int] | None = None) -> Comparison:
    """Compare two runs; ``stations`` is as for ``diff``.

    Raises PageError if no station has a log in both.
    """
    found = diff_logs(a.logs, b.logs, stations)
    if not found.stations:
        of_a, of_b = (", ".join(map(str, run.merged.stations)) for run in (a, b))
        raise PageError(f"no station to compare: A has {of_a}, B has {of_b}")
    logs = [*a.logs, *b.logs]
    places = {log.file: i for i, log in enumerate(a.logs)}
    others = {log.file: len(a.logs) + i for i, log in enumerate(b.logs)}
    made = Comparison(found, [*a.merged.clocks.offsets(), *b.merged.clocks.offsets()])
    firsts: list[tuple[int, Node, Node]] = []
    for one in found.stations:
        i, j = places[one.file_a], others[one.file_b]
        at = [{line: k for k, (line, _) in enumerate(logs[n].events)} for n in (i, j)]
        pairs = [((i, at[0][x]), (j, at[1][y])) for x, y in one.pairs]
        made.logs.append((i, j))
        made.ends.append([])
        made.beside |= dict(pairs)
        events = (None, None) if (d := one.difference) is None else (d.a, d.b)
        for n, side, event in zip((i, j), at, events, strict=True):
            made.ends[-1].append(None if event is None else (n, side[event.line]))
        firsts += [(_t_ms(logs, pairs[0][0]) - made.ahead[i], *pairs[0])] if pairs else []
    _align(made, logs, len(a.logs), sorted(firsts))
    return made


def _align(made: Comparison, logs: list[Log], n: int, firsts: list[tuple[int, Node, Node]]) -> None:
    """Align the clocks of B with those of A.

    A log is aligned by its first event that has an equal in A, other logs by the first such event
    of all. If there is none, both runs begin at the same time.
    """

    def clock(node: Node) -> int:
        return _t_ms(logs, node) - made.ahead[node[0]]

    if firsts:
        apart = clock(firsts[0][2]) - clock(firsts[0][1])
    else:
        begins = [
            min((clock((i, 0)) for i in some if logs[i].events), default=0)
            for some in (range(n), range(n, len(logs)))
        ]
        apart = begins[1] - begins[0]
    own = {b[0]: clock(b) - clock(a) for _, a, b in firsts}
    for i in range(n, len(logs)):
        made.ahead[i] += own.get(i, apart)


def _t_ms(logs: list[Log], node: Node) -> int:
    return logs[node[0]].events[node[1]][1].t_ms
