"""Follows a log that does not hold everything: every station of the specification it allows.

What a log does not promise to hold (``complete``) may have happened without being in it.  So
before each event every input of such a kind is supposed that changes the station, or that would
explain the event, again and again; what cannot take the event then is dropped.  If nothing is
left, the log diverges, whatever happened unseen.  What a station sends must be in the log: it is
what the protocol judges, and what pins the unseen inputs down.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from automcm_spec.oracle import Answer, Oracle, canonical
from automcm_traces.asking import frozen, state_place
from automcm_traces.engine import NOTHING, Engine
from automcm_traces.form import well_formed
from automcm_traces.graph_engine import GraphEngine
from automcm_traces.graph_inputs import other
from automcm_traces.graph_view import STRANGER, View, Y, real_timer
from automcm_traces.inputs import Asked
from automcm_traces.log import (
    ApplicationCommand,
    ApplicationIndication,
    Event,
    Header,
    Receive,
    Send,
    TimerArm,
    TimerEnd,
)
from automcm_traces.reader import Log
from automcm_traces.step import Deadline, Diverges
from automcm_traces.timers import named, timer_key
from automcm_traces.track import NUMBERED, CannotTell, Track

Json = Any
CHAIN = 8
"""Inputs in a row that may be unseen before one event."""
MOST = 300
"""Stations that are followed at once; beyond, nothing is concluded from there being none."""
_KINDS = {
    "receive": "receive",
    "cam": "receive",
    "command": "command",
    "expire": "timer",
    "restart": "restart",
}


class Possible:
    """Every station that the log so far allows; as Engine, for logs that promise less."""

    def __init__(self, log: Log | Header, late_ms: int | None = None) -> None:
        first = GraphEngine(log, late_ms)
        if "send" not in first.promised:
            raise CannotTell("the log does not promise to hold all that the station sends")
        self._unseen = set(_KINDS.values()) - first.promised
        self._engines: list[Engine] = [first]
        self._given_up = ""

    @property
    def states(self) -> int:
        """How many different stations are possible now."""
        return len({engine.track.key() for engine in self._engines})

    @property
    def track(self) -> Track:
        """The one that needs the fewest unseen inputs."""
        return self._engines[0].track

    def feed(self, at: int, event: Event) -> None:
        """The next event.  Raises as Engine.feed does; Diverges only if nothing can be unseen
        that would explain it."""
        taken: dict[Json, Engine] = {}
        refused: list[Diverges] = []
        seen = {_key(engine) for engine in self._engines}
        layer = self._engines
        for depth in range(CHAIN + 1):
            further: list[Engine] = []
            for engine in layer:
                took = self._took(engine, at, event, refused)
                if took is not None:
                    _merge(taken, took)
                if took is not None and _is_cam(event):
                    continue  # what is unseen may as well come later
                for quiet in self._unseen_inputs(engine, at, event):
                    if (key := _key(quiet)) not in seen:
                        seen.add(key)
                        further.append(quiet)
            layer = further
            if not layer:
                break
            if len(seen) > MOST or depth == CHAIN:
                self._given_up = "too much of what happened is not in the log"
                break
        if not taken:
            if self._given_up:
                raise CannotTell(self._given_up)
            raise _nearest(refused)
        self._engines = list(taken.values())

    def finish(self) -> None:
        """No more effects of the last input."""
        refused: list[Diverges] = []
        left = []
        for engine in self._engines:
            try:
                engine.finish()
            except Diverges as d:
                refused.append(d)
            else:
                left.append(engine)
        if not left:
            raise CannotTell(self._given_up) if self._given_up else refused[0]
        self._engines = left

    def _took(
        self, engine: Engine, at: int, event: Event, refused: list[Diverges]
    ) -> Engine | None:
        """The engine after the event; None if it cannot be."""
        copy = engine.copy()
        try:
            copy.feed(at, event)
        except Diverges as d:
            refused.append(d)
            return None
        except CannotTell as error:
            self._given_up = str(error)
            return None
        return copy

    def _unseen_inputs(self, engine: Engine, at: int, event: Event) -> Iterator[Engine]:
        """What the station may have become by one input that is not in the log."""
        base = engine.copy()
        try:
            base.finish()
        except Diverges:
            return  # what must follow first has not come yet
        whole_timers = "timer" in base.promised
        for view in _views(base.track, event):
            try:
                graph, place = state_place(view)
            except CannotTell as error:
                self._given_up = str(error)
                continue
            for answer in _answers(graph, place, view, event):
                value = frozen(graph.inputs[answer.input])
                if _KINDS[value[0]] not in self._unseen:
                    continue
                if value[0] == "cam" and not (isinstance(event, TimerArm) and whole_timers):
                    continue  # its timer is taken to last for ever then
                quiet = base.copy()
                view_ = view.on(quiet.track)
                timer = ""
                if value[0] == "expire":
                    timer = _due(quiet, view_, value[1], event.t_ms)
                    if not timer:
                        continue
                given = _given(view_, value)
                if given is None:
                    continue
                asked = Asked(value, _words(value), given, view=view_)
                try:
                    quiet.suppose(asked, at, event.t_ms, timer)
                except (CannotTell, Diverges):
                    continue
                yield quiet


def _key(engine: Engine) -> Json:
    """What tells one possible station from another."""
    timers = tuple(sorted((k, d.first, d.last or 0) for k, d in engine.timers.items()))
    return _kind(engine), timers, engine.since_ms


def _kind(engine: Engine) -> Json:
    """The same but for times."""
    step = engine.step
    calls: Json = None
    if step is not None:
        assert step.found is not None
        about = tuple(step.found.view.ids), step.found.view.event_session
        left = tuple(engine.outstanding()), tuple(step.told), len(step.sent)
        calls = step.input, about, left, len(step.arm), (step.given or {}).get("proposal")
    return engine.track.key(), tuple(sorted(engine.timers)), calls, engine.odd


def _merge(engines: dict[Json, Engine], engine: Engine) -> None:
    """Of two that differ in their times only, one remains that may be either."""
    other = engines.setdefault(_kind(engine), engine)
    if other is engine:
        return
    other.since_ms = min(other.since_ms, engine.since_ms)
    for key, a in other.timers.items():
        b = engine.timers[key]
        last = None if a.last is None or b.last is None else max(a.last, b.last)
        other.timers[key] = Deadline(min(a.first, b.first), last)
    if other.step is not None and engine.step is not None:
        other.step.since_ms = min(other.step.since_ms, engine.step.since_ms)


def _nearest(refused: list[Diverges]) -> Diverges:
    """Why an event cannot be: the state that needs the fewest unseen inputs says so, unless it
    calls for nothing more and another one calls for that message in another form."""
    first = refused[0]
    if first.off or list(first.wanted) not in ([], [NOTHING]):
        return first
    close = [d for d in refused if d.off and d.at == first.at]
    return min(close, key=lambda d: d.off, default=first)


def _is_cam(event: Event) -> bool:
    return (
        isinstance(event, Send | Receive)
        and event.message is not None
        and event.message["type"] == "CAM"
    )


def _about(event: Event) -> tuple[set[int], set[tuple[int, int]], int]:
    """The stations and sessions that an event names, and the proposal."""
    stations: set[int] = set()
    sessions: set[tuple[int, int]] = set()
    fields: dict[str, Json] = {}
    match event:
        case Send(message=m) | Receive(message=dict(m)) if well_formed(m):
            fields = m
        case TimerArm(timer=timer) | TimerEnd(timer=timer):
            told = timer.model_dump(exclude_none=True)
            fields = told.get("message", {})
            stations |= {told["station"]} if "station" in told else set()
        case ApplicationCommand(command=given):
            fields = given.model_extra or {}
    for name in ("src", "dst", "to", "target"):
        if isinstance(fields.get(name), int):
            stations.add(fields[name])
    session = fields.get("session")
    if isinstance(session, list) and len(session) == 2:
        sessions.add((session[0], session[1]))
        stations.add(session[0])
    proposal = fields.get("proposal", 0)
    return stations, sessions, proposal if isinstance(proposal, int) else 0


def _views(t: Track, event: Event) -> list[View]:
    """The parts of the station that something unseen may be about."""
    stations, named, proposal = _about(event)
    stations |= {t.peer, *t.recorded, *t.joined, *(e.to for e in t.outbox)}
    proposals = {proposal} | ({t.proposal - 1} if t.proposal > 1 else set())
    views = []
    for y in sorted(stations - {0, t.me}) or [0]:
        sessions = {s for s in named if s[0] in (y, t.me)}
        sessions |= {e.session for e in t.outbox if e.to == y}
        sessions |= {t.session} if t.session else set()
        about: list[tuple[int, int] | None] = [*sorted(sessions)] or [None]
        views += [
            View(t, y, other(t, y), session, k) for session in about for k in sorted(proposals)
        ]
    return views


def _answers(graph: Oracle, place: int, view: View, event: Event) -> Iterator[Answer]:
    """What an unseen input may be: one that changes the station, or explains the event."""
    yield from graph.changes(place)
    match event:
        case Send(message=m) if m["type"] != "CAM":
            of = m.get("of")
            acked = of.get("type") if isinstance(of, dict) else "none"
            for answer in _refusals(graph, place):
                if any(x[0] == m["type"] and x[8][0] == acked for x in answer.effect.messages):
                    yield answer
        case ApplicationIndication(indication=told) if told.name != "discarded":
            for answer in _refusals(graph, place):
                if answer.effect.told[0] == told.name:
                    yield answer


_kept: dict[tuple[str, int], list[Answer]] = {}


def _refusals(graph: Oracle, place: int) -> list[Answer]:
    """The inputs that change nothing and are answered."""
    key = graph.name, place
    if key not in _kept:
        _kept[key] = [
            answer
            for answer in graph.answers(place)
            if not answer.changes and (answer.effect.messages or answer.effect.told[0] != "nothing")
        ]
    return _kept[key]


def _due(engine: Engine, view: View, timer: Json, until_ms: int) -> str:
    """The key of an armed timer that may have expired by ``until_ms``; empty if there is none."""
    real = real_timer(view, timer)
    advertises = len(timer) > 1 and timer[0] == "resend" and timer[1][0] == "Advertisement"
    if real is None or (advertises and engine.track.advertisement is None):
        return ""
    key = timer_key(named(engine.track, [], real))
    deadline = engine.timers.get(key)
    return key if deadline is not None and deadline.first <= until_ms else ""


def _given(view: View, value: Json) -> dict[str, Json] | None:
    """The message or command behind an unseen input, as far as it is known; None if it cannot be
    expressed."""
    if value[0] == "receive":
        type_, src, dst, session, k, proposal, accepted, _, _ = value[1]
        known = (
            session[0] != STRANGER
            and session[1] in view.numbers.get(view.real_id(session[0]), {}).values()
        )
        if src != Y or dst not in (0, 1) or not known:
            return None
        m = {"type": type_, "src": view.real_id(Y), "session": list(view.real_session(session))}
        m |= {"seq": 0} if not k else {}
        if type_ in NUMBERED:
            m |= {"proposal": _proposal(view, proposal), "accepted": accepted}
        return m
    if value[0] == "command":
        proposal = {"proposal": _proposal(view, value[3])} if value[3] else {}
        return {"name": value[1], **proposal}
    if value[0] == "cam":
        return {"type": "CAM", "generation_ms": view.track.heard_ms or 0}
    return {}


def _proposal(view: View, k: int) -> int:
    """A proposal of the oracle as a real one."""
    current = view.track.proposal
    return current + k - view.proposals(current) if current else k


def _words(value: Json) -> str:
    if value[0] == "receive":
        return f"receive {value[1][0]}"
    name = value[1][0] if value[0] == "expire" else value[1] if len(value) > 1 else ""
    return f"{value[0]} {name}".strip() if isinstance(name, str) else canonical(value)
