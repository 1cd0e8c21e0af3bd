"""Follows a log that does not hold everything: every station of the specification it allows.

What a log does not promise to hold (``complete``) may have happened without being in it.  So
before each event every input of such a kind is supposed that changes the station, or that would
explain the event, again and again; what cannot take the event then is dropped.  If nothing is
left, the log diverges, whatever happened unseen.  What a station sends must be in the log: it is
what the protocol judges, and what pins the unseen inputs down.

An unseen input does not come after a timer that should have expired long before: then the expiry
must be supposed first, with all that it causes.  Only a restart may: what was due is lost (END-8).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import reduce
from math import inf

from automcm_spec.vocabulary.station import Input, Outcome
from automcm_traces.checker.engine import NOTHING, Deadline, Engine
from automcm_traces.checker.finding import Diverges, Late, Supposition
from automcm_traces.checker.input_alphabet import Answer, answers
from automcm_traces.checker.track import NOTHING_TOLD, Asked, CannotTell, Track, named, short
from automcm_traces.format.log import (
    ApplicationIndication,
    Event,
    Header,
    Receive,
    Send,
    TimerArm,
    TimerEnd,
)

CHAIN = 8
"""Inputs in a row that may be unseen before one event."""
MOST = 300
"""Stations that are followed at once; beyond, nothing is concluded from there being none."""
Refused = list[tuple[tuple[float, int], Diverges]]
"""What some station has against an event, with its rank."""
_KINDS = {
    "receive": "receive",
    "cam": "receive",
    "command": "command",
    "expire": "timer",
    "restart": "restart",
}


class _Supposing(Engine):
    """One station that the log allows."""

    supposed: tuple[Supposition, ...] = ()

    def suppose(self, i: Input, at: int, after: int, until_ms: int) -> None:
        """An input that was not observed, after one line and before the event of line ``at``
        at ``until_ms``.  Nothing may be expected any more of the input before it."""
        own = named(self.track, [], i.timer) if i.kind == "expire" else None
        if own is not None:
            self.since_ms = max(self.since_ms, self.timers[own].first)
        if i.kind != "restart":  # what was due before is lost (END-8)
            due = [d.last + self._late_ms for d in self.timers.values() if d.last is not None]
            until_ms = min([until_ms, *due])
        if own is not None:
            del self.timers[own]
        question = Asked(i, f"{_words(i)}, not logged")
        step = self._ask(at, until_ms, None, question)
        step.since_ms, step.unseen = self.since_ms, True
        if i.kind == "restart" or (i.kind == "expire" and step.says[0] == "fallback"):
            what = "restart" if i.kind == "restart" else short(i.timer)
            self.supposed = (*self.supposed, Supposition(what, after, at))


class Possible:
    """Every station that the log so far allows; as Engine, for logs that promise less."""

    def __init__(self, header: Header, late_ms: int | None = None) -> None:
        first = _Supposing(header, late_ms)
        if "send" not in first.promised:
            raise CannotTell("the log does not promise to hold all that the station sends")
        self._promised = first.promised
        self._engines: list[_Supposing] = [first]
        self._after = 1
        """The line of the last event but CAMs: what was not observed happened later."""
        self._given_up = ""

    @property
    def states(self) -> int:
        """How many different stations are possible now."""
        return len({engine.track.key() for engine in self._engines})

    @property
    def track(self) -> Track:
        """The one that needs the fewest unseen inputs."""
        return self._engines[0].track

    @property
    def only_if(self) -> tuple[Supposition, ...]:
        """What each of them supposes to have happened unseen."""
        return reduce(_common, (engine.supposed for engine in self._engines))

    def feed(self, at: int, event: Event) -> None:
        """The next event.  Raises as Engine.feed does; Diverges only if nothing can be unseen
        that would explain it."""
        search = _Search(at, event, self._after, self._promised)
        layer = self._engines
        for _ in range(CHAIN + 1):
            layer = [quiet for engine in layer for quiet in search.goes_on(engine)]
            if not layer or search.number > MOST:
                break
        if layer:
            search.given_up = "too much of what happened is not in the log"
        self._given_up = search.given_up or self._given_up
        if not search.taken:
            raise self._nearest(search.refused)
        self._engines = list(search.taken.values())
        if not _is_cam(event):
            self._after = at

    def finish(self) -> None:
        """No more effects of the last input."""
        refused: Refused = []
        left = []
        for engine in self._engines:
            try:
                engine.finish()
            except Diverges as d:
                refused.append((_rank(d, engine), d))
            else:
                left.append(engine)
        if not left:
            raise self._nearest(refused)
        self._engines = left

    def _nearest(self, refused: Refused) -> Exception:
        """Why no station allows an event, as the one says that explains most."""
        if self._given_up:
            return CannotTell(self._given_up)
        return min(refused, key=lambda r: r[0])[1]


@dataclass
class _Search:
    """For the stations that allow the event of line ``at``."""

    at: int
    event: Event
    after: int
    """What is unseen happened after this line."""
    promised: frozenset[str]
    taken: dict[tuple[object, ...], _Supposing] = field(default_factory=dict)
    """The stations after the event."""
    refused: Refused = field(default_factory=list)
    given_up: str = ""
    """Why there may be more of them than were found."""
    number: int = 0
    """Of the stations before the event."""
    _seen: dict[tuple[object, ...], list[_Supposing]] = field(default_factory=dict)

    def goes_on(self, engine: _Supposing) -> Iterator[_Supposing]:
        """Try the event; then, what the station may have become before by one input that is not in
        the log.  If the log must hold something that follows, that is tried on the event at once.
        """
        takes = self._try(engine.copy())
        if takes and _is_cam(self.event):
            return  # what is unseen may as well come later
        base = engine.copy()
        try:
            base.finish()
        except Diverges:
            return  # what must follow first has not come yet
        self._is_new(base)
        for answer in answers(base.track, self.event):
            shows, loud = _shows(answer, self.event), self._loud(answer.outcome)
            if (loud and not shows) or not (answer.changes or shows):
                continue
            if not self._may_be(answer.input, base):
                continue
            quiet = base.copy()
            quiet.suppose(answer.input, self.at, self.after, self.event.t_ms)
            if not shows:
                quiet.finish()
            if loud:
                self._try(quiet)
            elif self._is_new(quiet):
                yield quiet

    def _try(self, engine: _Supposing) -> bool:
        """Whether the engine allows the event."""
        try:
            engine.feed(self.at, self.event)
        except Diverges as d:
            self.refused.append((_rank(d, engine), d))
        except CannotTell as error:
            self.given_up = str(error)
        else:
            _merge(self.taken, engine)
            return True
        return False

    def _may_be(self, i: Input, engine: Engine) -> bool:
        """Whether an input may be unseen."""
        if _KINDS[i.kind] in self.promised:
            return False
        if i.kind == "cam":  # without timers, its timer is taken to last for ever
            return "timer" in self.promised
        if i.kind != "expire":
            return True
        deadline = engine.timers.get(named(engine.track, [], i.timer))
        return deadline is not None and deadline.first <= self.event.t_ms

    def _loud(self, outcome: Outcome) -> bool:
        """Whether the log promises to hold something of what follows."""
        told = "indication" in self.promised and outcome.told != NOTHING_TOLD
        timer = "timer" in self.promised and (outcome.arm or outcome.stop)
        return bool(outcome.out or told or timer)

    def _is_new(self, engine: _Supposing) -> bool:
        """Whether nothing that was seen may go on as this one may; then it has been seen now."""
        alike = self._seen.setdefault(_kind(engine), [])
        if any(_covers(other, engine) for other in alike):
            return False
        alike.append(engine)
        self.number += 1
        return True


def _kind(engine: Engine) -> tuple[object, ...]:
    """What tells one possible station from another, but for times."""
    step = engine.step
    calls: tuple[object, ...] = ()
    if step is not None:
        left = tuple(engine.outstanding()), tuple(step.told), len(step.sent)
        calls = step.input, left, len(step.arm), step.unseen
    return engine.track.key(), frozenset(engine.timers), calls, engine.odd


def _covers(a: _Supposing, b: _Supposing) -> bool:
    """Whether ``a``, which differs from ``b`` in its times only, may do all that ``b`` may, and
    supposes no more."""
    one, other = a.step, b.step
    if one and other and (one.since_ms > other.since_ms or one.t_ms < other.t_ms):
        return False
    return (
        a.since_ms <= b.since_ms
        and len(_common(a.supposed, b.supposed)) == len(a.supposed)
        and all(_lasts(a.timers[key], d) for key, d in b.timers.items())
    )


def _lasts(a: Deadline, b: Deadline) -> bool:
    """Whether ``a`` allows all that ``b`` does."""
    return a.first <= b.first and (a.last is None or (b.last is not None and b.last <= a.last))


def _merge(engines: dict[tuple[object, ...], _Supposing], engine: _Supposing) -> None:
    """Of two that differ in their times only, one remains that may be either."""
    other = engines.setdefault(_kind(engine), engine)
    if other is engine:
        return
    other.since_ms = min(other.since_ms, engine.since_ms)
    for key, a in other.timers.items():
        b = engine.timers[key]
        last = None if a.last is None or b.last is None else max(a.last, b.last)
        other.timers[key] = a._replace(first=min(a.first, b.first), last=last)
    if other.step is not None and engine.step is not None:
        other.step.since_ms = min(other.step.since_ms, engine.step.since_ms)
        other.step.t_ms = max(other.step.t_ms, engine.step.t_ms)
    other.supposed = _common(other.supposed, engine.supposed)


def _common(a: tuple[Supposition, ...], b: tuple[Supposition, ...]) -> tuple[Supposition, ...]:
    """What both suppose."""
    if a == b:
        return a
    found, left = [], list(b)
    for one in a:
        other = next((x for x in left if x.what == one.what), None)
        if other is not None:
            left.remove(other)
            lines = min(one.after, other.after), max(one.before, other.before)
            found.append(Supposition(one.what, *lines))
    return tuple(found)


def _rank(d: Diverges, engine: _Supposing) -> tuple[float, int]:
    """How little of the log a station explains: a timer that is late, or the fields of a message
    in another form; more if the event is not called for and something else is lacking; without
    end if nothing is.  An unseen restart counts too."""
    wanted = d.finding.expected
    lacks = 0 if wanted in ((), (NOTHING,)) else len(wanted)
    restarts = sum(one.what == "restart" for one in engine.supposed)
    if isinstance(d, Late):
        return 1 + restarts, 0
    if d.off:
        return d.off + restarts, 0
    return (3 + restarts, lacks) if lacks else (inf, 0)


def _is_cam(event: Event) -> bool:
    return (
        isinstance(event, Send | Receive)
        and event.message is not None
        and event.message["type"] == "CAM"
    )


def _shows(answer: Answer, event: Event) -> bool:
    """Whether an event may be what follows an input."""
    outcome = answer.outcome
    match event:
        case Send(message=m):
            of = m.get("of")
            acked = of.get("type") if isinstance(of, dict) else "none"
            return any((x.type, x.of[0]) == (m["type"], acked) for x in outcome.out)
        case ApplicationIndication(indication=told) if told.name != "discarded":
            return outcome.told[0] == told.name
        case TimerArm(timer=timer):
            return any(one[0] == timer.name for one in outcome.arm)
        case TimerEnd(op="stop", timer=timer):
            return any(one[0] == timer.name for one in outcome.stop)
    return False


def _words(i: Input) -> str:
    match i.kind:
        case "receive":
            return f"receive {i.message.type}"
        case "command":
            return f"command {i.name}"
        case "expire":
            return f"expire {i.timer[0]}"
    return i.kind
