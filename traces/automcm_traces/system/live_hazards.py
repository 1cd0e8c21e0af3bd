"""Finds the hazards of a run while its logs are written, in constant memory.

Of each log a window is kept: the events of the last seconds, and those of the present session
without CAMs. The windows are judged as ``properties`` judges complete logs.
"""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import replace
from itertools import zip_longest
from math import inf

from automcm_spec.vocabulary.parameters import DEFAULTS, MOST_OF
from automcm_traces.checker.follow import NEEDED, Ending, Follower
from automcm_traces.checker.track import Step, Track
from automcm_traces.format.log import Event, Receive, Send, TimerArm, TimerEnd
from automcm_traces.format.reader import Log, LogStream
from automcm_traces.system.hazards import CannotJudge, Hazard, hazard
from automcm_traces.system.log_merge import MergeError
from automcm_traces.system.timeline import Moment, Period, Recorder, Session, Timeline
from automcm_traces.system.world import World

SILENT_MS = MOST_OF["t_cam"]
"""The longest legal CAM interval in ms. A station that sends nothing for longer has stopped."""
MOST = 2000
"""The maximum number of events kept of the present session, besides those of the last seconds."""
AGAIN_MS = 100
"""How often a hazard that is not over is judged again."""
Key = tuple[Session, int, int]
"""A hazard: session, prescriber, target."""


class Window(Recorder):
    """The recent events of one log, and the timeline of its station."""

    def __init__(self, log: LogStream) -> None:
        super().__init__(log)
        self.log = log
        self.events: list[tuple[int, Event]] = []
        self.over = False
        """Whether the check of the log has ended."""
        self.first_ms: int | None = None
        """The time of the first kept event, if earlier ones have been dropped."""
        self._known = 0, 0, 0
        """Index, line and time of the last completed step."""
        p = log.header.known
        lasts = (p.get(name, DEFAULTS[name]) for name in ("t_cam_loss", "t_timeout"))
        self._kept_ms = 2 * max(lasts)
        missing = [kind for kind in NEEDED if kind not in log.header.complete]
        if missing:
            self.made.ending, self.made.why = "cannot_tell", f"it lacks {', '.join(missing)}"

    @property
    def now(self) -> Moment:
        """The present state of the station, as far as it is known."""
        return self.made.moments[-1] if self.made.moments else Moment(0, 0, 0)

    @property
    def t_ms(self) -> int:
        """The time of the last event."""
        return self._t_ms

    def event(self, line: int, event: Event, engine: Follower) -> None:
        """Keep the event."""
        super().event(line, event, engine)
        self._places[line] = len(self.events)
        self.events.append((line, event))

    def step(self, step: Step, track: Track) -> None:
        """Add a moment."""
        self._places.setdefault(step.at, 0)  # its event may have been dropped
        super().step(step, track)
        self._known = self.now.at, self.now.line, self.now.t_ms

    def ended(self, ending: Ending) -> None:
        """Record why the timeline ends."""
        super().ended(ending)
        self.over = True
        if self.made.ending in ("clean", "stopped"):
            self.made.last = max(len(self.events) - 1, 0), *self.made.last[1:]

    def as_log(self) -> Log:
        """The kept events as a log without an end."""
        return Log(self.log.file, self.log.header, self.events, None, False, [])

    def timeline(self, silent: bool) -> Timeline:
        """The timeline so far. ``silent``: the station is taken to have stopped."""
        made = self.made
        if self.over or made.ending == "cannot_tell":
            return made
        if not silent:
            at, reached, t_ms = self._known
            acts = (self.now.phase, self.now.role) == ("ACTUATING", "prescriber")
            last = at, reached, t_ms - (not acts)  # more events of the same ms may come
            return replace(made, why=f"its log has reached line {reached}", last=last)
        line = self.events[-1][0]
        why = f"its log stops at {made.file}:{line}"
        last = len(self.events) - 1, line, self._t_ms
        return replace(made, ending="stopped", why=why, last=last)

    def trim(self) -> None:
        """Drop what no later hazard needs."""
        horizon = self._t_ms - self._kept_ms
        recent = bisect_left(self.events, horizon, key=lambda entry: entry[1].t_ms)
        if recent < max(len(self.events) // 2, 1):
            return
        moments = self.made.moments
        begun: float = inf
        if self.now.session is not None:
            begun = next(m.line for m in moments if m.session == self.now.session)
        old = [(line, e) for line, e in self.events[:recent] if line >= begun and not _of_cam(e)]
        self.events = [*old[-MOST:], *self.events[recent:]]
        self.first_ms = self.events[0][1].t_ms
        self._places = {line: k for k, (line, _) in enumerate(self.events)}
        lines = [line for line, _ in self.events]
        kept: list[Moment] = []
        for m, after in zip_longest(moments, moments[1:]):
            if m.t_ms < horizon and after is not None:
                if after.t_ms < horizon and after.line <= begun:
                    continue  # neither recent nor the state before the present session
                if kept and m.shape == kept[-1].shape:
                    continue
            kept.append(replace(m, at=min(bisect_left(lines, m.line), max(len(lines) - 1, 0))))
        self.made.moments = kept[-MOST:]
        self._deadlines = {timer: t for timer, t in self._deadlines.items() if t >= horizon}
        self._known = bisect_left(lines, self._known[1]), *self._known[1:]


def _of_cam(event: Event) -> bool:
    """Whether an event is a CAM, or the timer that a CAM re-arms."""
    match event:
        case Send(message=m) | Receive(message=m):
            return m is None or m.get("type") == "CAM"
        case TimerArm(timer=timer) | TimerEnd(timer=timer, op="stop"):
            return timer.name == "cam"
    return False


def violates(one: Hazard) -> bool:
    """Whether a hazard violates S-5 or T-2."""
    return not one.excused or one.outcome == "exceeds"


class LiveHazards:
    """The hazards between stations whose logs are being written."""

    def __init__(self) -> None:
        self.problem = ""
        """Why the logs cannot be judged together."""
        self._windows: dict[int, Window] = {}
        self._open: dict[Key, Hazard] = {}
        """The reported hazards that may change: not over, or only because a log fell silent."""
        self._violated = False
        self._settled: dict[Key, None] = {}
        """The last periods that are over and judged."""
        self._world: World | None = None
        self._last: object = None

    def add(self, window: Window) -> None:
        """Add a log. Of two logs of one station, the later replaces the earlier."""
        self._windows[window.made.station] = window
        self._world = None

    def remove(self, window: Window) -> None:
        """Leave out a log from now on."""
        if self._windows.get(window.made.station) is window:
            del self._windows[window.made.station]
            self._world = None

    @property
    def violated(self) -> bool:
        """Whether a hazard has no excuse (S-5) or exceeds its bound (T-2)."""
        return self._violated or any(map(violates, self._open.values()))

    @property
    def silent(self) -> frozenset[int]:
        """The stations whose logs have had no event for longer than SILENT_MS, by another log."""
        return frozenset(s for s in self._windows if self._world and self._is_silent(s))

    def found(self) -> tuple[list[Hazard], list[Hazard]]:
        """The hazards that have begun, ended or exceeded their bound since the last call; and those
        withdrawn, because the log of a station that seemed to have stopped goes on."""
        new: list[Hazard] = []
        withdrawn: list[Hazard] = []
        silent = self.silent
        time = max(w.t_ms for w in self._windows.values()) // AGAIN_MS if self._open else 0
        state = [(s, w.now.shape, w.over) for s, w in self._windows.items()], silent, time
        if len(self._windows) > 1 and (state != self._last or self._undecided()):
            self._last = state
            for key, one in self._judged(silent):
                before = self._open.pop(key, None)
                if one is None:
                    withdrawn += [before] if before else []
                    continue
                if key not in self._settled:
                    self._open[key] = one
                self._violated = self._violated or (key in self._settled and violates(one))
                if before is None or (one.open, one.outcome) != (before.open, before.outcome):
                    new.append(one)
        for window in self._windows.values():
            window.trim()
        return new, withdrawn

    def _judged(self, silent: frozenset[int]) -> Iterator[tuple[Key, Hazard | None]]:
        """The hazard, or None, in each period that can be judged and has not been settled."""
        windows = self._windows.values()
        lines = {w.log.file: w.timeline(w.made.station in silent) for w in windows}
        try:
            world = self._world = World([w.as_log() for w in windows], lines)
        except MergeError as error:
            self.problem = str(error)
            return
        for line in world.timelines.values():
            for acts in line.periods("ACTUATING", "prescriber"):
                assert acts.session is not None, "a station that acts is bound"
                key = acts.session, acts.station, acts.start.target
                if key in self._settled or self._dropped(world, acts):
                    continue
                with suppress(CannotJudge):
                    found = hazard(world, acts)
                    if acts.end is not None and (found is None or acts.start.target not in silent):
                        self._settled[key] = None
                    yield key, found
        while len(self._settled) > MOST:
            del self._settled[next(iter(self._settled))]

    def _dropped(self, world: World, acts: Period) -> bool:
        """Whether the events of the target that decide about a period may have been dropped."""
        target = self._windows.get(acts.start.target)
        if target is None or world.committed(
            target.made.station, acts.session, acts.start.proposal
        ):
            return False
        first = target.first_ms
        gap = world.elapsed(acts.station, acts.start.t_ms, target.made.station, first or 0)
        return first is not None and (gap is None or gap.high > 0)

    def _undecided(self) -> bool:
        """Whether a prescriber acts without a committed target, and no hazard is reported."""
        for station, window in self._windows.items():
            m = window.now
            if (m.phase, m.role) != ("ACTUATING", "prescriber") or m.target not in self._windows:
                continue
            other = self._windows[m.target].now
            committed = (other.phase, other.session) == ("ACTUATING", m.session)
            if not committed and m.session and (m.session, station, m.target) not in self._open:
                return True
        return False

    def _is_silent(self, station: int) -> bool:
        world, own = self._world, self._windows[station]
        if world is None or own.over or not own.events:
            return False
        gaps = (world.elapsed(station, own.t_ms, s, w.t_ms) for s, w in self._windows.items())
        return any(gap is not None and gap.low > SILENT_MS for gap in gaps)
