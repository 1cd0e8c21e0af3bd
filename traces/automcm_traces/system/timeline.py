"""A station's states over time, as its log tells them: what the system properties are judged on.

What is known of the station after each input is a ``Moment``.  A ``Timeline`` ends
where the log does, or where the engine cannot follow it any more.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Literal

from automcm_spec.vocabulary.messages import Fields, to_dict
from automcm_spec.vocabulary.station import Input
from automcm_traces.checker.finding import cannot_tell
from automcm_traces.checker.follow import Ending, Follower, Watcher, follow
from automcm_traces.checker.track import Entry, Step, Track
from automcm_traces.format.log import Event, ForgetTimer, Receive, Timer, TimerArm, TimerEnd
from automcm_traces.format.reader import Log, LogStream

Session = tuple[int, int]
Ended = Literal["clean", "stopped", "diverges", "cannot_tell"]


@dataclass(frozen=True, slots=True)
class Moment:
    """A station after an input.  ``at`` is the place of the input among the log's events."""

    at: int
    line: int
    t_ms: int
    phase: str = "STANDALONE"
    role: str = "none"
    session: Session | None = None
    target: int = 0
    proposal: int = 0
    cause: str = ""
    """``restart``, ``command abort``, ``expire cam``, ``receive Fin``, …"""
    rule: str = ""
    src: int = 0
    """Who sent the message received, and of which session it is."""
    about: Session | None = None
    acked: tuple[tuple[int, str], ...] = ()
    """What an Ack took from the outbox: the addressee, and the message's key (``key_of``)."""
    own: object = None
    """All of the state that belongs to the own session (S-7)."""
    late_ms: int = 0
    """How long after its deadline the timer expired."""
    forgot: int = 0
    """The prescriber that a forget timer was about, and whether something for a session of it is
    still being sent then (T-5)."""
    left: bool = False

    @property
    def shape(self) -> tuple[str, str, Session | None, int, int]:
        """What of a state the properties look at."""
        return self.phase, self.role, self.session, self.target, self.proposal


@dataclass(frozen=True, slots=True)
class Spell:
    """A time in which phase, role, session, target and proposal stay; ``end`` is the moment at
    which that is over, None if the timeline ends first."""

    station: int
    start: Moment
    end: Moment | None

    @property
    def session(self) -> Session | None:
        """The session that it is about."""
        return self.start.session


@dataclass(slots=True)
class Timeline:
    """The moments of a station, in order."""

    station: int
    file: str
    moments: list[Moment] = field(default_factory=list)
    ending: Ended = "clean"
    why: str = ""
    """Why it ends, in words."""
    last: tuple[int, int, int] = (0, 0, 0)
    """Event, line and time up to which the station is known."""

    def where(self, m: Moment) -> str:
        """``FILE:LINE`` of a moment."""
        return f"{self.file}:{m.line}"

    def spells(self, phase: str, role: str) -> Iterator[Spell]:
        """Each time the station is in a phase of a role, as one session, target and proposal."""
        start: Moment | None = None
        for m in self.moments:
            if start is not None and m.shape != start.shape:
                yield Spell(self.station, start, m)
                start = None
            if start is None and (m.phase, m.role) == (phase, role):
                start = m
        if start is not None:
            yield Spell(self.station, start, None)

    def sessions(self) -> Iterator[Spell]:
        """Each time the station is bound, from joining or opening a session to leaving it."""
        start: Moment | None = None
        for m in self.moments:
            if start is not None and m.session != start.session:
                yield Spell(self.station, start, m)
                start = None
            if start is None and m.session is not None:
                start = m
        if start is not None:
            yield Spell(self.station, start, None)


def session_of(message: Fields) -> Session | None:
    """The session that a message names, if it names one."""
    match message.get("session"):
        case [int(prescriber), int(number)]:
            return prescriber, number
    return None


def key_of(message: Fields) -> str:
    """What a reliable message is, of its sender: addressee, session, type and seq."""
    m = message
    return f"{m['type']} seq={m['seq']} session={m['session']} to {m['dst']}"


def timeline(log: Log) -> Timeline:
    """The station's timeline; it ends early where the engine cannot follow the log."""
    recorder = Recorder(log)
    follow(log, watchers=[recorder])
    return recorder.made


class Recorder(Watcher):
    """Makes the timeline of a log while it is followed."""

    def __init__(self, log: Log | LogStream) -> None:
        self.made = Timeline(log.header.station, log.file)
        self._places: dict[int, int] = {}
        """Of the events, by line."""
        self._t_ms = 0
        self._outbox: list[Entry] = []
        self._deadlines: dict[Timer, int] = {}

    def event(self, line: int, event: Event, engine: Follower) -> None:
        """Keep the deadlines of armed timers, to see how late one expires."""
        self._places[line] = len(self._places)
        self._t_ms = event.t_ms
        if isinstance(event, TimerArm):
            self._deadlines[event.timer] = event.deadline

    def step(self, step: Step, track: Track) -> None:
        """One more moment."""
        t = track
        kept = {id(e) for e in t.outbox}
        gone = [e for e in self._outbox if id(e) not in kept]
        self._outbox = list(t.outbox)
        event = step.event
        src, about = 0, None
        if isinstance(event, Receive) and event.message is not None:
            sender = event.message.get("src")
            src, about = sender if isinstance(sender, int) else 0, session_of(event.message)
        cause = cause_of(step.input)
        acked = [(e.to, key_of(to_dict(e.message))) for e in gone] if cause == "receive Ack" else []
        late = forgot = 0
        if isinstance(event, TimerEnd):
            if isinstance(event.timer, ForgetTimer):
                forgot = event.timer.station or 0
            late = event.t_ms - self._deadlines.get(event.timer, event.t_ms)
        self.made.moments.append(
            Moment(
                self._places[step.at],
                step.at,
                step.t_ms,
                t.state.phase,
                t.state.role,
                t.session,
                t.state.target,
                t.state.proposal,
                cause,
                step.rule,
                src,
                about,
                tuple(acked),
                _own(t),
                late,
                forgot,
                any(e.session[0] == forgot for e in t.outbox),
            )
        )

    def ended(self, ending: Ending) -> None:
        """Why there are no more moments."""
        made, problem, line = self.made, ending.finding, ending.line
        if ending.lacking or ending.lost:
            missing = f"it does not promise to hold all of: {', '.join(ending.lacking)}"
            why = missing if ending.lacking else f"it lost {ending.lost} records"
            problem, line = cannot_tell(made.file, 0, why), 0
            made.moments.clear()
        if problem.kind == "cannot_tell":
            made.ending, made.why = "cannot_tell", f"{made.file}:{line}: {problem.observed}"
        elif ending.diverges is not None:
            made.ending, made.why = "diverges", f"{made.file}:{problem.at.line} diverges"
        else:
            made.last = (max(len(self._places) - 1, 0), line, self._t_ms)
            if ending.crashed:
                made.ending, made.why = "stopped", f"its log stops at {made.file}:{line}"
            else:
                made.why = f"its log ends at {made.file}:{line}"
            return
        known = made.moments[-1] if made.moments else Moment(0, 0, 0)
        made.last = (known.at, known.line, known.t_ms)


def cause_of(i: Input) -> str:
    """An input in two words."""
    match i.kind:
        case "command":
            return f"command {i.name}"
        case "expire":
            return f"expire {i.timer[0]}"
        case "receive":
            return f"receive {i.message.type}"
        case "cam":
            return "receive CAM"
    return i.kind


def _own(t: Track) -> tuple[object, ...]:
    st, entries = t.state, sorted((e.type, e.to, e.k) for e in t.outbox if e.session == t.session)
    recorded = (tuple(sorted(st.recorded)), tuple(sorted(st.withdrawn)))
    own = (
        st.phase,
        st.role,
        t.session,
        st.target,
        st.proposal,
        st.deciding,
        t.heard_ms is not None,
    )
    return own, recorded, tuple(entries)
