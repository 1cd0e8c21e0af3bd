"""A station's states over time, according to its log: the basis of the system properties.

A ``Moment`` is the station after an input. A ``Timeline`` ends where the log ends, or where its
check ends early.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import Literal

from automcm_spec.log_format.event_text import plain
from automcm_spec.log_format.log import (
    Event,
    ForgetTimer,
    Receive,
    Timer,
    TimerArm,
    TimerEnd,
    source_of,
)
from automcm_spec.log_format.reader import Log, LogStream
from automcm_spec.vocabulary.conditions import EMPTY
from automcm_spec.vocabulary.messages import Fields, session_in, to_dict
from automcm_spec.vocabulary.rules import kind
from automcm_spec.vocabulary.station import State
from automcm_traces.checker.finding import cannot_tell
from automcm_traces.checker.follow import Check, Follower, Watcher
from automcm_traces.checker.track import InputStep, OutboxEntry, Track

Session = tuple[int, int]
EndReason = Literal["clean", "stopped", "diverges", "cannot_tell"]


@dataclass(frozen=True, slots=True)
class Moment:
    """A station after an input. ``at`` is the index of the input in the log's events."""

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
    """The sender of the received message, and the session that the message names."""
    about: Session | None = None
    acked: tuple[tuple[int, str], ...] = ()
    """The messages that an Ack removed from the outbox: addressee and key (``key_of``)."""
    own: State | None = None
    """The part of the state that belongs to the own session (S-7)."""
    late_ms: int = 0
    """The delay of the expiry after its deadline."""
    forgot: int = 0
    """The prescriber of a forget timer, and whether a message of one of its sessions is still being
    sent (T-5)."""
    left: bool = False

    @property
    def shape(self) -> tuple[str, str, Session | None, int, int]:
        """The parts of the state that the properties compare."""
        return self.phase, self.role, self.session, self.target, self.proposal


@dataclass(frozen=True, slots=True)
class Period:
    """A period with constant phase, role, session, target and proposal. ``end`` is the first moment
    after it, None if the timeline ends first."""

    station: int
    start: Moment
    end: Moment | None

    @property
    def session(self) -> Session | None:
        """The session during the period."""
        return self.start.session


@dataclass(slots=True)
class Timeline:
    """The moments of a station, in order."""

    station: int
    file: str
    moments: list[Moment] = field(default_factory=list)
    ending: EndReason = "clean"
    why: str = ""
    """Why it ends, as text."""
    last: tuple[int, int, int] = (0, 0, 0)
    """Event, line and time up to which the state of the station is known."""

    def where(self, m: Moment) -> str:
        """``FILE:LINE`` of a moment."""
        return f"{self.file}:{m.line}"

    def periods(self, phase: str, role: str) -> Iterator[Period]:
        """Each period in which the station is in a phase and role, with one session, target and
        proposal."""
        return self._constant(lambda m: m.shape if (m.phase, m.role) == (phase, role) else None)

    def sessions(self) -> Iterator[Period]:
        """Each period in which the station is in a session."""
        return self._constant(lambda m: m.session)

    def _constant(self, part: Callable[[Moment], object]) -> Iterator[Period]:
        """Each period in which a part of the state has one value that is not None."""
        start: Moment | None = None
        value: object = None
        for m in self.moments:
            if (now := part(m)) != value:
                if start is not None:
                    yield Period(self.station, start, m)
                start, value = m if now is not None else None, now
        if start is not None:
            yield Period(self.station, start, None)


def key_of(message: Fields) -> str:
    """The key of a reliable message at its sender: addressee, session, type and seq."""
    m = message
    return f"{m['type']} seq={m['seq']} session={plain(m.get('session'))} to {m.get('dst')}"


def timeline(log: Log) -> Timeline:
    """The station's timeline, which ends early if the check of the log does."""
    recorder = Recorder(log)
    Check(log, watchers=[recorder]).read()
    return recorder.made


class Recorder(Watcher):
    """Records the timeline of a log while it is checked."""

    def __init__(self, log: Log | LogStream) -> None:
        self.made = Timeline(log.header.station, log.file)
        self._at = -1
        """The index of the last event."""
        self._t_ms = 0
        self._input = 0
        """The index of the last input."""
        self._outbox: list[OutboxEntry] = []
        self._own: State | None = None
        self._deadlines: dict[Timer, int] = {}
        self._known = 0, 0, 0
        """The last step: its event, line and time."""

    def event(self, line: int, event: Event, engine: Follower) -> None:
        """Record the deadlines of armed timers, to measure the delay of an expiry."""
        self._at, self._t_ms = self._at + 1, event.t_ms
        self._input = self._at if event.is_input else self._input
        if isinstance(event, TimerArm):
            self._deadlines[event.timer] = event.deadline

    def skipped(self) -> None:
        """Count an event that is not judged."""
        self._at += 1

    def step(self, step: InputStep, track: Track) -> None:
        """Add a moment, unless a CAM has come that changes nothing: most of a log."""
        t, gone = track, list[OutboxEntry]()
        self._known = self._input, step.at, step.t_ms
        if step.input.kind == "cam" and not step.changes:
            return
        if step.moves:
            kept = {id(e) for e in t.outbox}
            gone = [e for e in self._outbox if id(e) not in kept]
            self._outbox, own = list(t.outbox), _own(t.state)
            self._own = self._own if own == self._own else own
        event = step.event
        m = event.message if isinstance(event, Receive) else None
        src, about = source_of(m), None if m is None else session_in(m.get("session"))
        cause = kind(step.input)
        acked = [(e.to, key_of(to_dict(m))) for e, m in gone] if cause == "receive Ack" else []
        late = forgot = 0
        if isinstance(event, TimerEnd):
            if isinstance(event.timer, ForgetTimer):
                forgot = event.timer.station or 0
            late = event.t_ms - self._deadlines.get(event.timer, event.t_ms)
        self.made.moments.append(
            Moment(
                *self._known,
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
                self._own,
                late,
                forgot,
                any(e.spec.session[0] == forgot for e in t.outbox),
            )
        )

    def ended(self, check: Check) -> None:
        """Record why the timeline ends."""
        made, problem, line = self.made, check.finding, check.line
        if check.unpromised or check.lost:
            missing = f"`complete` in its header lacks {', '.join(check.unpromised)}"
            why = missing if check.unpromised else f"it lost {check.lost} records"
            problem, line = cannot_tell(made.file, 1, why), 1
            made.moments.clear()
            self._known = 0, 0, 0
        if problem.kind == "cannot_tell":
            made.ending, made.why = "cannot_tell", f"{made.file}:{line}: {problem.observed}"
        elif check.diverges is not None:
            made.ending, made.why = "diverges", f"{made.file}:{problem.at.line} diverges"
        else:
            made.last = (max(self._at, 0), line, self._t_ms)
            end = check.log.end
            if end is None or end.reason == "crash":
                made.ending, made.why = "stopped", f"its log stops at {made.file}:{line}"
            else:
                made.why = f"its log ends at {made.file}:{line}"
            return
        made.last = self._known


def _own(st: State) -> State:
    """The state without what does not belong to the own session."""
    outbox = frozenset(e for e in st.outbox if e.session == st.session)
    return st._replace(number=0, joined=EMPTY, outbox=outbox, quarantine=False, backoff=False)
