"""Checks an incomplete log by tracking every state of the specification that it allows.

Events of a kind that the log does not promise (``complete``) may have happened unobserved. So
before each event, every unpromised input is supposed that changes the station or would explain the
event, repeatedly. States that do not allow the event are dropped. If none is left, the log
diverges, whatever happened unobserved. A log must promise all sent messages: they are what the
protocol judges, and they limit the possible unobserved inputs.

An unobserved input cannot come after a timer that should have expired long before. That expiry with
all its effects must be supposed first. A restart is the exception: it loses all timers (END-8).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import reduce
from math import inf

from automcm_spec.log_format.log import ApplicationIndication, Event, Header, Timer
from automcm_spec.vocabulary.rules import kind
from automcm_spec.vocabulary.station import Input
from automcm_traces.checker.engine import NOTHING, Deadline, Engine
from automcm_traces.checker.finding import Diverges, Late, Supposition
from automcm_traces.checker.input_alphabet import LOGGED_AS, effect_of, unseen
from automcm_traces.checker.track import CannotTell, SpecInput, Track, short

CHAIN = 8
"""The maximum number of consecutive unobserved inputs before one event."""
MOST = 300
"""The maximum number of states tracked at once; above it, finding no state proves nothing."""
Refused = list[tuple[tuple[float, int], Diverges]]
"""The divergences of the tracked states from an event, each with its rank."""


class _Supposing(Engine):
    """One state that the log allows, with the unobserved events it supposes."""

    supposed: tuple[Supposition, ...] = ()
    restarts = 0
    """The number of restarts among ``supposed``."""

    def suppose(self, i: Input, at: int, after: int, until_ms: int) -> None:
        """Suppose an unobserved input after line ``after`` and before the event of line ``at`` at
        ``until_ms``.

        The effects of the previous input must be complete.
        """
        own = self.track.named([], i.timer) if i.kind == "expire" else None
        if own is not None:
            self.since_ms = max(self.since_ms, self.timers[own].first)
        if i.kind != "restart":  # a restart loses timers that were due before (END-8)
            due = [d.last + self._late_ms for d in self.timers.values() if d.last is not None]
            until_ms = min([until_ms, *due])
        if own is not None:
            del self.timers[own]
        question = SpecInput(i, f"{kind(i)}, not logged")
        step = self._begin_step(at, until_ms, None, question)
        step.since_ms, step.unseen = self.since_ms, True
        if i.kind == "restart" or (i.kind == "expire" and step.indication[0] == "fallback"):
            what = "restart" if i.kind == "restart" else short(i.timer)
            self.supposed = (*self.supposed, Supposition(what, after, at))
            self.restarts += what == "restart"

    def key(self) -> tuple[object, ...]:
        """A value that distinguishes possible states, except for their times."""
        step = self.step
        calls: tuple[object, ...] = ()
        if step is not None:
            left = tuple(self.outstanding()), tuple(step.indications), len(step.sent)
            calls = step.input, left, len(step.arm), step.unseen
        return self.track.key(), frozenset(self.timers), calls, self.malformed

    def covers(self, other: _Supposing) -> bool:
        """Whether this state, which differs from another only in times, allows all that the other
        allows and supposes no more."""
        a, b = self.step, other.step
        if a and b and (a.since_ms > b.since_ms or a.t_ms < b.t_ms):
            return False
        return (
            self.since_ms <= other.since_ms
            and len(_common(self.supposed, other.supposed)) == len(self.supposed)
            and all(_lasts(self.timers[key], d) for key, d in other.timers.items())
        )

    def rank(self, d: Diverges) -> tuple[float, int]:
        """How little of the log this state explains; lower is better.

        A late timer, or a message in another form, ranks by its differences. An event that no input
        calls for ranks behind, by the number of missing effects, and last if none is missing. Each
        supposed restart adds to the rank.
        """
        wanted = d.finding.expected
        lacks = 0 if wanted in ((), (NOTHING,)) else len(wanted)
        restarts = self.restarts
        if isinstance(d, Late):
            return 1 + restarts, 0
        if d.mismatch:
            return d.mismatch + restarts, 0
        return (3 + restarts, lacks) if lacks else (inf, 0)


class Possible:
    """All states that the log allows so far. Replaces Engine for logs that promise less."""

    def __init__(self, header: Header, late_ms: int | None = None) -> None:
        first = _Supposing(header, late_ms)
        if "send" not in first.promised:
            raise CannotTell('`complete` in the header lacks "send": sent messages may be missing')
        self._promised = first.promised
        self._engines: list[_Supposing] = [first]
        self._after = 1
        """The line of the last event other than a CAM; unobserved inputs happened later."""
        self._given_up = ""
        self._missed: dict[str, str] = {}
        """By type of message, the last copy without which a state went on no further."""

    @property
    def states(self) -> int:
        """The number of different states that are possible now."""
        return len({engine.track.key() for engine in self._engines})

    @property
    def track(self) -> Track:
        """The state that needs the fewest unobserved inputs."""
        return self._engines[0].track

    @property
    def only_if(self) -> tuple[Supposition, ...]:
        """The unobserved events that all possible states suppose."""
        return reduce(_common, (engine.supposed for engine in self._engines))

    @property
    def timers(self) -> set[Timer]:
        """The timers that may be armed."""
        return {timer for engine in self._engines for timer in engine.timers}

    @property
    def since_ms(self) -> int:
        """The time of the last event other than a CAM; unobserved inputs happened later."""
        return min(engine.since_ms for engine in self._engines)

    @since_ms.setter
    def since_ms(self, since_ms: int) -> None:
        for engine in self._engines:
            engine.since_ms = since_ms

    def feed(self, at: int, event: Event) -> None:
        """Check the next event. Raises the exceptions of Engine.feed; Diverges only if no
        unobserved input would explain the event."""
        search = _Search(at, event, self._after, self._promised)
        layer = self._engines
        for _ in range(CHAIN + 1):
            layer = [supposing for engine in layer for supposing in search.goes_on(engine)]
            if not layer or search.number > MOST:
                break
        if layer:
            search.given_up = "too many events are missing from the log"
        self._given_up = search.given_up or self._given_up
        if not search.taken:
            raise self._nearest(search.refused)
        for _, d in search.refused:
            if isinstance(d, Late) and d.message:
                self._missed[d.message] = f"is a copy missing? {d.finding.observed}"
        self._engines = list(search.taken.values())
        if not event.is_cam:
            self._after = at

    def finish(self) -> None:
        """End the last step in all states."""
        refused: Refused = []
        left = []
        for engine in self._engines:
            try:
                engine.finish()
            except Diverges as d:
                refused.append((engine.rank(d), d))
            else:
                left.append(engine)
        if not left:
            raise self._nearest(refused)
        self._engines = left

    def _nearest(self, refused: Refused) -> Exception:
        """The divergence of the state that explains the most, or CannotTell if the search was cut
        short."""
        if self._given_up:
            return CannotTell(self._given_up)
        rank, nearest = min(refused, key=lambda r: r[0])
        match nearest.seen:
            case ("send", {"type": str(type_)}) if rank[0] == inf:
                nearest.missed = self._missed.get(type_, "")
        return nearest


@dataclass
class _Search:
    """The search for all states that allow the event of line ``at``."""

    at: int
    event: Event
    after: int
    """Unobserved inputs happened after this line."""
    promised: frozenset[str]
    taken: dict[tuple[object, ...], _Supposing] = field(default_factory=dict)
    """The states after the event."""
    refused: Refused = field(default_factory=list)
    given_up: str = ""
    """The reason why there may be more states than were found; empty if there are none."""
    number: int = 0
    """The number of states before the event."""
    _seen: dict[tuple[object, ...], list[_Supposing]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self._effect = effect_of(self.event)

    def goes_on(self, engine: _Supposing) -> Iterator[_Supposing]:
        """Try the event, then yield the states that one unobserved input leads to before it.

        If the log promises an effect of that input, that effect must be this event, which is tried
        at once.
        """
        takes = self._try(engine.copy())
        if takes and self.event.is_cam:
            return  # an unobserved input may equally come later
        base = engine.copy()
        try:
            base.finish()
        except Diverges:
            return  # effects of the last input are still missing
        self._is_new(base)
        if not takes and isinstance(self.event, ApplicationIndication):
            self._try(base.copy())  # END-5: of an unobserved message, after the last input
        found = unseen(base.track, self.event, self._effect, self.promised)
        for i, shows, is_logged in found:
            if not self._may_be(i, base, shows):
                continue
            supposing = base.copy()
            supposing.suppose(i, self.at, self.after, self.event.t_ms)
            if not shows:
                supposing.finish()
            if is_logged:
                self._try(supposing)
            elif self._is_new(supposing):
                yield supposing

    def _try(self, engine: _Supposing) -> bool:
        """Whether the engine allows the event."""
        try:
            engine.feed(self.at, self.event)
        except Diverges as d:
            # Its traceback would hold this search, which holds it.
            self.refused.append((engine.rank(d), d.with_traceback(None)))
        except CannotTell as error:
            self.given_up = str(error)
        else:
            _merge(self.taken, engine)
            return True
        return False

    def _may_be(self, i: Input, engine: Engine, shows: bool) -> bool:
        """Whether an input may have happened unobserved; ``shows``: the event may be its effect."""
        if LOGGED_AS.get(i.kind, i.kind) in self.promised:
            return False
        if i.kind == "cam":  # without logged timers, the timer cam is taken to last for ever
            return shows or "timer" in self.promised
        if i.kind != "expire":
            return True
        deadline = engine.timers.get(engine.track.named([], i.timer))
        return deadline is not None and deadline.first <= self.event.t_ms

    def _is_new(self, engine: _Supposing) -> bool:
        """Whether no state seen so far covers this one; records it if so."""
        alike = self._seen.setdefault(engine.key(), [])
        if any(other.covers(engine) for other in alike):
            return False
        alike.append(engine)
        self.number += 1
        return True


def _lasts(a: Deadline, b: Deadline) -> bool:
    """Whether ``a`` allows every expiry that ``b`` allows."""
    return a.first <= b.first and (a.last is None or (b.last is not None and b.last <= a.last))


def _merge(engines: dict[tuple[object, ...], _Supposing], engine: _Supposing) -> None:
    """Add a state; one that differs only in times is merged into the existing one."""
    other = engines.setdefault(engine.key(), engine)
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
    if other.supposed != engine.supposed:
        other.supposed = _common(other.supposed, engine.supposed)
        other.restarts = sum(one.what == "restart" for one in other.supposed)


def _common(a: tuple[Supposition, ...], b: tuple[Supposition, ...]) -> tuple[Supposition, ...]:
    """The suppositions that both have."""
    if a == b:
        return a
    found, left = [], list(b)
    for one in a:
        other = next((x for x in left if x.what == one.what), None)
        if other is not None:
            left.remove(other)
            after = min(one.after_line, other.after_line)
            before = max(one.before_line, other.before_line)
            found.append(Supposition(one.what, after, before))
    return tuple(found)
