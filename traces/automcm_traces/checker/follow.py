"""Checks a log against the specification in one pass, up to its end or the first divergence.

Everything that needs the steps of a log watches this pass: verdict, timeline, page, coverage.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import replace
from itertools import islice
from typing import Self, TypeAlias

from automcm_spec.log_format.log import Event
from automcm_spec.log_format.reader import Log, LogStream
from automcm_spec.support.bad_input import BadInput
from automcm_traces.checker.engine import Engine
from automcm_traces.checker.finding import NOTHING_WRONG, Diverges, cannot_tell, unreadable
from automcm_traces.checker.log_start import MID_SESSION, LogStart
from automcm_traces.checker.possible_states import Possible
from automcm_traces.checker.track import CannotTell, InputStep, Track

NEEDED = ("command", "receive", "restart", "send", "timer")
"""The event kinds that a log must promise for the state of its station to be known."""
Follower: TypeAlias = Engine | Possible
RECENT = 8
"""The number of recent events kept."""
AFTER = 200
"""The number of events kept after a divergence."""


class Watcher:
    """Watches the check of a log. It gets steps only from logs that promise all of ``NEEDED``."""

    def event(self, line: int, event: Event, engine: Follower) -> None:
        """Called after each event."""

    def skipped(self) -> None:
        """Called instead of ``event`` where a log in mid-session cannot be judged yet."""

    def step(self, step: InputStep, track: Track) -> None:
        """Called after each complete step."""

    def ended(self, check: Check) -> None:
        """Called at the end."""


class Check:
    """The check of one log: ``feed`` it the events in order, then ``end`` it; or let it ``read``
    all. Of a LogStream, only the last events are kept in memory.

    ``late_ms`` is as for ``Engine``. With ``one``, a single state is tracked even if the log does
    not promise all of ``NEEDED``; where it does not allow an event, the check ends without a
    verdict.
    """

    def __init__(
        self,
        log: Log | LogStream,
        late_ms: int | None = None,
        watchers: Sequence[Watcher] = (),
        *,
        one: bool = False,
    ) -> None:
        self.log, self._watchers, self._one = log, watchers, one
        self._of_events = [w.event for w in watchers if type(w).event is not Watcher.event]
        self._of_steps = [w.step for w in watchers if type(w).step is not Watcher.step]
        self._start = LogStart(log.header, late_ms)
        header = log.header
        self.unpromised = tuple(kind for kind in NEEDED if kind not in header.complete)
        """The kinds of ``NEEDED`` that the log does not promise; if there are any, no step is
        certain."""
        self.finding = NOTHING_WRONG
        self.diverges: Diverges | None = None
        self.decided = False
        """Whether the check reached the end of the log or a divergence."""
        self.engine: Follower | None = None
        self.events = 0
        self.first_ms: int | None = None
        """The time of the first event; None if there is none."""
        self.recent: deque[tuple[int, Event]] = deque(maxlen=RECENT)
        """The last events, with their lines."""
        self.after: list[tuple[int, Event]] = []
        """The first ``AFTER`` events after a divergence, with their lines."""
        self.judged_from = 0
        """The line of the first event that was judged, in a log that begins in mid-session; else
        0."""
        try:
            if one or not self.unpromised:
                engine = Engine(header, late_ms)
                engine.observer = self._step
                self.engine = engine
            else:
                self.engine = Possible(header, late_ms)
        except CannotTell as error:
            self._refused(error)

    @property
    def line(self) -> int:
        """The line of the last event; 0 if there is none."""
        return self.recent[-1][0] if self.recent else 0

    @property
    def lost(self) -> int:
        """The number of records that the log reports as lost."""
        return 0 if self.log.end is None else self.log.end.lost_records

    @property
    def over(self) -> bool:
        """Whether further events change nothing."""
        return self.finding.kind != "nothing"

    def read(self, events: Iterable[tuple[int, Event]] | None = None) -> Self:
        """Feed all events, by default those of the log, and end."""
        left = iter(self.log if events is None else events)
        self.feed_all(left)
        self.after = _read_to_the_end(self.log, left)
        self.end()
        return self

    def feed_all(self, events: Iterable[tuple[int, Event]]) -> None:
        """Check these events, as far as they can be read, unless the check is over before."""
        try:
            for at, event in events:
                self.feed(at, event)
                if self.over:
                    break
        except BadInput as error:
            self.finding = unreadable(error)

    def feed(self, at: int, event: Event) -> None:
        """Check the next event, unless the check is over."""
        engine = self.engine
        if engine is None or self.over:
            return
        if self.first_ms is None:
            self.first_ms = event.t_ms
        if not self.events and self.log.mid_session:
            if not self._start.known_before(event):
                return self._skip()
            self.judged_from, engine.since_ms = at, self._start.since_ms or 0
        self.events += 1
        self.recent.append((at, event))
        if self.judged_from and self._start.is_left_over(event, engine.timers):
            return self._skip()
        try:
            engine.feed(at, event)
        except (Diverges, CannotTell) as error:
            self._refused(error)
            return
        for watch in self._of_events:
            watch(at, event, engine)

    def _skip(self) -> None:
        for watcher in self._watchers:
            watcher.skipped()

    def end(self) -> None:
        """Take note that the log has no further event."""
        if not self.over:
            try:
                self._finish()
            except (Diverges, CannotTell) as error:
                self._refused(error)
        if self.lost and self.finding.kind not in ("cannot_tell", "unreadable"):
            but = f"; apart from that: {self.finding.observed}" if self.diverges else ""
            text = f"the log lost {self.lost} records{but}"
            where = self.finding.at._replace(file=self.log.file)
            self.finding = replace(self.finding, kind="cannot_tell", at=where, observed=text)
        for watcher in self._watchers:
            watcher.ended(self)

    def _finish(self) -> None:
        """Check that no effect is missing at the end."""
        engine, log = self.engine, self.log
        if log.mid_session and not self.judged_from:
            raise CannotTell(f"{MID_SESSION}, and at no event the state of the station is known")
        if isinstance(log, LogStream) and log.gap is not None:
            line, missing = log.gap
            text = f"records are missing before this line: {missing}"
            self.finding = cannot_tell(log.file, line, text)
        elif engine is not None and log.ended:
            engine.finish()
        elif isinstance(engine, Engine):
            with suppress(Diverges, CannotTell):  # effects of the last input may be missing
                engine.finish()
        if self.judged_from and not self.over:
            text = f"{MID_SESSION}; it is allowed from line {self.judged_from} on"
            self.finding = cannot_tell(log.file, self.judged_from, text)
        self.decided = not self.over

    def _step(self, step: InputStep, track: Track) -> None:
        for watch in self._of_steps:
            watch(step, track)

    def _refused(self, error: Diverges | CannotTell) -> None:
        if isinstance(error, CannotTell):
            self.finding = cannot_tell(self.log.file, self.line or 1, str(error))
            return
        at = error.finding.at._replace(file=self.log.file)
        observed = error.finding.observed + _late(*self.recent[-1])
        if self._one and self.unpromised:  # unlogged events may have led there
            lacks = f"the log does not promise {', '.join(self.unpromised)}"
            self.finding = cannot_tell(at.file, at.line, f"{observed}; {lacks}")
            return
        self.diverges, self.decided = error, True
        self.finding = replace(error.finding, at=at, observed=observed)


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
