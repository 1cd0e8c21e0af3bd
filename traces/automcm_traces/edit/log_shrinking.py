"""Finds the smallest logs that still show the same problem.

``automcm_traces.explain.explain`` finds the problem. Then ever more is left out as long as the
verdict stays the same: the same event diverges, by the same rule, with the same guard in the way,
in the same state except for its numbers. The search leaves out whole sessions first, then whole
logs, then steps (an input with its effects), and finally single effects. It closes the resulting
gaps if the problem remains (``automcm_traces.edit.log_slice``).

The result is small, but not proven to be the smallest. No consecutive steps, and no two steps, can
be left out of it, unless it is long or the search reached its limit of tries.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from itertools import combinations
from pathlib import Path
from typing import Any

from automcm_spec.log_format.log import Receive, Send
from automcm_spec.log_format.reader import Log, LogStream
from automcm_spec.support.bad_input import BadInput, at_line, name_of, one_line
from automcm_spec.support.shortening import with_fewer_parts
from automcm_traces.checker.finding import Finding
from automcm_traces.edit.log_slice import Item, LogSlice
from automcm_traces.explain.explain import Verdict, explain, forged, verdicts_of
from automcm_traces.explain.log_table import TableRow, rows_of
from automcm_traces.system.properties import SystemReport, judge

TRIES = 3000
"""The maximum number of candidates that are checked."""
MOST_STEPS = 40
"""In longer logs, not all runs and pairs of steps are tried."""
Candidate = tuple[LogSlice, ...]
Test = Callable[[Sequence[Log]], bool]


class NothingToShrink(Exception):
    """The logs show no problem (``code`` 1), are unreadable (3), or are insufficient for a verdict
    (4)."""

    def __init__(self, text: str, code: int) -> None:
        super().__init__(text)
        self.code = code


@dataclass(slots=True)
class Shrunk:
    """The smallest logs found, and their problem."""

    finding: Finding
    """The problem; without a file if it involves all logs together."""
    logs: Candidate
    before: dict[str, int]
    """The number of events in each given log."""
    most: int
    tries: int = 0

    @property
    def ended(self) -> bool:
        """Whether the search reached its limit of tries."""
        return self.tries >= self.most

    @property
    def line_now(self) -> int:
        """The line of the event in the smallest log; 0 if the problem involves all logs
        together."""
        at = self.finding.at
        kept = [item.line for log in self.logs if log.file == at.file for item in log.items]
        return kept.index(at.line) + 2 if at.line in kept else 0

    def as_dict(self) -> dict[str, Any]:
        """The ``--json`` form."""
        return {
            "what": self.finding.observed,
            "rule": self.finding.rule or self.finding.property,
            "file": self.finding.at.file,
            "line_before": self.finding.at.line,
            "line": self.line_now,
            "tries": self.tries,
            "ended": self.ended,
            "logs": [
                {"file": log.file, "events_before": self.before[log.file], "events": len(log.items)}
                for log in self.logs
            ],
        }

    def text(self) -> list[str]:
        """The result as text."""
        at, rule = self.finding.at, self.finding.rule or self.finding.property
        where = f"{at.file}:{at.line}: " if at.file else ""
        shown = f" [{rule}]" if rule else ""
        lines = [one_line(f"{where}{self.finding.observed}{shown}")]
        for log in self.logs:
            lines.append(f"{log.file}: {len(log.items)} of {self.before[log.file]} events are left")
        gone = [file for file in self.before if file not in {log.file for log in self.logs}]
        lines += [f"{file}: is not needed" for file in gone]
        if self.ended:
            lines.append(
                f"stopped after {self.tries} tries; raise --tries to search for smaller logs"
            )
        return lines

    def rows(self) -> list[TableRow]:
        """All remaining events, log by log, with their lines in the new files."""
        return [
            row
            for log in self.logs
            for row in rows_of(log.header.station, enumerate((i.event for i in log.items), 2))
        ]


def shrink(
    paths: Sequence[Path],
    *,
    late_ms: int | None = None,
    tries: int = TRIES,
    on_progress: Callable[[str], None] = lambda text: None,
) -> Shrunk:
    """The smallest logs that show the first problem in the logs of these files.

    A log that diverges by itself is shrunk alone. A log with a forged message is shrunk together
    with the others, and so are logs that violate a property together. ``late_ms`` is as for
    ``explain``.

    Raises NothingToShrink and OSError.
    """
    verdicts = verdicts_of(paths, late_ms)
    wrong = next((v for v in verdicts if v.verdict == "diverges"), None)
    if wrong is not None and wrong.finding.kind != "forged":
        alone = LogSlice.read(wrong.file, max(wrong.seen, wrong.finding.at.line))
        before = {name_of(path): _events(path) for path in paths}
        found = Shrunk(wrong.finding, (alone,), before, tries)
        wanted = _signature(wrong)

        def same(logs: Sequence[Log]) -> bool:
            return _signature(explain(logs[0], late_ms)) == wanted

        return Search(found, same, on_progress).run()
    for v in verdicts:
        if v.verdict == "unreadable":
            where = at_line(v.file, v.finding.at.line)
            raise NothingToShrink(f"{where}: {v.finding.observed}", 3)
    undecided = next((v for v in verdicts if v.verdict == "cannot_tell"), None)
    text, code = "the logs are allowed: there is nothing to shrink", 1
    if undecided is not None:
        line, observed = undecided.finding.at.line, undecided.finding.observed
        text, code = f"{undecided.file}:{line}: CANNOT TELL: {observed}", 4
    try:
        logs = tuple(LogSlice.read(path) for path in paths)
    except BadInput:  # records are missing, as its verdict states
        raise NothingToShrink(text, code) from None
    problem = None if wrong is None else wrong.finding
    if problem is None and len(paths) > 1:
        system = judge([log.log() for log in logs])
        problem = next(iter(_violations(system)), None)
        if code == 1 and system.hazards:
            text = "a fault caused a hazard, but all stations behave as allowed: nothing to shrink"
    if problem is None:
        raise NothingToShrink(text, code)
    found = Shrunk(problem, logs, {log.file: len(log.items) for log in logs}, tries)
    return Search(found, shows_too(problem, verdicts, late_ms), on_progress).run()


def _events(path: Path) -> int:
    """The number of events in a file, as far as it can be read."""
    count = 0
    try:
        for _ in (log := LogStream(path, past_gaps=True)):
            count = log.events
    except BadInput:
        pass  # after the part to shrink
    return count


# -- the same problem


def masked(text: str) -> str:
    """A verdict text without its numbers, which change when events are left out."""
    return re.sub(r"\d+", "#", text)


def _signature(v: Verdict) -> tuple[object, ...]:
    """Equal for two verdicts on a log that diverges at the same event, by the same rule and in the
    same way: in the same state except for its numbers, with the same guard in the way."""
    # The missing effects of an input are the problem: no other effect may be left out there.
    found = v.finding
    exact = found.kind in ("missing", "state")
    missing = tuple(masked(e) for e in found.expected) if exact else ()
    around = found.guard, masked(found.state), masked(found.nearest)
    return found.kind, found.at, found.rule, masked(found.observed), missing, around


def shows_too(wrong: Finding, verdicts: Sequence[Verdict], late_ms: int | None) -> Test:
    """Whether several logs have the same forged message, or violate the same property in the same
    way, and no log has become worse."""
    wanted = wrong.property, masked(wrong.observed)
    good = {v.file for v in verdicts if v.verdict == "allowed" or v.finding is wrong}

    def same(logs: Sequence[Log]) -> bool:
        others = forged(logs)
        if wrong.kind == "forged" and others.pop(wrong.at.file, None) != wrong:
            return False
        alone = (explain(log, late_ms).verdict for log in logs if log.file in good)
        if others.keys() & good or any(verdict != "allowed" for verdict in alone):
            return False
        if wrong.kind == "forged":
            return True
        return wanted in [(f.property, masked(f.observed)) for f in _violations(judge(logs))]

    return same


def _violations(report: SystemReport) -> list[Finding]:
    """Each violated property, or ``forged`` or ``cycle``, with its place."""
    found = [(j.property, w) for j in report.properties if j.outcome == "violated" for w in j.where]
    found += [("forged", text) for text in report.forged]
    found += [("cycle", text) for text in report.cycles]
    return [Finding("property", property=name, observed=where) for name, where in found]


# -- the search


@dataclass(slots=True)
class Search:
    """Leaves out as much as possible. ``same`` tests whether logs still show the same problem."""

    found: Shrunk
    """The smallest logs so far."""
    same: Test
    on_progress: Callable[[str], None]
    _refused: set[tuple[tuple[int, ...], ...]] = field(default_factory=set)

    def run(self) -> Shrunk:
        """Search as far as the limit of tries allows."""
        self._sessions()
        self._logs()
        size = -1
        while size != self._size() and not self.found.ended:
            size = self._size()
            for n in range(len(self.found.logs)):
                self._exchanges(n)
                self._fewer(n, lambda log: log.steps())
                self._fewer(n, lambda log: log.effects())
            if size == self._size():
                for n in range(len(self.found.logs)):
                    self._some_fewer(n)
        return self.found

    def _size(self) -> int:
        return sum(len(log.items) for log in self.found.logs)

    def _sessions(self) -> None:
        """Leave out whole sessions, in all logs: first all except one, then each."""
        wrong, groups = self._wrong(), self._by_session()
        for name in sorted(groups, reverse=True):
            if groups[name] & wrong:
                self._without({i for other in groups if other != name for i in groups[other]})
        for name in sorted(self._by_session(), reverse=True):
            self._without(self._by_session().get(name, set()))

    def _by_session(self) -> dict[tuple[int, int], set[int]]:
        """The items of each session in all logs."""
        groups: dict[tuple[int, int], set[int]] = {}
        for log in self.found.logs:
            for name, items in log.by_session().items():
                groups.setdefault(name, set()).update(id(item) for item in items)
        return groups

    def _exchanges(self, n: int) -> None:
        """Leave out everything about one proposal, or about one message."""
        again = True
        while again and not self.found.ended:
            found = self.found.logs[n].by_number()
            again = any(self._without({id(item) for item in items}) for items in reversed(found))

    def _logs(self) -> None:
        """Leave out whole logs; two stay, because explain does not judge one log as a run."""
        for log in self.found.logs:
            if len(self.found.logs) > 2:
                self._try(tuple(other for other in self.found.logs if other is not log))

    def _fewer(self, n: int, parts_of: Callable[[LogSlice], list[list[Item]]]) -> None:
        """Leave out consecutive parts of the log at index ``n``, long runs first, from the end."""

        def without(best: Candidate, at: int, size: int) -> Candidate | None:
            away = parts_of(best[n])[::-1][at : at + size]
            done = self._without({id(item) for part in away for item in part})
            return self.found.logs if done else None

        with_fewer_parts(self.found.logs, lambda best: len(parts_of(best[n])), without)

    def _some_fewer(self, n: int) -> None:
        """Leave out any consecutive steps, or any two steps."""
        steps = self.found.logs[n].steps()
        if len(steps) > MOST_STEPS:
            return
        down = range(len(steps), -1, -1)
        rows = [steps[at : at + size] for size in down for at in down]
        for away in [*rows, *combinations(reversed(steps), 2)]:
            if self.found.ended or self._without({id(item) for step in away for item in step}):
                return

    def _without(self, away: set[int]) -> bool:
        """Try to leave out some items. In a single log, first try to close the gaps."""
        away = away - self._wrong()
        if len(self.found.logs) > 1:
            away = self._with_received(away)
        kept = [[item for item in log.items if id(item) not in away] for log in self.found.logs]
        key = tuple(tuple(item.line for item in items) for items in kept)
        if key in self._refused or not away:
            return False
        pairs = list(zip(self.found.logs, kept, strict=True))
        if len(self.found.logs) == 1 and self._try(
            tuple(log.closed_up(items) for log, items in pairs)
        ):
            return True
        if self._try(tuple(log.having(items) for log, items in pairs)):
            return True
        self._refused.add(key)
        return False

    def _wrong(self) -> set[int]:
        """The event with the problem, and its input, which both stay."""
        at = self.found.finding.at
        steps = (step for log in self.found.logs if log.file == at.file for step in log.steps())
        found = [step for step in steps if any(item.line == at.line for item in step)]
        return {id(i) for step in found for i in step if i is step[0] or i.line == at.line}

    def _with_received(self, away: set[int]) -> set[int]:
        """Add every step that receives a message that is no longer sent."""
        away = set(away)
        size = -1
        while size != len(away):
            size = len(away)
            items = [item for log in self.found.logs for item in log.items if id(item) in away]
            gone = {item.event.tx for item in items if isinstance(item.event, Send)}
            for log in self.found.logs:
                for step in log.steps():
                    event = step[0].event
                    if isinstance(event, Receive) and event.tx in gone:
                        away |= {id(item) for item in step}
        return away

    def _try(self, candidate: Candidate) -> bool:
        if self.found.ended:
            return False
        self.found.tries += 1
        if not self.same([log.log() for log in candidate]):
            return False
        self.found.logs = candidate
        self.on_progress(
            f"{self._size()} events in {len(self.found.logs)} logs, {self.found.tries} tried"
        )
        return True
