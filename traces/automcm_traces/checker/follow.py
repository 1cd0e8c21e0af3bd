"""Checks a log against the specification in one pass, up to its end or the first divergence.

Everything that needs the steps of a log watches this pass: verdict, timeline, page, coverage.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from itertools import chain, islice
from typing import TypeAlias

from automcm_spec.support.bad_input import BadInput
from automcm_traces.checker.engine import Engine
from automcm_traces.checker.finding import NOTHING_WRONG, Diverges, Finding, cannot_tell, unreadable
from automcm_traces.checker.log_start import MID_SESSION, LogStart
from automcm_traces.checker.possible_states import Possible
from automcm_traces.checker.track import CannotTell, Step, Track
from automcm_traces.format.log import Event
from automcm_traces.format.reader import Log, LogStream

NEEDED = ("command", "receive", "restart", "send", "timer")
"""The event kinds that a log must promise for the state of its station to be known."""
Follower: TypeAlias = Engine | Possible
RECENT = 8
"""The number of recent events kept."""
AFTER = 200
"""The number of events kept after a divergence."""


@dataclass(slots=True)
class Ending:
    """Where and how the check of a log ended."""

    unpromised: tuple[str, ...]
    """The kinds of ``NEEDED`` that the log does not promise; if there are any, no step is
    certain."""
    finding: Finding = NOTHING_WRONG
    diverges: Diverges | None = None
    decided: bool = False
    """Whether the check reached the end of the log or a divergence."""
    engine: Follower | None = None
    events: int = 0
    recent: deque[tuple[int, Event]] = field(default_factory=lambda: deque(maxlen=RECENT))
    """The last events, with their lines."""
    after: list[tuple[int, Event]] = field(default_factory=list)
    """The first ``AFTER`` events after a divergence, with their lines."""
    end: bool = False
    """Whether the log has an end record."""
    crashed: bool = False
    """Whether the end record is missing or reports a crash."""
    lost: int = 0
    """The number of records that the log reports as lost."""
    judged_from: int = 0
    """The line of the first event that was judged, in a log that begins in mid-session; else 0."""

    @property
    def line(self) -> int:
        """The line of the last event; 0 if there is none."""
        return self.recent[-1][0] if self.recent else 0


class Watcher:
    """Watches the check of a log. It gets steps only from logs that promise all of ``NEEDED``."""

    def event(self, line: int, event: Event, engine: Follower) -> None:
        """Called after each event."""

    def step(self, step: Step, track: Track) -> None:
        """Called after each complete step."""

    def ended(self, ending: Ending) -> None:
        """Called at the end."""


def follow(
    log: Log | LogStream,
    late_ms: int | None = None,
    watchers: Sequence[Watcher] = (),
    *,
    events: Iterable[tuple[int, Event]] | None = None,
    one: bool = False,
) -> Ending:
    """Check a log. Of a LogStream, only the last events are kept in memory.

    ``late_ms`` is as for ``Engine``. ``events`` replaces the events of the log. With ``one``, a
    single state is tracked even if the log does not promise all of ``NEEDED``.
    """
    ending = Ending(tuple(kind for kind in NEEDED if kind not in log.header.complete))

    def after(step: Step, track: Track) -> None:
        for watcher in watchers:
            watcher.step(step, track)

    events = iter(log if events is None else events)
    try:
        engine: Follower
        if one or not ending.unpromised:
            engine = Engine(log.header, late_ms)
            engine.observer = after
        else:
            engine = Possible(log.header, late_ms)
        ending.engine = engine
        start = LogStart(log.header, late_ms)
        events = _judged(log, start, events, ending, engine)
        for at, event in events:
            ending.events += 1
            ending.recent.append((at, event))
            if ending.judged_from and start.is_left_over(event, engine.timers):
                continue
            engine.feed(at, event)
            for watcher in watchers:
                watcher.event(at, event, engine)
        if isinstance(log, LogStream) and log.gap is not None:
            line, missing = log.gap
            text = f"records are missing before this line: {missing}"
            ending.finding = cannot_tell(log.file, line, text)
        elif log.ended:
            engine.finish()
        elif isinstance(engine, Engine):
            with suppress(Diverges, CannotTell):  # effects of the last input may be missing
                engine.finish()
        if ending.judged_from and ending.finding.kind == "nothing":
            text = f"{MID_SESSION}; it is allowed from line {ending.judged_from} on"
            ending.finding = cannot_tell(log.file, ending.judged_from, text)
        ending.decided = ending.finding.kind == "nothing"
    except Diverges as d:
        ending.diverges, ending.decided = d, True
        ending.finding = replace(
            d.finding,
            at=d.finding.at._replace(file=log.file),
            observed=d.finding.observed + _late(*ending.recent[-1]),
        )
    except CannotTell as error:
        ending.finding = cannot_tell(log.file, ending.line or 1, str(error))
    except BadInput as error:
        ending.finding = unreadable(error)
    ending.after = _read_to_the_end(log, events)
    ending.end = log.end is not None
    ending.crashed = log.end is None or log.end.reason == "crash"
    ending.lost = 0 if log.end is None else log.end.lost_records
    if ending.lost and ending.finding.kind not in ("cannot_tell", "unreadable"):
        but = f"; apart from that: {ending.finding.observed}" if ending.diverges else ""
        text = f"the log lost {ending.lost} records{but}"
        where = ending.finding.at._replace(file=log.file)
        ending.finding = replace(ending.finding, kind="cannot_tell", at=where, observed=text)
    for watcher in watchers:
        watcher.ended(ending)
    return ending


def _judged(
    log: Log | LogStream,
    start: LogStart,
    events: Iterator[tuple[int, Event]],
    ending: Ending,
    engine: Follower,
) -> Iterator[tuple[int, Event]]:
    """The events that can be judged: all, unless the log begins in mid-session.

    Raises CannotTell if there are none.
    """
    for at, event in events:
        if not log.mid_session:
            return chain([(at, event)], events)
        if start.known_before(event):
            ending.judged_from, engine.since_ms = at, start.since_ms or 0
            return chain([(at, event)], events)
    if log.mid_session:
        raise CannotTell(f"{MID_SESSION}, and at no event the state of the station is known")
    return events


def _late(line: int, event: Event) -> str:
    ms = event.late_ms
    return f"; the station reports that it was {ms} ms late (late_ms, line {line})" if ms else ""


def _read_to_the_end(
    log: Log | LogStream, events: Iterator[tuple[int, Event]]
) -> list[tuple[int, Event]]:
    """The first ``AFTER`` of the remaining events. Reads all: the end record applies to the whole
    log."""
    kept: list[tuple[int, Event]] = []
    with suppress(BadInput):  # already reported, or after the divergence
        kept.extend(islice(events, AFTER))
        if isinstance(log, LogStream):
            for _ in events:
                pass
            for _ in log if log.gap is not None else ():
                pass
    return kept
