"""One station, sans-IO: no socket, no clock, no thread.

Every entry point takes ``now`` (integer milliseconds, never going back) and returns what
happened, in order: due timers first, then the input itself (docs/protocol.md, section 3).
The rules decide (rules.py); this file keeps the clock of the armed timers.
"""

from __future__ import annotations

import random
from collections.abc import Callable, Mapping
from functools import lru_cache
from typing import NamedTuple

from automcm.core.outcome import Expiry, Heard, Input, Me, Outcome, Restart, Rules
from automcm.core.rules import RULES, decide
from automcm.core.state import LEASE, State, Timer, armed
from automcm_spec.vocabulary.application import Accepted, Command, Discarded, Indication
from automcm_spec.vocabulary.messages import (
    Advertisement,
    Cam,
    Message,
    MessageError,
    Trajectory,
    decode,
)
from automcm_spec.vocabulary.parameters import (
    Known,
    Parameters,
    durations,
    forgotten_at,
    lease_lasts,
    rank,
)

Plan = Callable[[Advertisement], Trajectory | None]
"""The application's predicate "concerned" (ADV-3): what it would drive, or None."""
Decode = Callable[[bytes], Message | Cam]
"""A codec's decoder; raises MessageError."""


DEFAULT = Parameters()


@lru_cache
def _times(p: Parameters) -> tuple[Known, Mapping[str, int | None]]:
    """All parameters by name, and how long timers last; stations of equal ones share both."""
    return p.known, durations(p.known)


def unconcerned(advertisement: Advertisement) -> Trajectory | None:
    """A plan that joins nothing."""
    return None


class Effects(NamedTuple):
    """What one input did at ``now_ms``.

    ``input`` is None for bytes that are no message.  ``armed`` holds the timers armed (or armed
    anew) with their deadlines in ms, ``stopped`` those stopped before they expired.
    """

    now_ms: int
    input: Input | None
    rule: str
    state: State
    """After the input."""
    messages: tuple[Message, ...] = ()
    indications: tuple[Indication, ...] = ()
    armed: tuple[tuple[Timer, int], ...] = ()
    stopped: tuple[Timer, ...] = ()


class Station:
    """A station that can be a prescriber in one session and a receiver in another.

    ``number`` is the last session number it has used, kept over a restart (END-8); a station
    that comes back calls ``restart`` at once.  ``seed`` feeds the back-off (END-7).
    """

    def __init__(
        self,
        station_id: int,
        parameters: Parameters | None = None,
        *,
        plan: Plan = unconcerned,
        number: int = 0,
        seed: int = 0,
        rules: Rules = RULES,
        decode: Decode = decode,
    ) -> None:
        self.parameters = p = parameters or DEFAULT
        self.me = Me(station_id, p.max_rounds, p.max_participants, p.outbox_limit, p.memory_limit)
        self.state = State(number=number)
        self.timers: dict[Timer, int] = {}
        """Deadline in ms of each armed timer, older before younger."""
        self.durations: Mapping[str, int] = {}
        """How long timers of a name last, in ms, instead of what the parameters say.  It counts
        from the next arming on; for the conformance kit."""
        self._times = _times(p)
        self._plan = plan
        self._rules = rules
        self._decode = decode
        self._random = random.Random(seed)
        self._joined_at: dict[int, int] = {}
        self._now = 0

    @property
    def station_id(self) -> int:
        """Its own id."""
        return self.me.station_id

    def next_deadline(self) -> int | None:
        """When ``advance`` is to be called at the latest, in ms; None if no timer runs."""
        return min(self.timers.values(), default=None)

    def advance(self, now: int) -> list[Effects]:
        """Fire what is due.  Raises ValueError if time goes back."""
        if now < self._now:
            raise ValueError(f"time goes back: {now} ms after {self._now} ms")
        self._now = now
        effects: list[Effects] = []
        while self.timers and min(self.timers.values()) <= now:
            effects.append(self._step(Expiry(self._first()), now))
        return effects

    def receive(self, message: Message | Cam | bytes, now: int) -> list[Effects]:
        """A message, a CAM, or bytes from the radio; bytes that are no message are END-5."""
        effects = self.advance(now)
        if isinstance(message, bytes):
            try:
                message = self._decode(message)
            except MessageError as error:
                told = Discarded(detail=str(error))
                effects.append(Effects(now, None, "END-5", self.state, indications=(told,)))
                return effects
        i = message if isinstance(message, Cam) else self._heard(message)
        effects.append(self._step(i, now))
        return effects

    def command(self, command: Command, now: int) -> list[Effects]:
        """A command of the application; one that no rule provides for is refused (CMD-1)."""
        return [*self.advance(now), self._step(command, now)]

    def restart(self, now: int) -> list[Effects]:
        """Come back remembering no session (END-8).  What was due before is lost as well."""
        if now < self._now:
            raise ValueError(f"time goes back: {now} ms after {self._now} ms")
        self._now = now
        return [self._step(Restart(), now)]

    def _heard(self, message: Message) -> Heard[Message]:
        plan = None
        if isinstance(message, Advertisement) and message.src != self.station_id:
            plan = self._plan(message)
        return Heard(message, plan)

    def _first(self) -> Timer:
        """The timer that fires next: by deadline, then by rank, then that of the older message."""

        def turn(timer: Timer) -> tuple[int, int]:
            advertises = timer.entry is not None and timer.entry.type == "Advertisement"
            return self.timers[timer], rank(timer.name, advertises)

        return min(armed(self.station_id, self.state), key=turn)

    def _step(self, i: Input, now: int) -> Effects:
        before = self.state
        rule, outcome = decide(self.me, before, i, self._rules)
        self.state, messages, told, again = outcome
        newly: tuple[tuple[Timer, int], ...] = ()
        stopped: tuple[Timer, ...] = ()
        if self.state is not before or again or isinstance(i, Expiry):
            newly, stopped = self._rearm(before, outcome, i, now)
        if isinstance(told, Accepted):  # only here is a clock
            left = self.timers[LEASE] - now
            told = told.model_copy(update={"lease_left_ms": left})
        indications = () if told is None else (told,)
        return Effects(now, i, rule, self.state, messages, indications, newly, stopped)

    def _rearm(
        self, before: State, outcome: Outcome, i: Input, now: int
    ) -> tuple[tuple[tuple[Timer, int], ...], tuple[Timer, ...]]:
        """Arm and stop timers so that those of the new state run."""
        expired = i.timer if isinstance(i, Expiry) else None
        if expired is not None:
            self.timers.pop(expired, None)
        if outcome.state.joined is not before.joined:
            self._joined_at = {
                p: self._joined_at.get(p, now) if before.joined.get(p) == number else now
                for p, number in outcome.state.joined.items()
            }
        timers = self.timers
        running = armed(self.station_id, outcome.state)
        stopped = [timer for timer in timers if timer not in running]
        for timer in stopped:
            del timers[timer]
        for timer in outcome.again:
            timers.pop(timer, None)
        newly = []
        for timer in running:
            if timer not in timers:
                timers[timer] = deadline = now + self._duration(timer, now)
                newly.append((timer, deadline))
        return tuple(newly), tuple(stopped)

    def _duration(self, timer: Timer, now: int) -> int:
        p, name = self.parameters, timer.name
        if name == "lease":
            return lease_lasts(p.clock_drift, self.state.role, self.state.lease_ms)
        if name in self.durations:
            return self.durations[name]
        if name == "backoff":
            return self._random.randint(p.backoff_min, p.backoff_max)
        known, lasting = self._times
        if name == "forget":
            return forgotten_at(known, self._joined_at.get(timer.station, now), now) - now
        lasts = lasting[name]
        assert lasts is not None, f"no formula: {name}"
        return lasts
