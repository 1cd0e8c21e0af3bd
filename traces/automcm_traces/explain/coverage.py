"""Measures how much of the specification a set of logs exercises.

Each log is checked on the compiled specification. Counting a log stops where it diverges, where no
verdict is possible any more, or where it cannot be read.
"""

from __future__ import annotations

import textwrap
from collections import Counter, defaultdict
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import TypeAlias, get_args

from automcm_spec.log_format.log import Event, Receive, Send
from automcm_spec.log_format.reader import LogStream
from automcm_spec.support.bad_input import BadInput, at_line, one_line
from automcm_spec.vocabulary.condition_coverage import ConditionCoverage, lacking, reached
from automcm_spec.vocabulary.conditions import recording
from automcm_spec.vocabulary.messages import MessageType
from automcm_spec.vocabulary.reachable_steps import steps
from automcm_spec.vocabulary.rules import RULES, kind
from automcm_spec.vocabulary.station import Input, OpenStation, State, Station
from automcm_traces.checker.finding import Answer, Finding, answer, unreadable, worst
from automcm_traces.checker.follow import Check, Follower, Watcher
from automcm_traces.checker.track import INITIAL, InputStep, Track

ALL_TYPES = (*get_args(MessageType), "CAM")
REMEMBERED = 20_000
"""The number of distinct queries that are counted before they are evaluated."""
Question: TypeAlias = tuple[int, tuple[int, ...], State, Input | None]
"""A query: station, limits, state, and input; the input is None for the marks of a CAM."""


@cache
def possible() -> dict[str, tuple[str, ...]]:
    """The elements of the specification that logs can cover: the rules that decide an input, the
    phases, the ways ``A -> B`` from phase to phase, the kinds of input, the types of messages.

    They are those of a station with one peer: it has all phases, ways and kinds of input (tests).
    """
    one = frozenset({1})
    o = OpenStation(2, 1, 5, 2, peers=frozenset({2}), own_sessions=one, peer_sessions=one)
    ways = {
        f"{st.phase} -> {after.st.phase}"
        for st, _, after in steps(o)
        if after.st != st or after.arm
    }
    deciding = {c.text for c in reached().rules}
    return {
        "rules": tuple(rule for rule in RULES if rule in deciding),
        "phases": tuple(sorted(o.phases)),
        "ways": tuple(sorted(ways)),
        "inputs": tuple(sorted({kind(i) for i in o.alphabet})),
        "sent": ALL_TYPES,
        "received": ALL_TYPES,
    }


@dataclass
class LogCoverage:
    """The combined coverage of all logs given to ``add``."""

    logs: int = 0
    events: int = 0
    steps: int = 0
    problems: list[tuple[str, int, Answer, str]] = field(default_factory=list)
    """File, line, verdict and reason for each log that was not counted to its end."""
    counts: dict[str, Counter[str]] = field(default_factory=lambda: defaultdict(Counter))
    """How often each of the ``possible`` elements was seen; a phase, when an input came in it."""
    _conditions: ConditionCoverage = field(default_factory=ConditionCoverage)
    _pending: Counter[Question] = field(default_factory=Counter)
    """The counts of the queries that have not been evaluated yet."""

    def add(self, path: Path, late_ms: int | None = None) -> None:
        """Count one log, read lazily. ``late_ms`` is as for ``Engine``."""
        self.logs += 1
        try:
            stream = LogStream(path)
        except BadInput as error:
            self._problem(unreadable(error), 0)
            return
        check = Check(stream, late_ms, [_Counter(self)], one=True).read()
        if check.finding.kind != "nothing":
            self._problem(check.finding, check.line)

    def _problem(self, found: Finding, last: int) -> None:
        line = found.at.line or last
        self.problems.append((found.at.file, line, answer(found.kind), one_line(found.observed)))

    def count(self, track: Track, st: State, i: Input | None) -> None:
        """Count a query to the specification."""
        self._pending[track.me, track.limits, st, i] += 1
        if len(self._pending) >= REMEMBERED:
            self._evaluate()

    @property
    def conditions(self) -> ConditionCoverage:
        """How often each condition of Station.tla was true and false."""
        self._evaluate()
        return self._conditions

    def _evaluate(self) -> None:
        """Evaluate each pending query once, recording its conditions."""
        for (me, limits, st, i), times in self._pending.items():
            self._conditions.times = times
            station = recording(Station(*limits), self._conditions.meet)
            station.marks(st) if i is None else station.step(me, st, i)
        self._pending.clear()

    def tables(self) -> dict[str, dict[str, int]]:
        """The tables by name: how often each possible element was seen, 0 for never."""
        return {
            name: {element: self.counts[name][element] for element in elements}
            for name, elements in possible().items()
        }

    def as_dict(self) -> dict[str, object]:
        """The ``--json`` form."""
        return {
            "logs": self.logs,
            "events": self.events,
            "steps": self.steps,
            "problems": [
                {"file": file, "line": line, "verdict": what, "reason": why}
                for file, line, what, why in self.problems
            ],
            "conditions": self.conditions.as_list(),
            **self.tables(),
        }


class _Counter(Watcher):
    """Counts the coverage of one log."""

    def __init__(self, coverage: LogCoverage) -> None:
        self._c = coverage
        self._before = INITIAL
        self._line = 0

    def event(self, line: int, event: Event, engine: Follower) -> None:
        self._line = line
        self._message(event)
        if isinstance(event, Send) and event.is_cam:
            self._c.count(engine.track, engine.track.state, None)

    def ended(self, check: Check) -> None:
        self._c.events += check.events
        if check.line > self._line:  # the event that was not allowed
            self._message(check.recent[-1][1])

    def _message(self, event: Event) -> None:
        if isinstance(event, Send):
            self._c.counts["sent"][str(event.message["type"])] += 1
        elif isinstance(event, Receive) and event.message is not None:
            self._c.counts["received"][str(event.message["type"])] += 1

    def step(self, step: InputStep, track: Track) -> None:
        was, self._before = self._before, track.state
        self._c.steps += 1
        self._c.counts["rules"][step.rule] += 1
        self._c.counts["phases"][was.phase] += 1
        self._c.counts["inputs"][kind(step.input)] += 1
        if step.changes:
            self._c.counts["ways"][f"{was.phase} -> {track.state.phase}"] += 1
        self._c.count(track, was, step.input)


def measure(paths: Iterable[Path], late_ms: int | None = None) -> LogCoverage:
    """The combined coverage of these logs."""
    coverage = LogCoverage()
    for path in paths:
        coverage.add(path, late_ms)
    return coverage


def exit_code(coverage: LogCoverage) -> int:
    """0 if each log was counted to its end, otherwise that of the most severe problem."""
    return worst(what for _, _, what, _ in coverage.problems)


CONDITIONS = "conditions both ways"
MOST_PROBLEMS = 10
_PROBLEMS: dict[Answer, str] = {
    "diverges": "with a divergence",
    "unreadable": "not readable to the end",
    "cannot_tell": "without enough for a verdict to the end",
}


def text(coverage: LogCoverage) -> list[str]:
    """The report as text: each count with its total, and the elements that were never seen."""
    c = coverage
    logs = "1 log" if c.logs == 1 else f"{c.logs:,} logs"
    lines = [f"{logs}, {c.events:,} events, {c.steps:,} steps of the specification"]
    counts = Counter(what for _, _, what, _ in c.problems)
    for what, texts in _PROBLEMS.items():
        if counts[what]:
            lines.append(f"  {counts[what]:,} {texts}; counted up to there")
    lines += [f"  {one}" for one in problems(c)[:MOST_PROBLEMS]]
    if len(c.problems) > MOST_PROBLEMS:
        lines.append(f"  {len(c.problems) - MOST_PROBLEMS:,} more")
    for name, part, whole, never in shares(c):
        percent = 100 * part / whole
        lines.append(f"{name:<22} {part:>9,} of {whole:>10,} {percent:>6.1f} %")
        if name == CONDITIONS:
            lines += [f"  {line}" for line in never]
        else:
            lines += _wrapped("  never: ", never)
    return lines


def problems(coverage: LogCoverage) -> list[str]:
    """A line for each log that was not counted to its end."""
    return [
        f"{at_line(one_line(file), line)}: {problem.replace('_', ' ').upper()}: {why}"
        for file, line, problem, why in coverage.problems
    ]


def shares(coverage: LogCoverage) -> Iterator[tuple[str, int, int, list[str]]]:
    """For each kind of element: its name, how many were seen, how many there are, and the others.

    For conditions, the others are the lines of ``lacking``.
    """
    conditions = coverage.conditions
    yield CONDITIONS, conditions.both_ways(), len(reached().conditions), lacking(conditions)
    for name, table in coverage.tables().items():
        never = [thing for thing, count in table.items() if not count]
        yield name, len(table) - len(never), len(table), never


def _wrapped(start: str, texts: Sequence[str]) -> list[str]:
    """The texts, separated by commas, in lines of at most 80 characters."""
    whole = ", ".join(text.replace(" ", "\N{NO-BREAK SPACE}") for text in texts)
    lines = textwrap.wrap(
        whole, 80, initial_indent=start, subsequent_indent=" " * len(start), break_on_hyphens=False
    )
    return [line.replace("\N{NO-BREAK SPACE}", " ") for line in lines]
